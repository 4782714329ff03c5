"""Free ways: the collision oracle, paths, and the planner of base and arm."""
