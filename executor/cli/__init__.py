"""The command line `scene2demo`."""
