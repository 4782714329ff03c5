"""Where a held thing can be put down."""
