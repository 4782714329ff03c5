"""Commands that make data sets and work with them."""
