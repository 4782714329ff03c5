"""The world: the same bits every time, no renderer needed, poses that are never stale."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from executor.scenes.generators import household
from executor.sim.engine import GROUND, ROBOT, BodyRef, Physics
from executor.sim.world import World
from tests.executor.helpers import MakeWorld, at, scene_at_paper_size, scene_object, settle

pytestmark = pytest.mark.physics
SCENES = ("kitchen_t1", "kitchen_t3")


def drive(world: World, steps: int) -> None:
    """Move base, arm and fingers, so that everything is awake."""
    for step in range(steps):
        targets = (0.2 * np.sin(step / 60), -0.3 - step / 4000, 0.1, 0.2, -0.7, 0.1, -2.2, 0.0, 2.5, 0.8, 0.01, 0.01)
        for joint, target in zip(world.robot.active_joints, targets, strict=True):
            joint.set_drive_target(float(target))
        world.step()


@pytest.mark.parametrize("name", SCENES)
def test_equal_commands_give_equal_bits(name: str, make_world: MakeWorld) -> None:
    first, second = make_world(name), make_world(name)
    for world in (first, second):
        drive(world, 400)
    assert first.state_vector().tobytes() == second.state_vector().tobytes()
    assert first.pack() == second.pack()
    assert first.contacts() == second.contacts()


@pytest.mark.parametrize("name", SCENES)
def test_a_packed_state_unpacks_in_a_fresh_world(name: str, make_world: MakeWorld) -> None:
    world, fresh = make_world(name), make_world(name)
    drive(world, 200)
    fresh.unpack(world.pack())
    assert fresh.state_vector().tobytes() == world.state_vector().tobytes()
    for object_id in world.articulated_ids:
        for link in world.assets[object_id].links:
            here = world.T_world_link(object_id, link.name)
            assert fresh.T_world_link(object_id, link.name) == pytest.approx(here, abs=1e-6)


def test_two_continuations_of_a_checkpoint_are_equal(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    settle(world, 0.4)
    ends = []
    for _ in range(2):
        again = make_world("kitchen_t3")
        again.unpack(world.pack())
        drive(again, 200)
        ends.append(again.state_vector().tobytes())
    assert ends[0] == ends[1]


def test_a_state_of_another_scene_is_refused(make_world: MakeWorld) -> None:
    with pytest.raises(ValueError, match="other objects"):
        make_world("kitchen_t1").unpack(make_world("kitchen_t3").pack())


@pytest.mark.parametrize("name", SCENES)
def test_objects_rest_where_the_scene_puts_them(name: str, make_world: MakeWorld) -> None:
    world = make_world(name)
    settle(world, 1.0)
    for object_id in world.dynamic_ids:
        start = world.scene.objects[object_id].position
        assert world.T_world_link(object_id)[:3, 3] == pytest.approx(start, abs=1e-3)


def test_contacts_name_each_pair_once_with_the_robot_first(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    settle(world, 0.2)
    contacts = world.contacts()
    pairs = {(contact.a, contact.b) for contact in contacts}
    assert len(pairs) == len(contacts)
    assert (BodyRef("bowl_0", "bowl"), BodyRef("table_0", "table")) in pairs
    assert all(abs(contact.separation_m) < 1e-3 and contact.impulse_ns > 0 for contact in contacts)
    weight_ns = sum(contact.impulse_ns for contact in contacts if contact.a.owner == "apple_0")
    assert weight_ns / world.timestep_s == pytest.approx(0.0511 * 9.81, rel=0.05)


def test_contacts_of_some_owners_only(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    settle(world, 0.2)
    assert {contact.a.owner for contact in world.contacts({"apple_0"})} == {"apple_0"}
    assert world.contacts({ROBOT}) == ()


def test_bodies_are_damped_as_their_assets_say(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t3")
    for object_id in world.dynamic_ids:
        (body,) = world._built[object_id].bodies.values()
        assert body.angular_damping == pytest.approx(world.assets[object_id].angular_damping)
        assert body.linear_damping == pytest.approx(world.assets[object_id].linear_damping)


def test_a_dropped_thing_touches_the_ground(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    world.set_object_pose("glass_0", at(-1.5, 0.0, 0.05))
    settle(world, 0.5)
    assert [contact.b for contact in world.contacts({"glass_0"})] == [BodyRef(GROUND, GROUND)]


def test_door_pose_follows_its_joint_at_once(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    shut = world.T_world_link("refrigerator_0", "door")
    world.set_joint_position("refrigerator_0", "door_hinge", 1.2)
    opened = world.T_world_link("refrigerator_0", "door")
    assert world.joint_position("refrigerator_0", "door_hinge") == pytest.approx(1.2)
    assert opened[:3, 3] == pytest.approx(shut[:3, 3])
    engine = world._built["refrigerator_0"].articulation.links[1].entity_pose.to_transformation_matrix()
    assert opened == pytest.approx(engine, abs=1e-6)


def test_a_scene_can_start_with_an_open_door(make_world: MakeWorld) -> None:
    scene = scene_at_paper_size("kitchen_t1")
    fridge = scene_object("refrigerator", open_fraction=0.5)
    world = make_world(scene.__class__(scene.name, scene.robot, {"refrigerator_0": fridge}))
    low, high = world.assets["refrigerator_0"].joint("door_hinge").limits
    assert world.joint_position("refrigerator_0", "door_hinge") == pytest.approx((low + high) / 2)


def test_an_oracle_reports_contacts_of_poses_and_moves_nothing(make_world: MakeWorld) -> None:
    oracle = make_world("kitchen_t1", oracle=True)
    oracle.set_object_pose("glass_0", at(0.0, -1.12, 0.9))
    oracle.step()
    assert oracle.contacts({"glass_0"}) == ()
    oracle.set_object_pose("glass_0", at(0.0, -1.12, 0.60 + 0.0426 - 0.01))
    oracle.step()
    (contact,) = oracle.contacts({"glass_0"})
    assert contact.b.owner == "table_0" and contact.separation_m == pytest.approx(-0.01, abs=1e-4)
    oracle.set_object_pose("glass_0", at(0.0, -1.12, 0.9))
    assert oracle._built["glass_0"].bodies["glass"].disable_gravity
    assert not make_world("kitchen_t1")._built["glass_0"].bodies["glass"].disable_gravity


def test_an_oracle_sees_the_held_thing_and_the_open_door(make_world: MakeWorld) -> None:
    oracle = make_world("kitchen_t1", oracle=True)
    oracle.set_joint_position("refrigerator_0", "door_hinge", 1.5)
    handle = oracle.assets["refrigerator_0"].handles[0]
    T_world_door = oracle.T_world_link("refrigerator_0", "door")
    oracle.set_object_pose("glass_0", at(*(T_world_door @ [*handle.position_m, 1.0])[:3]))
    oracle.step()
    assert [(c.b.owner, c.b.link) for c in oracle.contacts({"glass_0"})] == [("refrigerator_0", "door")]


def test_misuse_is_named(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    with pytest.raises(ValueError, match="table_0 is not a dynamic object; those are glass_0"):
        world.set_object_pose("table_0", np.eye(4))
    with pytest.raises(KeyError, match="no joint 'lid'; it has door_hinge"):
        world.joint_position("refrigerator_0", "lid")
    with pytest.raises(KeyError, match="no link 'lid'; it has body, door"):
        world.T_world_link("refrigerator_0", "lid")


def test_time_counts_steps(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1", physics=Physics(timestep_s=1 / 100))
    settle(world, 0.5)
    assert world.time_s == pytest.approx(0.5)


def run_python(code: str, **environment: str) -> subprocess.CompletedProcess[str]:
    root = Path(__file__).parents[3]
    return subprocess.run(
        [sys.executable, "-W", "ignore", "-c", textwrap.dedent(code)],
        env=os.environ | {"PYTHONPATH": str(root)} | environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )


def test_physics_needs_no_renderer_and_an_error_ends_the_process_normally() -> None:
    code = """
        from executor.scenes import library
        from executor.sim.world import World
        world = World(library.load("kitchen_t1"))
        for _ in range(10):
            world.step()
        print("stepped", world.steps)
        raise SystemError("on purpose")
    """
    done = run_python(code, VK_DRIVER_FILES="/nonexistent.json", VK_ICD_FILENAMES="/nonexistent.json")
    assert done.stdout == "stepped 10\n"
    assert done.returncode == 1 and done.stderr.rstrip().endswith("SystemError: on purpose")


def test_visuals_without_a_renderer_are_refused_in_one_sentence() -> None:
    code = """
        from executor.scenes import library
        from executor.sim.engine import RendererMissing
        from executor.sim.world import World
        try:
            World(library.load("kitchen_t1"), visual=True)
        except RendererMissing as missing:
            print(missing)
    """
    done = run_python(code, VK_DRIVER_FILES="/nonexistent.json", VK_ICD_FILENAMES="/nonexistent.json")
    assert done.returncode == 0 and "scene2demo doctor" in done.stdout


@pytest.mark.parametrize("start_rad", [0.23, 0.24, 0.30, 0.38])
def test_a_door_passes_its_neighbour_by_a_millimetre(start_rad: float) -> None:
    # The door's free edge comes in beside a counter that touches the refrigerator: 0.8 mm are left between them.
    with World(household.pair(51001, 26).scene) as world:
        world.set_joint_position("refrigerator_0", "door_hinge", start_rad)
        door = next(a for a in world.sapien_scene.get_all_articulations() if a.name == "refrigerator_0")
        for _ in range(300):
            door.set_qvel(np.array([-0.4], dtype=np.float32))
            world.step()
        assert world.joint_position("refrigerator_0", "door_hinge") == pytest.approx(0.0, abs=1e-3)
