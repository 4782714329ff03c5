"""From nested forms to formulas."""
