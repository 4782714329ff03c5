"""How many of a number of things are done, live on standard error: a moving line on a terminal, one line elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from executor.cli.terminal.output import ERR, tell

Progress = Callable[[int, int], None]


@contextmanager
def counting(what: str, *, quiet: bool = False) -> Iterator[Progress]:
    """Gives a function that is told how many of a number of things are done, and shows it.

    Args:
        what: What is counted, such as "drawing pictures".
        quiet: Shows nothing.
    """
    if quiet:
        yield lambda done, total: None
    elif ERR.is_terminal:
        with ERR.status(what) as status:
            yield lambda done, total: status.update(f"{what}: {done} of {total}")
    else:
        tell(f"  {what}")
        yield lambda done, total: None
