"""How far a benchmark is, live on standard error: a bar with the success count, or one line a unit elsewhere."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeRemainingColumn

from bddl.visible import counted
from executor.bench.store import BenchFolder
from executor.bench.units import Series, Unit
from executor.cli.terminal.output import ERR, tell


class BenchProgress:
    """Shows the units as they end.

    Args:
        folder: Where results are kept; what is done already counts.
        asked: The series that are run.
        remaining: How many units are still to be run here.
        quiet: Shows nothing.
    """

    def __init__(self, folder: BenchFolder, asked: Sequence[Series], remaining: int, *, quiet: bool = False) -> None:
        self._quiet = quiet
        self._total = sum(series.episodes for series in asked)
        self._remaining = remaining
        self._endings: Counter[str] = Counter()
        if not quiet:
            done = (result for series in asked for result in folder.results(series))
            self._endings.update(result["ended"] for result in done)
        self._progress: Progress | None = None
        self._task: TaskID | None = None

    def __enter__(self) -> BenchProgress:
        if self._quiet:
            return self
        if done := sum(self._endings.values()):
            tell(f"  {done} of {counted(self._total, 'unit')} done already, {self._remaining} to run now")
        if ERR.is_terminal and self._remaining:
            columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
            self._progress = Progress(*columns, console=ERR)
            self._task = self._progress.add_task(self._counts(), total=self._total, completed=done)
            self._progress.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._progress is not None:
            self._progress.stop()

    def told(self, unit: Unit, result: Mapping[str, Any]) -> None:
        """Shows one unit's ending."""
        self._endings[result["ended"]] += 1
        if self._quiet:
            return
        failure = result.get("failure") or {}
        words = "succeeded" if result["ended"] == "succeeded" else f"{failure.get('kind')}: {failure.get('message')}"
        line = f"  {unit.name:28} {result['elapsed_s']:6.1f} s  {words}"
        if self._progress is None or self._task is None:
            tell(line)
            return
        if result["ended"] != "succeeded":
            self._progress.console.print(f"[red]{escape(line)}[/]")
        self._progress.update(self._task, advance=1, description=self._counts())

    def _counts(self) -> str:
        done = sum(self._endings.values())
        return f"{self._endings['succeeded']} of {done} succeeded"
