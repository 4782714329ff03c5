"""Nothing lets the robot pass through furniture, and its forearm does not pass through its own pedestal."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from executor.assets.library import LIBRARY, sample
from executor.planning.cargo import Carried
from executor.planning.collision import CollisionOracle
from executor.sim.engine import ROBOT
from executor.sim.robot.description import BASE_LINK, MAST_LINK
from executor.sim.world import World
from oag import Scene
from oag.model.robots import PAPER_ROBOT
from oag.model.scene import RobotPose
from tests.executor.helpers import MakeWorld, at, scene_at_paper_size

pytestmark = pytest.mark.physics

UPPER = ("base_body", "panda_link0", "panda_link1", "panda_link2")
LOWER = ("panda_link5", "panda_link6", "panda_link7", "panda_hand", "panda_leftfinger", "panda_rightfinger")
FOLDED = np.array([0.0, 0.6, 0.0, -3.0, 0.0, 0.1, 0.785])
"""The wrist bent back until the hand is in the pedestal."""

Groups = list[int]


def collide(a: Groups, b: Groups) -> bool:
    """The engine's filter: types must meet affinities, and a shared ignore bit switches the pair off."""
    return bool(a[0] & b[1] or a[1] & b[0]) and not (a[2] & b[2])


def groups(world: World) -> dict[tuple[str, str], list[Groups]]:
    """Return (owner, link) -> the collision groups of its shapes."""
    found: dict[tuple[str, str], list[Groups]] = {}
    for body, ref in world._owner_of.items():
        shapes = [list(shape.get_collision_groups()) for shape in body.collision_shapes]
        found[ref.owner, ref.link] = shapes
    return found


@pytest.fixture(scope="module")
def every_model() -> Scene:
    """One of every model of the library, far from each other."""
    objects = {}
    for index, model in enumerate(sorted(LIBRARY)):
        item = sample(model, 0, f"thing_{index}")
        objects[item.id] = item
    return Scene(name="everything", robot=RobotPose(), objects=objects, facts=(), closed=frozenset())


def test_every_pair_of_the_robot_and_another_thing_collides(every_model: Scene) -> None:
    with World(every_model) as world:
        found = groups(world)
    robot = {key: shapes for key, shapes in found.items() if key[0] == ROBOT}
    others = {key: shapes for key, shapes in found.items() if key[0] != ROBOT}
    assert sum(len(shapes) for shapes in robot.values()) > 10
    assert len({owner for owner, _ in others}) == len(LIBRARY) + 1
    for mine in robot.values():
        for theirs in others.values():
            assert all(collide(a, b) for a in mine for b in theirs)


def test_things_collide_with_each_other(every_model: Scene) -> None:
    with World(every_model) as world:
        found = groups(world)
    alike = {tuple(shape) for key, shapes in found.items() if key[0] != ROBOT for shape in shapes}
    assert all(collide(list(a), list(b)) for a, b in combinations([*alike, *alike], 2))


def test_the_forearm_collides_with_base_and_upper_arm_and_neighbours_do_not(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    shapes = {link: found for (owner, link), found in groups(world).items() if owner == ROBOT}
    for upper in UPPER:
        for lower in LOWER:
            assert all(collide(a, b) for a in shapes[upper] for b in shapes[lower])
    for one, other in (("panda_link0", "panda_link1"), ("panda_link2", "panda_link3"), ("panda_link6", "panda_hand")):
        assert not any(collide(a, b) for a in shapes[one] for b in shapes[other])


def test_the_oracle_sees_the_hand_in_the_robots_own_pedestal() -> None:
    with World(scene_at_paper_size("kitchen_t1"), oracle=True) as world:
        oracle = CollisionOracle(world)
        home, folded = (np.array([-2.0, 0.0, 0.0, *arm]) for arm in (PAPER_ROBOT.home, FOLDED))
        assert oracle.hits(home) == []
        hits = oracle.hits(folded)
        assert hits
        assert {hit.other.split("/")[0] for hit in hits} == {ROBOT}
        assert all(hit.mover in {*UPPER, *LOWER} for hit in hits)


def test_all_of_the_arm_collides_with_the_mast(make_world: MakeWorld) -> None:
    shapes = {link: found for (owner, link), found in groups(make_world("kitchen_t1")).items() if owner == ROBOT}
    arm = [link for link in shapes if link.startswith("panda_") and shapes[link]]
    assert len(arm) >= 10
    for link in arm:
        assert all(collide(a, b) for a in shapes[link] for b in shapes[MAST_LINK]), link
    assert not any(collide(a, b) for a in shapes[BASE_LINK] for b in shapes[MAST_LINK])


def test_the_oracle_sees_the_elbow_at_the_mast_and_the_mast_under_a_table() -> None:
    scene = scene_at_paper_size("kitchen_t1")
    with World(scene, oracle=True) as world, World(scene) as real:
        oracle = CollisionOracle(world)
        oracle.synchronize(real)
        elbow_back_left = np.array([-2.0, 0.0, 0.0, -0.75, -1.3, *PAPER_ROBOT.home[2:]])
        assert {frozenset((hit.mover, hit.other)) for hit in oracle.hits(elbow_back_left)} & {
            frozenset((MAST_LINK, f"{ROBOT}/panda_link{index}")) for index in (3, 4)
        }
        x, y, _ = scene.objects["table_0"].position
        # The base backs in under the top, which is above it and below the top of the mast.
        under = np.array([x - 0.35, y, np.pi, *PAPER_ROBOT.home])
        assert (MAST_LINK, "table_0") in {(hit.mover, hit.other.split("/")[0]) for hit in oracle.hits(under)}


def test_what_is_held_does_not_pass_through_the_robot() -> None:
    scene = scene_at_paper_size("kitchen_t1")
    with World(scene, oracle=True) as world, World(scene) as real:
        oracle = CollisionOracle(world)
        oracle.synchronize(real)
        q = np.array([-2.0, 0.0, 0.0, *PAPER_ROBOT.home])
        hand = oracle.kinematics.forward(q)
        oracle.carried = Carried("glass_0", at(0.0, 0.0, 0.0))
        assert oracle.hits(q) == [], "in the hand it touches nothing but the hand"
        shoulder = np.linalg.inv(hand) @ at(-2.0, 0.0, 0.45)
        oracle.carried = Carried("glass_0", shoulder)
        assert {hit.other for hit in oracle.hits(q)} == {"glass_0/glass"}


def test_the_engine_itself_stops_the_hand_at_the_pedestal(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    for joint, target in zip(world.robot.active_joints[3:10], FOLDED, strict=True):
        joint.set_drive_target(float(target))
    for _ in range(750):
        world.step()
    short = np.abs(np.asarray(world.robot.get_qpos())[PAPER_ROBOT.arm] - FOLDED).max()
    touching = [c for c in world.contacts({ROBOT}) if c.b.owner == ROBOT and c.impulse_ns > 0]
    assert touching, "own links press on each other"
    assert short > np.deg2rad(2.0)
    assert min(contact.separation_m for contact in touching) > -0.003
