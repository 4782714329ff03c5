"""What can be wrong with somebody's asset, said so that they can mend it."""

from __future__ import annotations

from pathlib import Path


class ImportRefused(ValueError):
    """An asset cannot be read, or the robot could do nothing with it.

    Attributes:
        path: The file at fault.
        problem: What is wrong with it.
        hint: What to do about it.
    """

    def __init__(self, path: Path, problem: str, hint: str) -> None:
        self.path, self.problem, self.hint = path, problem, hint
        super().__init__(f"{path}: {problem}; {hint}")
