"""What a policy sees, in numbers; and what it would see in a mirror."""
