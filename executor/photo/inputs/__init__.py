"""What is given: a picture, its depth, its camera, and boxes with names; all of it is checked before it is used."""
