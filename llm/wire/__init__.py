"""How models are reached: servers, profiles, budgets, and recordings of what they answered."""
