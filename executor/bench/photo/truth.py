"""Ground truth from the simulator: a room as a camera sees it, and the object of every pixel.

The only module around reconstructions that knows the simulator's ids. A reconstruction gets a noisy picture and boxes
that `benchmarks.drawn_rooms` makes of this; the rest is for comparison.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array, inverse
from executor.sim.engine import GROUND, ROBOT
from executor.sim.render.cameras import WALL, Camera, Solids, is_lens_clear, look_at
from executor.sim.render.stage import SceneRenderer, Stage
from executor.sim.world import World
from executor.system.extras import load_sapien
from oag import Scene, SceneObject

SIZE_PX = (640, 480)
LEAST_PX = 150
"""Fewer pixels of a thing are not counted."""

_HEIGHT_M = (1.2, 1.7)  # Height of eyes, or of hands that hold a camera.
_FOV_RAD = (math.radians(45.0), math.radians(70.0))
_LOOK_AT_M = (0.45, 0.80)  # Height of what the middle of the picture shows.
_ASIDE_RAD = math.radians(50.0)  # Off the direction that most fronts face.
_TRIES = 60
_FILLED = 0.9  # Of half the picture's width.


class NoPlace(ValueError):
    """A room has no place from which it can be photographed."""


@dataclass(frozen=True)
class Shot:
    """One rendered photograph of a known room; everything in it is from the simulator.

    Attributes:
        scene: The room.
        rgb: (H, W, 3) uint8.
        depth_m: (H, W) along the camera's axis, 0 where nothing is.
        owners: (H, W) index into `names`, -1 without an object: floor, walls, nothing.
        names: Ids of the scene's objects.
        K: (3, 3) in pixels, centres of pixels at half numbers.
        T_world_camera: (4, 4), x right, y down, z ahead.
    """

    scene: Scene
    rgb: NDArray[np.uint8]
    depth_m: Array
    owners: NDArray[np.int32]
    names: tuple[str, ...]
    K: Array
    T_world_camera: Array

    def visible(self, least_px: int = LEAST_PX) -> dict[str, NDArray[np.bool_]]:
        """Return the mask of every object with enough visible pixels; the default is enough to count."""
        masks = {name: self.owners == index for index, name in enumerate(self.names)}
        return {name: mask for name, mask in masks.items() if int(mask.sum()) >= least_px}

    @property
    def T_level_world(self) -> Array:
        """World to the frame under the camera: origin on the floor, z up, x where the camera looks."""
        ahead = self.T_world_camera[:3, 2]
        yaw = math.atan2(ahead[1], ahead[0])
        T = np.eye(4)
        T[:2, :2] = [[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]]
        T[:2, 3] = self.T_world_camera[:2, 3]
        return inverse(T)


@contextmanager
def photographer() -> Iterator[SceneRenderer]:
    """Give the renderer that stays warm while photographs are rendered."""
    one = SceneRenderer()
    try:
        yield one
    finally:
        one.close()


def photograph(scene: Scene, seed: int, size_px: tuple[int, int] = SIZE_PX) -> Shot:
    """Return one photograph of a room without the robot, from a place drawn from a seed.

    Raises:
        NoPlace: None was found for a camera.
    """
    return _taken(scene, _camera(scene, np.random.default_rng([seed, 18]), size_px), size_px)


def _taken(scene: Scene, camera: Camera, size_px: tuple[int, int]) -> Shot:
    with World(scene, visual=True) as world:
        # Links of articulations are at the origin until a step has run.
        world.step()
        world.robot.set_root_pose(load_sapien().Pose([0.0, 0.0, -50.0]))
        stage = Stage(world, (camera,), {camera.name: size_px})
        try:
            sensed = stage.sense(world.pack())[camera.name]
            owners, names = _owners(sensed.segmentation, stage, scene)
            depth = np.asarray(sensed.depth_mm, dtype=float) / 1000.0
            return Shot(
                scene,
                sensed.color,
                depth,
                owners,
                names,
                stage.intrinsics(camera.name),
                stage.T_world_camera(camera.name),
            )
        finally:
            stage.close()


def _owners(segmentation: object, stage: Stage, scene: Scene) -> tuple[NDArray[np.int32], tuple[str, ...]]:
    numbers = np.asarray(segmentation)
    names = tuple(name for name, obj in scene.objects.items() if obj.category not in (WALL, "floor"))
    index: Mapping[str, int] = {name: i for i, name in enumerate(names)}
    owners = np.full(numbers.shape, -1, dtype=np.int32)
    for number, ref in stage.legend().items():
        if ref.owner not in (GROUND, ROBOT) and ref.owner in index:
            owners[numbers == number] = index[ref.owner]
    return owners, names


def _camera(scene: Scene, rng: np.random.Generator, size_px: tuple[int, int]) -> Camera:
    """Return a camera that looks at a room's furniture."""
    things = [obj for obj in scene.objects.values() if obj.category not in (WALL, "floor")]
    large = [obj for obj in things if obj.extent_m[2] > 0.3] or things
    points = np.array([obj.position for obj in large])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    facing = np.sum([-_own_x(obj) for obj in large], axis=0)[:2]
    front = math.atan2(facing[1], facing[0]) if np.linalg.norm(facing) > 0.3 else math.pi
    walls = Solids.of(scene).without([obj.id for obj in things])
    sights = np.vstack([points, [*middle[:2], 0.02]])
    for _ in range(_TRIES):
        fov_y, height_m = float(rng.uniform(*_FOV_RAD)), float(rng.uniform(*_HEIGHT_M))
        angle = front + float(rng.uniform(-_ASIDE_RAD, _ASIDE_RAD))
        direction = np.array([math.cos(angle), math.sin(angle), 0.0])
        target = np.array([*middle[:2], float(rng.uniform(*_LOOK_AT_M))])
        half = math.atan(math.tan(fov_y / 2) * size_px[0] / size_px[1]) * _FILLED
        across = points[:, :2] @ [-direction[1], direction[0]]
        along = points[:, :2] @ direction[:2]
        reach = np.abs(across - middle[:2] @ [-direction[1], direction[0]]) / math.tan(half)
        away = float((reach + along).max() - middle[:2] @ direction[:2]) + float(rng.uniform(0.3, 0.8))
        eye = np.array([*(middle + away * direction)[:2], height_m])
        # Pictures of a room are not taken from behind its wall.
        if is_lens_clear(scene, eye) and not walls.hidden(eye, sights).any():
            return Camera("photo", None, look_at(eye, target), fov_y, near_m=0.05, far_m=25.0)
    raise NoPlace(f"no place for a camera in {scene.name}")


def _own_x(obj: SceneObject) -> Array:
    w, x, y, z = obj.orientation
    return np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 0.0])
