"""Print results on standard output, everything else on standard error.

Much of what is printed was written by others: scenes, tasks, models, benchmarks' folders. All of it goes through here,
and nothing in it steers the terminal.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment

from bddl.terminal import escape_control
from executor.system.files import json_text
from executor.system.progress import OnProgress


class _Terminal(Console):
    """A console on which only the program's own styles and moving lines emit escape sequences."""

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for text, style, control in super().render(renderable, options):
            yield Segment(text if control else escape_control(text), style, control)

    def on_broken_pipe(self) -> None:
        # Rich would end the process with the code of a failure.
        raise BrokenPipeError


# Without emoji=False "vllm:m: no reply" would be shown with a picture in place of ":m:".
OUT = _Terminal(highlight=False, soft_wrap=True, emoji=False)
ERR = _Terminal(stderr=True, highlight=False, soft_wrap=True, emoji=False)

_PACE_EVERY_S = 60.0


def say(text: str, style: str | None = None) -> None:
    """Print a line of the result on standard output."""
    with _standard_output():
        OUT.print(text, style=style, markup=False)


def tell(text: str, style: str | None = None) -> None:
    """Print a line on standard error, such as progress or a warning."""
    ERR.print(text, style=style, markup=False)


def tell_progress(quiet: bool) -> Callable[[str], None]:
    """Return what prints a sentence about the progress in a line on standard error; when quiet, nothing."""
    return (lambda words: None) if quiet else (lambda words: tell(f"  {words}"))


def tell_notes(notes: Iterable[str]) -> None:
    """Print notes about the result on standard error, a line each."""
    for note in notes:
        tell(f"note: {note}")


def tell_warnings(warnings: Iterable[object]) -> None:
    """Print warnings on standard error, a line each."""
    for warning in warnings:
        tell(f"warning: {warning}", style="yellow")


def print_text(text: str) -> None:
    """Print a finished text on standard output, with escapes for what its encoding lacks."""
    encoding = sys.stdout.encoding or "utf-8"
    with _standard_output():
        sys.stdout.write(escape_control(text).encode(encoding, "backslashreplace").decode(encoding))
        sys.stdout.flush()


def print_json(value: object) -> None:
    """Print one JSON object on standard output."""
    print_text(json_text(value) + "\n")


@contextmanager
def counting(what: str, *, quiet: bool = False) -> Iterator[OnProgress]:
    """Provide a function that shows how many of a number of things are done.

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


@contextmanager
def bar(what: str, total: int, *, done: int = 0, quiet: bool = False) -> Iterator[Callable[[int, str], None]]:
    """Provide a function that shows how many things are done, with a note, in a bar; only on a terminal.

    Args:
        what: The first note.
        total: How many things there are.
        done: How many of them were done before.
        quiet: Shows nothing.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=ERR, disable=quiet or not ERR.is_terminal) as progress:
        task = progress.add_task(what, total=total, completed=done)
        yield lambda done, note: progress.update(task, completed=done, description=note)


@contextmanager
def _standard_output() -> Iterator[None]:
    """Name standard output in write errors, such as those of a full disk."""
    try:
        yield
    except OSError as problem:
        if problem.filename is None and problem.errno is not None:
            raise OSError(problem.errno, problem.strerror, "standard output") from problem
        raise


def span_text(seconds: float) -> str:
    """Return a time as people say it: "40 s", "12 min", "3.5 h"."""
    if seconds < 100.0:
        return f"{seconds:.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 6000.0 else f"{seconds / 3600.0:.1f} h"


class Pace:
    """How fast a run is: a line about it now and then, where no bar shows it.

    Args:
        total: How many things there are.
        done: How many of them were done before.
        quiet: Tells nothing.
    """

    def __init__(self, total: int, done: int = 0, *, quiet: bool = False) -> None:
        self._total, self._before, self._quiet = total, done, quiet
        self._began = self._shown = time.perf_counter()

    def text(self, done: int) -> str:
        """Return how many things are done an hour, and the time that the others take."""
        span_s, here = time.perf_counter() - self._began, done - self._before
        if here <= 0 or span_s <= 0.0:
            return "no rate yet"
        left_s = max(self._total - done, 0) * span_s / here
        return f"{3600.0 * here / span_s:.0f} an hour, {span_text(left_s)} left"

    def note(self, done: int) -> None:
        """Tell how far the run is, if a minute has passed since the last time."""
        if not self._quiet and time.perf_counter() - self._shown >= _PACE_EVERY_S:
            self._shown = time.perf_counter()
            tell(f"  {done} of {self._total}, {self.text(done)}")


def first_line(message: object) -> str:
    """Return the first line of a message, for lists."""
    return str(message).partition("\n")[0]
