"""`python -m executor` is the command line."""

from __future__ import annotations

from executor.cli.main import main

if __name__ == "__main__":
    main()
