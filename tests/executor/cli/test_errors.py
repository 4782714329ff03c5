"""Every exception that is known by name exists, and means what it should."""

from __future__ import annotations

import errno
import importlib
import os
from pathlib import Path

import pytest

from bddl import Atom
from bddl.files import read_bounded
from executor.cli.errors import (
    BAD_INPUT,
    BAD_INPUT_ERRORS,
    DISK_FULL,
    FAILED,
    FAILURE_ERRORS,
    INTERRUPTED,
    UNREAD,
    explain,
)
from executor.records import PlanRefused
from executor.rollouts.checkpoint import CheckpointError
from executor.scenes.library import SceneNotFound
from executor.sim.detectors import UnknownObject
from oag import Report, SceneError, TaskError, compose
from tests.executor.recordings import invented_rollout


def report() -> Report:
    """Return what was decided about some plan."""
    recorded = invented_rollout()
    return compose(recorded.task, scene=recorded.scene).verify()


@pytest.mark.parametrize("name", sorted(BAD_INPUT_ERRORS | FAILURE_ERRORS))
def test_known_names_are_real(name: str) -> None:
    module, _, attribute = name.rpartition(".")
    found = getattr(importlib.import_module(module), attribute)
    assert issubclass(found, Exception)
    assert f"{found.__module__}.{found.__qualname__}" == name


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (SceneNotFound("kitchn", ("kitchen_t1",)), BAD_INPUT),
        (TaskError("is not valid JSON: x at line 3, column 4", source="t.json"), BAD_INPUT),
        (SceneError("has no object 'x'"), BAD_INPUT),
        (FileNotFoundError(2, "No such file or directory", "c.json"), BAD_INPUT),
        (KeyboardInterrupt(), INTERRUPTED),
        (BrokenPipeError(32, "Broken pipe"), UNREAD),
        (OSError(errno.ENOSPC, "No space left on device", "r/rollout.json"), DISK_FULL),
        (CheckpointError("not a checkpoint"), BAD_INPUT),
        (UnknownObject(Atom("open", ("cup_9",)), "cup_9", ("glass_0",)), BAD_INPUT),
        (PlanRefused(report()), FAILED),
        (ZeroDivisionError("division by zero"), FAILED),
        (OSError("no file to blame"), FAILED),
    ],
)
def test_exit_codes(error: BaseException, code: int) -> None:
    assert explain(error).code == code


@pytest.mark.parametrize(
    ("number", "words"),
    [
        (errno.ENOSPC, "No space left on device; make room,"),
        (errno.EDQUOT, "Disk quota exceeded; make room within your share"),
        (errno.EFBIG, "File too large; the disk has room, but no file may grow"),
    ],
)
def test_each_reason_why_nothing_can_be_written_has_its_own_advice(number: int, words: str) -> None:
    ending = explain(OSError(number, os.strerror(number), "r/rollout.json"))
    assert ending.code == DISK_FULL and f"r/rollout.json: {words}" in ending.message


def test_an_input_that_is_too_large_fills_no_disk(tmp_path: Path) -> None:
    file = tmp_path / "large"
    file.write_bytes(bytes(101))
    with pytest.raises(OSError) as read:
        read_bounded(file, 100)
    wrapped = TaskError("cannot be read", source=str(file))
    wrapped.__cause__ = read.value
    for error in (read.value, wrapped):
        assert explain(error).code == BAD_INPUT and "room" not in explain(error).message


def test_a_mistake_of_ours_says_how_to_see_more() -> None:
    verdict = explain(ZeroDivisionError("division by zero"))
    assert not verdict.expected
    assert "ZeroDivisionError: division by zero" in verdict.message and "--debug" in verdict.message
