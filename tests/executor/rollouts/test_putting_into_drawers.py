"""A glass goes into a cabinet of drawers: opened is one into which a hand can put it, not the largest."""

from __future__ import annotations

import numpy as np
import pytest

import executor
import llm
import oag
from executor.scenes.placement import AtEdge, PlaceSpec, place, stand_robot
from executor.scenes.room import Room, against, stand
from oag.measurements import JointMotion, first_of

pytestmark = [pytest.mark.physics, pytest.mark.slow]


def test_a_drawer_that_serves_is_opened_not_the_lowest() -> None:
    room = Room("drawers", "kitchen", np.random.default_rng(3), depth_m=3.6, width_m=4.0)
    size = {"x": 0.6, "y": 0.5, "z": 0.8}
    cabinet = room.draw("cabinet_drawers", extent_m=size, parameters={"drawers": 3})
    against(room, "east", cabinet, 0.3)
    table = stand(room, room.draw("table_four_legs", extent_m={"z": 0.7}), -0.6, -1.1, yaw_rad=0.0)
    glass = room.draw("tumbler", extent_m={"x": 0.07, "y": 0.07, "z": 0.12})
    place(room, glass, PlaceSpec(table, at=AtEdge("+y", (0.08, 0.16))))
    stand_robot(room)
    scene = room.scene()
    done = executor.rollout(oag.compose(llm.propose("put the glass into the cabinet", scene).task), scene)
    assert done.succeeded, done.failure
    opened = [motion.joint for step in done.subtasks[0].steps if (motion := first_of(step.measurements, JointMotion))]
    assert opened != ["drawer_3_slide"], "no hand reaches into the lowest one"
