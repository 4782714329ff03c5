"""Writers that turn episodes into files that robot-learning tools open as they are."""
