"""From text to formulas, problems and domains; every mistake on the way is reported with its place."""
