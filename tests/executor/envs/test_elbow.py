"""The elbow keeps off what is near and off the limits of joints, and the hand stays where it is meanwhile."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from executor.assets.model import Shape
from executor.envs.hand_control import SPARE_RAD, Elbow, HandFollower, Obstacles
from executor.geometry import Array, transform_from_quaternion
from executor.sim.robot.actions import arm_chain, joint_limits
from executor.sim.robot.description import BASE_LINK, robot_urdf
from executor.sim.robot.kinematics import ArmChain
from oag import Scene, SceneObject
from oag.model.robots import PAPER_ROBOT
from oag.model.scene import RobotPose
from tests.executor.helpers import MakeWorld

pytestmark = pytest.mark.physics

OPEN_M = 0.028
STILL = np.array([0.0] * 6 + [1.0] + [0.0] * 3)


def room(*walls_m: tuple[float, float]) -> Scene:
    """Return a scene with the robot in its middle and walls along x, 8 cm thick, of which these are the near sides."""
    objects = {
        f"wall_{k}": SceneObject(
            id=f"wall_{k}",
            category="wall",
            model="wall",
            position=(x_m, y_m + 0.04, 1.0),
            orientation=(0.5**0.5, 0.0, 0.0, 0.5**0.5),
            bbox_extent=(0.08, 3.0, 2.0),
        )
        for k, (x_m, y_m) in enumerate(walls_m)
    }
    return Scene("room", RobotPose(), objects, (), frozenset())


def stood_still(scene: Scene, arm: Array, make_world: MakeWorld, actions: int = 30) -> Array:
    """Return the (7,) posture after some actions that tell the hand nothing."""
    target = np.concatenate([[0.0, 0.0, 0.0], arm, [OPEN_M, OPEN_M]])
    follower = HandFollower(PAPER_ROBOT, target, 0.1, Elbow(make_world(scene)))
    for _ in range(actions):
        target = follower.joint_target(target, STILL)
    before, after = arm_chain(PAPER_ROBOT).forward(np.stack([arm, target[3:10]]))
    assert np.allclose(before, after, atol=1e-4)
    return target[3:10]


def elbow_m(arm: Array) -> Array:
    return np.asarray(ArmChain(robot_urdf(visual=False), BASE_LINK, "panda_link4").forward(arm[None, :4])[0, :3, 3])


def test_distances_are_those_of_the_solids(make_world: MakeWorld) -> None:
    around = Obstacles(make_world(room((0.0, 1.0))))
    points = np.array([[0.2, 0.7, 1.0], [0.1, 0.9, 0.05], [0.0, 1.03, 0.6], [1.6, 0.9, 1.0], [0.0, 0.7, 2.4]])
    # Before its face, over the floor, inside it, beside an edge, over another one.
    assert around.distances_m(points, 1.0) == pytest.approx([0.3, 0.05, -0.03, np.hypot(0.1, 0.1), 0.5], abs=1e-6)
    assert np.isinf(around.distances_m(points[:1] + [0.0, -0.2, 1.0], 0.1)).all()


def surface(shape: Shape) -> trimesh.Trimesh:
    """Return the surface that a solid is taken to have, where it is in its body."""
    if shape.kind == "cylinder":
        found = trimesh.creation.cylinder(shape.size_m[0], 2.0 * shape.size_m[1], sections=128)
    elif shape.kind == "convex":
        return (
            trimesh.Trimesh(np.array(shape.vertices_m))
            .bounding_box.to_mesh()
            .apply_transform(transform_from_quaternion(shape.position_m, shape.orientation))
        )
    else:
        found = trimesh.creation.box(2.0 * np.array(shape.size_m if shape.kind == "box" else shape.size_m * 3))
    return found.apply_transform(transform_from_quaternion(shape.position_m, shape.orientation))


def test_distances_in_a_kitchen_are_those_to_its_surfaces(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    solids = [
        surface(shape).apply_transform(world.T_world_link(name, link.name))
        for name, asset in world.assets.items()
        for link in asset.links
        for shape in link.shapes
        if shape.collides
    ]
    around = np.random.default_rng(62000).uniform(-0.6, 0.6, (60, 3)) + [0.0, 0.0, 0.7]
    points = world.T_world_link("table_0")[:3, 3] * [1.0, 1.0, 0.0] + around
    found = Obstacles(world).distances_m(points, 1.0)
    to_all = [trimesh.proximity.closest_point_naive(solid, points)[1] for solid in solids]
    assert (found > 0.0).sum() > 40
    assert found[found > 0.0] == pytest.approx(np.min([*to_all, points[:, 2]], axis=0)[found > 0.0], abs=5e-4)


def test_what_moves_is_looked_at_where_it_is_now(make_world: MakeWorld) -> None:
    world = make_world("kitchen_t1")
    around = Obstacles(world)
    place = world.T_world_link("glass_0")
    above = place[:3, 3] + [0.0, 0.0, 0.3]
    before = around.distances_m(above[None], 1.0)[0]
    place[:3, 3] += [0.0, 0.0, 0.1]
    world.set_object_pose("glass_0", place)
    assert around.distances_m(above[None], 1.0)[0] == pytest.approx(before - 0.1, abs=1e-4)


def test_the_elbow_gives_way_to_a_wall_beside_it(make_world: MakeWorld) -> None:
    home = np.array(PAPER_ROBOT.home)
    free = stood_still(room(), home, make_world)
    assert np.allclose(free, home, atol=1e-6)
    left, right = (stood_still(room((0.0, y_m)), home, make_world) for y_m in (0.10, -0.18))
    assert elbow_m(left)[1] < -0.02 and elbow_m(right)[1] > 0.02
    # Where it cannot give way to both, it stays between them.
    between = stood_still(room((0.0, 0.10), (0.0, -0.18)), home, make_world)
    assert abs(elbow_m(between)[1]) < 0.02


def test_the_elbow_goes_round_what_is_under_its_middle(make_world: MakeWorld) -> None:
    # A post under the elbow: whichever way the elbow begins to go, it gets no farther off at first.
    post = replace(room((0.0, 0.0)).objects["wall_0"], position=(-0.12, 0.0, 0.3375), bbox_extent=(0.05, 0.2, 0.675))
    upright = replace(post, orientation=(1.0, 0.0, 0.0, 0.0))
    scene = replace(room(), objects={"wall_0": upright})
    home = np.array(PAPER_ROBOT.home)
    after = stood_still(scene, home, make_world)
    around = Obstacles(make_world(scene))
    before_m, after_m = (around.distances_m(elbow_m(arm)[None], 1.0)[0] for arm in (home, after))
    assert before_m < 0.05 and after_m > 0.1


def test_joints_keep_off_their_limits_where_the_hand_lets_them(make_world: MakeWorld) -> None:
    high = joint_limits(PAPER_ROBOT)[3:10, 1]
    arm = np.array(PAPER_ROBOT.home)
    arm[6] = high[6] - 0.05
    after = stood_still(room(), arm, make_world, actions=60)
    assert 0.1 < high[6] - after[6] < SPARE_RAD + 0.05
