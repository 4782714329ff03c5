"""Lights and cameras in a visible world: what turns a physical state, or a scene as it starts, into pictures."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from executor.assets.model import Shape, Vector
from executor.assets.visuals import textured_box, textured_material
from executor.geometry import Array, inverse, pose_vector
from executor.machine.extras import load_sapien
from executor.machine.vulkan import activate
from executor.pictures.cameras import Camera
from executor.pictures.frames import Picture
from executor.pictures.overview import cameras_for, interest_points
from executor.world.engine import GROUND, BodyRef
from executor.world.world import World
from oag import Scene, SceneObject

SIZE_PX = (960, 720)
"""Of the picture of a scene before anything is planned."""

SHADERS = Path(__file__).with_name("shaders")
"""What the engine draws by: surfaces are lit as they are drawn, in one pass. Its own shaders first note down seven
numbers of each pixel and light them afterwards, twice as long, and take 25 samples of the shadow map for each."""

_SEEN = "PositionSegmentation"  # As the engine names what shaders put out: two numbers unused, depth in mm, body.
_VIEW = "global"
_SHADOW_MAP_SIZE = 1024
_TILE_PX = 128  # Of the texture: its edges, a pixel wide, are as sharp as a camera sees them.
_FLOOR_REACH_M = 9.6  # Rooms, and what is seen of the ground past them.
_FLOOR_HALF_M = 0.2  # A sheet would be dappled by its own shadow, which the engine lets the undersides of things throw.
_TILE_COLORS = ((0.40, 0.38, 0.35), (0.46, 0.44, 0.41))  # Without a pattern, driving is hard to see in a picture.


Surroundings = Literal["plain", "sky", "dusk", "hall", "forest"]
"""What is to be seen where a scene ends: one colour, or a panorama of a kind (`executor.pictures.backdrop`)."""


@dataclass(frozen=True, slots=True)
class Lights:
    """What lights a scene: a sun that throws shadows, a weaker light from elsewhere, and light from all around.

    Attributes:
        ambient: Linear RGB from all around.
        sun_direction, fill_direction: Where the light goes, in the world's frame; of any length.
        sun_color, fill_color: Linear RGB; 1 lights a white matt surface fully.
        surroundings: What is to be seen where the scene ends.
        panorama: Which of the panoramas of that kind.
    """

    ambient: Vector = (0.34, 0.35, 0.38)
    sun_direction: Vector = (0.55, 0.45, -1.0)
    sun_color: Vector = (1.75, 1.68, 1.55)
    fill_direction: Vector = (-0.6, -0.35, -0.55)
    fill_color: Vector = (0.42, 0.46, 0.55)
    surroundings: Surroundings = "plain"
    panorama: int = 0


DAYLIGHT = Lights()


class Painting(Protocol):
    """What makes a scene's surfaces look other than its assets say (`executor.pictures.surfaces`)."""

    def paint(self) -> Callable[[SceneObject, Shape], Any]:
        """Returns what says how a shape of a scene's object looks (`executor.assets.visuals.Paint`)."""

    def slab(self, half_m: Vector) -> Any:
        """Returns the drawn shape of a floor of these half extents, at the origin."""


@dataclass(frozen=True, slots=True)
class Sensed:
    """What one camera saw of one state.

    Attributes:
        color: (H, W, 3) uint8 RGB.
        depth_mm: (H, W) distance along the camera's axis in millimetres; 0 where there is nothing.
        segmentation: (H, W) number of the body that is seen (`Stage.legend`); 0 where there is nothing.
    """

    color: Picture
    depth_mm: NDArray[np.uint16] | None
    segmentation: NDArray[np.uint16] | None


class Stage:
    """A visible world with lights and cameras.

    Args:
        world: A world that was built with `visual=True`.
        cameras: The cameras to mount.
        sizes: Camera name -> width and height of its pictures.
        shadows: Whether the sun throws shadows.
        shadow_map_px: Side of the map that shadows are looked up in; it is drawn anew for each camera.
        lights: What lights it.
        painting: Makes the floor; by default it has tiles in two tones.
        panorama: (H, W, 3) linear RGB that is seen where the scene ends, over all directions: rows from straight up to
            straight down, columns around; by default the colour of the light from all around.
    """

    def __init__(
        self,
        world: World,
        cameras: Iterable[Camera],
        sizes: Mapping[str, tuple[int, int]],
        *,
        shadows: bool = True,
        shadow_map_px: int = _SHADOW_MAP_SIZE,
        lights: Lights = DAYLIGHT,
        painting: Painting | None = None,
        panorama: NDArray[np.float32] | None = None,
    ) -> None:
        self._world = world
        plain = np.asarray(lights.ambient, np.float32).reshape(1, 1, 3)
        self._panorama = plain if panorama is None else panorama
        self._add_lights(lights, shadow_map_px if shadows else None)
        self._floor = self._add_floor(painting)
        self._cameras: dict[str, Any] = {camera.name: self._mount(camera, sizes[camera.name]) for camera in cameras}

    def show(self, state: bytes | None = None) -> dict[str, Picture]:
        """Returns view name -> (H, W, 3) uint8 RGB of a packed state, by default of the scene as it is built."""
        return {name: sensed.color for name, sensed in self.sense(state, depth=False, segmentation=False).items()}

    def sense(self, state: bytes | None, *, depth: bool = True, segmentation: bool = True) -> dict[str, Sensed]:
        """Returns view name -> color and, where wanted, depth and segmentation of a packed physical state.

        Args:
            state: By default the scene as it is built.
            depth, segmentation: Whether these are wanted.
        """
        if state is not None:
            self._world.unpack(state)
        self._world.sapien_scene.update_render()
        for camera in self._cameras.values():
            camera.take_picture()
        return {name: self._read(name, depth=depth, segmentation=segmentation) for name in self._cameras}

    def _read(self, view: str, *, depth: bool, segmentation: bool) -> Sensed:
        camera = self._cameras[view]
        color = np.ascontiguousarray(camera.get_picture("Color")[..., :3])
        seen = camera.get_picture(_SEEN)
        empty = seen[..., 3] == 0
        return Sensed(
            _filled(color, empty, self.T_world_camera(view), self.intrinsics(view), self._panorama),
            seen[..., 2].astype(np.uint16) if depth else None,
            seen[..., 3].astype(np.uint16) if segmentation else None,
        )

    def legend(self) -> dict[int, BodyRef]:
        """Returns which body each number of a segmentation is."""
        return {**self._world.numbered(), int(self._floor.per_scene_id): BodyRef(GROUND, GROUND)}

    def intrinsics(self, view: str) -> Array:
        """Returns a camera's (3, 3) matrix, in pixels."""
        return np.asarray(self._cameras[view].get_intrinsic_matrix(), dtype=float)

    def T_world_camera(self, view: str) -> Array:
        """Returns the (4, 4) pose of a camera in the state that was shown last; x right, y down, z ahead (OpenCV's)."""
        T_camera_world = np.eye(4)
        T_camera_world[:3] = self._cameras[view].get_extrinsic_matrix()
        return inverse(T_camera_world)

    def close(self) -> None:
        """Lets go of the cameras, which keep the engine's scene alive."""
        self._cameras = {}
        self._floor = None

    def _add_lights(self, lights: Lights, shadow_map_px: int | None) -> None:
        scene = self._world.sapien_scene
        points = interest_points(self._world.scene)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        reach = float(np.linalg.norm(points - middle, axis=1).max()) + 0.5
        scene.set_ambient_light(list(lights.ambient))
        scene.add_directional_light(
            list(lights.sun_direction),
            list(lights.sun_color),
            position=[float(v) for v in middle],
            shadow=shadow_map_px is not None,
            shadow_scale=reach,
            shadow_near=-3 * reach,
            shadow_far=3 * reach,
            shadow_map_size=shadow_map_px or _SHADOW_MAP_SIZE,
        )
        scene.add_directional_light(list(lights.fill_direction), list(lights.fill_color))

    def _add_floor(self, painting: Painting | None) -> Any:
        """Lays a floor, which is visual only: a body would change the physics that the packed states belong to."""
        sapien = load_sapien()

        half_m = (_FLOOR_REACH_M, _FLOOR_REACH_M, _FLOOR_HALF_M)
        slab = textured_box(half_m, _tiles()) if painting is None else painting.slab(half_m)
        slab.local_pose = sapien.Pose([0.0, 0.0, -_FLOOR_HALF_M])
        component = sapien.render.RenderBodyComponent()
        component.attach(slab)
        entity = sapien.Entity()
        entity.set_name("floor")
        entity.add_component(component)
        self._world.sapien_scene.add_entity(entity)
        return entity

    def _mount(self, camera: Camera, size: tuple[int, int]) -> Any:
        sapien = load_sapien()

        scene, vector = self._world.sapien_scene, pose_vector(camera.T_mount_camera)
        pose = sapien.Pose(vector[:3], vector[3:])
        width, height = size
        settings = (width, height, camera.fov_y_rad, camera.near_m, camera.far_m)
        if camera.mount is None:
            mounted = scene.add_camera(camera.name, *settings)
            mounted.set_entity_pose(pose)
            return mounted
        link = self._world.robot.find_link_by_name(camera.mount)
        return scene.add_mounted_camera(camera.name, link.entity, pose, *settings)


def _tiles() -> Any:
    """Returns the material of the usual floor: square tiles in two tones, half a texture wide."""
    tile = np.arange(_TILE_PX) * 2 // _TILE_PX
    return textured_material(np.asarray(_TILE_COLORS)[(tile[:, None] + tile) % 2], 0.9, 0.1)


def _filled(
    picture: Picture,
    empty: NDArray[np.bool_],
    T_world_camera: Array,
    intrinsics: Array,
    panorama: NDArray[np.float32],
) -> Picture:
    """Returns a picture with the panorama where it is empty: looked up afterwards, it costs next to nothing.

    Args:
        picture: (H, W, 3) uint8 RGB.
        empty: (H, W) where nothing was drawn.
        T_world_camera: (4, 4) the camera; x right, y down, z ahead (OpenCV's).
        intrinsics: (3, 3) its matrix in pixels.
        panorama: (H, W, 3) linear RGB over all directions: rows from straight up to straight down, columns around.
    """
    v, u = np.nonzero(empty)
    if not len(v):
        return picture
    rows, columns = panorama.shape[:2]
    if rows == columns == 1:
        colors = panorama[0]
    else:
        across = np.stack([u + 0.5, v + 0.5, np.ones(len(u))], axis=1)
        rays = across @ np.linalg.inv(intrinsics).T @ T_world_camera[:3, :3].T
        rays /= np.linalg.norm(rays, axis=1, keepdims=True)
        row = np.arccos(np.clip(rays[:, 2], -1.0, 1.0)) / np.pi * rows
        column = np.arctan2(rays[:, 1], rays[:, 0]) / (2.0 * np.pi) % 1.0 * columns
        colors = panorama[np.minimum(row.astype(int), rows - 1), np.minimum(column.astype(int), columns - 1)]
    shown = picture.copy()
    shown[v, u] = np.clip(colors, 0.0, 1.0) ** (1.0 / 2.2) * 255.0 + 0.5
    return shown


def warm_up() -> Any:
    """Returns a tiny scene of which one picture was drawn, with the same kinds of lights as a stage.

    As long as it is kept, later stages of the process reuse the shaders that it compiled.
    """
    sapien = load_sapien()

    sapien.render.set_camera_shader_dir(str(SHADERS))
    sapien.render.set_picture_format("Color", "r8g8b8a8unorm")
    scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
    scene.add_directional_light(list(DAYLIGHT.sun_direction), list(DAYLIGHT.sun_color), shadow=True, shadow_map_size=64)
    scene.add_directional_light(list(DAYLIGHT.fill_direction), list(DAYLIGHT.fill_color))
    camera = scene.add_camera("warm_up", 32, 32, 1.0, 0.1, 10.0)
    scene.update_render()
    camera.take_picture()
    camera.get_picture("Color")
    return scene


class Draughtsman:
    """Makes stages one after the other; the shaders that the first picture of a process compiles for seconds are kept.

    Attributes:
        renderer: What draws, in words.

    Raises:
        RendererNotFound: When nothing on this machine can draw.
    """

    def __init__(self) -> None:
        self.renderer = activate().why
        # Compiled shaders live as long as a scene that uses them.
        self._shaders: Any = warm_up()

    @contextmanager
    def stage(
        self,
        scene: Scene,
        cameras: Iterable[Camera],
        sizes: Mapping[str, tuple[int, int]],
        *,
        shadows: bool = True,
        shadow_map_px: int = _SHADOW_MAP_SIZE,
        lights: Lights = DAYLIGHT,
        painting: Painting | None = None,
        panorama: NDArray[np.float32] | None = None,
    ) -> Iterator[Stage]:
        """Gives a stage of a concrete scene, which ends with the block; arguments as for `Stage`."""
        with World(scene, visual=True, paint=None if painting is None else painting.paint()) as world:
            stage = Stage(
                world,
                cameras,
                sizes,
                shadows=shadows,
                shadow_map_px=shadow_map_px,
                lights=lights,
                painting=painting,
                panorama=panorama,
            )
            try:
                yield stage
            finally:
                stage.close()

    def close(self) -> None:
        """Lets go of the shaders; a scene that is alive while the interpreter shuts down can abort the process."""
        self._shaders = None


@contextmanager
def kept_draughtsman() -> Iterator[Callable[[], Draughtsman]]:
    """Gives a function that returns one draughtsman, made when it is asked for first and closed when the block ends."""
    made: list[Draughtsman] = []

    def draughtsman() -> Draughtsman:
        if not made:
            made.append(Draughtsman())
        return made[0]

    try:
        yield draughtsman
    finally:
        for one in made:
            one.close()


def scene_picture(scene: Scene, size_px: tuple[int, int] = SIZE_PX) -> Image.Image:
    """Returns the overview of a scene: every object and the robot, from the side that shows the most.

    Args:
        scene: What to draw; its things stand where it says, also in mid-air.
        size_px: Width and height.

    Raises:
        AssetError: An object cannot be built.
        RendererNotFound: Nothing on this machine can draw.
    """
    draughtsman = Draughtsman()
    cameras = cameras_for(scene, (_VIEW,), aspect=size_px[0] / size_px[1])
    with draughtsman.stage(scene, cameras, {_VIEW: size_px}) as stage:
        picture = Image.fromarray(stage.show()[_VIEW])
    draughtsman.close()
    return picture
