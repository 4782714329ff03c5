"""Appearance of a scene, sampled from a seed: finishes and textures, panoramas, lights, and perturbed cameras.

Textures are computed, not stored. They lie in metres on the flat faces of boxes, so that a plank is as wide on a table
as on a door. Round and bent shapes, and things that are carried, get a colour alone.

A panorama is the background, shown where a picture has nothing else in it. It is (H, W, 3) linear RGB over all
directions: rows from straight up to straight down, columns around, as `executor.sim.render.stage` reads it.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from functools import cache, lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from executor.assets.build import build_render_component, textured_box, textured_material
from executor.assets.families.shapes import box
from executor.assets.model import Shape, Vector
from executor.geometry import Array, rotation_z, transform
from executor.sim.render.cameras import Camera, is_lens_clear
from executor.sim.render.stage import DAYLIGHT, Lights, Surroundings
from oag import Scene, SceneObject

Material = Literal["paint", "wood", "planks", "herringbone", "steel", "tiles", "metro", "stone", "fabric", "view"]

_TEXTURE_PX = 256  # 5 mm a pixel: finer than a camera's at a metre.
_PLANKS, _TILES, _METRO = 10, 4, (16, 8)  # Across a texture: 12 cm, 30 cm, and 7.5 by 15 cm.
_PLAIN: tuple[Material, ...] = ("paint",)  # Without a texture.
_LOOK = {"steel": (0.35, 0.5), "tiles": (0.3, 0.45), "metro": (0.25, 0.5), "stone": (0.3, 0.45), "fabric": (0.9, 0.05)}
_USUAL_LOOK = (0.5, 0.3)


@dataclass(frozen=True, slots=True)
class Finish:
    """What a surface is made of.

    Attributes:
        color: Linear RGB of its brighter parts.
        pattern: Which of the material's patterns.
    """

    material: Material
    color: Vector
    pattern: int = 0


@dataclass(frozen=True, slots=True)
class WallPart:
    """A box of a wall: two corners in its frame (x into the room, y along, z up) [m], and the role of its surface."""

    low_m: Vector
    high_m: Vector
    role: str


@dataclass(frozen=True, slots=True)
class Wall:
    """One side of a room, which is drawn only.

    Attributes:
        position_m: A point of the plane behind which no camera sees it.
        yaw_rad: Heading of the plane's inward normal; None for a ceiling, whose x looks down.
    """

    position_m: Vector
    yaw_rad: float | None
    parts: tuple[WallPart, ...]

    @property
    def T_world_wall(self) -> Array:
        """(4, 4) pose of its frame."""
        down = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        return transform(down if self.yaw_rad is None else rotation_z(self.yaw_rad)[:3, :3], self.position_m)


@dataclass(frozen=True, slots=True)
class Surfaces:
    """The finishes of a scene, and the walls around it.

    Attributes:
        finishes: Category and original colour, as `surface_key` writes them -> finish; furniture of a kind matches.
        roles: Role of a wall's part -> finish.
        replaced: Walls of the scene that are not drawn, since `walls` are where they stand.
    """

    floor: Finish
    finishes: Mapping[str, Finish]
    roles: Mapping[str, Finish]
    walls: tuple[Wall, ...] = ()
    replaced: tuple[str, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """Return them as plain data."""
        return asdict(self)

    def paint(self) -> Callable[[SceneObject, Shape], Any]:
        """Return a function that gives the material of a shape; it caches textures, so make one for each world."""
        look = _looks()

        def drawn(thing: SceneObject, shape: Shape) -> Any:
            if thing.id in self.replaced:
                return None
            finish = self.finishes.get(surface_key(thing.category, shape))
            if finish is None:
                return shape.color
            return look(finish) if shape.kind == "box" else (*finish.color, *shape.color[3:])

        return drawn

    def slab(self, half_m: Vector) -> Any:
        """Return the drawn shape of a floor of these half extents, at the origin."""
        return textured_box(half_m, material_of(self.floor))

    def sides(self) -> Iterator[tuple[Array, Any]]:
        """Yield the pose (4, 4) and the render component of each wall."""
        look = _looks()
        for wall in self.walls:
            shapes = [box(part.low_m, part.high_m, (1.0, 1.0, 1.0), collides=False) for part in wall.parts]
            looks = {id(one): look(self.roles[part.role]) for one, part in zip(shapes, wall.parts, strict=True)}

            def paint(shape: Shape, looks: dict[int, Any] = looks) -> Any:
                return looks[id(shape)]

            yield wall.T_world_wall, build_render_component(shapes, paint, wall=True)


def surface_key(category: str, shape: Shape) -> str:
    """Return the key of surfaces that share one finish: "cabinet/0.80,0.79,0.76"."""
    return f"{category}/{','.join(f'{value:.2f}' for value in shape.color[:3])}"


def _looks() -> Callable[[Finish], Any]:
    """Return a function that gives the look of a finish: a colour, or a material that is made once."""
    return cache(lambda finish: finish.color if finish.material in _PLAIN else material_of(finish))


def material_of(finish: Finish) -> Any:
    """Return an engine's material with a finish's texture."""
    roughness, specular = _LOOK.get(finish.material, _USUAL_LOOK)
    if finish.material == "view":
        return textured_material(_view(finish.pattern), roughness, 0.0, glow=1.0)
    colors = pattern(finish.material, finish.pattern)[..., None] * np.asarray(finish.color)
    return textured_material(colors, roughness, specular)


@lru_cache(maxsize=32)
def pattern(material: Material, number: int) -> NDArray[np.float32]:
    """Return (H, W) the brightness of a material, 0 to 1, which repeats without a seam."""
    rng = np.random.default_rng((zlib.crc32(material.encode()), number))
    rows = np.arange(_TEXTURE_PX)

    def noise(sigma: tuple[float, float]) -> NDArray[Any]:
        field = gaussian_filter(rng.standard_normal((_TEXTURE_PX, _TEXTURE_PX)), sigma, mode="wrap")
        return np.asarray(field / field.std())

    def brick(row_count: int, column_count: int, joint: float) -> NDArray[Any]:
        """Return the shade of tiles in rows, each of a tone of its own, with joints between them."""
        down = rows * row_count // _TEXTURE_PX
        shift = 0 if row_count == column_count else _TEXTURE_PX // column_count // 2
        across = (rows[None, :] + shift * (down % 2)[:, None]) % _TEXTURE_PX * column_count // _TEXTURE_PX
        tone = rng.uniform(-0.05, 0.04, (row_count, column_count))[down[:, None], across]
        gap = (np.diff(down, prepend=-1) != 0)[:, None] | (across != np.roll(across, 1, axis=1))
        # Rolled, so that the edges of the texture are within tiles.
        return np.roll(np.where(gap, joint, 0.95 + tone), (5, 5), axis=(0, 1))

    if material == "steel":
        shade = 0.95 + 0.015 * noise((0.6, 30.0)) + 0.005 * noise((0.5, 0.5))
    elif material == "wood":
        shade = 0.85 + 0.06 * np.sin(6.0 * noise((9.0, 60.0))) + 0.05 * noise((0.8, 14.0))
    elif material in ("planks", "herringbone"):
        plank = rows * _PLANKS // _TEXTURE_PX
        ends = rng.integers(_TEXTURE_PX, size=_PLANKS)[plank][:, None]
        half = ((rows[None, :] - ends) % _TEXTURE_PX) * 2 // _TEXTURE_PX
        tone = rng.uniform(-0.12, 0.08, (_PLANKS, 2))[plank[:, None], half]
        gap = (np.diff(plank, prepend=-1) != 0)[:, None] | (half != np.roll(half, 1, axis=1))
        shade = 0.88 + tone + 0.05 * noise((0.8, 18.0)) - 0.3 * gap
        if material == "herringbone":
            shade = _herringbone(rng, noise((0.8, 10.0)))
    elif material == "tiles":
        shade = brick(_TILES, _TILES, 0.68) + 0.015 * noise((2.0, 2.0))
    elif material == "metro":
        shade = brick(*_METRO, 0.72)
    elif material == "stone":
        veins = np.exp(-((noise((14.0, 22.0)) / 0.05) ** 2))
        shade = 0.95 - 0.10 * veins + 0.015 * noise((1.0, 1.0))
    elif material == "fabric":
        weave = 0.04 * np.where((rows[:, None] + rows[None, :]) // 2 % 2, 1.0, -1.0)
        shade = 0.9 + weave + 0.04 * noise((1.5, 1.5))
    else:
        shade = 0.97 + 0.012 * noise((3.0, 3.0))
    return np.asarray(np.clip(shade, 0.0, 1.0), np.float32)


def _herringbone(rng: np.random.Generator, grain: NDArray[Any]) -> NDArray[Any]:
    """Return the shade of blocks, four times as long as wide, laid at right angles to each other."""
    cell = _TEXTURE_PX // 16
    y, x = np.mgrid[:_TEXTURE_PX, :_TEXTURE_PX] // cell
    # In each row a block lies along, four cells long, and next to it four blocks stand; rows are shifted by one cell.
    place = (x - y) % 8
    lies = place < 4
    first = np.where(lies, x - place, x) % 16
    top = np.where(lies, y, y - (7 - place)) % 16
    tone = rng.uniform(-0.10, 0.08, (16, 16, 2))[top, first, lies.astype(int)]
    inside = np.mgrid[:_TEXTURE_PX, :_TEXTURE_PX] % cell
    gap = np.where(lies, (inside[0] == 0) | ((place == 0) & (inside[1] == 0)), (inside[1] == 0))
    gap |= ~lies & (place == 7) & (inside[0] == 0)
    return 0.88 + tone + 0.05 * np.where(lies, grain, grain.T) - 0.25 * gap


@lru_cache(maxsize=8)
def _view(number: int) -> NDArray[np.float32]:
    """Return (H, W, 3) linear RGB of what is outside a window: sky, trees and a lawn, out of focus.

    Rows go up, and the middle of the pane is row 0: texture coordinates begin there.
    """
    rng = np.random.default_rng((zlib.crc32(b"view"), number))
    up = (np.arange(_TEXTURE_PX) / _TEXTURE_PX - 0.5)[:, None]

    def noise(sigma: float) -> NDArray[Any]:
        field = gaussian_filter(rng.standard_normal((_TEXTURE_PX, _TEXTURE_PX)), sigma, mode="wrap")
        return np.asarray(field / field.std())

    sky = np.array([0.62, 0.78, 0.95]) + np.clip(0.4 - up, 0.0, 1.0)[..., None] * np.array([0.35, 0.2, 0.05])
    color = np.broadcast_to(sky, (_TEXTURE_PX, _TEXTURE_PX, 3)).copy()
    tree = up < 0.02 + 0.10 * noise(24.0)[:1]
    color[tree] = (np.array([0.16, 0.26, 0.10]) * (1.0 + 0.30 * noise(5.0)[..., None]))[tree]
    color[np.broadcast_to(up < -0.24, tree.shape)] = (0.30, 0.42, 0.16)
    blurred = gaussian_filter(np.clip(color, 0.0, 1.0), (3.0, 3.0, 0.0), mode=("nearest", "wrap", "nearest"))
    return np.roll(blurred, -_TEXTURE_PX // 2, axis=0).astype(np.float32)


TINTS: Mapping[Surroundings, Vector] = {
    "plain": (1.0, 1.0, 1.0),
    "sky": (0.94, 1.0, 1.10),
    "dusk": (1.12, 0.99, 0.90),
    "hall": (1.05, 1.0, 0.94),
    "forest": (0.95, 1.05, 0.94),
}
"""Factor of the ambient light: about the mean of the panorama, none of them dark."""

_ROWS, _COLUMNS = 128, 256  # 1.4 degrees: a few pixels of a camera, as blurred as what is far from the lens.
_SURROUNDINGS: tuple[Surroundings, ...] = ("sky", "dusk", "hall", "forest")
_PANORAMAS = 4  # Of each.
_GROUND = np.array([0.22, 0.21, 0.19])


def panorama_of(lights: Lights) -> NDArray[np.float32] | None:
    """Return the panorama (H, W, 3) of a scene's lights, or None where the background is the ambient colour."""
    return None if lights.surroundings == "plain" else _panorama(lights.surroundings, lights.panorama)


@lru_cache(maxsize=32)
def _panorama(kind: Surroundings, number: int) -> NDArray[np.float32]:
    color = np.empty((_ROWS, _COLUMNS, 3))
    rng = np.random.default_rng((zlib.crc32(kind.encode()), number))
    up = np.cos((np.arange(_ROWS) + 0.5) / _ROWS * np.pi)[:, None]  # The height of each row's direction, 1 to -1.

    def noise(rows: float, columns: float) -> NDArray[np.float64]:
        field = gaussian_filter(rng.standard_normal((_ROWS, _COLUMNS)), (rows, columns), mode=("nearest", "wrap"))
        return np.asarray(field / field.std())

    def between(low: tuple[float, float, float], high: tuple[float, float, float], share: Array) -> Array:
        return np.add(low, np.clip(share, 0.0, 1.0)[..., None] * np.subtract(high, low))

    if kind == "hall":
        # Walls with windows in a row, a ceiling above, a floor below.
        bay = np.arange(_COLUMNS) % (_COLUMNS // 8) / (_COLUMNS / 8)
        window = ((bay > 0.25) & (bay < 0.75))[None, :] & (up > 0.05) & (up < 0.42)
        wall = rng.uniform(0.35, 0.75, 3) * 0.5 + 0.25
        color[:] = wall * (0.95 + 0.03 * noise(3.0, 3.0)[..., None])
        color[np.broadcast_to(up > 0.6, color.shape[:2])] = (0.72, 0.71, 0.69)
        color[np.broadcast_to(up < -0.35, color.shape[:2])] = _GROUND * 1.6
        color[window] = (1.0, 1.0, 0.98)
        return gaussian_filter(color, (0.8, 0.8, 0.0), mode=("nearest", "wrap", "nearest")).astype(np.float32)
    if kind == "dusk":
        color[:] = between((0.95, 0.55, 0.30), (0.25, 0.30, 0.50), np.broadcast_to(up * 1.6, color.shape[:2]))
    else:
        color[:] = between((0.75, 0.82, 0.90), (0.25, 0.45, 0.80), np.broadcast_to(up * 1.2, color.shape[:2]))
    clouds = np.clip(0.5 * noise(3.0, 9.0), 0.0, 1.0) * np.clip(4.0 * up, 0.0, 1.0)
    color += 0.6 * clouds[..., None] * (0.9 - color)
    # What stands along the horizon: hills, houses or trees.
    skyline = 0.04 + 0.03 * noise(0.0, 6.0)[0] + (0.22 + 0.08 * noise(0.0, 1.5)[0] if kind == "forest" else 0.0)
    along = (up < skyline[None, :]) & (up >= -0.02)
    tone = (0.10, 0.17, 0.07) if kind == "forest" else (0.24, 0.25, 0.27)
    color[along] = np.asarray(tone) * (1.0 + 0.25 * noise(1.0, 1.0)[along][:, None])
    ground = np.broadcast_to(up < -0.02, color.shape[:2])
    color[ground] = _GROUND * (1.0 + 0.1 * noise(2.0, 2.0)[ground][:, None])
    return np.clip(color, 0.0, 1.0).astype(np.float32)


# A camera's place (m, each way), its direction (rad, about each axis) and its vertical opening angle (rad): what
# mounting and calibrating leave; the overview moves from room to room. The wrist's camera has 23 mm to the hand.
_PERTURBATIONS = {
    "global": (0.20, math.radians(3.0), math.radians(3.0)),
    "head": (0.02, math.radians(3.0), math.radians(4.0)),
    "wrist": (0.005, math.radians(2.0), math.radians(4.0)),
}
_TRIES = 20


def sample_lights(rng: np.random.Generator) -> Lights:
    """Sample side, height, colour and strength of the lights, and the background; always bright enough to see by."""
    azimuth, height = rng.uniform(-math.pi, math.pi), math.radians(rng.uniform(45.0, 78.0))
    fill_azimuth, fill_height = azimuth + math.pi + rng.uniform(-1.0, 1.0), math.radians(rng.uniform(20.0, 50.0))
    warmth = rng.uniform(-0.12, 0.12)  # From a cloudy noon to lamps.
    tint = np.array([1.0 + warmth, 1.0, 1.0 - warmth])
    sun, fill, ambient = rng.uniform(0.6, 1.25), rng.uniform(0.5, 1.5), rng.uniform(0.7, 1.4)
    surroundings, panorama = _SURROUNDINGS[int(rng.integers(len(_SURROUNDINGS)))], int(rng.integers(_PANORAMAS))
    return Lights(
        ambient=_color(np.multiply(DAYLIGHT.ambient, ambient) * TINTS[surroundings]),
        sun_direction=_direction(azimuth, height),
        sun_color=_color(np.multiply(DAYLIGHT.sun_color, sun * tint)),
        fill_direction=_direction(fill_azimuth, fill_height),
        fill_color=_color(np.multiply(DAYLIGHT.fill_color, fill * tint[::-1])),
        surroundings=surroundings,
        panorama=panorama,
    )


def perturb_cameras(rng: np.random.Generator, cameras: Iterable[Camera], scene: Scene) -> tuple[Camera, ...]:
    """Return cameras with perturbed poses and opening angles; a still camera stays clear of all solids.

    Args:
        rng: Random numbers; each camera has its own, independent of which others there are.
    """
    base = int(rng.integers(2**62))
    return tuple(
        _perturb_camera(np.random.default_rng((base, *camera.name.encode())), camera, scene) for camera in cameras
    )


def _perturb_camera(rng: np.random.Generator, camera: Camera, scene: Scene) -> Camera:
    place_m, turn_rad, fov_rad = _PERTURBATIONS[camera.name]
    for _ in range(_TRIES):
        turn = Rotation.from_rotvec(rng.uniform(-turn_rad, turn_rad, 3)).as_matrix()
        T = camera.T_mount_camera @ transform(turn, rng.uniform(-place_m, place_m, 3))
        found = replace(camera, T_mount_camera=T, fov_y_rad=camera.fov_y_rad + float(rng.uniform(-fov_rad, fov_rad)))
        if camera.mount is not None or is_lens_clear(scene, T[:3, 3]):
            return found
    return camera


def _direction(azimuth_rad: float, height_rad: float) -> Vector:
    across = math.cos(height_rad)
    return (across * math.cos(azimuth_rad), across * math.sin(azimuth_rad), -math.sin(height_rad))


def _color(values: np.ndarray) -> Vector:
    r, g, b = (round(float(value), 4) for value in values)
    return (r, g, b)
