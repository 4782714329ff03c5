"""Object families as data, and how they become bodies in a physics scene."""
