"""Exact decisions about plans, over every start state that agrees with what is known."""
