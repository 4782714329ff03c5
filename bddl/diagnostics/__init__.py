"""Mistakes beyond grammar and names: what is suspicious in a legal text, and what a wrong one was meant to be."""
