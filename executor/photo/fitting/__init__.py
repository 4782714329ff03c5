"""Analysis by synthesis: the models of the library, posed, sized and opened so that they explain what was seen."""
