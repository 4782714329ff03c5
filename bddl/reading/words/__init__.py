"""From text to words and nested forms."""
