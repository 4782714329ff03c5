"""Self-evolution: flows that fail are revised and tried again (the paper's Algorithm 1)."""
