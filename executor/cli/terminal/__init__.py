"""What the command line prints: words, progress, summaries, errors and exit codes."""
