"""What the primitives need and write, what excludes what, and what is known at the start."""
