"""Runs the command line the way that a shell does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from executor.machine.files import write_json
from tests.executor.rollout.tasks import closing

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
    """Returns an environment in which the packages of this checkout are found."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "80", "NO_COLOR": "1"}


@pytest.fixture
def door(tmp_path: Path) -> Path:
    """A task file whose flow leaves a refrigerator's door ajar; its scene is beside it, see `scene_of`."""
    graph = closing()
    write_json(tmp_path / "kitchen.json", graph.scene.to_json())
    return write_json(tmp_path / "task.json", graph.task.to_json())


def scene_of(task: Path) -> str:
    """Returns the name of the scene file beside a task file."""
    return str(task.with_name("kitchen.json"))


@pytest.fixture
def command(tmp_path: Path) -> Command:
    """Runs one command line in an empty folder."""

    def run(*arguments: str | Path, timeout: float = 300.0) -> Answer:
        done = subprocess.run(
            [sys.executable, "-m", "executor.cli.main", *map(str, arguments)],
            cwd=tmp_path,
            env=environment(),
            capture_output=True,
            text=True,
            timeout=timeout,
        )
        assert "Traceback" not in done.stderr, done.stderr
        return Answer(done.returncode, done.stdout, done.stderr)

    return run
