"""How far a goal is reached, and the cheapest ways to reach it."""
