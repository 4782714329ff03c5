"""Reconstructions from photographs, and how good they are."""
