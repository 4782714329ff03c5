"""The slips that language models make when they write BDDL: their labels, and texts put right."""
