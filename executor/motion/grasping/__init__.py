"""Where and how the hand can take a thing."""
