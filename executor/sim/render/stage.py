"""Lights and cameras in a visible world: renders of physical states, of starts, and contact sheets of assets."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from executor.assets.build import build_asset, textured_box, textured_material
from executor.assets.library import asset_for
from executor.assets.model import Asset, Shape, Vector
from executor.geometry import Array, inverse, pose_vector, transform
from executor.sim.engine import GROUND, BodyRef
from executor.sim.render.cameras import Camera, cameras_for, interest_points, look_at
from executor.sim.render.frames import Picture
from executor.sim.world import World
from executor.system.extras import load_sapien
from executor.system.vulkan import activate
from oag import Scene, SceneObject

SIZE_PX = (960, 720)
"""Of the picture of a scene before anything is planned."""

SHADERS = Path(__file__).with_name("shaders")
"""What the engine draws by: surfaces are lit as they are drawn, in one pass. Its own shaders first note down seven
numbers of each pixel and light them afterwards, twice as long, and take 25 samples of the shadow map for each."""

ROOM = "room"
"""Owner of drawn walls in a segmentation."""

_GEOMETRY = "PositionSegmentation"  # The engine's name of the shaders' output: two numbers unused, depth in mm, body.
_VIEW = "global"
_SHADOW_MAP_SIZE = 1024
_TILE_PX = 128  # Of the texture: its edges, a pixel wide, are as sharp as a camera sees them.
_FLOOR_REACH_M = 9.6  # Rooms, and the visible ground past them.
_FLOOR_HALF_M = 0.2  # A sheet would be dappled by its own shadow, which the engine lets the undersides of things throw.
_TILE_COLORS = ((0.40, 0.38, 0.35), (0.46, 0.44, 0.41))  # Without a pattern, driving is hard to see in a picture.


Surroundings = Literal["plain", "sky", "dusk", "hall", "forest"]
"""Background where a scene ends: one colour, or a panorama of a kind (`executor.sim.render.appearance`)."""


@dataclass(frozen=True, slots=True)
class Lights:
    """Lights of a scene: a sun that throws shadows, a weaker fill light, and ambient light.

    Attributes:
        ambient: Linear RGB from all around.
        sun_direction, fill_direction: Direction of the light, in the world's frame; of any length.
        sun_color, fill_color: Linear RGB; 1 lights a white matt surface fully.
    """

    ambient: Vector = (0.34, 0.35, 0.38)
    sun_direction: Vector = (0.55, 0.45, -1.0)
    sun_color: Vector = (1.75, 1.68, 1.55)
    fill_direction: Vector = (-0.6, -0.35, -0.55)
    fill_color: Vector = (0.42, 0.46, 0.55)
    surroundings: Surroundings = "plain"
    panorama: int = 0


DAYLIGHT = Lights()


class Materials(Protocol):
    """Protocol of materials that replace the assets' own (`Surfaces` in `executor.sim.render.appearance`)."""

    def paint(self) -> Callable[[SceneObject, Shape], Any]:
        """Return a function from a shape of a scene's object to its material (`executor.assets.build.Paint`)."""

    def slab(self, half_m: Vector) -> Any:
        """Return the drawn shape of a floor of these half extents, at the origin."""

    def sides(self) -> Iterable[tuple[Array, Any]]:
        """Return the pose (4, 4) and the render component of each wall."""


@dataclass(frozen=True, slots=True)
class CameraImages:
    """Images of one camera for one state.

    Attributes:
        color: (H, W, 3) uint8 RGB.
        depth_mm: (H, W) distance along the camera's axis in millimetres; 0 where there is nothing.
        segmentation: (H, W) number of the visible body (`Stage.legend`); 0 where there is nothing.
    """

    color: Picture
    depth_mm: NDArray[np.uint16] | None
    segmentation: NDArray[np.uint16] | None


class Stage:
    """A visible world with lights and cameras.

    Args:
        world: A world that was built with `visual=True`.
        sizes: Camera name -> width and height of its pictures.
        shadow_map_px: Side of the shadow map; it is drawn again for each camera.
        materials: Makes the floor; by default it has tiles in two tones.
        panorama: (H, W, 3) linear RGB of the background over all directions: rows from straight up to straight down,
            columns around; by default the colour of the ambient light.
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
        materials: Materials | None = None,
        panorama: NDArray[np.float32] | None = None,
    ) -> None:
        self._world = world
        plain = np.asarray(lights.ambient, np.float32).reshape(1, 1, 3)
        self._panorama = plain if panorama is None else panorama
        self._add_lights(lights, shadow_map_px if shadows else None)
        sides = () if materials is None else materials.sides()
        # What walls hide of the floor is not shaded where they are drawn first.
        self._walls = [self._add_drawn("wall", component, T) for T, component in sides]
        self._floor = self._add_floor(materials)
        self._cameras: dict[str, Any] = {camera.name: self._mount(camera, sizes[camera.name]) for camera in cameras}

    def show(self, state: bytes | None = None) -> dict[str, Picture]:
        """Return view name -> (H, W, 3) uint8 RGB of a packed state, by default of the scene as it is built."""
        return {name: sensed.color for name, sensed in self.sense(state, depth=False, segmentation=False).items()}

    def sense(self, state: bytes | None, *, depth: bool = True, segmentation: bool = True) -> dict[str, CameraImages]:
        """Return view name -> color and, where wanted, depth and segmentation of a packed physical state.

        Args:
            state: By default the scene as it is built.
        """
        if state is not None:
            self._world.unpack(state)
        self._world.sapien_scene.update_render()
        for camera in self._cameras.values():
            camera.take_picture()
        return {name: self._read(name, depth=depth, segmentation=segmentation) for name in self._cameras}

    def _read(self, view: str, *, depth: bool, segmentation: bool) -> CameraImages:
        camera = self._cameras[view]
        color = np.ascontiguousarray(camera.get_picture("Color")[..., :3])
        geometry = camera.get_picture(_GEOMETRY)
        empty = geometry[..., 3] == 0
        return CameraImages(
            _fill_background(color, empty, self.T_world_camera(view), self.intrinsics(view), self._panorama),
            geometry[..., 2].astype(np.uint16) if depth else None,
            geometry[..., 3].astype(np.uint16) if segmentation else None,
        )

    def legend(self) -> dict[int, BodyRef]:
        """Return the body of each number of a segmentation."""
        walls = {int(wall.per_scene_id): BodyRef(ROOM, "wall") for wall in self._walls}
        return {**self._world.bodies_by_number(), int(self._floor.per_scene_id): BodyRef(GROUND, GROUND), **walls}

    def aim(self, view: str, T_world_camera: Array) -> None:
        """Move a camera that no link carries to a pose (4, 4) in the frame of `Camera`."""
        vector = pose_vector(T_world_camera)
        self._cameras[view].set_entity_pose(load_sapien().Pose(vector[:3], vector[3:]))

    def intrinsics(self, view: str) -> Array:
        """Return a camera's (3, 3) matrix, in pixels."""
        return np.asarray(self._cameras[view].get_intrinsic_matrix(), dtype=float)

    def T_world_camera(self, view: str) -> Array:
        """Return the (4, 4) pose of a camera in the state that was shown last; x right, y down, z ahead (OpenCV's)."""
        T_camera_world = np.eye(4)
        T_camera_world[:3] = self._cameras[view].get_extrinsic_matrix()
        return inverse(T_camera_world)

    def close(self) -> None:
        """Release the cameras, which keep the engine's scene alive."""
        self._cameras = {}
        self._floor, self._walls = None, []

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

    def _add_floor(self, materials: Materials | None) -> Any:
        """Lay a floor, which is visual only: a body would change the physics that the packed states belong to."""
        sapien = load_sapien()

        half_m = (_FLOOR_REACH_M, _FLOOR_REACH_M, _FLOOR_HALF_M)
        slab = textured_box(half_m, _tiles()) if materials is None else materials.slab(half_m)
        slab.local_pose = sapien.Pose([0.0, 0.0, -_FLOOR_HALF_M])
        component = sapien.render.RenderBodyComponent()
        component.attach(slab)
        return self._add_drawn("floor", component, np.eye(4))

    def _add_drawn(self, name: str, component: Any, T_world_entity: Array) -> Any:
        sapien, vector = load_sapien(), pose_vector(T_world_entity)
        entity = sapien.Entity()
        entity.set_name(name)
        entity.add_component(component)
        entity.set_pose(sapien.Pose(vector[:3], vector[3:]))
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
    """Return the material of the usual floor: square tiles in two tones, half a texture wide."""
    tile = np.arange(_TILE_PX) * 2 // _TILE_PX
    return textured_material(np.asarray(_TILE_COLORS)[(tile[:, None] + tile) % 2], 0.9, 0.1)


def _fill_background(
    picture: Picture,
    empty: NDArray[np.bool_],
    T_world_camera: Array,
    intrinsics: Array,
    panorama: NDArray[np.float32],
) -> Picture:
    """Return a picture with the panorama where it is empty: filled in afterwards, it costs next to nothing.

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
    """Return a tiny scene of which one picture was drawn, with the same kinds of lights as a stage.

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


class SceneRenderer:
    """Makes stages in turn, and keeps the shaders that a process compiles for seconds at its first picture."""

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
        materials: Materials | None = None,
        panorama: NDArray[np.float32] | None = None,
    ) -> Iterator[Stage]:
        """Yield a stage of a concrete scene for the duration of the block; arguments as for `Stage`."""
        with World(scene, visual=True, paint=None if materials is None else materials.paint()) as world:
            stage = Stage(
                world,
                cameras,
                sizes,
                shadows=shadows,
                shadow_map_px=shadow_map_px,
                lights=lights,
                materials=materials,
                panorama=panorama,
            )
            try:
                yield stage
            finally:
                stage.close()

    def close(self) -> None:
        """Release the shaders; a scene that is alive while the interpreter shuts down can abort the process."""
        self._shaders = None


@contextmanager
def shared_renderer() -> Iterator[Callable[[], SceneRenderer]]:
    """Yield a function that returns one renderer, made at its first call and closed when the block ends."""
    made: list[SceneRenderer] = []

    def scene_renderer() -> SceneRenderer:
        if not made:
            made.append(SceneRenderer())
        return made[0]

    try:
        yield scene_renderer
    finally:
        for one in made:
            one.close()


def render_scene(scene: Scene) -> Image.Image:
    """Return the overview of a scene: every object and the robot, from the side that shows the most.

    Args:
        scene: The scene; its things stand at their given poses, also in mid-air.
    """
    scene_renderer = SceneRenderer()
    cameras = cameras_for(scene, (_VIEW,), aspect=SIZE_PX[0] / SIZE_PX[1])
    with scene_renderer.stage(scene, cameras, {_VIEW: SIZE_PX}) as stage:
        picture = Image.fromarray(stage.show()[_VIEW])
    scene_renderer.close()
    return picture


TILE_PX = 200
COLUMNS = 6
_LINE_PX = 14
_FOV_RAD = math.radians(28.0)
# Furniture faces -x; mugs have their ear at +x.
_AZIMUTH_RAD = {True: math.radians(215.0), False: math.radians(255.0)}
_ELEVATION_RAD = math.radians(24.0)
_OPEN_FRACTION = 0.45
_PAPER, _INK = (255, 255, 255), (30, 30, 30)
_FLOOR = (0.62, 0.61, 0.58, 1.0)


def asset_sheet(objects: Sequence[SceneObject]) -> Image.Image:
    """Return a picture with a tile for each object, its doors half open, named after its model.

    Args:
        objects: What to draw, row by row.
    """
    activate()
    # While this small scene lives, the tiles' scenes share its shaders; compiling them again takes seconds a tile.
    shaders = warm_up()
    sheet = contact_sheet([(_tile(asset_for(obj)), (obj.model,)) for obj in objects])
    del shaders
    return sheet


def contact_sheet(tiles: Sequence[tuple[Image.Image, Sequence[str]]], columns: int = COLUMNS) -> Image.Image:
    """Return pictures of one size side by side, row by row, each with its lines of words under it."""
    width, height = tiles[0][0].size
    caption_px = 4 + _LINE_PX * len(tiles[0][1])
    sheet = Image.new("RGB", (columns * width, -(-len(tiles) // columns) * (height + caption_px)), _PAPER)
    pen = ImageDraw.Draw(sheet)
    for index, (picture, lines) in enumerate(tiles):
        left, top = index % columns * width, index // columns * (height + caption_px)
        sheet.paste(picture, (left, top))
        for number, words in enumerate(lines):
            middle = left + width / 2, top + height + 2 + (number + 0.5) * _LINE_PX
            pen.text(middle, words, fill=_INK, anchor="mm", font_size=11)
    return sheet


def _tile(asset: Asset) -> Image.Image:
    """Return the picture of one asset from its front, filling the tile."""
    sapien = load_sapien()

    scene = sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
    half = np.asarray(asset.extent_m) / 2
    material = sapien.render.RenderMaterial(base_color=list(_FLOOR), roughness=0.9, specular=0.1)
    scene.add_ground(0.0, render_material=material)
    built = build_asset(scene, "asset", asset, transform(np.eye(3), [0.0, 0.0, half[2]]), visual=True)
    if built.articulation is not None:
        built.articulation.set_qpos([joint.start(_OPEN_FRACTION) for joint in asset.joints])
        scene.set_timestep(1e-6)
        scene.step()
    radius = float(np.linalg.norm(half)) * (1.2 if built.articulation is not None else 1.0)
    _light(scene, radius)
    azimuth, level = _AZIMUTH_RAD[asset.motion != "dynamic"], math.cos(_ELEVATION_RAD)
    direction = np.array([level * math.cos(azimuth), level * math.sin(azimuth), math.sin(_ELEVATION_RAD)])
    distance = radius / math.sin(_FOV_RAD / 2)
    target = np.array([0.0, 0.0, half[2]])
    camera = scene.add_camera("sheet", TILE_PX, TILE_PX, _FOV_RAD, distance / 20, 20 * distance)
    vector = pose_vector(look_at(target + distance * direction, target))
    camera.set_entity_pose(sapien.Pose(vector[:3], vector[3:]))
    scene.update_render()
    camera.take_picture()
    return Image.fromarray(camera.get_picture("Color")[..., :3])


def _light(scene: Any, radius_m: float) -> None:
    scene.set_ambient_light([0.38, 0.39, 0.42])
    scene.add_directional_light(
        [0.75, 0.35, -1.0],
        [1.7, 1.65, 1.5],
        shadow=True,
        shadow_scale=3 * radius_m,
        shadow_near=-10 * radius_m,
        shadow_far=10 * radius_m,
        shadow_map_size=1024,
    )
    scene.add_directional_light([-0.2, -0.9, -0.3], [0.4, 0.44, 0.5])
