"""Tasks: read, named, checked for form, and edited."""
