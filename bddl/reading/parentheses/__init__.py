"""Texts whose parentheses do not match: where they are wrong, and the words with that put right."""
