"""What a text that cannot be read was meant to be."""
