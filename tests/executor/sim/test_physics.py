"""Settings of an experiment reach the engine, and the usual ones change nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from executor.sim.engine import STANDARD, Physics
from executor.sim.robot.description import FINGER_FRICTION
from executor.sim.world import World
from oag.model.robots import PAPER_ROBOT
from tests.executor.helpers import MakeWorld, settle

pytestmark = pytest.mark.physics


def body(world: World, name: str) -> Any:
    bodies = world.sapien_scene.physx_system.rigid_dynamic_components
    return next(each for each in bodies if each.entity.name == name)


def limits(world: World) -> np.ndarray:
    return np.array([joint.force_limit for joint in world.robot.active_joints])


def finger_friction(world: World) -> set[tuple[float, float]]:
    shapes = [s for name in PAPER_ROBOT.finger_links for s in world.robot.find_link_by_name(name).collision_shapes]
    materials = [shape.physical_material for shape in shapes]
    return {(round(m.static_friction, 6), round(m.dynamic_friction, 6)) for m in materials}


def test_every_setting_is_read_back_from_the_engine(make_world: MakeWorld) -> None:
    other = Physics(
        timestep_s=1 / 500,
        finger_friction=0.6,
        damping=2.0,
        item_mass=3.0,
        base_force=0.5,
        arm_force=0.25,
        grip_force=2.0,
    )
    usual, changed = make_world("kitchen_t1"), make_world("kitchen_t1", physics=other)
    glass, heavy = (body(world, "glass_0") for world in (usual, changed))
    assert changed.sapien_scene.timestep == pytest.approx(1 / 500)
    assert heavy.mass == pytest.approx(3.0 * glass.mass)
    assert heavy.inertia == pytest.approx(3.0 * glass.inertia)
    assert heavy.angular_damping == pytest.approx(2.0 * glass.angular_damping)
    assert limits(changed) / limits(usual) == pytest.approx([0.5] * 3 + [0.25] * 7 + [2.0] * 2)
    assert finger_friction(usual) == {(FINGER_FRICTION, FINGER_FRICTION)}
    assert finger_friction(changed) == {(0.6, 0.6)}


def test_joint_friction_is_what_a_door_resists_with(make_world: MakeWorld) -> None:
    speeds = []
    for factor in (1.0, 2.0):
        world = make_world("kitchen_t1", physics=Physics(joint_friction=factor))
        joint = world.assets["refrigerator_0"].joints[0]
        links = world.sapien_scene.physx_system.articulation_link_components
        door = next(link for link in links if link.articulation.name == "refrigerator_0" and not link.is_root)
        # Opened wide, where no gasket pulls, and pushed with 1.5 times what it asks usually.
        usual = joint.friction / factor
        world.set_joint_position("refrigerator_0", joint.name, 0.8)
        world.step()
        for _ in range(50):
            door.add_force_torque([0.0, 0.0, 0.0], np.array([0.0, 0.0, np.sign(joint.axis[2]) * 1.5 * usual]))
            world.step()
        speeds.append(float(door.articulation.get_qvel()[0]))
    assert speeds[0] > 0.02 and abs(speeds[1]) < 1e-3, speeds


def test_the_usual_settings_change_no_bit(make_world: MakeWorld) -> None:
    first, second = make_world("kitchen_t3"), make_world("kitchen_t3", physics=Physics())
    settle(first, 0.2)
    settle(second, 0.2)
    assert np.array_equal(first.state_vector(), second.state_vector())
    assert STANDARD.of(first.assets["apple_0"]) is first.assets["apple_0"]


def test_a_setting_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="grip_force has to be more than 0"):
        Physics(grip_force=0.0)
