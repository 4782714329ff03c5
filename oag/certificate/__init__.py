"""Certificates of verdicts: written, and checked again from their text."""
