"""Devices and pipes in the place of files: every door of the command line refuses them, in a bounded memory."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from typing import Any

import pytest

from tests.executor.cli.conftest import ROOT, environment

T1 = str(ROOT / "tests" / "data" / "T1.json")
# What an honest start of any of these takes, torch and SAPIEN left out, is a tenth of it.
MOST_MEMORY = 4_000_000_000
DOORS: dict[str, tuple[list[str], str]] = {
    "task": (["verify", "/dev/zero"], "no regular file"),
    "scene": (["verify", T1, "--scene", "/dev/zero"], "no regular file"),
    "scene of a graph": (["graph", T1, "--scene", "/dev/zero"], "no regular file"),
    "scene to look at": (["scenes", "/dev/zero"], "no regular file"),
    "scene from a pipe": (["scenes", "pipe"], "no regular file"),
    "scene to run in": (["run", "open the refrigerator", "--scene", "/dev/zero", "--out", "r"], "no regular file"),
    "certificate": (["recheck", "/dev/zero"], "no regular file"),
    "recording": (
        ["run", "q", "--scene", "kitchen_t1", "--out", "m", "--model", "replay:/dev/zero"],
        "no regular file",
    ),
    "picture": (
        ["run", "q", "--scene", "kitchen_t1", "--out", "p", "--model", "replay:x", "--image", "/dev/zero"],
        "no regular file",
    ),
    "BDDL": (["bddl", "check", "/dev/zero"], "larger than 8 MB"),
    "asset": (["assets", "import", "link.urdf"], "no regular file"),
    "mesh": (["assets", "import", "link.obj"], "no regular file"),
}
_RUN_ALL = """
import contextlib, io, json, sys
from executor.cli.app import run
said = []
for arguments in json.loads(sys.argv[1]):
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        code = run(arguments)
    said.append([code, out.getvalue() + err.getvalue()])
print(json.dumps(said))
"""


def _bound() -> None:
    resource.setrlimit(resource.RLIMIT_AS, (MOST_MEMORY, MOST_MEMORY))


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Exit code and words of every door, all of them in one process that has little memory."""
    folder = tmp_path_factory.mktemp("doors")
    os.mkfifo(folder / "pipe")
    for name in ("link.urdf", "link.obj"):
        (folder / name).symlink_to("/dev/zero")
    done = subprocess.run(
        [sys.executable, "-c", _RUN_ALL, json.dumps([arguments for arguments, _ in DOORS.values()])],
        cwd=folder,
        env=environment(),
        preexec_fn=_bound,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return dict(zip(DOORS, json.loads(done.stdout.splitlines()[-1]), strict=True))


@pytest.mark.parametrize("door", DOORS)
def test_a_door_refuses_what_has_no_end(door: str, answers: dict[str, Any]) -> None:
    code, said = answers[door]
    assert code == 2, said
    assert DOORS[door][1] in " ".join(said.split()), said
