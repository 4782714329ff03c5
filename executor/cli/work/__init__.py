"""What several sub-commands share between their options and their results."""
