"""What is given: a picture, its depth, its camera, and boxes with names; nothing of it is trusted before it is checked."""
