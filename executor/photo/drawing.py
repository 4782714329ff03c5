"""Pictures of a reconstruction: outlines on the photograph, and the scene as the same camera draws it."""

from __future__ import annotations

import colorsys
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import maximum_filter, minimum_filter

from executor.assets.footprint import yaw_of
from executor.geometry import Array
from executor.photo.fitting.hypothesis import PoseHypothesis, raycaster_of
from executor.photo.geometry.observation import Observation, is_hidden
from executor.photo.geometry.walls import Wall, depth_of_empty
from executor.photo.room.reconstruct import FittedRoom
from oag import Scene, SceneObject

Picture = NDArray[np.uint8]

_GOLDEN = 0.61803  # Hues that follow each other by this share of the circle are never alike.
_DIMMED = 0.75
_AROUND = 0.15  # Of a box's sides, shown around it.
_LEAST_SIDE_PX = 24
_PANEL_PX, _NAME_PX, _LINE_PX = 640, 14, 5
_FLOOR, _WALL, _NOTHING = (0.42, 0.40, 0.37), (0.62, 0.61, 0.58), (0.80, 0.84, 0.90)  # Linear colours.
_LIGHT, _AMBIENT, _FARTHEST_M = np.array([-0.45, 0.30, 0.84]), 0.45, 30.0


def colour(number: int) -> Picture:
    """Return the (3,) colour of an object by its number."""
    return np.array([255 * part for part in colorsys.hsv_to_rgb(number * _GOLDEN % 1.0, 0.85, 1.0)], dtype=np.uint8)


def visible_owners(observation: Observation, guesses: Mapping[str, PoseHypothesis]) -> NDArray[np.int32]:
    """Return (H, W) the object visible in each pixel, by its position in the mapping; -1 for none."""
    return visible_surfaces(observation, guesses)[0]


def visible_surfaces(
    observation: Observation, guesses: Mapping[str, PoseHypothesis]
) -> tuple[NDArray[np.int32], Array]:
    """Return (H, W) the object visible in each pixel as `visible_owners`, and (H, W) the depth of the nearest [m]."""
    owner, depth, _ = _rendered(observation, guesses)
    # Parts hidden by something unknown get no outline.
    return np.where(is_hidden(observation, depth), -1, owner).astype(np.int32), depth


def _rendered(
    observation: Observation, guesses: Mapping[str, PoseHypothesis]
) -> tuple[NDArray[np.int32], Array, Array]:
    """Return (H, W) the nearest object, (H, W) its depth, infinite without one, and (H, W, 3) its linear colour."""
    depth = np.full(observation.z_m.shape, np.inf)
    owner = np.full(observation.z_m.shape, -1, dtype=np.int32)
    colours = np.zeros((*depth.shape, 3))
    rays = observation.rays.reshape(-1, 3)
    for number, guess in enumerate(guesses.values()):
        body = raycaster_of(guess)
        if body is None:
            continue
        own, shade = body.colours(guess, observation.eye_m, rays)
        own = own.reshape(depth.shape)
        nearer = own < depth
        depth, owner = np.where(nearer, own, depth), np.where(nearer, number, owner)
        colours[nearer] = shade.reshape(colours.shape)[nearer]
    return owner, depth, colours


def as_settled(found: FittedRoom, scene: Scene | None) -> dict[str, PoseHypothesis]:
    """Return the fits as they are in a scene: moved, resized and settled; as they are found without one."""
    if scene is None:
        return found.guesses
    return {thing.id: _placed(thing.fit.guess, scene.objects[thing.id]) for thing in found.things}


def _placed(guess: PoseHypothesis, obj: SceneObject) -> PoseHypothesis:
    x, y, z = obj.position
    length, width, height = (float(side) for side in obj.extent_m)
    sides = (length, width, height)
    return replace(guess, x_m=x, y_m=y, yaw_rad=yaw_of(obj), bottom_m=z - height / 2, size_m=sides)


def draw_outlines(rgb: Picture, owner: NDArray[np.int32]) -> Picture:
    """Return a photograph (H, W, 3) with the outline of every fitted object."""
    picture = (rgb * _DIMMED).astype(np.uint8)
    border = maximum_filter(owner, _LINE_PX) != minimum_filter(owner, _LINE_PX)
    for number in np.unique(owner[owner >= 0]):
        picture[border & (owner == number)] = colour(int(number))
    return picture


def draw_scene(observation: Observation, guesses: Mapping[str, PoseHypothesis], walls: tuple[Wall, ...]) -> Picture:
    """Return the scene (H, W, 3) as the photograph's camera draws it, with light from above."""
    owner, depth, colours = _rendered(observation, guesses)
    empty, surface = depth_of_empty(observation, walls)
    colours[owner < 0] = np.where((surface == 0)[..., None], _FLOOR, _WALL)[owner < 0]
    depth = np.minimum(depth, empty)
    points = observation.eye_m + observation.rays * np.minimum(depth, _FARTHEST_M)[..., None]
    normals = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=0))
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    lit = _AMBIENT + (1.0 - _AMBIENT) * np.abs(normals @ _LIGHT)
    linear = np.where(np.isfinite(depth)[..., None], colours * lit[..., None], _NOTHING)
    return np.asarray(255.0 * np.clip(linear, 0.0, 1.0) ** (1 / 2.2), dtype=np.uint8)


def side_by_side(observation: Observation, found: FittedRoom, scene: Scene | None) -> Picture:
    """Return photograph, fitted outlines with names, and drawn scene side by side, each 640 pixels wide.

    Args:
        observation: The photograph.
        found: The fits.
        scene: The scene that they became; None without one.
    """
    guesses = as_settled(found, scene)
    step = max(1, observation.size_px[0] // _PANEL_PX)
    coarser = {name: getattr(observation, name)[::step, ::step] for name in ("rgb", "z_m", "rays")}
    observation = replace(observation, **coarser)
    width, height = observation.size_px
    size_px = (_PANEL_PX, round(height * _PANEL_PX / width))
    owner = np.asarray(Image.fromarray(visible_owners(observation, guesses)).resize(size_px, Image.Resampling.NEAREST))
    photograph = _resized(observation.rgb, size_px)
    outlined = _named(draw_outlines(photograph, owner), owner, list(guesses))
    drawn = _named(_resized(draw_scene(observation, guesses, found.walls), size_px), owner, list(guesses))
    return np.concatenate([photograph, outlined, drawn], axis=1)


def _resized(picture: Picture, size_px: tuple[int, int]) -> Picture:
    return np.asarray(Image.fromarray(picture).resize(size_px, Image.Resampling.LANCZOS))


def _named(picture: Picture, owner: NDArray[np.int32], names: list[str]) -> Picture:
    """Return a picture with the name of each object in its visible middle."""
    image = Image.fromarray(picture)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(_NAME_PX)
    for number in np.unique(owner[owner >= 0]):
        rows, columns = np.nonzero(owner == number)
        at = (float(np.median(columns)), float(np.median(rows)))
        ink = tuple(int(part) for part in colour(int(number)))
        draw.text(at, names[int(number)], ink, font, "mm", stroke_width=2, stroke_fill=(0, 0, 0))
    return np.asarray(image)


def cut(picture: Picture, box_px: tuple[float, float, float, float]) -> Picture:
    """Crop a picture to a box and its surroundings."""
    height, width = picture.shape[:2]
    x0, y0, x1, y1 = box_px
    over_x = max(_AROUND * (x1 - x0), (_LEAST_SIDE_PX - (x1 - x0)) / 2, 0.0)
    over_y = max(_AROUND * (y1 - y0), (_LEAST_SIDE_PX - (y1 - y0)) / 2, 0.0)
    left, right = max(0, int(x0 - over_x)), min(width, int(x1 + over_x) + 1)
    top, bottom = max(0, int(y0 - over_y)), min(height, int(y1 + over_y) + 1)
    return picture[top:bottom, left:right]
