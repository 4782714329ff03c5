"""Truth of formulas in states: known in part, complete, or many at once."""
