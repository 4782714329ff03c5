"""What commands that execute plans share: ranges of options, the task, progress, and the summary on one screen."""

from __future__ import annotations

import shlex
import textwrap
from collections.abc import Collection, Iterator
from dataclasses import fields, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import get_args, get_type_hints

import tyro
from rich.markup import escape
from rich.status import Status

from bddl.terminal import pluralize
from executor.campaign.engine import Shard
from executor.cli.errors import FAILED, check
from executor.cli.inputs import task_and_scene
from executor.cli.options import CommonOptions
from executor.cli.output import ERR, counting, print_json, say, tell, tell_warnings
from executor.records import Event, Rollout, readable
from executor.reports.run_folder import ResultsWriter, RunFolder
from executor.rollouts.evolution_record import Evolution
from executor.rollouts.run_record import RunRecord, evolution_json, rollout_json
from executor.scenes.validation import require_valid
from executor.scenes.vary import LARGEST_SEED, MOST_EPISODES
from oag import Report, Scene, Task
from oag.measurements import GoalReading

LONGEST_LIMIT_S = 604_800.0
"""A week [s]; timers of threads have a largest number."""


def check_unit_limit(limit_s: float) -> None:
    """Refuse a time limit that clocks cannot be set to."""
    good = 0.0 < limit_s <= LONGEST_LIMIT_S
    check(good, "--limit-s", limit_s, f"a number of seconds above 0, at most {LONGEST_LIMIT_S:.0f}")


def read_shard(text: str) -> Shard:
    """Parse a part of a whole, such as 3/8."""
    number, slash, of = text.partition("/")
    good = bool(slash) and number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)
    check(good, "--shard", text, "a part of a whole, such as 1/4 to 4/4")
    return Shard(int(number), int(of))


def check_seed(seed: int, episodes: int = 1) -> None:
    """Refuse seeds that the generators cannot take."""
    check(1 <= episodes <= MOST_EPISODES, "--episodes", episodes, f"a whole number from 1 to {MOST_EPISODES}")
    most = LARGEST_SEED - episodes
    check(0 <= seed <= most, "--seed", seed, f"a whole number from 0 to {most}")


def check_limit(limit: int) -> None:
    """Refuse a negative number of revisions."""
    check(limit >= 0, "--limit", limit, "0 or more")


def check_object(scene: Scene, object_id: str) -> None:
    """Refuse an id that is none of a scene's objects; the error names near ones."""
    _ = scene[object_id]


def check_workers(workers: int) -> None:
    """Refuse fewer than one worker."""
    check(workers >= 1, "--workers", workers, "at least 1")


def task_to_run(task_path: Path, scene: str | None, *, keep_sizes: bool) -> tuple[Task, Scene]:
    """Return a task file's task and its scene, all of whose objects can be built.

    Args:
        task_path: The task's file.
        scene: Name or file of the scene; by default it lies in the task's folder.
        keep_sizes: Whether the task's factors are left out, so that everything keeps its size.
    """
    task, found = task_and_scene(task_path, scene)
    tell_warnings(require_valid(found))
    return replace(task, scales={}) if keep_sizes else task, found


def refuse(report: Report, *, as_json: bool) -> int:
    """Print why a plan is not executed, and return the exit code."""
    if as_json:
        print_json({"ok": False, "exit_code": FAILED, **report.to_json()})
    else:
        say(str(report))
        tell(f"scene2demo: the plan is {report.verdict.value.lower()}, not proved; nothing was moved", style="red")
    return FAILED


def results_writer(size: tuple[int, int], *, video: bool, quiet: bool, plain: bool = False) -> ResultsWriter:
    """Return what draws, encodes and writes the results of a command's run, with its progress on the terminal."""
    return ResultsWriter(video, size, partial(counting, quiet=quiet), partial(tell, style="yellow"), plain)


def command_line(command: str, *given: object, **options: object) -> str:
    """Return a command line, quoted for a shell, such as the one that repeats a run.

    Args:
        command: The sub-command.
        given: What is typed without an option's name.
        options: Values by the options' names: True stands for a flag, a tuple for several words, a list for an option
            that is given several times; what is None or False is not typed.
    """
    words = ["scene2demo", *command.split(), *map(str, given)]
    for name, value in options.items():
        for one in value if isinstance(value, list) else [value]:
            if one is None or one is False:
                continue
            words.append(f"--{name.replace('_', '-')}")
            words += [] if one is True else map(str, one) if isinstance(one, tuple) else [str(one)]
    return shlex.join(words)


def typed_command(command: str, options: CommonOptions, positional: str, without: Collection[str] = ()) -> str:
    """Return the command line that gives these options, such as the one that repeats a run.

    Args:
        command: The sub-command.
        options: Its options.
        positional: Name of the field that is typed without a name.
        without: Names of fields to leave out, besides those of output, of going on, and of budgets.
    """
    return shlex.join(["scene2demo", *command.split(), *option_words(options, positional, {*_LEFT_OUT, *without})])


_LEFT_OUT = ("json", "debug", "force", "resume", "max_tokens", "max_cost_usd", "max_time_s")


def option_words(options: object, positional: str = "", without: Collection[str] = ()) -> Iterator[str]:
    """Yield the words that give some options: the positional one, and by name all that are not at their defaults."""
    if positional:
        value = getattr(options, positional)
        yield from map(str, value if isinstance(value, tuple) else (value,))
    hints = get_type_hints(type(options), include_extras=True)
    for field in fields(options):  # type: ignore[arg-type]
        value = getattr(options, field.name)
        if field.name in (*without, positional) or value == field.default:
            continue
        name = f"--{field.name.replace('_', '-')}"
        if is_dataclass(value):
            yield from option_words(value, without=without)
        elif isinstance(value, bool):
            yield f"--no-{name[2:]}" if field.default is True else name
        elif tyro.conf.UseAppendAction in get_args(hints[field.name]):
            yield from (word for one in value for word in (name, str(one)))
        else:
            words = [*map(str, value if isinstance(value, tuple) else (value,))]
            # A separate word that begins with two dashes would be read as an option.
            yield from (f"{name}={words[0]}",) if len(words) == 1 and words[0].startswith("--") else (name, *words)


class RolloutProgress:
    """Listener of a rollout that shows its progress.

    Args:
        quiet: Shows nothing.
    """

    def __init__(self, *, quiet: bool = False) -> None:
        self._quiet = quiet
        self._status: Status | None = None
        self._subtask = ""

    def __enter__(self) -> RolloutProgress:
        if not self._quiet and ERR.is_terminal:
            self._status = ERR.status("starting the physics")
            self._status.start()
        return self

    def __exit__(self, *exception: object) -> None:
        if self._status is not None:
            self._status.stop()

    def __call__(self, event: Event) -> None:
        """Show one event."""
        if self._quiet:
            return
        if event.kind == "subtask-start":
            self._subtask = f"{event.subtask + 1}/{event.subtask_count} {readable(event.name)}"
            if self._status is None:
                tell(f"  {self._subtask}")
            else:
                self._status.update(escape(self._subtask))
        elif event.kind == "step-start":
            if self._status is not None:
                self._status.update(f"{escape(self._subtask)}: {event.name} ({event.simulated_s:.1f} s simulated)")
        elif event.kind == "revision":
            if self._status is None:
                tell(f"  back to {event.simulated_s:.1f} s: {event.message}")
            else:
                back_to = f"[yellow]back to {event.simulated_s:.1f} s[/]"
                ERR.print(f"  {back_to} {escape(self._subtask)}  {escape(event.message)}")
        elif event.kind == "step-end":
            if self._status is None:
                mark = "failed" if event.message else "done"
                tell(f"    {event.step + 1:2} {event.name:20} {mark:6} at {event.simulated_s:6.1f} s  {event.message}")
        elif self._status is not None:
            mark = "[red]failed[/]" if event.message else "[green]done[/]  "
            at = f"[dim]at {event.simulated_s:.1f} s[/]"
            ERR.print(f"  {mark} {escape(self._subtask)}  {at} {escape(event.message)}")


WIDTH, HEIGHT = 80, 24
_MOST_SUBTASKS = 9  # So that the summary fits the screen with all its other lines.
_OUTCOMES = {
    "succeeded": ("SUCCEEDED", "bold green"),
    "failed": ("FAILED", "bold red"),
    "interrupted": ("INTERRUPTED", "bold yellow"),
    "not-run": ("NOT RUN", "bold yellow"),
}


def print_summary(record: RunRecord, folder: RunFolder) -> None:
    """Print the summary of a run; it fits a terminal of 80 x 24."""
    for text, style in summary_lines(record, folder):
        say(text, style=style)


def summary_lines(record: RunRecord, folder: RunFolder) -> Iterator[tuple[str, str | None]]:
    """Yield the lines of the summary with their styles."""
    rollout = record.rollout
    words, style = _OUTCOMES[record.outcome]
    yield _cut(f"{record.report.verdict.value:11} {record.query or readable(record.graph.task.name)}"), "bold"
    if rollout is None:
        yield f"{words:11} nothing was moved", style
        if record.feasibility is not None and not record.feasibility:
            word = "infeasible" if record.feasibility.decided else "no answer"
            yield from ((line, "red") for line in _rows(word, record.feasibility.reason)[:4])
    else:
        reached = sum(subtask.succeeded for subtask in rollout.subtasks)
        total = len(rollout.task.subtasks)
        yield f"{words:11} {reached} of {pluralize(total, 'subtask')}, {rollout.simulated_s:.1f} s simulated", style
        yield from ((line, None) for line in _subtasks(rollout))
        for note in rollout.detour_notes:
            yield from ((line, "yellow") for line in _rows("detour", note)[:3])
        if record.evolution is not None:
            yield from ((line, None) for line in _rows("evolved", _evolved(record.evolution))[:2])
        if rollout.goal_readings:
            yield from ((line, None) for line in _rows("goal", "  ".join(map(_reading, rollout.goal_readings))))
        yield from ((line, "yellow") for line in _scaled(record))
        failure = rollout.failure
        if failure is not None:
            yield from ((line, "red") for line in _rows("because", failure.message)[:3])
        if record.stopped:
            yield from ((line, "red") for line in _rows("stopped", record.stopped)[:2])
    if record.spending is not None:
        yield from ((line, None) for line in _rows("model", record.spending.total())[:3])
    times = ", ".join(f"{part} {seconds:.1f} s" for part, seconds in record.wall_s.items())
    if times:
        yield from ((line, None) for line in _rows("wall time", times))
    if record.pictures and not folder.video.exists():
        yield from ((line, "yellow") for line in _rows("no pictures", record.pictures)[:5])
    yield from ((line, None) for line in _rows("results", f"{folder.path}: {', '.join(folder.written())}"))
    if rollout is not None and rollout.state_hash:
        yield f"{'state hash':11} {rollout.state_hash}", None


def summary_json(record: RunRecord, folder: RunFolder | None) -> dict[str, object]:
    """Return the summary, and more, as plain data."""
    rollout = record.rollout
    return {
        "ok": record.outcome == "succeeded",
        "outcome": record.outcome,
        "query": record.query,
        "verdict": record.report.verdict.value,
        "diagnostics": [finding.to_json() for finding in record.report.diagnostics],
        "feasibility": None if record.feasibility is None else record.feasibility.to_json(),
        "notes": list(record.notes),
        "rollout": None if rollout is None else rollout_json(rollout),
        "usage": None if record.spending is None else record.spending.to_json(),
        "stopped": record.stopped,
        "evolution": None if record.evolution is None else evolution_json(record.evolution),
        "pictures": record.pictures,
        "wall_s": dict(record.wall_s),
        "out": None if folder is None else str(folder.path),
        "files": [] if folder is None else list(folder.written()),
    }


def _evolved(evolution: Evolution) -> str:
    """Return how many revisions each subtask took."""
    revised = [(story.history.subtask + 1, story.revisions) for story in evolution.stories if story.revisions]
    if not revised:
        return "no revision was needed" if evolution.succeeded else "no revision was made"
    parts = [f"{count} in subtask {number}" for number, count in revised]
    return f"{pluralize(evolution.revisions, 'revision')}: {', '.join(parts)}"


def _subtasks(rollout: Rollout) -> Iterator[str]:
    """Yield one line a subtask; the middle of a very long task is left out."""
    records = {record.index: record for record in rollout.subtasks}
    lines = []
    for index, subtask in enumerate(rollout.task.subtasks):
        record = records.get(index)
        name = textwrap.shorten(readable(subtask.name), 44, placeholder="...")
        if record is None:
            lines.append(f"          · {index + 1} {name:44} not run")
            continue
        mark = "✓" if record.succeeded else "✗"
        done = sum(step.failure is None for step in record.steps)
        steps = f"{done:2}/{pluralize(len(record.flow), 'step')}"
        seconds = record.steps[-1].end_s - record.steps[0].start_s if record.steps else 0.0
        lines.append(f"          {mark} {index + 1} {name:44} {steps:11} {seconds:5.1f} s")
    if len(lines) > _MOST_SUBTASKS:
        left_out = len(lines) - _MOST_SUBTASKS + 1
        lines[_MOST_SUBTASKS // 2 : _MOST_SUBTASKS // 2 + left_out] = [f"          … {left_out} more"]
    yield from lines


def _scaled(record: RunRecord) -> list[str]:
    """Return which things were handled at another size, on two lines at most."""
    words = ", ".join(f"{change.object_id} by {change.by}" for change in record.sizes)
    return _rows("scaled", words)[:2] if words else []


def _reading(reading: GoalReading) -> str:
    literal = reading.literal if reading.wanted else f"(not {reading.literal})"
    return f"{'✓' if reading.satisfied else '✗'} {literal}"


def _rows(head: str, text: str) -> list[str]:
    """Return text wrapped to the screen, with a label before its first line."""
    lines = textwrap.wrap(" ".join(text.split()), WIDTH - 12, break_on_hyphens=False) or [""]
    return [f"{head if index == 0 else '':11} {line}" for index, line in enumerate(lines)]


def _cut(line: str) -> str:
    return line if len(line) <= WIDTH else line[: WIDTH - 3] + "..."
