"""The planner that needs no model: a lexicon and a grammar for queries, and the modules in their fixed order."""
