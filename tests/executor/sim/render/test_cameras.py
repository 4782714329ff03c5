"""Cameras: every object is in the overview, the head sees the hand, projections are those of a pinhole."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

import llm
import oag
from executor.assets.library import asset_for
from executor.geometry import Array, transform, transform_from_quaternion
from executor.scenes import library
from executor.scenes.generators import household
from executor.scenes.generators.long_horizon import draw
from executor.scenes.vary import vary
from executor.sim.render.cameras import (
    LENS_GAP_M,
    TARGET_PX,
    VIEWS,
    Camera,
    Solids,
    cameras_for,
    following,
    global_camera,
    head_camera,
    interest_points,
    is_lens_clear,
    look_at,
    wrist_camera,
)
from oag.model.robots import PAPER_ROBOT
from tests.executor.appliances import appliance

SCENES = [(name, seed) for name in library.names() for seed in (0, 1, 7)]
SIZE = (320, 240)


def project(camera: Camera, T_world_mount: Array, points_m: ArrayLike, size: tuple[int, int]) -> Array:
    """Return (N, 3): column and row in pixels, and the distance along the viewing axis in metres."""
    width, height = size
    T = T_world_mount @ camera.T_mount_camera
    local = (np.asarray(points_m, dtype=float) - T[:3, 3]) @ T[:3, :3]
    focal = height / 2 / math.tan(camera.fov_y_rad / 2)
    depth = local[:, 0]
    safe = np.where(np.abs(depth) < 1e-9, 1e-9, depth)
    return np.stack([width / 2 - focal * local[:, 1] / safe, height / 2 - focal * local[:, 2] / safe, depth], axis=1)


def in_picture(projected: Array, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return (N,) whether each projected point (see `project`) lies in front of the camera and in the picture."""
    u, v, depth = projected.T
    return np.asarray((depth > 0) & (u >= 0) & (u < size[0]) & (v >= 0) & (v < size[1]))


@pytest.mark.parametrize(("name", "seed"), SCENES)
def test_the_overview_has_every_object_and_the_robot_in_view(name: str, seed: int) -> None:
    scene = vary(library.load(name), seed)
    camera = global_camera(scene, aspect=SIZE[0] / SIZE[1])
    seen = in_picture(project(camera, np.eye(4), interest_points(scene), SIZE), SIZE)
    assert seen.all()


@pytest.mark.parametrize(("name", "seed"), SCENES)
def test_the_overview_looks_from_above_and_wastes_little_room(name: str, seed: int) -> None:
    scene = vary(library.load(name), seed)
    camera = global_camera(scene)
    points = project(camera, np.eye(4), interest_points(scene), (100, 100))[:, :2]
    assert camera.T_mount_camera[2, 3] > max(thing.position[2] for thing in scene.objects.values())
    assert (points.max(axis=0) - points.min(axis=0)).max() > 80


def test_the_overview_sees_into_an_opened_refrigerator() -> None:
    # The hinge of this scene's door is on +y and its front faces -x: the inside is seen from -x, -y.
    eye = global_camera(library.load("kitchen_t1")).T_mount_camera[:3, 3]
    fridge = library.load("kitchen_t1").objects["refrigerator_0"].position
    assert eye[0] < fridge[0] and eye[1] < fridge[1]


@pytest.mark.slow
def test_walls_need_not_be_in_the_picture_and_the_overview_looks_past_them() -> None:
    scene = draw("T1", 12000).scene
    walls = {name: thing for name, thing in scene.objects.items() if thing.category == "wall"}
    others = {name: thing for name, thing in scene.objects.items() if name not in walls}
    bare = replace(scene, objects=others, facts=())
    assert walls and np.array_equal(interest_points(scene), interest_points(bare))
    eye = global_camera(scene).T_mount_camera[:3, 3]
    for wall in walls.values():
        T = transform_from_quaternion(wall.position, wall.orientation)
        outside = float(((eye - T[:3, 3]) @ T[:3, :3])[0]) > 0.0
        assert not outside or wall.extent_m[2] <= 1.0, "the camera stands behind a wall as high as a refrigerator"


@pytest.mark.slow
def test_in_a_home_the_overview_shows_what_the_task_is_about_from_nearer_than_one_of_everything() -> None:
    nearer = []
    for index in range(0, 102, 24):
        pair = household.pair(12000, index)
        parts = pair.task.subtasks[0]
        about = {name for name in (parts.target, parts.support_init, parts.support_goal) if name is not None}
        camera = global_camera(pair.scene, SIZE[0] / SIZE[1], pair.task)
        assert in_picture(project(camera, np.eye(4), interest_points(pair.scene, about), SIZE), SIZE).all(), index
        middle = np.mean([pair.scene.objects[parts.target].position, pair.scene.robot.position], axis=0)
        eyes = [each.T_mount_camera[:3, 3] for each in (camera, global_camera(pair.scene, SIZE[0] / SIZE[1]))]
        near, far = (math.dist(eye, middle) for eye in eyes)
        nearer.append(near / far)
    assert np.median(nearer) < 0.9, nearer


def test_a_plan_without_subtasks_is_about_the_whole_scene() -> None:
    scene = library.load("kitchen_t1")
    nothing = oag.Task.from_json({"goal": "(not (open refrigerator_0))", "sub_tasks": []}, scene=scene)
    assert np.array_equal(global_camera(scene, task=nothing).T_mount_camera, global_camera(scene).T_mount_camera)


@pytest.mark.parametrize("height_px", [96, 448])
def test_the_overview_is_so_near_that_the_first_target_has_enough_pixels(height_px: int) -> None:
    scene = library.load("kitchen_t3")
    task = llm.propose("put the apple into the bowl", scene).task
    size = (height_px, height_px)
    still, near = (global_camera(scene, 1.0, task, height) for height in (None, height_px))
    apple = scene.objects[task.subtasks[0].target]
    corners = np.asarray(apple.position) + np.array(list(product((-1, 1), repeat=3))) * np.asarray(apple.extent_m) / 2
    ends = project(near, np.eye(4), corners, size)
    assert in_picture(ends, size).all()
    # A ball takes pi / 4 of the square around it, and more of it is in the outline of its box's corners.
    assert np.ptp(ends[:, :2], axis=0).prod() * 0.5 >= TARGET_PX
    eyes = [each.T_mount_camera[:3, 3] for each in (near, still)]
    assert Solids.of(scene).gap_m(eyes[0]) >= LENS_GAP_M
    assert math.dist(eyes[0], apple.position) <= math.dist(eyes[1], apple.position) + 1e-9


def test_a_following_overview_turns_nowhere_and_has_in_its_picture_what_it_is_to_show() -> None:
    scene = library.load("kitchen_t1")
    still = global_camera(scene)
    rng = np.random.default_rng(5)
    around = np.asarray(scene.objects["glass_0"].position) + rng.uniform(-0.4, 0.4, (1, 9, 3))
    poses = following(still, np.repeat(around, 30, axis=0), Solids.of(scene), 1.0, 10.0)
    assert (poses[:, :3, :3] == still.T_mount_camera[:3, :3]).all()
    camera = replace(still, T_mount_camera=poses[15])
    assert in_picture(project(camera, np.eye(4), around[0], (200, 200)), (200, 200)).all()
    middle = around[0].mean(axis=0)
    assert math.dist(poses[15, :3, 3], middle) < math.dist(still.T_mount_camera[:3, 3], middle)


def test_a_point_ahead_is_in_the_middle_and_left_is_left() -> None:
    camera = Camera("test", None, look_at([0, 0, 1], [1, 0, 1]), math.radians(90))
    ahead, left, above = project(camera, np.eye(4), [[2, 0, 1], [2, 1, 1], [2, 0, 2]], (200, 100))
    assert ahead == pytest.approx([100, 50, 2])
    assert left == pytest.approx([75, 50, 2])
    assert above == pytest.approx([100, 25, 2])


def test_what_lies_behind_is_not_in_the_picture() -> None:
    camera = Camera("test", None, look_at([0, 0, 1], [1, 0, 1]), math.radians(90))
    assert not in_picture(project(camera, np.eye(4), [[-2, 0, 1]], SIZE), SIZE).any()


def test_a_moving_mount_moves_the_picture() -> None:
    camera = head_camera(PAPER_ROBOT)
    driven = transform(np.eye(3), [0.3, -0.7, 0.0])
    point = np.array([[0.6, 0.0, 0.5]])
    assert project(camera, driven, point + [0.3, -0.7, 0.0], SIZE) == pytest.approx(
        project(camera, np.eye(4), point, SIZE)
    )


def test_head_and_wrist_look_where_the_hand_works() -> None:
    workspace = [[0.45, 0.0, 0.65], [0.45, 0.25, 0.65], [0.45, -0.25, 0.65]]
    assert in_picture(project(head_camera(PAPER_ROBOT), np.eye(4), workspace, (100, 100)), (100, 100)).all()
    between_the_fingers = [[0.0, 0.0, 0.09], [0.0, 0.0, 0.3]]
    assert in_picture(project(wrist_camera(PAPER_ROBOT), np.eye(4), between_the_fingers, (100, 100)), (100, 100)).all()


@pytest.mark.parametrize("camera", cameras_for(library.load("kitchen_t3")), ids=VIEWS)
def test_poses_are_rigid_and_upright(camera: Camera) -> None:
    R = camera.T_mount_camera[:3, :3]
    assert pytest.approx(np.eye(3), abs=1e-12) == R.T @ R
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_an_unknown_view_is_named_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="no view 'front'; the views are global, head, wrist"):
        cameras_for(library.load("kitchen_t1"), ["front"])


def test_a_lens_is_as_near_to_a_knob_as_it_stands_whatever_opens() -> None:
    scene = appliance("oven", "knob", 0)
    thing, (knob,) = scene["oven_0"], asset_for(scene["oven_0"]).controls
    T = transform_from_quaternion(thing.position, thing.orientation)
    middle = T[:3, :3] @ np.add(knob.position_m, knob.grip.position_m) + T[:3, 3]
    outward, across = (
        T[:3, :3] @ np.asarray(knob.grip.outward),
        T[:3, :3] @ np.cross(knob.grip.outward, [0.0, 0.0, 1.0]),
    )
    shut = Solids.of(scene)
    for ahead_m, aside_m, up_m in product((0.0, 0.03), np.arange(-0.1, 0.1, 0.01), np.arange(0.0, 0.1, 0.01)):
        eye = middle + (LENS_GAP_M + ahead_m) * outward + aside_m * across + [0.0, 0.0, up_m]
        assert is_lens_clear(scene, eye) is bool(shut.gap_m(eye) >= LENS_GAP_M)
