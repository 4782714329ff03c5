"""The robot: its description, how it is loaded, and its kinematics."""
