"""What is done with a store beside filling it: looking through it, merging it, describing it."""
