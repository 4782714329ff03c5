"""Typed records of what happened, in the order in which it does: events, steps, rollouts, failures."""
