"""What a self-evolution records, and which revisions it may run."""
