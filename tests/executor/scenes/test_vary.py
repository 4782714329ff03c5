"""Variation: a pure function of scene and seed that keeps the scene's facts true and its way free."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bddl
from executor.assets.asset_geometry import bounds
from executor.assets.library import asset_for
from executor.geometry import Array, inverse, transform_from_quaternion
from executor.scenes import library
from executor.scenes.vary import VariationError, vary
from executor.sim.detectors import read
from oag import Scene, SceneObject
from tests.executor.helpers import MakeWorld, scene_at_paper_size, settle

NAMES = ("kitchen_t1", "kitchen_t2", "kitchen_t3", "kitchen_t4")
SEEDS = range(200)


def pose(obj: SceneObject) -> Array:
    return transform_from_quaternion(obj.position, obj.orientation)


def yaw(obj: SceneObject) -> float:
    T = pose(obj)
    return float(np.arctan2(T[1, 0], T[0, 0]))


def test_the_block_in_the_documents_varies_all_that_it_names() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "datasets.md").read_text(encoding="utf-8")
    block = next(
        json.loads(text) for text in re.findall(r"```json\n(.*?)```", page, re.DOTALL) if '"variation"' in text
    )
    scene = replace(library.load("kitchen_t1"), **block)
    starts = [vary(scene, seed) for seed in range(8)]
    assert set(block["variation"]["objects"]) == set(scene.objects)
    for name in scene.objects:
        assert len({start[name].position for start in starts}) == len(starts), name
    assert len({start.robot.yaw_rad for start in starts}) == len(starts)
    assert {start["table_0"].position[1] for start in starts} == {-1.25, 1.75}
    assert all(10 <= start["refrigerator_0"].parameters["handle_force_n"] <= 30 for start in starts)


def facts_by_geometry(scene: Scene) -> bool:
    """Decide whether every `ontop` fact holds: bottom on the support's top, the whole footprint over it."""
    for fact in scene.facts:
        for literal in bddl.literals(fact) or ():
            if literal.atom.predicate == "ontop":
                above, below = (scene.objects[name] for name in literal.atom.args)
                local = inverse(pose(below)) @ pose(above)
                low, high = bounds(asset_for(above), local[:3, :3])
                half = np.asarray(below.extent_m) / 2
                if abs(local[2, 3] + low[2] - half[2]) > 1e-6:
                    return False
                if np.any(np.maximum(np.abs(local[:2, 3] + low[:2]), np.abs(local[:2, 3] + high[:2])) > half[:2]):
                    return False
    return True


def footprint(obj: SceneObject) -> tuple[Array, Array]:
    low, high = bounds(asset_for(obj), pose(obj)[:3, :3])
    center = np.asarray(obj.position)
    return (center + low)[:2], (center + high)[:2]


@pytest.mark.parametrize("name", NAMES)
def test_facts_stay_true_for_every_seed(name: str) -> None:
    scene = scene_at_paper_size(name)
    assert all(facts_by_geometry(vary(scene, seed)) for seed in SEEDS)


@pytest.mark.parametrize("name", NAMES)
def test_furniture_and_the_robot_keep_their_distance(name: str) -> None:
    scene = scene_at_paper_size(name)
    for seed in SEEDS:
        varied = vary(scene, seed)
        large = [footprint(o) for o in varied.objects.values() if max(o.extent_m) > 0.3]
        robot = np.asarray(varied.robot.position[:2])
        for low, high in large:
            # The base's half diagonal is 0.24 m; half a metre lets it turn on the spot.
            assert np.linalg.norm(np.maximum(0, np.maximum(low - robot, robot - high))) > 0.5
        (low_a, high_a), (low_b, high_b) = large
        gap = np.maximum(low_a - high_b, low_b - high_a)
        assert float(np.linalg.norm(np.maximum(gap, 0.0))) > 0.25


@pytest.mark.parametrize("name", NAMES)
def test_equal_seeds_give_equal_scenes_and_others_differ(name: str) -> None:
    scene = scene_at_paper_size(name)
    before = scene.to_json()
    assert vary(scene, 7) == vary(scene, 7)
    assert scene.to_json() == before
    starts = {vary(scene, seed).robot.position for seed in SEEDS}
    assert len(starts) == len(SEEDS)


def test_scenes_of_other_names_draw_other_numbers() -> None:
    scene = library.load("kitchen_t1")
    assert vary(scene, 3).robot != vary(replace(scene, name="kitchen_t1_copy"), 3).robot


def test_ranges_are_used_and_kept() -> None:
    scene = scene_at_paper_size("kitchen_t1")
    varied = [vary(scene, seed) for seed in SEEDS]
    offsets = np.array([np.subtract(v.robot.position, scene.robot.position)[:2] for v in varied])
    assert np.abs(offsets).max() <= 0.1 and np.abs(offsets).max() > 0.09
    assert max(abs(v.robot.yaw_rad) for v in varied) <= 0.2
    fridges = [v.objects["refrigerator_0"] for v in varied]
    assert 0.09 < max(abs(yaw(fridge)) for fridge in fridges) <= 0.1
    assert 0.045 < max(abs(fridge.position[1]) for fridge in fridges) <= 0.05
    assert {fridge.position[0] for fridge in fridges} == {0.94}
    sides = [v.objects["table_0"].position[1] > 0 for v in varied]
    assert 60 < sum(sides) < 140


def test_the_glass_stands_near_the_edge_that_faces_the_room() -> None:
    scene = scene_at_paper_size("kitchen_t1")
    for seed in SEEDS:
        objects = vary(scene, seed).objects
        table, glass = objects["table_0"], objects["glass_0"]
        towards_room = -np.sign(table.position[1])
        inset = 0.25 - towards_room * (glass.position[1] - table.position[1])
        assert 0.08 - 1e-9 <= inset <= 0.16 + 1e-9
        assert abs(glass.position[0] - table.position[0]) <= 0.25 + 1e-9


def test_a_seed_means_the_same_start_at_every_size() -> None:
    small, large = (vary(scene, 11) for scene in (scene_at_paper_size("kitchen_t1"), library.load("kitchen_t1")))
    assert small.robot == large.robot
    assert small.objects["glass_0"].position[:2] == pytest.approx(large.objects["glass_0"].position[:2])
    assert small.objects["glass_0"].position[2] < large.objects["glass_0"].position[2]


def test_what_rests_on_a_thing_moves_with_it() -> None:
    scene = library.load("kitchen_t1")
    ranges = {"objects": {"table_0": {"dx_m": [0.3, 0.3], "dyaw_rad": [0.5, 0.5]}}}
    moved = vary(replace(scene, variation=ranges), 0)
    before = inverse(pose(scene.objects["table_0"])) @ pose(scene.objects["glass_0"])
    after = inverse(pose(moved.objects["table_0"])) @ pose(moved.objects["glass_0"])
    assert after == pytest.approx(before)
    assert moved.objects["glass_0"].position[0] > 0.2
    assert moved.robot == scene.robot


def test_a_scene_without_ranges_comes_back_as_it_is() -> None:
    scene = replace(library.load("kitchen_t1"), variation={})
    assert vary(scene, 5) is scene


@pytest.mark.parametrize(
    ("variation", "message"),
    [
        ({"robots": {}}, "has a key 'robots' that nothing reads"),
        ({"robot": {"dz_m": [0, 1]}}, "has a key 'dz_m' that nothing reads"),
        ({"robot": {"dx_m": [1, 0]}}, r"\.robot\.dx_m: expected \[low, high\], the lower one first, got \[1, 0\]"),
        ({"robot": {"dx_m": 0.1}}, r"expected 2 numbers \(low, high\), got 0.1"),
        ({"objects": {"fridge_0": {}}}, r"\.objects\.fridge_0: no such object"),
        ({"objects": {"glass_0": {"on": "desk_0", "edge": "+y"}}}, "no such object 'desk_0'"),
        (
            {"objects": {"glass_0": {"on": "table_0", "edge": "front"}}},
            r"expected '\+x', '-x', '\+y' or '-y', got \"front",
        ),
        (
            {"objects": {"glass_0": {"on": "table_0", "edge": "+y", "dx_m": [0, 1]}}},
            "has a key 'dx_m' that nothing reads",
        ),
        ({"robot": 5}, r"variation\.robot: expected an object, got 5"),
        ({"objects": [1]}, r"variation\.objects: expected an object, got \[1\]"),
        ({"objects": {"glass_0": 5}}, r"\.objects\.glass_0: expected an object, got 5"),
        ({"objects": {"glass_0": None}}, r"\.objects\.glass_0: expected an object, got null"),
        ({"objects": {"table_0": {"places": 5}}}, r"\.table_0\.places: expected a list, got 5"),
        ({"objects": {"table_0": {"places": [{}]}}}, r"\.table_0\.places\[0\]: the field 'x_m' is missing"),
        (
            {"objects": {"table_0": {"places": [{"x_m": 0, "y_m": 0}, [1]]}}},
            r"places\[1\]: expected an object, got \[1\]",
        ),
        (
            {"objects": {"table_0": {"places": [{"x_m": 0, "y_m": "far"}]}}},
            r"places\[0\]\.y_m: expected a number, got \"far\"",
        ),
        ({"objects": {"table_0": {"places": [{"x_m": 0, "y_m": 0, "yaw_rad": None}]}}}, "yaw_rad: expected a number"),
        ({"objects": {"glass_0": {"on": ["x"], "edge": "+y"}}}, r"\.on: expected a string, got \[\"x\"\]"),
        (
            {"objects": {"glass_0": {"on": "table_0", "edge": ["+y"]}}},
            r"\.edge: expected '\+x', '-x', '\+y' or '-y', got",
        ),
        ({"robot": {"dx_m": None}}, r"\.robot\.dx_m: expected 2 numbers \(low, high\), got null"),
        ({"robot": {"dx_m": ["a", "b"]}}, r"dx_m\[0\]: expected a number, got \"a\""),
        ({"robot": {"dx_m": [False, True]}}, r"dx_m\[0\]: expected a number, got false"),
        ({"robot": {"dx_m": [0, float("inf")]}}, r"dx_m\[[01]\]: expected a number, got"),
        ({"robot": {"dx_m": [float("nan"), 1]}}, r"dx_m\[[01]\]: expected a number, got"),
        ({"robot": {"dx_m": [0, 10**400]}}, r"dx_m\[[01]\]: expected a number, got"),
    ],
)
def test_wrong_declarations_are_named(variation: dict[str, object], message: str) -> None:
    scene = replace(library.load("kitchen_t1"), variation=variation)
    with pytest.raises(VariationError, match=message):
        vary(scene, 0)


@pytest.mark.physics
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", [0, 1, 2, 3])
def test_facts_are_true_in_the_settled_world(name: str, seed: int, make_world: MakeWorld) -> None:
    scene = vary(scene_at_paper_size(name), seed)
    world = make_world(scene)
    settle(world, 0.4)
    for fact in scene.facts:
        for literal in bddl.literals(fact) or ():
            assert read(literal.atom, world).value is literal.value
    for object_id in world.dynamic_ids:
        assert world.T_world_link(object_id)[:3, 3] == pytest.approx(scene.objects[object_id].position, abs=2e-3)
    assert not [contact for contact in world.contacts({"robot"}) if "robot" in (contact.a.owner, contact.b.owner)]
