"""How near a hand is to what it can take: to the bar of a handle, or to the thing, not to the middle of either."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from executor.assets.library import asset_for
from executor.envs.episodes import hand_distance_m
from executor.geometry import Array, transform
from executor.learn.evaluation import NEAR_M, OutcomeWatch
from executor.sim.engine import ROBOT
from executor.sim.world import World
from oag import SceneObject
from oag.model.actions import flow_from_json
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import scene_object

FIXTURES = [
    ("refrigerator", None),
    ("cabinet_drawers", (0.5, 0.8, 0.9)),
    ("oven", (0.5, 0.8, 0.9)),
    ("microwave", None),
]
ITEMS = ["water_glass", "bowl", "apple", "bottle", "book"]
EXTENTS = {"microwave": (0.4, 0.5, 0.3), "bottle": (0.06, 0.06, 0.28), "book": (0.2, 0.14, 0.03)}


class _Placed:
    """A world in which one thing stands anywhere, each link of it somewhere else, and the hand is where it is put."""

    model = PAPER_ROBOT

    def __init__(self, thing: SceneObject, seed: int) -> None:
        asset, self.scene = asset_for(thing), SimpleNamespace(objects={"it": thing})
        self.assets, self.hand_m, self.time_s = {"it": asset}, np.zeros(3), 0.0
        rng = np.random.default_rng(seed)
        self.links = {
            name: transform(Rotation.random(random_state=int(rng.integers(999))).as_matrix(), rng.normal(size=3))
            for name in (None, *(link.name for link in asset.links))
        }

    def T_world_link(self, object_id: str, link: str | None = None) -> Array:
        return (
            transform(np.eye(3), self.hand_m)
            if (object_id, link) == (ROBOT, PAPER_ROBOT.tip_link)
            else self.links[link]
        )

    def contacts(self, of: object) -> list[Any]:
        return []

    def joint_position(self, object_id: str, joint: str) -> float:
        return 0.0


def _world(category: str, extent: tuple[float, float, float] | None, seed: int = 0) -> _Placed:
    return _Placed(replace(scene_object(category, extent or EXTENTS.get(category)), model=category), seed)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(("category", "extent"), FIXTURES)
def test_anywhere_on_a_bar_is_at_the_handle(
    category: str, extent: tuple[float, float, float] | None, seed: int
) -> None:
    world = _world(category, extent, seed)
    for handle in world.assets["it"].handles:
        T, axis, middle = world.T_world_link("it", handle.link), np.array(handle.axis), np.array(handle.position_m)
        aside = np.cross(axis, handle.outward)
        for share in (-1.0, -0.6, 0.0, 0.9, 1.0):
            for off_m in (0.0, 0.03):
                local = middle + share * handle.length_m / 2 * axis + off_m * aside
                world.hand_m = (T @ np.array([*local, 1.0]))[:3]
                assert hand_distance_m(cast(World, world), "it") == pytest.approx(off_m, abs=1e-9)
        world.hand_m = (T @ np.array([*(middle + (handle.length_m / 2 + 0.08) * axis), 1.0]))[:3]
        assert hand_distance_m(cast(World, world), "it") <= 0.08 + 1e-9


@pytest.mark.parametrize("category", ITEMS)
def test_a_thing_is_as_near_as_its_box_however_it_lies(category: str) -> None:
    world = _world(category, None, seed=3)
    T, half = world.T_world_link("it"), np.array(world.assets["it"].extent_m) / 2
    rng = np.random.default_rng(4)
    for axis in range(3):
        for sign in (-1.0, 1.0):
            local = rng.uniform(-0.9, 0.9, 3) * half
            world.hand_m = (T @ np.array([*local, 1.0]))[:3]
            assert hand_distance_m(cast(World, world), "it") == 0.0
            local[axis] = sign * (half[axis] + 0.07)
            world.hand_m = (T @ np.array([*local, 1.0]))[:3]
            assert hand_distance_m(cast(World, world), "it") == pytest.approx(0.07)


def _failure(world: _Placed, primitives: list[Any], local_m: Array, link: str | None) -> str:
    """What is recorded of an episode in which the hand was once at a place, in a link's frame, and nothing else."""
    subtask = SimpleNamespace(target="it", flow=flow_from_json(primitives))
    world.hand_m = np.full(3, 9.0)
    watch = OutcomeWatch(cast(Any, SimpleNamespace(task=SimpleNamespace(subtasks=[subtask]))), cast(World, world))
    world.hand_m = (world.T_world_link("it", link) @ np.array([*local_m, 1.0]))[:3]
    world.time_s += 0.1
    watch.look({})
    outcome = watch.outcome(0)
    assert np.isfinite(outcome.measured["nearest_m"])
    return outcome.failure


@pytest.mark.parametrize(("category", "extent"), FIXTURES)
def test_who_was_at_the_end_of_a_bar_reached_it(category: str, extent: tuple[float, float, float] | None) -> None:
    world = _world(category, extent)
    handle = max(world.assets["it"].handles, key=lambda handle: handle.length_m)
    end = np.array(handle.position_m) + handle.length_m / 2 * np.array(handle.axis)
    outward = np.array(handle.outward)
    opening = [17, 1, 2, 3, 4, 5, 6]
    assert _failure(world, opening, end + 0.8 * NEAR_M * outward, handle.link) == "not-grasped"
    far = np.array(handle.position_m) + 5.0 * outward
    assert _failure(world, opening, far, handle.link) == "not-reached"


def test_who_was_at_the_top_of_a_tall_bottle_reached_it() -> None:
    world = _world("bottle", None)
    world.links[None] = transform(np.eye(3), (1.0, 2.0, 0.5))
    assert _failure(world, [17, 1, 2, 3, 7], np.array([0.0, 0.0, 0.13]), None) == "not-grasped"
    assert _failure(world, [17, 1, 2, 3, 7], np.array([0.0, 0.0, 0.13 + 0.01 + NEAR_M + 0.01]), None) == "not-reached"
