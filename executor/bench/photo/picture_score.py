"""Scores of reconstructions of real pictures: what a person says of a picture, compared with its scene.

A box that has no thing in the scene is lost, and counts as wrong in every column. Nothing is known of the true poses:
outlines are compared in the picture, sizes with the depth in a box, the vertical with planes that people chose.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import label as connected

from executor.campaign.rate import Rate
from executor.geometry import Array
from executor.photo.geometry.residuals import box_of
from executor.photo.inputs.picture import Intrinsics, up_in_camera
from llm.offline.lexicon import built_in
from llm.vision import overlap

Box = tuple[float, float, float, float]

FLOOR, WALL = "floor", "wall"
"""Supports in an annotation that are no things."""

SIZE_SHARE = 0.2
"""Deviation of a size from that of the depth up to which it is right."""

_QUANTILES = (0.05, 0.95)
_JUMP_M, _JUMP_SHARE = 0.02, 0.02  # Neighbouring pixels that differ by more are of different surfaces.
_LEAST_PX = 30
_RING_SHARE, _RING_PX = 0.25, 6.0
_PLANE_M, _PLANE_SHARE, _PLANE_DRAWS = 0.01, 0.5, 200


@dataclass(frozen=True)
class PictureThing:
    """Scores of one box.

    Attributes:
        thing: Its id in the annotation.
        label: The person's word.
        made: Its id in the scene; empty for a lost one.
        lost: Why it is lost.
        called: Its category in the scene.
        named: Whether it is in the scene under the person's name.
        outline_iou: Of the box around its visible pixels with the person's box.
        support: The annotated relation and support; empty without one.
        stands: What the scene has in its place.
        support_right: Whether both are the same.
        size_ratios: Width and height of its visible surface, divided by those of the depth in its box.
        nearer_m: How much nearer its surface is than the depth in its box.
    """

    thing: str
    label: str
    made: str = ""
    lost: str = ""
    called: str = ""
    named: bool = False
    outline_iou: float = 0.0
    support: str = ""
    stands: str = ""
    support_right: bool = False
    size_ratios: tuple[float, float] | None = None
    nearer_m: float | None = None

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


def is_called(label: str, category: str) -> bool:
    """Return whether a scene's category is a person's word, or another word for the same in the lexicon."""
    spoken, written = (" ".join(name.lower().replace("_", " ").split()) for name in (label, category))
    if spoken == written:
        return True
    entry, other = (built_in().category_of(name.replace(" ", "_")) for name in (spoken, written))
    if entry is None or other is None or spoken not in other.names:
        return False
    # Mugs and glasses have entries of their own, and share most names.
    return entry is other or written in entry.names


def is_same_support(annotated: str, made: str, boarded: Collection[str]) -> bool:
    """Return whether two relations with a support are the same; people say that a thing on a board is in its shelf.

    Args:
        annotated, made: `on desk` or `inside shelf`.
        boarded: Ids of the supports that have boards.
    """
    support = annotated.split(" ", 1)[-1]
    return annotated == made or (support in boarded and made == f"on {support}")


def outline_iou(mask: NDArray[np.bool_], box_px: Box) -> float:
    """Return the intersection over union of a box with the box around a mask (H, W); 0 for an empty mask."""
    return overlap(box_of(mask), box_px) if mask.any() else 0.0


def angle_deg(first: Array, second: Array) -> float:
    """Return the angle [deg] between two vectors (3,)."""
    across = float(np.linalg.norm(np.cross(first, second)))
    return math.degrees(math.atan2(across, float(np.dot(first, second))))


def level_scores(level: Mapping[str, Any], up: Array, height_m: float) -> dict[str, Any]:
    """Return how far a level is off the annotated one; None where the annotation lacks it.

    Args:
        level: The annotation's `tilt_deg`, `roll_deg`, `height_m` and `height_above_support_m`, those that are known.
        up: (3,) the vertical in the camera's frame.
        height_m: Of the camera above the floor.
    """
    scores: dict[str, Any] = {"off_deg": None, "tilt_off_deg": None, "height_off_m": None, "took_top_for_floor": False}
    if "tilt_deg" in level:
        scores["tilt_off_deg"] = math.degrees(math.asin(-float(up[2]))) - level["tilt_deg"]
        if "roll_deg" in level:
            scores["off_deg"] = angle_deg(up, up_in_camera(level["tilt_deg"], level["roll_deg"]))
    floor_m, top_m = level.get("height_m"), level.get("height_above_support_m")
    if floor_m is not None:
        scores["height_off_m"] = height_m - floor_m
    if top_m is not None:
        beyond_m = math.inf if floor_m is None else abs(height_m - floor_m)
        scores["took_top_for_floor"] = abs(height_m - top_m) < min(beyond_m, 0.1 * top_m)
    return scores


def points_in_camera(z_m: Array, camera: Intrinsics) -> Array:
    """Return (H, W, 3) the points of a depth picture (H, W) in the camera's frame, centres of pixels at halves [m]."""
    rows, columns = np.mgrid[0.5 : z_m.shape[0], 0.5 : z_m.shape[1]]
    x, y = (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy
    return np.stack([x * z_m, y * z_m, z_m], axis=-1)


def pixels_of_box(z_m: Array, camera: Intrinsics, box_px: Box, others: Sequence[Box]) -> NDArray[np.bool_]:
    """Return (H, W) the pixels of a box that are of its thing by the depth alone.

    These are the largest smooth surface in its middle, without the plane around the box and without smaller boxes.

    Args:
        z_m: (H, W) depth, 0 where nothing was measured.
        camera: Its intrinsics.
        box_px: The box.
        others: The other boxes.
    """
    inside = within(z_m.shape, box_px)
    free = inside & (z_m > 0.0) & ~covered(z_m.shape, box_px, others)
    x0, y0, x1, y1 = box_px
    wide, high = _RING_SHARE * (x1 - x0) + _RING_PX, _RING_SHARE * (y1 - y0) + _RING_PX
    around = within(z_m.shape, (x0 - wide, y0 - high, x1 + wide, y1 + high))
    neighbours = [other for other in others if _area(other) < 4.0 * _area(box_px)]
    ring = around & ~inside & (z_m > 0.0) & ~_any_of(z_m.shape, neighbours)
    points = points_in_camera(z_m, camera)
    plane = plane_of(points[ring])
    if plane is not None:
        normal, offset_m = plane
        free &= np.abs(points @ normal - offset_m) > _PLANE_M
    return _smooth_piece(np.where(free, z_m, 0.0), box_px)


def plane_of(points_m: Array) -> tuple[Array, float] | None:
    """Return the unit normal and offset of the plane that most of some points (N, 3) are on; None without such."""
    if len(points_m) < _LEAST_PX:
        return None
    rng, best = np.random.default_rng(0), np.zeros(len(points_m), dtype=bool)
    for _ in range(_PLANE_DRAWS):
        a, b, c = points_m[rng.choice(len(points_m), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-9:
            continue
        near = np.abs((points_m - a) @ (normal / length)) < _PLANE_M
        best = near if near.sum() > best.sum() else best
    if best.mean() < _PLANE_SHARE:
        return None
    middle = points_m[best].mean(axis=0)
    normal = np.linalg.svd(points_m[best] - middle, full_matrices=False)[2][2]
    return normal, float(normal @ middle)


def extents_m(points_m: Array) -> tuple[float, float]:
    """Return width and height of points (N, 3) across the camera's view, without the outer twentieths [m]."""
    low, high = np.quantile(points_m[:, :2], _QUANTILES, axis=0)
    return float(high[0] - low[0]), float(high[1] - low[1])


def size_scores(
    measured: NDArray[np.bool_],
    z_m: Array,
    made: NDArray[np.bool_],
    made_z_m: Array,
    camera: Intrinsics,
    box_px: Box,
) -> tuple[tuple[float, float] | None, float | None]:
    """Return the ratios of a fit's visible width and height to those of the depth, and how much nearer it is [m].

    Of the fit, too, counts the smooth surface in the middle of the box: legs are apart from their table in both.

    Args:
        measured: (H, W) pixels of the thing in the depth.
        z_m: (H, W) the depth.
        made: (H, W) visible pixels of its fit.
        made_z_m: (H, W) their depth.
        camera: Intrinsics of both.
        box_px: The thing's box.
    """
    made = _smooth_piece(np.where(made, made_z_m, 0.0), box_px)
    if measured.sum() < _LEAST_PX or not made.any():
        return None, None
    true = points_in_camera(z_m, camera)[measured]
    fitted = points_in_camera(np.where(made, made_z_m, 0.0), camera)[made]
    sides, own = extents_m(true), extents_m(fitted)
    if min(sides) <= 0.0:
        return None, None
    return (own[0] / sides[0], own[1] / sides[1]), float(np.median(true[:, 2]) - np.median(fitted[:, 2]))


def within(shape: tuple[int, ...], box_px: Box) -> NDArray[np.bool_]:
    """Return (H, W) the pixels whose centre is in a box."""
    rows, columns = np.mgrid[0.5 : shape[0], 0.5 : shape[1]]
    x0, y0, x1, y1 = box_px
    return np.asarray((columns > x0) & (columns < x1) & (rows > y0) & (rows < y1))


def covered(shape: tuple[int, ...], box_px: Box, others: Sequence[Box]) -> NDArray[np.bool_]:
    """Return (H, W) the pixels of smaller boxes, whose things may be before that of a box."""
    return _any_of(shape, [other for other in others if _area(other) < _area(box_px)])


def _any_of(shape: tuple[int, ...], boxes: Sequence[Box]) -> NDArray[np.bool_]:
    found = np.zeros(shape[:2], dtype=bool)
    for box in boxes:
        found |= within(shape, box)
    return found


def _area(box_px: Box) -> float:
    return (box_px[2] - box_px[0]) * (box_px[3] - box_px[1])


def _smooth_piece(z_m: Array, box_px: Box) -> NDArray[np.bool_]:
    """Return the piece of a depth picture (H, W) without jumps that has most pixels in the middle of a box."""
    valid = z_m > 0.0
    step_m = np.maximum(_JUMP_M, _JUMP_SHARE * z_m)
    cut = np.zeros(valid.shape, dtype=bool)
    cut[:, 1:] |= (np.abs(z_m[:, 1:] - z_m[:, :-1]) > step_m[:, 1:]) & valid[:, :-1]
    cut[1:] |= (np.abs(z_m[1:] - z_m[:-1]) > step_m[1:]) & valid[:-1]
    pieces, count = connected(valid & ~cut)
    if not count:
        return np.zeros(valid.shape, dtype=bool)
    x0, y0, x1, y1 = box_px
    wide, high = (x1 - x0) / 3, (y1 - y0) / 3
    middle = pieces[within(valid.shape, (x0 + wide, y0 + high, x1 - wide, y1 - high))]
    counts = np.bincount(middle[middle > 0] if (middle > 0).any() else pieces[pieces > 0])
    return np.asarray(pieces == int(counts.argmax()))


PictureRecord = Mapping[str, Any]
LEAST_IN_BOX = 0.5
"""Outline IoU from which a thing is within its box."""


def sections(pictures: Sequence[PictureRecord]) -> dict[str, list[PictureRecord]]:
    """Return the pictures by half, and in it with and without depth; empty ones are left out."""
    found: dict[str, list[PictureRecord]] = {}
    for half in ("tuning", "judging"):
        for name, has_depth in (("with depth", True), ("without depth", False)):
            some = [one for one in pictures if one["half"] == half and one["has_depth"] is has_depth]
            if some:
                found[f"{half}, {name}"] = some
    return found


def picture_rows(pictures: Sequence[PictureRecord]) -> list[tuple[str, str]]:
    """Return the lines of the table over some pictures, as names and texts."""
    things = [thing for one in pictures for thing in one["things"]]
    chains = [chain for one in pictures for chain in one["sentences"]]
    possible = [chain for chain in chains if chain["possible"]]
    sized = [thing for thing in things if thing["size_ratios"] is not None]
    supported = [thing for thing in things if thing["support"]]
    kept = [thing for thing in things if thing["made"]]
    rows = [
        ("pictures", str(len(pictures))),
        ("a scene to work in", _share(pictures, lambda one: not one["refused"])),
        ("a usable scene: all there, in its box, on its support", _share(pictures, _is_usable)),
        ("labels kept", _share(things, lambda thing: thing["named"])),
        ("outline IoU, lost count 0", _middle([thing["outline_iou"] for thing in things], 2)),
        ("outline IoU of those kept", _middle([thing["outline_iou"] for thing in kept], 2)),
        ("support right", _share(supported, lambda thing: thing["support_right"])),
        (
            "width and height within a fifth of the depth's",
            _share(sized, lambda thing: _is_sized(thing["size_ratios"])),
        ),
        ("nearer than the depth [cm]", _middle([100.0 * thing["nearer_m"] for thing in sized], 1)),
        ("things that no box asked for", str(sum(len(one["invented"]) for one in pictures))),
        ("level off [deg]", _middle(_levels(pictures, "off_deg"), 1)),
        ("tilt off [deg]", _middle([abs(value) for value in _levels(pictures, "tilt_off_deg")], 1)),
        ("camera's height off [cm]", _middle([100.0 * abs(value) for value in _levels(pictures, "height_off_m")], 1)),
        ("a top taken for the floor", _share(_levelled(pictures), lambda one: one["level"]["took_top_for_floor"])),
    ]
    rows += [
        ("possible sentences: planned and proved", _share(possible, lambda chain: chain["planned"])),
        ("  of all, feasible", _share(possible, lambda chain: chain["feasible"])),
        ("  of all, succeeded in physics", _share(possible, lambda chain: chain["succeeded"])),
        ("  of all, as asked", _share(possible, lambda chain: chain["as_asked"])),
        ("  of all, as asked and nothing scaled", _share(possible, _is_done_in_true_size)),
    ]
    impossible = [chain for chain in chains if not chain["possible"]]
    rows.append(("impossible sentences: not reached", _share(impossible, lambda chain: not chain["as_asked"])))
    fitted = [one for one in pictures if one["things"] and not one["refused"]]
    for name, seconds in (
        ("CPU seconds a picture", [one["cpu_s"] for one in pictures]),
        ("CPU seconds for five boxes", [5.0 * one["cpu_s"] / len(one["things"]) for one in fitted]),
    ):
        rows.append((name, f"{_middle(seconds, 0)}, at most {max(seconds):.0f}" if seconds else "none"))
    return rows


def causes(pictures: Sequence[PictureRecord]) -> dict[str, dict[str, int]]:
    """Return how often what failed for which cause: pictures, boxes, and possible sentences."""
    refused = Counter(one["refused_kind"] for one in pictures if one["refused"])
    lost = Counter(thing["lost"] for one in pictures for thing in one["things"] if not thing["made"])
    stages = Counter(
        chain["stage"] for one in pictures for chain in one["sentences"] if chain["possible"] and not chain["as_asked"]
    )
    every = {"pictures": refused, "boxes": lost, "possible sentences": stages}
    return {name: dict(counts.most_common()) for name, counts in every.items()}


def _levelled(pictures: Sequence[PictureRecord]) -> list[PictureRecord]:
    return [one for one in pictures if one["level"] is not None]


def _levels(pictures: Sequence[PictureRecord], key: str) -> list[float]:
    return [one["level"][key] for one in _levelled(pictures) if one["level"][key] is not None]


def _is_usable(picture: PictureRecord) -> bool:
    return not picture["refused"] and all(
        thing["named"] and thing["outline_iou"] >= LEAST_IN_BOX and (thing["support_right"] or not thing["support"])
        for thing in picture["things"]
    )


def _is_done_in_true_size(chain: Mapping[str, Any]) -> bool:
    return chain["as_asked"] and all(factor == 1.0 for factor in chain["scaled"].values())


def _is_sized(ratios: Sequence[float]) -> bool:
    return all(1.0 / (1.0 + SIZE_SHARE) <= ratio <= 1.0 + SIZE_SHARE for ratio in ratios)


def _share(members: Iterable[Any], holds: Callable[[Any], bool]) -> str:
    every = [bool(holds(one)) for one in members]
    return str(Rate(sum(every), len(every))) if every else "none"


def _middle(values: Sequence[float], digits: int) -> str:
    if not values:
        return "none"
    low, high = np.quantile(values, (0.25, 0.75))
    return f"median {median(values):.{digits}f}, half of {len(values)} from {low:.{digits}f} to {high:.{digits}f}"
