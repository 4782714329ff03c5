"""The 21 primitives: what each does to the world, and what it measures."""
