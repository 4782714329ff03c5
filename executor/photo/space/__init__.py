"""Where the camera stands in the room: the floor below it, what is vertical, the walls, and how noisy the depth is."""
