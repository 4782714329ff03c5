"""Doors and drawers of every kind under physics: folding ones, several at once, and where a rigid arc has no floor."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

import executor
import oag
from executor.assets.library import sample
from executor.planning import articulation_stances
from executor.planning.articulation_stances import push_stances, rigid_stances
from executor.records import FailureKind, Rollout
from executor.sim.world import World
from executor.skills import articulate
from oag import Scene, SceneObject, Task
from oag.measurements import measurements_json
from oag.model.actions import flow_to_json
from oag.model.scene import RobotPose

pytestmark = [pytest.mark.physics, pytest.mark.slow]
FRONT_X_M = 0.75
SEED = 17000
FLOWS: dict[str, list[Any]] = {"open": [17, 1, 2, 3, {"4": None}, 5, 6], "close": [17, 1, 2, 3, {"19": None}, 5, 6]}
STATES = {True: "(open fixture_0)", False: "(not (open fixture_0))"}


def box(name: str, centre: tuple[float, float, float], extent: tuple[float, float, float]) -> SceneObject:
    """Return a closed body that stands in the way."""
    return SceneObject(name, "cabinet", "closed", centre, (1.0, 0.0, 0.0, 0.0), extent, (1.0, 1.0, 1.0), {})


def scene_of(
    model: str,
    *others: SceneObject,
    variation: int = 0,
    robot: tuple[float, float] = (-0.4, 0.2),
    **parameters: object,
) -> Scene:
    """Return a fixture with its front at x = 0.75 m, and what stands around it."""
    fixture = sample(model, variation, "fixture_0")
    depth, _, height = fixture.extent_m
    fixture = replace(
        fixture,
        position=(FRONT_X_M + depth / 2, 0.0, height / 2),
        parameters={**fixture.parameters, **parameters},
    )
    objects = {"fixture_0": fixture, **{other.id: other for other in others}}
    opened = bool(parameters.get("open_fraction"))
    known = {name: {"category": o.category, "bbox_extent": list(o.bbox_extent)} for name, o in objects.items()}
    return Scene(
        name="articulation",
        robot=RobotPose(position=(*robot, 0.0)),
        objects=objects,
        facts=Scene.from_json({"objects": known, "facts": [STATES[opened]]}).facts,
        closed=frozenset({"ontop", "inside", "open"}),
    )


def run(scene: Scene, *kinds: str, flows: list[list[Any]] | None = None) -> Rollout:
    """Return the rollout of openings and closings, one subtask each."""
    subtasks = [
        {
            "task_activity_name": kind,
            "target": "fixture_0",
            "init": STATES[kind == "close"],
            "goal": STATES[kind == "open"],
            "flow": FLOWS[kind] if flows is None else flows[index],
        }
        for index, kind in enumerate(kinds)
    ]
    task = {"task_activity_name": "articulation", "goal": STATES[kinds[-1] == "open"], "sub_tasks": subtasks}
    return executor.rollout(oag.compose(Task.from_json(task, scene=scene)), scene, seed=SEED, vary=False)


def motions(rollout: Rollout) -> list[Any]:
    """Return by which motion each articulation was done."""
    steps = [step for subtask in rollout.subtasks for step in subtask.steps if step.primitive.startswith("ARTICULATE")]
    return [measurements_json(step.measurements)["motion"] for step in steps]


@pytest.mark.parametrize("model", ["oven_bottom_hinge", "dishwasher_bottom_hinge"])
@pytest.mark.parametrize("variation", [0, 1])
def test_a_door_that_folds_down_opens_wide_and_closes(model: str, variation: int) -> None:
    rollout = run(scene_of(model, variation=variation), "open", "close")
    assert rollout.succeeded, rollout.failure
    assert motions(rollout)[0] == "whole-body arc"
    assert rollout.subtasks[0].readings[0].measurements.open_fraction > 0.5


def test_a_door_that_lies_open_is_lifted_by_its_edge_and_pushed_shut() -> None:
    rollout = run(scene_of("oven_bottom_hinge", open_fraction=1.0), "close")
    assert rollout.succeeded, rollout.failure


@pytest.mark.parametrize(
    ("model", "parameters", "doors"),
    [
        ("cabinet_two_doors", {}, 2),
        ("fridge_side_by_side", {}, 2),
        ("cabinet_drawers", {"drawers": 3}, 3),
    ],
)
def test_closing_closes_everything_that_stands_open(model: str, parameters: dict[str, object], doors: int) -> None:
    rollout = run(scene_of(model, open_fraction=0.6, **parameters), "close")
    assert rollout.succeeded, rollout.failure
    step = next(step for step in rollout.subtasks[0].steps if step.primitive == "ARTICULATE_CLOSE")
    assert len({stage["joint"] for stage in measurements_json(step.measurements)["stages"]}) == doors  # type: ignore[union-attr,index,call-overload]


def in_a_corner() -> Scene:
    """A refrigerator hinged on the right, a wall beside that side, a table on the other."""
    width = sample("fridge_one_door", 0, "fixture_0").extent_m[1]
    wall = box("wall_0", (0.45, -width / 2 - 0.18, 0.8), (1.9, 0.30, 1.6))
    table = box("table_0", (-0.35, 0.95, 0.3), (0.6, 0.8, 0.6))
    return scene_of("fridge_one_door", wall, table, robot=(-0.5, 0.1), hinge="right")


def test_a_refrigerator_in_a_corner_is_opened_by_the_whole_body() -> None:
    rollout = run(in_a_corner(), "open", "close")
    assert rollout.succeeded, rollout.failure
    assert motions(rollout)[0] == "whole-body arc"


def test_numbers_that_were_filled_in_do_the_same_again() -> None:
    scene = scene_of("oven_bottom_hinge", variation=2)
    first = run(scene, "open", "close")
    assert first.succeeded, first.failure
    again = run(scene, "open", "close", flows=[flow_to_json(subtask.flow) for subtask in first.subtasks])
    assert again.succeeded, again.failure
    reached = [r.subtasks[0].readings[0].measurements.open_fraction for r in (first, again)]
    assert reached[0] == pytest.approx(reached[1], abs=0.03)


def test_a_door_that_meets_a_wall_is_refused_before_anything_moves() -> None:
    wall = box("wall_0", (0.2, 0.0, 0.6), (0.3, 1.6, 1.2))
    flow = [17, 1, 2, 3, {"4": [0.0, 0.9]}, 5, 6]
    rollout = run(scene_of("fridge_one_door", wall, robot=(-0.6, 0.0)), "open", flows=[flow])
    assert rollout.failure is not None and rollout.failure.kind is FailureKind.NO_PATH
    assert measurements_json(rollout.failure.measurements)["in_the_way"] == ["wall_0/cabinet"]


def test_the_drawer_that_holds_the_item_is_opened_and_the_item_goes_along() -> None:
    die = replace(sample("die", 0, "die_0"), bbox_extent=(0.04, 0.04, 0.04))
    with World(scene_of("cabinet_drawers", drawers=3)) as world:
        region = next(r for r in world.assets["fixture_0"].regions if r.name == "drawer_2")
        x, y, z = (world.T_world_link("fixture_0", region.link) @ [*region.center_m, 1.0])[:3]
    die = replace(die, position=(float(x), float(y), float(z) + 0.021 - region.half_extents_m[2]))
    scene = scene_of("cabinet_drawers", die, drawers=3)
    known = {name: {"category": o.category, "bbox_extent": list(o.bbox_extent)} for name, o in scene.objects.items()}
    facts = ["(not (open fixture_0))", "(inside die_0 fixture_0)"]
    scene = replace(scene, facts=Scene.from_json({"objects": known, "facts": facts}).facts)
    opening = {
        "task_activity_name": "open",
        "target": "fixture_0",
        "init": STATES[False],
        "goal": STATES[True],
        "flow": FLOWS["open"],
    }
    taking = {
        "task_activity_name": "take",
        "target": "die_0",
        "support_init": "fixture_0",
        "init": "(and (inside die_0 fixture_0) (open fixture_0))",
        "goal": "(inside die_0 gripper)",
        "flow": [17, 1, 2, 3, {"7": None}],
    }
    task = {"task_activity_name": "fetch", "goal": "(inside die_0 gripper)", "sub_tasks": [opening, taking]}
    rollout = executor.rollout(oag.compose(Task.from_json(task, scene=scene)), scene, seed=SEED, vary=False)
    step = next(step for step in rollout.subtasks[0].steps if step.primitive == "ARTICULATE_OPEN")
    assert measurements_json(step.measurements)["joint"] == "drawer_2_slide"
    assert rollout.succeeded, rollout.failure


def test_what_a_pull_leaves_ajar_is_pushed_wide_from_inside(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(articulation_stances, "OPENING", ((rigid_stances, True),))
    rollout = run(scene_of("fridge_one_door"), "open", flows=[[17, 1, 2, 3, {"4": [0.0, 0.85]}, 5, 6]])
    assert rollout.succeeded, rollout.failure
    step = next(step for step in rollout.subtasks[0].steps if step.primitive == "ARTICULATE_OPEN")
    assert [stage["motion"] for stage in measurements_json(step.measurements)["stages"]] == ["rigid arc", "push"]  # type: ignore[union-attr,index,call-overload]
    assert rollout.subtasks[0].readings[0].measurements.open_fraction == pytest.approx(0.85, abs=0.04)


@pytest.mark.parametrize("model", ["oven_bottom_hinge", "fridge_one_door"])
def test_a_push_from_outside_shuts_a_door(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(articulation_stances, "CLOSING", ((push_stances, False),))
    rollout = run(scene_of(model, open_fraction=0.5), "close")
    assert rollout.succeeded, rollout.failure
    assert motions(rollout) == ["push"]


def test_each_of_two_openings_of_one_grasp_has_its_own_numbers() -> None:
    flow = [17, 1, 2, 3, {"4": [0.0, 0.3]}, {"4": [0.3, 0.6]}, 5, 6]
    rollout = run(scene_of("fridge_one_door"), "open", flows=[flow])
    assert rollout.succeeded, rollout.failure
    steps = [step for step in rollout.subtasks[0].steps if step.primitive == "ARTICULATE_OPEN"]
    assert [measurements_json(step.measurements)["fraction_asked"] for step in steps] == [0.3, 0.6]
    assert rollout.subtasks[0].readings[0].measurements.open_fraction == pytest.approx(0.6, abs=0.04)


def test_an_opening_that_takes_too_many_motions_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(articulation_stances, "OPENING", ((rigid_stances, True),))
    monkeypatch.setattr(articulate, "MOST_STAGES", 1)
    rollout = run(scene_of("fridge_one_door"), "open", flows=[[17, 1, 2, 3, {"4": [0.0, 0.85]}, 5, 6]])
    assert rollout.failure is not None and rollout.failure.kind is FailureKind.STALLED
    assert "not where it was asked to be after 1 motions" in rollout.failure.message
    assert 0.1 < measurements_json(rollout.failure.measurements)["fraction_reached"] < 0.85
