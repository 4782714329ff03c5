"""Where the base can stand for a pose of the hand."""
