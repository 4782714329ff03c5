"""SET_UPRIGHT in physics: what has fallen is stood up from a sentence, and told before it moves where it cannot be."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import bddl
import llm
import oag
from executor import feasible, rollout
from executor.records import Rollout
from executor.scenes.file import complete_scene
from executor.sim.detectors import read
from executor.sim.world import World

pytestmark = pytest.mark.physics

SIZES: dict[str, tuple[str, tuple[float, float, float]]] = {
    "bottle": ("bottle", (0.065, 0.065, 0.22)),
    "can": ("can", (0.06, 0.06, 0.11)),
    "glass": ("tumbler", (0.07, 0.07, 0.12)),
    "carton": ("carton", (0.08, 0.05, 0.15)),
}


def fallen(
    kind: str,
    yaw_deg: float,
    *,
    table_m: float = 0.72,
    roll_deg: float = 0.0,
    extent_m: tuple[float, float, float] | None = None,
    **others: Any,
) -> oag.Scene:
    """Return a scene in which a thing lies on a table, its top towards a heading."""
    model, usual = SIZES[kind]
    extent = extent_m or usual
    turn = Rotation.from_euler("ZYZ", [yaw_deg, 90.0, roll_deg], degrees=True)
    x, y, z, w = turn.as_quat().tolist()
    half = float(np.abs(turn.as_matrix()[2]) @ np.array(extent)) / 2 if kind == "carton" else extent[0] / 2
    thing = {"model": model, "category": {"glass": "water_glass", "carton": "box"}.get(kind, kind)}
    place = {"position": [0.95, 0.1, table_m + half + 0.0003], "orientation": [w, x, y, z], "bbox_extent": [*extent]}
    table = {"category": "table", "position": [1.1, 0.0], "bbox_extent": [0.7, 1.0, table_m]}
    found = complete_scene(
        {"name": f"fallen_{kind}", "objects": {"table_0": table, f"{kind}_0": thing | place, **others}}
    )
    assert found.scene is not None, found.problems
    return found.scene


def stood_up(scene: oag.Scene, query: str, seed: int) -> Rollout:
    """Return the rollout of a sentence; its plan is proved and feasible."""
    graph = oag.compose(llm.propose(query, scene).task)
    assert graph.verify()
    found = feasible(graph, scene, seed)
    assert found, found.reason
    return rollout(graph, scene, seed, conditions=found.conditions())


@pytest.mark.parametrize(
    ("kind", "yaw_deg", "query"),
    [
        ("bottle", 30.0, "stand the bottle up"),
        ("can", 200.0, "put the can upright"),
        ("glass", -75.0, "stand the glass up"),
    ],
)
def test_what_has_fallen_is_stood_up(kind: str, yaw_deg: float, query: str) -> None:
    scene = fallen(kind, yaw_deg)
    assert bddl.parse_formula(f"(ontop {kind}_0 table_0)") in scene.facts
    done = stood_up(scene, query, 0)
    assert done.succeeded, done.failure
    assert all(reading.satisfied for reading in done.goal_readings)
    # Nothing passes through anything.
    assert done.penetration.deepest_m < 0.002


@pytest.mark.slow
@pytest.mark.parametrize("kind", SIZES)
def test_most_are_stood_up_however_they_lie(kind: str) -> None:
    yaws_deg = np.random.default_rng(49).uniform(-180.0, 180.0, 6)
    heights_m = np.linspace(0.5, 0.9, 6)
    done = [
        stood_up(fallen(kind, float(yaw), table_m=round(float(high), 3)), f"stand {kind}_0 up", seed)
        for seed, (yaw, high) in enumerate(zip(yaws_deg, heights_m, strict=True))
    ]
    assert sum(each.succeeded for each in done) >= 5


def test_what_stands_and_what_lies_is_stated_only_where_something_lies() -> None:
    can = {"category": "can", "on": "table_0"}
    die = {"category": "die", "on": "table_0"}
    scene = fallen("bottle", 0.0, can_0=can, die_0=die)
    said = {bddl.format(fact) for fact in scene.facts if "upright" in bddl.format(fact) or "stand" in bddl.format(fact)}
    assert said == {"(can_stand bottle_0)", "(not (upright bottle_0))", "(can_stand can_0)", "(upright can_0)"}
    table = {"category": "table", "position": [1.1, 0.0]}
    standing = complete_scene({"name": "standing", "objects": {"table_0": table, "can_0": can}}).scene
    assert standing is not None and standing.domain.built_in and "upright" not in standing.closed


@pytest.mark.parametrize(
    ("lean_deg", "is_upright"), [(0.0, True), (14.0, True), (16.0, False), (90.0, False), (180.0, False)]
)
def test_the_detector_reads_how_a_thing_leans(lean_deg: float, is_upright: bool) -> None:
    scene = fallen("can", 0.0)
    with World(scene) as world:
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("y", lean_deg, degrees=True).as_matrix()
        lean = math.radians(lean_deg)
        T[:3, 3] = 0.95, 0.1, 0.72 + 0.055 * abs(math.cos(lean)) + 0.03 * abs(math.sin(lean))
        world.set_object_pose("can_0", T)
        world.step()
        reading = read(bddl.Atom("upright", ("can_0",)), world)
        assert reading.value is is_upright
        assert reading.measurements.tilted_deg == pytest.approx(lean_deg, abs=1.0)
        T[2, 3] += 0.2
        world.set_object_pose("can_0", T)
        world.step()
        assert read(bddl.Atom("upright", ("can_0",)), world).value is False, "it is in the air"


def test_what_no_hand_can_stand_up_is_told_before_anything_moves() -> None:
    # Its narrow sides are below and above, and across it is wider than the hand opens.
    scene = fallen("carton", 20.0, roll_deg=90.0, extent_m=(0.1, 0.05, 0.15))
    graph = oag.compose(llm.propose("stand the carton up", scene).task)
    found = feasible(graph, scene, 0)
    assert graph.verify() and not found
    assert "no side of carton_0" in str(found.reason)
