"""How the robot gets there: stances, grasps, places, paths, and the ways of doors."""
