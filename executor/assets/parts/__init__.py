"""Building blocks that the models share: shapes, cupboards, doors, drawers and handles."""
