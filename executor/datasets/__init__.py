"""Demonstrations in numbers: units to generate, a store of finished episodes, and data sets made of it."""
