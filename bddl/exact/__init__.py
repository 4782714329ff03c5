"""Satisfiability of ground formulas by z3, which is loaded when it is first asked."""
