"""Processes that work for this one, and may crash one by one."""
