"""Look at what was made: runs, stores, benchmarks, evaluations, exported sets and scenes as one local page."""
