"""A scene in the physics engine, what its detectors read, and what the robot believes of it."""
