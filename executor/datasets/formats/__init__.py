"""Data sets in the formats that trainers load, folded from a store of episodes."""
