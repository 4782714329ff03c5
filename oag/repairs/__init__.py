"""Small changes to a refuted plan, each verified before it is offered."""
