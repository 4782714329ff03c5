"""Cameras, drawing, and films."""
