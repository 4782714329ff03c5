"""Pictures of attempts: drawn when somebody looks and not before, kept under their hash, never too large."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import oag
from executor.records import StepRecord, SubtaskRecord, Trajectory
from executor.rollouts.evolution_record import MOST_BYTES, AttemptFrames, encoded
from executor.system import vulkan
from llm.errors import PicturesMissing
from llm.evolve import AttemptObservation, StepObservation
from tests.llm.evolve.attempts import paper_task
from tests.oag.paper import scene

DURATIONS_S = (0.05, 1.0, 2.5, 40.0)
HASH = "0123456789abcdef" * 4


class Counting(AttemptFrames):
    """Writes down what it was to draw, and draws nothing."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self.drawn: list[list[bytes]] = []

    def draw(self, scene: oag.Scene, task: oag.Task, states: Sequence[bytes]) -> dict[str, list[bytes]]:
        self.drawn.append(list(states))
        return {view: [f"{view} {state.decode()}".encode() for state in states] for view in self.views}


def attempt() -> tuple[AttemptObservation, SubtaskRecord, Trajectory]:
    """Return an attempt of four steps, recorded ten times a second."""
    task = paper_task("T1")
    flow = task.subtasks[3].flow or ()
    steps, owners, start = [], list[int](), 0.0
    for step, seconds in enumerate(DURATIONS_S):
        steps.append(
            StepRecord(3, step, flow[step].primitive.name, flow[step].to_json(), start, start + seconds, 0, ())
        )
        owners += [step] * int(seconds * 10)
        start += seconds
    count = len(owners)
    empty = np.zeros((count, 12), dtype=np.float32)
    trajectory = Trajectory(
        time_s=np.arange(count) / 10,
        robot_qpos=empty,
        robot_qvel=empty,
        robot_target=empty,
        eef_pose=empty[:, :7],
        object_poses={},
        joint_positions={},
        subtask=np.full(count, 3, dtype=np.int32),
        step=np.array(owners, dtype=np.int32),
        packed_states=tuple(str(index).encode() for index in range(count)),
    )
    record = SubtaskRecord(3, "close", flow, tuple(steps), (), HASH, b"")
    seen = tuple(StepObservation(step, flow[step], flow[step]) for step in range(len(steps)))
    return AttemptObservation(task, 3, flow, seen, ()), record, trajectory


def attached(frames: AttemptFrames) -> AttemptObservation:
    seen, record, trajectory = attempt()
    return frames.attach(seen, record, trajectory, scene("T1"))


def test_nothing_is_drawn_until_somebody_looks_and_then_once() -> None:
    frames = Counting(("global", "wrist"))
    seen = attached(frames)
    assert [list(step.frames) for step in seen.steps] == [["global", "wrist"]] * 4 and frames.drawn == []
    pictures = seen.steps[2].frames["wrist"]
    assert [len(step.frames["global"]) for step in seen.steps] == [0, 1, 3, 6] and len(frames.drawn) == 1
    # One second has ten samples; a step of 2.5 s is shown at its beginning, in its middle, and at its end.
    assert pictures == (b"wrist 10", b"wrist 22", b"wrist 34")
    assert seen.steps[1].frames["global"] == (b"global 9",)


def test_a_view_that_was_not_asked_for_is_not_there() -> None:
    seen = attached(Counting(("head",)))
    assert seen.steps[1].frames.get("wrist", ()) == ()
    with pytest.raises(KeyError):
        seen.steps[1].frames["wrist"]


def test_kept_pictures_are_not_drawn_again(tmp_path: Path) -> None:
    first = Counting(("head",), folder=tmp_path)
    told = attached(first).steps[3].frames["head"]
    assert (tmp_path / HASH[:16] / "step_04_head_6.jpg").read_bytes() == told[5]
    again = Counting(("head",), folder=tmp_path / "other", recorded=tmp_path)
    assert attached(again).steps[3].frames["head"] == told and again.drawn == []
    assert not (tmp_path / "other").exists()


def test_pictures_of_other_states_or_incomplete_ones_are_not_taken(tmp_path: Path) -> None:
    _ = attached(Counting(("head",), folder=tmp_path)).steps[3].frames["head"]
    seen, record, trajectory = attempt()
    frames = Counting(("head",), folder=tmp_path)
    other = frames.attach(seen, replace(record, state_hash="f" * 64), trajectory, scene("T1"))
    assert other.steps[3].frames["head"] and len(frames.drawn) == 1
    (tmp_path / HASH[:16] / "step_04_head_6.jpg").unlink()
    again = Counting(("head",), folder=tmp_path)
    assert attached(again).steps[3].frames["head"] and len(again.drawn) == 1


def test_without_a_renderer_it_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = vulkan.Renderer("none", "no driver was found", "install one")
    monkeypatch.setattr(vulkan, "find_renderer", lambda: nothing)
    with AttemptFrames(("head",)) as frames:
        seen = attached(frames)
        with pytest.raises(PicturesMissing, match=r"no driver was found(.|\n)*--views none"):
            seen.steps[3].frames["head"]


def test_an_unknown_view_is_refused() -> None:
    with pytest.raises(ValueError, match="there is no view 'side'; the views are global, head, wrist"):
        AttemptFrames(("side",))


@pytest.mark.parametrize("most", [MOST_BYTES, 20_000, 800])
def test_a_picture_fits_whatever_it_shows(most: int) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (448, 448, 3), dtype=np.uint8)
    data = encoded(noise, most)
    assert len(data) <= most
    assert Image.open(io.BytesIO(data)).format == "JPEG"


def test_a_usual_picture_keeps_its_size_and_its_colors() -> None:
    plain = np.full((224, 224, 3), (200, 120, 40), dtype=np.uint8)
    found = np.asarray(Image.open(io.BytesIO(encoded(plain))))
    assert found.shape == plain.shape and np.abs(found.astype(int) - plain).max() <= 4
