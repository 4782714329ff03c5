"""Every expected exception ends a command with its exit code."""

from __future__ import annotations

import errno
import importlib
import os
from pathlib import Path

import pytest

from bddl import Atom
from bddl.errors import Scene2DemoError
from bddl.files import read_bounded
from executor.cli.errors import (
    BAD_INPUT,
    DISK_FULL,
    FAILED,
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


EXIT_CODES = {
    "bddl.diagnostics.BDDLError": BAD_INPUT,
    "executor.assets.importers.files.ImportRefused": BAD_INPUT,
    "executor.assets.library.NameTaken": BAD_INPUT,
    "executor.assets.parameters.AssetError": BAD_INPUT,
    "executor.campaign.claims.BenchBusy": BAD_INPUT,
    "executor.bench.folder.NotABench": BAD_INPUT,
    "executor.scenes.generators.families.NoPaperFlow": BAD_INPUT,
    "executor.cli.faults.BadFault": BAD_INPUT,
    "executor.cli.errors.BadOption": BAD_INPUT,
    "executor.data.formats.export.ExportExists": BAD_INPUT,
    "executor.data.formats.selection.NothingToExport": BAD_INPUT,
    "executor.data.store.NotADataset": BAD_INPUT,
    "executor.learn.policy_record.NotAPolicy": BAD_INPUT,
    "executor.photo.errors.PhotoRefused": BAD_INPUT,
    "executor.records.MissingFlow": BAD_INPUT,
    "executor.skills.library.MissingSkill": BAD_INPUT,
    "executor.reports.run_folder.FolderUnusable": BAD_INPUT,
    "executor.reports.run_folder.ResultsExist": BAD_INPUT,
    "executor.rollouts.checkpoint.CheckpointError": BAD_INPUT,
    "executor.scenes.library.SceneNotFound": BAD_INPUT,
    "executor.scenes.vary.SeedError": BAD_INPUT,
    "executor.scenes.vary.VariationError": BAD_INPUT,
    "executor.sim.detectors.UnknownObject": BAD_INPUT,
    "executor.sim.faults.FaultUnfit": BAD_INPUT,
    "executor.sim.render.frames.BadPictureSize": BAD_INPUT,
    "executor.sim.robot.description.RobotDataMissing": BAD_INPUT,
    "bddl.errors.MissingExtra": BAD_INPUT,
    "executor.system.vulkan.RendererNotFound": BAD_INPUT,
    "llm.errors.LlmError": BAD_INPUT,
    "oag.model.errors.OagError": BAD_INPUT,
    "executor.data.work.NotPlannable": FAILED,
    "executor.photo.errors.RoomRefused": FAILED,
    "executor.records.PlanRefused": FAILED,
    "executor.scenes.pair.NotDrawn": FAILED,
    "executor.sim.render.frames.VideoFailed": FAILED,
    "executor.sim.render.frames.RenderFailed": FAILED,
    "executor.system.workers.WorkersUnusable": FAILED,
    "llm.errors.BadReply": FAILED,
    "llm.errors.BudgetSpent": FAILED,
    "llm.errors.ModelRefused": FAILED,
    "llm.errors.ModelTimeout": FAILED,
    "llm.errors.ModelUnavailable": FAILED,
    "llm.structured.conversation.AnswersRefused": FAILED,
}


@pytest.mark.parametrize("name", EXIT_CODES)
def test_every_expected_error_has_its_exit_code(name: str) -> None:
    module, _, attribute = name.rpartition(".")
    found = getattr(importlib.import_module(module), attribute)
    assert issubclass(found, Scene2DemoError) and found.exit_code == EXIT_CODES[name]
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
