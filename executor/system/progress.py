"""Tell a caller how far a long computation is."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

OnProgress: TypeAlias = Callable[[int, int], None]
"""Called with the numbers of finished and of all things; from any thread, but never twice at once."""


def ignore_progress(done: int, total: int) -> None:
    """Show nothing."""
