"""Scores of reconstructions: match things with the true room, compare them, and summarise the columns.

Source: the columns of Digital Cousins' table of reconstructions (category, model, L2, orientation, box IoU, IoU with
centres put together); ADD-SB as in recent work on object poses: the mean distance between two surfaces, both ways, and
right where it is below 5 % of the true diameter. The report card has every column over all visible things, over
furniture and over items.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from statistics import fmean, median, pstdev
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from executor.assets.asset_geometry import shape_mesh
from executor.assets.footprint import Footprint, open_fraction, yaw_of
from executor.assets.library import LIBRARY, asset_for
from executor.bench.photo.truth import Shot
from executor.geometry import Array, rotation_z, transform_from_quaternion
from executor.photo.drawing import visible_owners
from executor.photo.inputs.annotations import Detection
from executor.photo.pipeline import PhotoResult
from executor.sim.render.cameras import joints_at_start, link_frames
from executor.system.extras import require
from oag import SceneObject
from oag.model.scene import about_z
from oag.model.symbols import Kind
from oag.primitives.table import OPEN_FRACTION

_LEAST_COMMON = 0.5
"""IoU of two masks: as usual for detectors (COCO's AP50)."""


def match_things(
    masks: Mapping[str, NDArray[np.bool_]], boxes: Mapping[str, Detection], result: PhotoResult
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return true id -> id in the reconstruction, and the reconstructed ids without a true object.

    An object fitted to a box is matched to the box's true object. An unboxed one is matched to the object that it
    covers in the picture, if the two have half of their pixels in common.

    Args:
        masks: id -> (H, W) pixels of every visible object.
        boxes: id -> its given detection.
        result: The reconstruction.
    """
    made_of = {id(thing.detection): thing.id for thing in result.found.things}
    found = {name: made_of[id(box)] for name, box in boxes.items() if id(box) in made_of}
    guesses = {thing.id: thing.fit.guess for thing in result.found.things}
    shown = visible_owners(result.observation, guesses)
    others = [name for name in masks if name not in found]
    free = [(number, key) for number, key in enumerate(guesses) if key not in found.values()]
    common = np.zeros((len(others), len(free)))
    for row, name in enumerate(others):
        for column, (number, _) in enumerate(free):
            own = shown == number
            common[row, column] = (masks[name] & own).sum() / max(1, (masks[name] | own).sum())
    for row, column in zip(*linear_sum_assignment(-common), strict=True):
        if common[row, column] >= _LEAST_COMMON:
            found[others[row]] = free[column][1]
    return found, tuple(key for _, key in free if key not in found.values())


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
_ROUND = ("table_round",)


@dataclass(frozen=True)
class ThingScore:
    """Scores of one visible object of a room.

    Attributes:
        thing, category, model: Its identity.
        item: Whether it can be grasped.
        pixels: Number of its visible pixels.
        found: Whether the reconstruction has it; if not, the following fields are None, False or 0.
        category_right, model_right: Whether category and model are correct.
        l2_m: Distance of the boxes' middles.
        turned_rad: Difference of headings, None for round objects.
        iou, centred_iou: Of the boxes; the second after their middles were put together.
        add_right: Whether the surfaces are nearer than 5 % of its diameter.
        hinge_right, drawers_right, open_right: None if it has no such part.
        confidence: The reconstruction's confidence in its model.
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
        """Return it as plain data."""
        return asdict(self)


def in_level_frame(shot: Shot, name: str) -> SceneObject:
    """Return a true object in the frame of a reconstruction: under the camera, x where it looks."""
    obj, T = shot.scene.objects[name], shot.T_level_world
    x, y, z = (float(value) for value in (T @ [*obj.position, 1.0])[:3])
    yaw = yaw_of(obj) + math.atan2(T[1, 0], T[0, 0])
    return replace(obj, position=(x, y, z), orientation=about_z(yaw), bbox_extent=obj.extent_m, scale=(1.0, 1.0, 1.0))


def compare_thing(
    true: SceneObject, category: str, pixels: int, made: SceneObject | None, confidence: float | None, points_m: Array
) -> ThingScore:
    """Compare an object with its reconstruction.

    Args:
        true: In the level frame.
        category: The library's category.
        pixels: Number of its visible pixels.
        made: Its reconstruction, or None.
        confidence: The reconstruction's confidence.
        points_m: (N, 3) its visible points, for the box that is drawn around them.
    """
    start = ThingScore(true.id, category, true.model, true.kind is Kind.ITEM, pixels)
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
        category_right=made.model in LIBRARY and LIBRARY[made.model].category == category,
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
    """Return the difference of two headings, modulo the symmetry of the true model."""
    period = math.pi / 2 if true.model in _QUARTER else math.pi if true.model in _HALF else 2 * math.pi
    return abs(math.remainder(yaw_of(made) - yaw_of(true), period))


def iou(first: SceneObject, second: SceneObject) -> float:
    """Return the intersection over union of two upright boxes."""
    polygon = require("shapely.geometry", "photo").Polygon
    a, b = Footprint.of(first), Footprint.of(second)
    height = max(0.0, min(a.high_m, b.high_m) - max(a.low_m, b.low_m))
    common = float(polygon(a.corners_m).intersection(polygon(b.corners_m)).area) * height
    both = float(np.prod(first.extent_m) + np.prod(second.extent_m)) - common
    return common / both


def visible_box(points_m: Array, true: SceneObject) -> SceneObject:
    """Return the box around visible points in the true heading: how Digital Cousins sizes objects."""
    R = rotation_z(yaw_of(true))
    low, high = np.percentile(points_m @ R, 0.5, axis=0), np.percentile(points_m @ R, 99.5, axis=0)
    x, y, z = (float(value) for value in R @ ((low + high) / 2))
    length, width, height = (max(0.005, float(value)) for value in high - low)
    return replace(true, position=(x, y, z), bbox_extent=(length, width, height))


def support_counts(true: Sequence[tuple[str, str]], made: Sequence[tuple[str, str]]) -> tuple[int, int, int]:
    """Return how many pairs (thing, support) are in both, in the truth, and in the reconstruction."""
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
    """Return (N, 3) points on the visible surface of an object."""
    asset, trimesh = asset_for(obj), require("trimesh", "sim")
    frames = link_frames(asset, joints_at_start(obj))
    meshes = [
        shape_mesh(shape).apply_transform(frames[link.name])
        for link in asset.links
        for shape in link.shapes
        if shape.visible
    ]
    points, _ = require("trimesh.sample", "sim").sample_surface(trimesh.util.concatenate(meshes), _SAMPLES, seed=0)
    T = transform_from_quaternion(obj.position, obj.orientation)
    return np.asarray(points) @ T[:3, :3].T + T[:3, 3]


RoomRecord = Mapping[str, Any]
ThingRecord = Mapping[str, Any]

PRINTED = (
    "Digital Cousins as printed, RGB only, its own simulator: 39 things, L2 9.5 cm, 0.08 rad, IoU 0.65, centred 0.74"
)


def card_rows(rooms: Sequence[RoomRecord]) -> list[tuple[str, str]]:
    """Return the lines of the table over some rooms, as names and texts."""
    rows = [("rooms", str(len(rooms)))]
    without = sum("not_photographed" in room for room in rooms)
    rooms = [room for room in rooms if "not_photographed" not in room]
    rows += [("not photographed: no such room, or no place for a camera in it", str(without))] if without else []
    things = [thing for room in rooms for thing in room["things"]]
    rows += _settled(rooms)
    for name, members in (
        ("all", things),
        ("furniture", [thing for thing in things if not thing["item"]]),
        ("items", [thing for thing in things if thing["item"]]),
    ):
        rows += [(f"{name}: {column}", value) for column, value in _columns(members)]
    rows.append(("supports: F1", _f1(rooms)))
    rows.append(("things made of nothing that is there", str(sum(len(room.get("invented", ())) for room in rooms))))
    return rows


def _settled(rooms: Sequence[RoomRecord]) -> list[tuple[str, str]]:
    done = [room for room in rooms if "took_s" in room]
    rows = [
        ("no floor or nothing recognised", str(len(rooms) - len(done))),
        ("settled in physics", _share(done, lambda room: bool(room["settled"]))),
    ]
    if done:
        took, cpu = [room["took_s"] for room in done], [room["cpu_s"] for room in done]
        rows.append(("seconds a room", f"{fmean(took):.0f}, of the processor {fmean(cpu):.0f}, at most {max(cpu):.0f}"))
    return rows


def _columns(things: Sequence[ThingRecord]) -> list[tuple[str, str]]:
    found = [thing for thing in things if thing["found"]]
    turned = [thing["turned_rad"] for thing in found if thing["turned_rad"] is not None]
    boxed = [thing for thing in things if thing["visible_iou"] is not None]
    return [
        ("visible things", str(len(things))),
        ("recall", _share(things, lambda thing: bool(thing["found"]))),
        ("category", _share(things, lambda thing: bool(thing["category_right"]))),
        ("category of those found", _share(found, lambda thing: bool(thing["category_right"]))),
        ("model", _share(things, lambda thing: bool(thing["model_right"]))),
        ("L2 [cm]", _spread([100.0 * thing["l2_m"] for thing in found], 1)),
        ("orientation [rad]", _spread(turned, 3)),
        ("turned by more than 0.5 rad", _share(turned, lambda value: value > FLIP_RAD)),
        ("box IoU, missed count 0", _spread([thing["iou"] for thing in things], 2)),
        ("box IoU of those found", _spread([thing["iou"] for thing in found], 2)),
        ("centred IoU of those found", _spread([thing["centred_iou"] for thing in found], 2)),
        ("ADD-SB at 5 %", _share(things, lambda thing: bool(thing["add_right"]))),
        ("hinge side", _agreed(things, "hinge_right")),
        ("number of drawers", _agreed(things, "drawers_right")),
        ("open or shut", _agreed(things, "open_right")),
        ("box of the true mask's points: L2 [cm]", _spread([100.0 * thing["visible_l2_m"] for thing in boxed], 1)),
        ("box of the true mask's points: IoU", _spread([thing["visible_iou"] for thing in boxed], 2)),
    ]


def _agreed(things: Sequence[ThingRecord], key: str) -> str:
    """Return the share over objects to which the column applies; an object with another model counts as wrong."""
    return _share([thing for thing in things if thing[key] is not None], lambda thing: bool(thing[key]))


def _share(members: Iterable[Any], holds: Callable[[Any], bool]) -> str:
    every = list(members)
    good = sum(holds(one) for one in every)
    return f"{100 * good / len(every):.1f} % ({good} of {len(every)})" if every else "none"


def _spread(values: Sequence[float], digits: int) -> str:
    if not values:
        return "none"
    return f"{fmean(values):.{digits}f} ± {pstdev(values):.{digits}f}, median {median(values):.{digits}f}"


def _f1(rooms: Sequence[RoomRecord]) -> str:
    both, true, made = (sum(room["supports"][part] for room in rooms if "supports" in room) for part in range(3))
    return f"{2 * both / (true + made):.3f} ({both} right of {true} true and {made} made)" if true + made else "none"
