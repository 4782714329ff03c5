"""What can be typed to the sub-commands, and checks that types cannot express."""
