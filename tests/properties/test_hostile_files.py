"""Scene and task files with mistakes in them: each ends in a verdict or a typed error, in bounded time."""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.hostile_files import Mutant, mutant, mutants
from tests.hostile_reading import read_through, typed

# Nothing here takes a second; what takes this long hangs.
MOST_SECONDS = 20
FIRST, BLOCK = 120, 70


class _TooSlow(BaseException):
    """Time is up; nothing that catches exceptions stops it."""


@contextmanager
def _time_limit() -> Iterator[None]:
    def stop(*_: object) -> None:
        raise _TooSlow

    before = signal.signal(signal.SIGALRM, stop)
    signal.alarm(MOST_SECONDS)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def _crashes(act: Callable[[Mutant, Path], object], count: int, first: int, folder: Path) -> list[str]:
    """Return what went wrong with each mutant of which something did."""
    found = []
    for each in mutants(count, first):
        try:
            with _time_limit():
                act(each, folder)
        except (Exception, _TooSlow) as problem:
            found.append(f"{type(problem).__name__}: {problem!s:.200} <- {each.label:.300}")
    return found


def test_a_number_draws_the_same_mutant_again() -> None:
    assert [mutant(number) for number in range(50)] == list(mutants(50))
    assert len({mutant(number).label for number in range(50)}) == 50


def test_mutants_come_to_every_kind_of_end(tmp_path: Path) -> None:
    """A fuzzer that only breaks JSON, or breaks nothing, would show nothing."""
    ends = Counter(read_through(each, tmp_path) for each in mutants(FIRST))
    assert {"PROVED", "REFUTED", "SceneError", "TaskError"} <= ends.keys()
    assert max(ends.values()) < 80


@pytest.mark.parametrize("first", range(FIRST, 400, BLOCK))
def test_no_file_crashes_the_library(first: int, tmp_path: Path) -> None:
    assert _crashes(read_through, BLOCK, first, tmp_path) == []


@pytest.mark.slow
def test_no_file_crashes_the_command_line(tmp_path: Path) -> None:
    assert _crashes(typed, 30, 0, tmp_path) == []


@pytest.mark.slow
@pytest.mark.parametrize("first", range(0, 3500, 500))
def test_no_file_of_3500_crashes_the_library(first: int, tmp_path: Path) -> None:
    assert _crashes(read_through, 500, first, tmp_path) == []


@pytest.mark.slow
def test_no_file_of_1000_crashes_the_command_line(tmp_path: Path) -> None:
    assert _crashes(typed, 1000, 100_000, tmp_path) == []
