"""The usual slips of language models in BDDL text: their labels, and texts put right."""
