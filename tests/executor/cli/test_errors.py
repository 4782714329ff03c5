"""Every exception that is known by name exists, and means what it should."""

from __future__ import annotations

import errno
import importlib

import pytest

from bddl import Atom
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
from executor.records.rollout import PlanRefused
from executor.rollouts.checkpoint import CheckpointError
from executor.scenes.library import SceneNotFound
from executor.world.detectors import UnknownObject
from oag import Report, SceneError, TaskError, compose
from tests.executor.recordings import invented_rollout


def report() -> Report:
    """Returns what was decided about some plan."""
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


def test_a_mistake_of_ours_says_how_to_see_more() -> None:
    verdict = explain(ZeroDivisionError("division by zero"))
    assert not verdict.expected
    assert "ZeroDivisionError: division by zero" in verdict.message and "--debug" in verdict.message
