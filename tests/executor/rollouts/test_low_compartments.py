"""Things nearly as high as the compartment that they are put into."""

from __future__ import annotations

import numpy as np
import pytest

import executor
import llm
import oag
from executor.assets.library import asset_for
from executor.scenes.placement import AtEdge, PlaceSpec, place, stand_robot
from executor.scenes.room import Room, against, stand
from oag import Scene
from oag.model.robots import LIFTED

pytestmark = pytest.mark.physics


def a_bottle_and_a_refrigerator(spare_m: float) -> Scene:
    """Return a bottle on a table and a refrigerator whose highest compartment has so much room above it."""
    room = Room("low", "kitchen", np.random.default_rng(2), depth_m=3.6, width_m=4.0)
    parameters = {"hinge": "right", "shelves": 3}
    size = {"x": 0.70, "y": 0.66, "z": 1.20}
    fridge = room.draw("fridge_one_door", extent_m=size, parameters=parameters)
    against(room, "east", fridge, 0.6)
    highest_m = max(2 * region.half_extents_m[2] for region in asset_for(fridge).regions)
    table = room.draw("table_four_legs")
    stand(room, table, -0.3, -1.1, yaw_rad=0.0)
    bottle = room.draw("bottle", extent_m={"x": 0.06, "y": 0.06, "z": highest_m - spare_m})
    place(room, bottle, PlaceSpec(table.id, at=AtEdge("-x", (0.08, 0.12), (-0.1, 0.1))))
    stand_robot(room)
    return room.scene().with_robot(LIFTED.name)


@pytest.mark.parametrize(("spare_m", "feasible"), [(0.025, True), pytest.param(0.001, False, marks=pytest.mark.slow)])
def test_a_bottle_goes_under_a_board_that_is_a_little_higher(spare_m: float, feasible: bool) -> None:
    scene = a_bottle_and_a_refrigerator(spare_m)
    task = llm.propose("put the bottle into the refrigerator", scene).task
    found = executor.feasible(oag.compose(task), scene, vary=False)
    assert found.feasible is feasible, found.reason
    if not feasible:
        assert "no spot is free" in found.reason, "without a search"
        assert found.effort_s < 12.0
