"""Runs the command line the way that a shell does: a process of its own, words, streams and an exit code.

Libraries take a second to load, and there are a hundred commands here. So a process that has loaded them is copied for
each command. What a start from nothing does, what is imported when, and how long `--help` takes is for `test_commands`.
"""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import Any

import pytest

from executor.cli.app import main
from executor.system.files import write_json
from tests.executor.rollouts.tasks import closing

ROOT = Path(__file__).resolve().parents[3]


@dataclass(frozen=True)
class Answer:
    """What a command printed and how it ended."""

    code: int
    out: str
    err: str

    @property
    def data(self) -> dict[str, Any]:
        """The one JSON object on standard output; fails when there is anything else."""
        found = json.loads(self.out)
        assert isinstance(found, dict)
        return found


Command = Callable[..., Answer]


def environment() -> dict[str, str]:
    """Return an environment in which the packages of this checkout are found."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "80", "NO_COLOR": "1"}


@pytest.fixture
def door(tmp_path: Path) -> Path:
    """A task file whose flow leaves a refrigerator's door ajar; its scene is beside it, see `scene_of`."""
    graph = closing()
    write_json(tmp_path / "kitchen.json", graph.scene.to_json())
    return write_json(tmp_path / "task.json", graph.task.to_json())


def scene_of(task: Path) -> str:
    """Return the name of the scene file beside a task file."""
    return str(task.with_name("kitchen.json"))


# The commands that move nothing, with all that they load; a simulator's threads do not survive being copied.
_LOADED = [
    "executor.cli.app",
    "openai",
    "executor.cli.evolution_setup",
    "executor.cli.execution",
    "executor.rollouts.feasibility",
    "executor.sim.render.stage",
    "llm.offline.planner",
]


def _typed(arguments: list[str], folder: Path, said: Path, environment: dict[str, str]) -> None:
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(folder)
    for descriptor, name in ((1, "out"), (2, "err")):
        os.dup2(os.open(said / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), descriptor)
    main(arguments)


@pytest.fixture(scope="session")
def copies() -> ForkServerContext:
    """Give what starts processes in which the libraries are loaded."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_LOADED)
    return context


@pytest.fixture
def command(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, copies: ForkServerContext) -> Command:
    """Run one command line in an empty folder."""

    def run(*arguments: str | Path, timeout: float = 600.0) -> Answer:
        said = tmp_path_factory.mktemp("said")
        words = [str(argument) for argument in arguments]
        process = copies.Process(target=_typed, args=(words, tmp_path, said, environment()))
        process.start()
        process.join(timeout)
        if process.exitcode is None:
            process.kill()
            pytest.fail(f"{words} did not end within {timeout} s")
        out, err = ((said / name).read_bytes().decode("utf-8", "replace") for name in ("out", "err"))
        assert "Traceback" not in err, err
        return Answer(process.exitcode, out, err)

    return run
