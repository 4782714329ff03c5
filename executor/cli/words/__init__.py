"""What can be typed: one class a sub-command, whose docstrings are the help."""
