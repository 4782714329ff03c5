"""A plan followed through what is known, obligation by obligation."""
