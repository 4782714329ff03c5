"""The audit of the physics sees what it is there to see, and finds nothing in an episode as it is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchmarks.audit import audit, replay
from benchmarks.audit_watch import Watch, watching
from executor.assets.library import sample
from executor.audit.decision import holds
from executor.audit.geometry import Snapshot
from executor.bench.units import BenchSetting, Unit
from executor.bench.work import execute, prepare
from executor.sim.world import World
from executor.system.extras import load_sapien
from tests.executor.helpers import at, on_a_shelf, scene_at_paper_size

pytestmark = pytest.mark.physics
sapien = load_sapien()

Cheat = Callable[[World], Any]


def body(world: World) -> Any:
    return next(b for b in world.sapien_scene.physx_system.rigid_dynamic_components if b.entity.name == "glass_0")


def door(world: World) -> Any:
    links = world.sapien_scene.physx_system.articulation_link_components
    return next(link.articulation for link in links if link.articulation.name == "refrigerator_0")


def attach(world: World) -> None:
    hand = world.robot.find_link_by_name("panda_hand")
    world.sapien_scene.create_drive(hand, sapien.Pose(), body(world), sapien.Pose())


def assign_pose(world: World) -> None:
    body(world).entity.pose = sapien.Pose([0, 0, 2])


def assign_speed(world: World) -> None:
    body(world).linear_velocity = [1, 0, 0]


CHEATS: dict[str, Cheat] = {
    "Entity.set_pose": lambda world: world.set_object_pose("glass_0", at(0, 0, 2)),
    "Entity.pose": assign_pose,
    "PhysxArticulation.set_qpos": lambda world: world.set_joint_position("refrigerator_0", "door_hinge", 1.0),
    "PhysxArticulation.set_qvel": lambda world: world.robot.set_qvel(np.zeros(12, dtype=np.float32)),
    "PhysxArticulation.set_root_pose": lambda world: world.robot.set_root_pose(sapien.Pose()),
    "PhysxArticulation.create_fixed_tendon": lambda world: world.robot.create_fixed_tendon(
        [world.robot.find_link_by_name(n) for n in ("panda_hand", "panda_leftfinger", "panda_rightfinger")],
        [0.0, 1.0, -1.0],
        [0.0, 1.0, -1.0],
        stiffness=1.0,
    ),
    "PhysxArticulationJoint.set_drive_properties": lambda world: world.robot.active_joints[0].set_drive_properties(
        1, 1
    ),
    "PhysxArticulationJoint.set_friction": lambda world: door(world).active_joints[0].set_friction(0.0),
    "PhysxArticulationJoint.set_drive_target": lambda world: door(world).active_joints[0].set_drive_target(1.0),
    "PhysxRigidDynamicComponent.set_linear_velocity": lambda world: body(world).set_linear_velocity([0, 0, 1]),
    "PhysxRigidDynamicComponent.linear_velocity": assign_speed,
    "PhysxRigidDynamicComponent.set_kinematic": lambda world: world.hold("glass_0", still=True),
    "PhysxRigidBodyComponent.set_mass": lambda world: body(world).set_mass(0.001),
    "PhysxRigidBodyComponent.set_disable_gravity": lambda world: body(world).set_disable_gravity(True),
    "PhysxRigidBodyComponent.add_force_at_point": lambda world: body(world).add_force_at_point([0, 0, 9], [0, 0, 0]),
    "Scene.create_drive": attach,
    "PhysxDriveComponent": attach,
    "PhysxDistanceJointComponent": lambda world: sapien.physx.PhysxDistanceJointComponent(body(world)),
    "Scene.set_timestep": lambda world: world.sapien_scene.set_timestep(1e-3),
    "PhysxCpuSystem.unpack": lambda world: world.unpack(world.pack()),
}


PICKING = Unit("T6", 62900, 4, BenchSetting())


@pytest.fixture
def watch() -> Iterator[Watch]:
    with watching() as watch:
        yield watch


@pytest.mark.parametrize("call", CHEATS)
def test_every_forbidden_call_on_a_live_world_is_caught(call: str, watch: Watch) -> None:
    with World(scene_at_paper_size("kitchen_t1")) as world:
        world.step()
        assert watch.caught == [], "building a world is no cheating"
        CHEATS[call](world)
    assert any(caught.startswith((f"{call} on", f"{call} made")) for caught in watch.caught), watch.caught


def test_what_decides_the_physics_is_looked_at_again(watch: Watch) -> None:
    with World(scene_at_paper_size("kitchen_t1")) as world:
        world.step()
        for shape in body(world).collision_shapes:
            shape.set_collision_groups([0, 0, 0, 0])
        for _ in range(250):
            world.step()
    assert len(set(watch.logs[-1].makeup)) == 2


def test_a_state_that_no_world_was_in_may_not_be_gone_on_from(watch: Watch) -> None:
    scene = scene_at_paper_size("kitchen_t1")
    with World(scene) as world:
        world.step()
        state = world.pack()
    with World(scene) as world:
        world.unpack(state)
        assert watch.caught == [] and watch.restored == 1
    forged = bytearray(state)
    forged[-3] ^= 1
    with World(scene) as world:
        world.unpack(bytes(forged))
    assert watch.caught == ["PhysxCpuSystem.unpack on world"]


def test_a_collision_oracle_may_put_things_where_it_likes(watch: Watch) -> None:
    with World(scene_at_paper_size("kitchen_t1"), oracle=True) as world:
        world.step()
        world.set_object_pose("glass_0", at(0, 0, 2))
        world.step()
    assert watch.caught == [] and watch.logs == []


def test_nothing_stays_hooked() -> None:
    before = sapien.physx.PhysxArticulation.set_qpos, sapien.Entity.pose
    with watching():
        assert sapien.physx.PhysxArticulation.set_qpos is not before[0]
    assert (sapien.physx.PhysxArticulation.set_qpos, sapien.Entity.pose) == before
    assert "step" not in vars(sapien.physx.PhysxCpuSystem)


@pytest.mark.slow
def test_an_episode_is_clean_agrees_with_a_second_geometry_and_replays() -> None:
    found = audit(PICKING)
    assert found.succeeded and found.clean, found
    assert found.steps > 2000 and found.measured["finger force peak, N"] > 20.0


@pytest.mark.slow
def test_a_replay_without_the_hand_and_a_goal_that_does_not_hold_are_told() -> None:
    done, _ = execute(PICKING, *prepare(PICKING))
    done.trajectory.robot_target[:, 10:] = 0.028  # The fingers never close.
    with World(done.scene) as world:
        before, after = (Snapshot(world, state) for state in (done.trajectory.packed_states[0], replay(done)))
    assert not holds(done.task.goal, done.scene, before, before)
    assert not holds(done.task.goal, done.scene, before, after)


def test_the_second_geometry_knows_what_is_set_upright_and_what_is_out_from_under_a_board() -> None:
    scene = on_a_shelf(0.12)
    half = 0.5**0.5
    fallen = replace(scene.objects["can_0"], orientation=(half, 0.0, half, 0.0))
    shots = []
    for one, off_m, R in (
        (scene, 0.0, np.eye(3)),
        (scene, 0.3, np.eye(3)),
        (replace(scene, objects={**scene.objects, "can_0": fallen}), 0.0, None),
    ):
        with World(one) as world:
            place = world.T_world_link("can_0")
            place[0, 3] -= off_m
            world.set_object_pose("can_0", place if R is None else at(*place[:3, 3], R))
            shots.append(Snapshot(world, world.pack()))
    stands, out, lies = shots
    assert stands.is_roofed("can_0") and not out.is_roofed("can_0")
    assert stands.tilt_deg("can_0", lies) < 1.0 and lies.tilt_deg("can_0", lies) < 1.0
    assert lies.tilt_deg("can_0", stands) > 80.0


@pytest.mark.parametrize(
    ("noun", "extent_m", "up_m", "is_on"),
    [
        pytest.param("carton", (0.12, 0.09, 0.05), 0.0, True, id="across the rim"),
        pytest.param("carton", (0.12, 0.09, 0.05), 0.02, False, id="above it"),
        pytest.param("die", (0.03, 0.03, 0.03), -0.07, False, id="inside"),
        # Of a ball of 37 mm radius, 16 mm hang into a mouth of 30 mm radius.
        pytest.param("red_apple", (0.074, 0.074, 0.074), -0.014, True, id="a ball in the rim"),
        pytest.param("red_apple", (0.074, 0.074, 0.074), -0.03, False, id="a ball that goes through"),
    ],
)
def test_what_lies_across_a_rim_is_on_it(noun: str, extent_m: tuple[float, ...], up_m: float, is_on: bool) -> None:
    x, y, z = extent_m
    cup = replace(sample("cup", 0, "cup_0"), bbox_extent=(0.061, 0.061, 0.09))
    thing = replace(sample(noun, 0, "thing_0"), bbox_extent=(x, y, z))
    scene = scene_at_paper_size("kitchen_t1")
    with World(replace(scene, objects={**scene.objects, "cup_0": cup, "thing_0": thing})) as world:
        world.set_object_pose("cup_0", at(-1.0, 1.0, 0.045))
        world.set_object_pose("thing_0", at(-1.0, 1.0, 0.09 + up_m + z / 2))
        assert Snapshot(world, world.pack()).is_on("thing_0", "cup_0") is is_on
