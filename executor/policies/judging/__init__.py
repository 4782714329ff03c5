"""Policies judged: in the same episodes, by the same rules, with everything that failed."""
