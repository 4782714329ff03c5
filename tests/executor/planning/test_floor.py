"""The floor by footprints agrees with the engine: what it calls taken is taken, doors where they stand."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from executor.planning.collision import CollisionOracle
from executor.planning.planner import Planner
from executor.planning.stances import is_base_free
from executor.sim.world import World
from tests.executor.helpers import scene_at_paper_size

pytestmark = pytest.mark.physics
DOOR = ("refrigerator_0", "door_hinge")


@pytest.fixture(scope="module")
def kitchen() -> Iterator[Planner]:
    """A planner of kitchen_t1."""
    scene = scene_at_paper_size("kitchen_t1")
    with World(scene) as world, World(scene, oracle=True) as oracle:
        world.step()
        planner = Planner(CollisionOracle(oracle))
        planner.start_subtask(world, 0, 0)
        yield planner


@settings(max_examples=60)
@given(
    x_m=st.floats(-1.5, 2.0),
    y_m=st.floats(-2.0, 1.5),
    yaw_rad=st.floats(-np.pi, np.pi),
    door_rad=st.floats(0.0, 1.8),
)
def test_what_is_taken_by_footprints_is_taken(
    kitchen: Planner, x_m: float, y_m: float, yaw_rad: float, door_rad: float
) -> None:
    base = np.array([x_m, y_m, yaw_rad])
    kitchen.oracle.set_joint(DOOR, door_rad)
    if kitchen.floor.taken(base[None])[0]:
        assert not is_base_free(kitchen, base, 0.0)


def test_most_of_what_the_engine_refuses_is_known_without_it(kitchen: Planner) -> None:
    kitchen.oracle.set_joint(DOOR, 1.5)
    rng = np.random.default_rng(0)
    bases = rng.uniform([-0.5, -1.6, -np.pi], [1.3, 0.8, np.pi], (150, 3))
    refused = np.array([not is_base_free(kitchen, base, 0.0) for base in bases])
    taken = kitchen.floor.taken(bases)
    assert not (taken & ~refused).any()
    assert taken.sum() > 0.5 * refused.sum() > 10


def test_a_door_takes_the_floor_where_it_stands(kitchen: Planner) -> None:
    hinge = kitchen.oracle.world.assets[DOOR[0]].joint(DOOR[1])
    before = [[x, 0.0, 0.0] for x in np.arange(-0.2, 0.6, 0.05)]
    counts = []
    for position in (0.0, hinge.position(0.3)):
        kitchen.oracle.set_joint(DOOR, position)
        counts.append(int(kitchen.floor.taken(np.array(before)).sum()))
    assert counts[0] < counts[1]


@pytest.mark.parametrize(("robot", "remembered"), [("panda-lift", True), ("paper", False)])
def test_a_line_that_was_planned_is_remembered_where_no_stored_result_counts_the_effort(
    robot: str, remembered: bool
) -> None:
    scene = scene_at_paper_size("kitchen_t1").with_robot(robot)
    with World(scene, oracle=True) as oracle:
        planner = Planner(CollisionOracle(oracle))
        q = np.array(planner.robot.start(-0.5, 0.0, 0.0))[: planner.robot.movers]
        T = planner.kinematics.forward(q)
        T[2, 3] -= 0.03
        first, second = planner.line(q, T), planner.line(q, T)
        assert first.path is not None and second.path is not None
        assert np.array_equal(first.path, second.path) and (first is second) is remembered
        T[2, 3] -= 0.03
        farther = planner.line(q, T).path
        assert farther is not None and not np.array_equal(first.path, farther)
