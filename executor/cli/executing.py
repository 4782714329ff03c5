"""The commands that execute plans: checks of their options, the task to run, and the command line that repeats one."""

from __future__ import annotations

import shlex
from dataclasses import replace
from functools import partial
from pathlib import Path

from executor.cli.errors import FAILED, check
from executor.cli.inputs import task_and_scene
from executor.cli.output import counting, print_json, say, tell, tell_warnings
from executor.cli.words.running import BenchReplayOptions, RunOptions
from executor.results.studio import Studio
from executor.scenes.plausible import require_possible
from executor.scenes.vary import LARGEST_SEED, MOST_EPISODES
from oag import Report, Scene, Task


def check_seed(seed: int, episodes: int = 1) -> None:
    """Refuses seeds that the generators cannot take.

    Raises:
        BadOption: When the number of episodes is not positive or too large, or a seed is negative or too large.
    """
    check(1 <= episodes <= MOST_EPISODES, "--episodes", episodes, f"a whole number from 1 to {MOST_EPISODES}")
    most = LARGEST_SEED - episodes
    check(0 <= seed <= most, "--seed", seed, f"a whole number from 0 to {most}")


def check_limit(limit: int) -> None:
    """Refuses a negative number of revisions.

    Raises:
        BadOption: It is negative.
    """
    check(limit >= 0, "--limit", limit, "0 or more")


def check_workers(workers: int) -> None:
    """Refuses to work with nobody.

    Raises:
        BadOption: There are no workers.
    """
    check(workers >= 1, "--workers", workers, "at least 1")


def task_to_run(task_path: Path, scene: str | None, *, keep_sizes: bool) -> tuple[Task, Scene]:
    """Returns a task file's task and its scene, all of whose things can be built.

    Args:
        task_path: The task's file.
        scene: Name or file of the scene; without one, it lies beside the task.
        keep_sizes: Whether the task's factors are left out, so that everything keeps its size.

    Raises:
        TaskError, SceneError, SceneNotFound, BadOption: As for `task_and_scene`; or something cannot be built.
    """
    task, found = task_and_scene(task_path, scene)
    tell_warnings(require_possible(found))
    return replace(task, scales={}) if keep_sizes else task, found


def refuse(report: Report, *, as_json: bool) -> int:
    """Prints why a plan is not executed, and returns the exit code."""
    if as_json:
        print_json({"ok": False, "exit_code": FAILED, **report.to_json()})
    else:
        say(str(report))
        tell(f"scene2demo: the plan is {report.verdict.value.lower()}, not proved; nothing was moved", style="red")
    return FAILED


def studio_for(options: RunOptions | BenchReplayOptions) -> Studio:
    """Returns what draws, encodes and writes what a command's run leaves, and tells it on the terminal."""
    return Studio(options.video, options.size, partial(counting, quiet=options.json), partial(tell, style="yellow"))


def command_line(command: str, *given: object, **options: object) -> str:
    """Returns a command line that a shell understands, such as the one that repeats a run.

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
