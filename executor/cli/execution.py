"""What commands that execute plans share: checks of options, the task to run, the command line to repeat a run."""

from __future__ import annotations

import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path

from executor.campaign.engine import Shard
from executor.cli.command_options import BenchReplayOptions, RunOptions
from executor.cli.errors import FAILED, check
from executor.cli.inputs import task_and_scene
from executor.cli.output import counting, print_json, say, tell, tell_warnings
from executor.reports.run_folder import ResultsWriter
from executor.scenes.validation import require_valid
from executor.scenes.vary import LARGEST_SEED, MOST_EPISODES
from oag import Report, Scene, Task

LONGEST_LIMIT_S = 604_800.0
"""A week [s]; timers of threads have a largest number."""


def check_unit_limit(limit_s: float) -> None:
    """Refuse a time limit that clocks cannot be set to.

    Raises:
        BadOption: It is not above 0, or more than a week.
    """
    good = 0.0 < limit_s <= LONGEST_LIMIT_S
    check(good, "--limit-s", limit_s, f"a number of seconds above 0, at most {LONGEST_LIMIT_S:.0f}")


def read_shard(text: str) -> Shard:
    """Parse a part of a whole, such as 3/8.

    Raises:
        BadOption: It is none.
    """
    number, slash, of = text.partition("/")
    good = bool(slash) and number.isdecimal() and of.isdecimal() and 1 <= int(number) <= int(of)
    check(good, "--shard", text, "a part of a whole, such as 1/4 to 4/4")
    return Shard(int(number), int(of))


def check_seed(seed: int, episodes: int = 1) -> None:
    """Refuse seeds that the generators cannot take.

    Raises:
        BadOption: When the number of episodes is not positive or too large, or a seed is negative or too large.
    """
    check(1 <= episodes <= MOST_EPISODES, "--episodes", episodes, f"a whole number from 1 to {MOST_EPISODES}")
    most = LARGEST_SEED - episodes
    check(0 <= seed <= most, "--seed", seed, f"a whole number from 0 to {most}")


def check_limit(limit: int) -> None:
    """Refuse a negative number of revisions.

    Raises:
        BadOption: It is negative.
    """
    check(limit >= 0, "--limit", limit, "0 or more")


def check_workers(workers: int) -> None:
    """Refuse fewer than one worker.

    Raises:
        BadOption: There are no workers.
    """
    check(workers >= 1, "--workers", workers, "at least 1")


def task_to_run(task_path: Path, scene: str | None, *, keep_sizes: bool) -> tuple[Task, Scene]:
    """Return a task file's task and its scene, all of whose objects can be built.

    Args:
        task_path: The task's file.
        scene: Name or file of the scene; by default it lies in the task's folder.
        keep_sizes: Whether the task's factors are left out, so that everything keeps its size.

    Raises:
        TaskError, SceneError, SceneNotFound, BadOption: As for `task_and_scene`; or something cannot be built.
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


def results_writer(options: RunOptions | BenchReplayOptions) -> ResultsWriter:
    """Return what draws, encodes and writes the results of a command's run, with its progress on the terminal."""
    return ResultsWriter(
        options.video, options.size, partial(counting, quiet=options.json), partial(tell, style="yellow")
    )


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
