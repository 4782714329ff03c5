"""Modules 1 to 5 as questions to a model: for each, the prompt, the check of its answer, and what comes of it."""
