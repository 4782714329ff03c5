"""Opening and closing: which door, by which motion, from which stance."""
