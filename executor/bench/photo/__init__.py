"""How good reconstructions from photographs are: known rooms, drawn, spoilt like true pictures, and compared."""
