"""The whole room: what is known of it at any time, and how one thing after the other is fitted among that."""
