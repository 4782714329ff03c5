"""Pushing: what is too wide for the hand comes beside another thing, by physics; what cannot is refused before."""

from __future__ import annotations

from typing import Any

import pytest

import bddl
import llm
import oag
from executor import feasible, rollout
from executor.records import FailureKind
from executor.rollouts.feasibility import Feasibility
from executor.scenes.file import complete_scene
from oag import Scene, SimpleTask
from oag.flows import PUSH
from oag.model.robots import LIFTED
from oag.model.where import Where
from oag.sizes import Sizing


def table(item: str, at: tuple[float, float], other: str, place: tuple[float, float], **more: Any) -> Scene:
    objects = {
        "table_0": {"category": "table", "model": "table_four_legs", "position": [0.9, 0.0]},
        "thing_0": {"category": "book", "model": item, "on": "table_0", "at": list(at)},
        "other_0": {"category": "cup", "model": other, "on": "table_0", "at": list(place)},
        **more,
    }
    robot = {"position": [-0.6, 0.0], "name": LIFTED.name}
    completed = complete_scene({"name": "push", "robot": robot, "objects": objects})
    assert completed.scene is not None, completed.problems
    return completed.scene


def forecast(scene: Scene, query: str) -> Feasibility:
    task = llm.propose(query, scene, sizing=Sizing(keep=True)).task
    return feasible(oag.compose(task, scene=scene), scene, 0, vary=False)


@pytest.mark.parametrize(
    ("item", "at", "other", "place", "where"),
    [
        ("book_lying", (-0.1, -0.25), "porcelain_bowl", (-0.05, 0.15), "next to other_0"),
        ("plate", (0.1, 0.2), "bottle", (-0.15, -0.15), "next to other_0"),
        ("teddy_bear", (-0.1, -0.2), "plate", (-0.05, 0.2), "right of other_0"),
    ],
)
def test_a_wide_thing_is_pushed_to_where_it_is_wanted(
    item: str, at: tuple[float, float], other: str, place: tuple[float, float], where: str
) -> None:
    scene = table(item, at, other, place)
    found = forecast(scene, f"push thing_0 {where}")
    assert found, found.reason
    done = rollout(oag.compose(found.task, scene=scene), scene, 0, vary=False, conditions=found.conditions())
    assert done.succeeded, done.failure
    spot = done.subtasks[0].readings[-2]
    assert str(done.subtasks[0].readings).count(where)
    assert spot.satisfied
    (stroke,) = (step for step in done.subtasks[0].steps if step.primitive == "MOVE_EEF_FORWARD")
    assert next(iter(stroke.action.values())) > 0.02  # type: ignore[union-attr]


def test_what_bars_a_push_is_named_and_moved_aside() -> None:
    between = {"can_0": {"category": "can", "on": "table_0", "at": [-0.1, 0.0]}}
    free = table("carton", (-0.1, -0.3), "bottle", (-0.1, 0.25))
    barred = table("carton", (-0.1, -0.3), "bottle", (-0.1, 0.25), **between)
    assert forecast(free, "push thing_0 right of other_0")
    task = llm.propose("push thing_0 right of other_0", barred, sizing=Sizing(keep=True)).task
    found = feasible(oag.compose(task, scene=barred), barred, 0, vary=False)
    assert found, found.reason
    moved = [subtask.target for subtask in found.task.subtasks]
    assert moved[-1] == "thing_0"
    assert set(moved[:-1]) == {"can_0"}
    done = rollout(oag.compose(found.task, scene=barred), barred, 0, vary=False, conditions=found.conditions())
    assert done.succeeded, done.failure


def test_the_thing_that_the_spot_is_beside_is_not_moved_out_of_the_way() -> None:
    scene = table("carton", (-0.1, -0.2), "bottle", (-0.1, 0.05))
    found = forecast(scene, "push thing_0 to the left of other_0")
    assert not found
    assert "thing_0 and other_0 meet" in found.reason
    assert found.in_the_way == ()
    assert {subtask.target for subtask in found.task.subtasks} == {"thing_0"}


def test_no_push_ends_beyond_the_edge() -> None:
    scene = table("book_lying", (-0.1, -0.2), "cup", (-0.1, 0.27))
    found = forecast(scene, "push thing_0 to the left of other_0")
    assert not found
    assert found.failure is not None
    assert found.failure.kind is FailureKind.NO_PATH
    assert "no straight push" in found.reason


@pytest.mark.parametrize("model", ["tennis_ball", "red_apple"])
def test_what_rolls_is_not_pushed_and_what_only_is_round_is(model: str) -> None:
    ball = forecast(table(model, (-0.1, -0.25), "porcelain_bowl", (-0.05, 0.15)), "push thing_0 next to other_0")
    assert not ball
    assert ball.failure is not None
    assert ball.failure.kind is FailureKind.PRECONDITION
    assert "it rolls" in ball.reason
    can = forecast(table("can", (-0.1, -0.25), "porcelain_bowl", (-0.05, 0.15)), "push thing_0 next to other_0")
    assert can, can.reason


@pytest.mark.parametrize(("carrier", "is_loose"), [("book_0", True), ("table_0", False)])
def test_nothing_is_pushed_along_what_is_loose_whoever_wrote_the_task(carrier: str, is_loose: bool) -> None:
    objects = {
        "table_0": {"category": "table", "model": "table_four_legs", "position": [0.9, 0.0]},
        "book_0": {"category": "book", "model": "book_lying", "on": "table_0", "at": [-0.1, 0.2]},
        "thing_0": {"category": "die", "on": carrier, "at": [0.0, -0.035]},
        "other_0": {"category": "die", "on": carrier, "at": [0.0, 0.035]},
    }
    completed = complete_scene(
        {"name": "push", "robot": {"position": [-0.6, 0.0], "name": LIFTED.name}, "objects": objects}
    )
    assert completed.scene is not None, completed.problems
    rests, flow = bddl.parse_formula(f"(ontop thing_0 {carrier})"), tuple(map(oag.Action, PUSH))
    where = Where("next to", "other_0")
    subtask = SimpleTask("push_thing", "", "thing_0", carrier, carrier, rests, rests, flow, where=where)
    task = oag.Task("push", "", rests, True, (subtask,), scene=completed.scene)
    found = feasible(oag.compose(task, scene=completed.scene), completed.scene, 0, vary=False)
    assert (f"{carrier} is loose" in found.reason) is is_loose
