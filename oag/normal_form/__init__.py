"""One form for all the ways in which one decomposition can be written down."""
