"""What is suspicious about a text that can be read."""
