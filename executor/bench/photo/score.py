"""One thing of a known room beside what a reconstruction made of it, and the numbers of the usual tables.

Source: the columns of Digital Cousins' table of reconstructions (category, model, L2, orientation, box IoU, IoU with
centres put together); ADD-SB as in recent work on object poses: the mean distance between two surfaces, both ways, and
right where it is below 5 % of the true diameter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from executor.assets.footprint import Footprint, open_fraction, yaw_of
from executor.assets.library import LIBRARY, asset_for
from executor.assets.surface import surface_of
from executor.bench.photo.foreign import ROUND
from executor.bench.photo.truth import Shot
from executor.geometry import Array, rotation_z, transform_from_quaternion
from executor.machine.extras import require
from executor.pictures.solids import joints_at_start, link_frames
from oag import Kind, SceneObject
from oag.model.scenefile import about_z
from oag.table.library import OPEN_FRACTION

FLIP_RAD = 0.5
_SAMPLES = 1000
_ADD_SHARE = 0.05
# Models that look the same after a quarter turn with their sides exchanged, or after half a turn.
_QUARTER = (
    "table_four_legs",
    "coffee_table",
    "desk_four_legs",
    "carton",
    "open_box",
    "book_upright",
    "book_lying",
    "die",
)
_HALF = ("counter_plain",)
_ROUND = ("table_round", *ROUND)


@dataclass(frozen=True)
class Compared:
    """One visible thing of a room.

    Attributes:
        thing, category, model: What it is.
        item: Whether it is something to take hold of.
        pixels: How many of it are seen.
        found: Whether the reconstruction has it. What follows is None, False or 0 where it has not.
        category_right, model_right: Whether it is taken for what it is.
        l2_m: Distance of the boxes' middles.
        turned_rad: Difference of headings, None for what is round.
        iou, centred_iou: Of the boxes; the second after their middles were put together.
        add_right: Whether the surfaces are nearer than 5 % of its diameter.
        hinge_right, drawers_right, open_right: None where it has no such thing.
        confidence: What the reconstruction says of its model.
        visible_l2_m, visible_iou: Of the box of its visible points, given its true heading.
    """

    thing: str
    category: str
    model: str
    item: bool
    pixels: int
    found: bool = False
    taken_for: str = ""
    category_right: bool = False
    model_right: bool = False
    l2_m: float | None = None
    turned_rad: float | None = None
    iou: float = 0.0
    centred_iou: float = 0.0
    add_right: bool = False
    hinge_right: bool | None = None
    drawers_right: bool | None = None
    open_right: bool | None = None
    confidence: float | None = None
    visible_l2_m: float | None = None
    visible_iou: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Returns it as plain data."""
        return asdict(self)


def in_level_frame(shot: Shot, name: str) -> SceneObject:
    """Returns a true object in the frame of a reconstruction: under the camera, x where it looks."""
    obj, T = shot.scene.objects[name], shot.T_level_world
    x, y, z = (float(value) for value in (T @ [*obj.position, 1.0])[:3])
    yaw = yaw_of(obj) + math.atan2(T[1, 0], T[0, 0])
    return replace(obj, position=(x, y, z), orientation=about_z(yaw), bbox_extent=obj.extent_m, scale=(1.0, 1.0, 1.0))


def compared(
    true: SceneObject, category: str, pixels: int, made: SceneObject | None, confidence: float | None, points_m: Array
) -> Compared:
    """Returns a thing beside what was made of it.

    Args:
        true: In the level frame.
        category: The library's name of what it is.
        pixels: How many of it are seen.
        made: What the reconstruction has for it, or None.
        confidence: What the reconstruction says.
        points_m: (N, 3) its visible points, for the box that is drawn around them.
    """
    start = Compared(true.id, category, true.model, true.kind is Kind.ITEM, pixels)
    if len(points_m):
        box = visible_box(points_m, true)
        start = replace(start, visible_l2_m=_apart_m(true, box), visible_iou=iou(true, box))
    if made is None:
        return start
    is_round = asset_for(true).symmetric_about_z or true.model in _ROUND
    same = replace(made, orientation=true.orientation) if is_round else made
    same_model = made.model == true.model
    return replace(
        start,
        found=True,
        taken_for=made.model,
        category_right=LIBRARY[made.model].category == category,
        model_right=same_model,
        l2_m=_apart_m(true, made),
        turned_rad=None if is_round else turned_rad(true, made),
        iou=iou(true, same),
        centred_iou=iou(true, replace(same, position=true.position)),
        add_right=_add_right(true, made),
        hinge_right=_same_option("hinge", true, made),
        drawers_right=_same_option("drawers", true, made),
        open_right=_same_opening(true, made),
        confidence=confidence,
    )


def turned_rad(true: SceneObject, made: SceneObject) -> float:
    """Returns the difference of two headings, up to what makes no difference to the true model."""
    period = math.pi / 2 if true.model in _QUARTER else math.pi if true.model in _HALF else 2 * math.pi
    return abs(math.remainder(yaw_of(made) - yaw_of(true), period))


def iou(first: SceneObject, second: SceneObject) -> float:
    """Returns how much two upright boxes have in common, as a share of what they take up together."""
    polygon = require("shapely.geometry", "photo").Polygon
    a, b = Footprint.of(first), Footprint.of(second)
    height = max(0.0, min(a.high_m, b.high_m) - max(a.low_m, b.low_m))
    common = float(polygon(a.corners_m).intersection(polygon(b.corners_m)).area) * height
    both = float(np.prod(first.extent_m) + np.prod(second.extent_m)) - common
    return common / both


def visible_box(points_m: Array, true: SceneObject) -> SceneObject:
    """Returns the box around visible points in the true heading: how Digital Cousins sizes things."""
    R = rotation_z(yaw_of(true))
    low, high = np.percentile(points_m @ R, 0.5, axis=0), np.percentile(points_m @ R, 99.5, axis=0)
    x, y, z = (float(value) for value in R @ ((low + high) / 2))
    length, width, height = (max(0.005, float(value)) for value in high - low)
    return replace(true, position=(x, y, z), bbox_extent=(length, width, height))


def support_counts(true: Sequence[tuple[str, str]], made: Sequence[tuple[str, str]]) -> tuple[int, int, int]:
    """Returns how many pairs (thing, support) are in both, in the truth, and in the reconstruction."""
    return len(set(true) & set(made)), len(set(true)), len(set(made))


def _apart_m(first: SceneObject, second: SceneObject) -> float:
    return float(math.dist(first.position, second.position))


def _same_option(name: str, true: SceneObject, made: SceneObject) -> bool | None:
    if name not in true.parameters:
        return None
    return made.parameters.get(name) == true.parameters[name]


def _same_opening(true: SceneObject, made: SceneObject) -> bool | None:
    if true.kind is not Kind.ARTICULATED:
        return None
    return (open_fraction(true) > OPEN_FRACTION) == (open_fraction(made) > OPEN_FRACTION)


def _add_right(true: SceneObject, made: SceneObject) -> bool:
    a, b = _surface(true), _surface(made)
    mean = (float(cKDTree(a).query(b)[0].mean()) + float(cKDTree(b).query(a)[0].mean())) / 2
    return mean < _ADD_SHARE * math.hypot(*true.extent_m)


def _surface(obj: SceneObject) -> Array:
    """(N, 3) points on what is seen of an object."""
    asset, trimesh = asset_for(obj), require("trimesh", "sim")
    frames = link_frames(asset, joints_at_start(obj))
    meshes = [
        surface_of(shape).apply_transform(frames[link.name])
        for link in asset.links
        for shape in link.shapes
        if shape.visible
    ]
    points, _ = require("trimesh.sample", "sim").sample_surface(trimesh.util.concatenate(meshes), _SAMPLES, seed=0)
    T = transform_from_quaternion(obj.position, obj.orientation)
    return np.asarray(points) @ T[:3, :3].T + T[:3, 3]
