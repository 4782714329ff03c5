"""One subtask in a world: the robot's drives, the monitors that watch them, and what primitives share."""
