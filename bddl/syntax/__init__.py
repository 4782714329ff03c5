"""The syntax tree of formulas, problems and domains, and what is known of words, dialects and mistakes."""
