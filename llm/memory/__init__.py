"""Skill memory: corrections that worked, kept as readable notes, and found again when something similar fails.

Source: the paper's future work. What a note says is data: it is checked when it is read, and a flow that it proposes
has to be admissible like any other.
"""
