"""How good reconstructions from photographs are: rooms that are known, drawn, spoilt like true pictures, and compared."""
