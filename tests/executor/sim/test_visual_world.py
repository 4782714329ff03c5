"""The world with visuals: packed states go both ways, and the robot is light enough to draw."""

from __future__ import annotations

import numpy as np
import pytest

from executor.system.extras import load_sapien
from executor.system.vulkan import activate
from tests.executor.helpers import MakeWorld, settle

pytestmark = [pytest.mark.physics, pytest.mark.render]


@pytest.fixture(scope="module", autouse=True)
def renderer() -> None:
    activate()


@pytest.mark.parametrize("name", ["kitchen_t1", "kitchen_t3"])
def test_packed_states_go_both_ways(name: str, make_world: MakeWorld) -> None:
    unseen, seen = make_world(name), make_world(name, visual=True)
    settle(unseen, 0.2)
    assert len(seen.pack()) == len(unseen.pack())
    seen.unpack(unseen.pack())
    assert seen.state_vector().tobytes() == unseen.state_vector().tobytes()
    for link, twin in zip(unseen.robot.links, seen.robot.links, strict=True):
        assert link.name == twin.name
        assert np.asarray(link.entity_pose.p) == pytest.approx(np.asarray(twin.entity_pose.p), abs=1e-6)
    seen.step()
    unseen.step()
    unseen.unpack(seen.pack())
    assert seen.state_vector().tobytes() == unseen.state_vector().tobytes()


def test_every_body_is_drawn_and_the_robot_is_light(make_world: MakeWorld) -> None:
    sapien = load_sapien()

    world = make_world("kitchen_t3", visual=True)
    body_type = sapien.render.RenderBodyComponent
    for object_id in world.assets:
        for body in world._built[object_id].bodies.values():
            assert body.entity.find_component_by_type(body_type).render_shapes
    triangles = 0
    for link in world.robot.links:
        drawn = link.entity.find_component_by_type(body_type)
        for shape in drawn.render_shapes if drawn else ():
            if isinstance(shape, sapien.render.RenderShapeTriangleMesh):
                triangles += sum(len(part.triangles) for part in shape.parts)
    assert 8_000 < triangles < 20_000
