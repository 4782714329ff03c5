"""Level frame and scale of a close picture of a table, from the rim of a round object of usual size.

A circle is an ellipse in a picture. It gives the tilt of its plane and, if its radius is known, the distance (Forsyth
et al. 1991). Where neither floor nor vertical lines are visible, a cup gives the vertical and the scale. The stated
uncertainty is the spread of the sizes of cups.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from executor.assets.library import LIBRARY
from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.errors import PhotoRefused
from executor.photo.fitting.hypothesis import PoseHypothesis, is_round
from executor.photo.fitting.likelihood import OF_RANGE, Fit, RatedHypothesis, SearchContext, usual_size_m
from executor.photo.geometry.observation import FloorPlane
from executor.photo.inputs.annotations import Detection
from executor.photo.inputs.picture import Intrinsics, Photograph
from executor.system.extras import require
from oag.model.symbols import Kind, kind_of

_WIDEST, _NARROWEST = 1.05, 0.5  # Of the box's width, that a rim may take up.
_LEVEL_RAD = math.radians(12.0)  # Off the picture's own level, that the longer axis of a rim may be.
_FLATTEST, _ROUNDEST = 0.15, 0.95  # Shorter axis by longer: a view from the side or from straight above gives nothing.
_LEAST_POINTS, _NEAR_PX, _LEAST_EDGE_SHARE = 30, 1.5, 0.6  # Points of a curve; of an ellipse, how much of it is edge.
_CANNY = ((50, 120), (25, 70), (90, 200))
_AROUND = 0.1  # Of a box's sides, looked at around it.


@dataclass(frozen=True)
class LevelCircle:
    """A level circle in the picture.

    Attributes:
        up: (3,) normal of its plane in the camera's frame.
        distance: Of the camera from that plane, in radii of the circle.
        ellipse_px: Middle, full axes, turn in degrees, as OpenCV has them.
        edge_share: Share of the ellipse that lies on edges.
    """

    up: Array
    distance: float
    ellipse_px: tuple[tuple[float, float], tuple[float, float], float]
    edge_share: float


def level_by_rim(picture: Photograph, camera: Intrinsics, things: Sequence[Detection]) -> FloorPlane:
    """Return the floor below a table that fills the picture, from the rim of a round object on it.

    Both are assumed to be of usual size.

    Args:
        picture, camera: The input.
        things: Detections, with a table whose edges are outside the picture, and a round object.

    Raises:
        PhotoRefused: There is no such table, or no rim is visible.
        MissingExtra: OpenCV is not installed.
    """
    table = next((entry for one in things for entry in beneath(one, picture.size_px)), None)
    found = [(rim, entry) for one in things for entry in _round(one) for rim in _rims(picture, camera, one)]
    if table is None or not found:
        problem = "has no depth, and nothing that gives its scale"
        missing = "no table fills the picture" if table is None else "no rim of something round on its table is seen"
        hint = "give --depth or a recording, --camera-height-m, --length along the floor, or --board"
        raise PhotoRefused("depth", picture.source, f"{problem}: {missing}", hint)
    rim, entry = max(found, key=lambda one: one[0].edge_share)
    _, width_m, height_m = usual_size_m(entry)
    table_m = usual_size_m(table)[2]
    above_m = rim.distance * width_m / 2 + height_m
    spread = OF_RANGE * (entry.width.high - entry.width.low) / width_m
    reference = f"the rim of a {entry.category} as wide as usual, {width_m:.3f} m; a {table.category} as high as usual"
    tilt = math.degrees(math.asin(float(np.clip(-rim.up[2], -1.0, 1.0))))
    return FloorPlane(rim.up, above_m + table_m, 0.0, tilt, 0.0, f"{reference}, {table_m:.2f} m", spread)


def beneath(thing: Detection, size_px: tuple[int, int]) -> list[ModelEntry]:
    """Return the models of a support whose box reaches three borders of the picture: it carries everything else."""
    x0, y0, x1, y1 = thing.box_px
    width, height = size_px
    reached = (x0 < 0.04 * width, y0 < 0.04 * height, x1 > 0.96 * width, y1 > 0.96 * height)
    entries = [entry for entry in LIBRARY.values() if entry.category == thing.category]
    supports = [entry for entry in entries if kind_of(entry.category, entry.width.low) is Kind.SUPPORT]
    return supports if sum(reached) >= 3 else []


def assumed_beneath(around: SearchContext, entries: Sequence[ModelEntry], over: Array) -> Fit:
    """Return a support of usual size whose edges are outside the picture, centred below some places.

    Args:
        around: The context.
        entries: Candidate models, the likeliest first.
        over: (N, 2) places on the floor that it is below.
    """
    x, y = (float(value) for value in np.mean(over, axis=0))
    facing = math.atan2(y, x)
    first, *others = [PoseHypothesis(entry, x, y, facing, 0.0, usual_size_m(entry)) for entry in entries]
    spread_m = around.scale_share * math.hypot(x, y)
    assumption = "its edges are not in the picture: as large as usual, its middle under what stands on it"
    alternatives = tuple(RatedHypothesis(one, 0.0) for one in others)
    return Fit(first, 0.0, alternatives, 1.0, math.inf, 0, None, spread_m, assumption)


def tilted_circle(
    ellipse_px: tuple[tuple[float, float], tuple[float, float], float], camera: Intrinsics
) -> tuple[Array, float]:
    """Return the normal (3,) of the plane of a circle from its ellipse, and the plane's distance in radii.

    Of the two solutions it is the one that faces the camera from below: a ceiling has no cups.
    """
    (u, v), (across, along), turn_deg = ellipse_px
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    axes = np.array([[c, s], [-s, c]]) / np.array([[across / 2], [along / 2]])
    A = axes.T @ axes
    middle = np.array([u, v])
    conic = np.block([[A, -(A @ middle)[:, None]], [-(A @ middle)[None, :], np.array([[middle @ A @ middle - 1.0]])]])
    K = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    cone = K.T @ conic @ K
    values, vectors = np.linalg.eigh(cone)
    # Two of the eigenvalues have the sign of the ellipse's inside, the smallest one the other.
    low, middle_value, high = (float(value) for value in values)
    lean = math.sqrt(max(0.0, (high - middle_value) / (high - low)))
    stand = math.sqrt(max(0.0, (middle_value - low) / (high - low)))
    candidates = [lean * sign * vectors[:, 2] + stand * vectors[:, 0] for sign in (-1.0, 1.0)]
    ray = np.array([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, 1.0])
    # The upper side of a table is visible.
    towards = [normal if float(normal @ ray) < 0.0 else -normal for normal in candidates]
    up = min(towards, key=lambda normal: float(normal[1]))
    return up, middle_value / math.sqrt(-low * high)


def _round(thing: Detection) -> list[ModelEntry]:
    """Return the round models of a detection; one of them is enough."""
    entries = (one for one in LIBRARY.values() if one.category == thing.category)
    return [one for one in entries if is_round(one) and kind_of(one.category, one.width.low) is Kind.ITEM][:1]


def _rims(picture: Photograph, camera: Intrinsics, thing: Detection) -> Iterator[LevelCircle]:
    """Yield level ellipses of edges in a detection's box."""
    cv2 = require("cv2", "photo")
    x0, y0, x1, y1 = thing.box_px
    over_x, over_y = _AROUND * (x1 - x0), _AROUND * (y1 - y0)
    left, top = max(0, int(x0 - over_x)), max(0, int(y0 - over_y))
    cut = picture.rgb[top : int(y1 + over_y) + 1, left : int(x1 + over_x) + 1]
    grey = cv2.GaussianBlur(cv2.cvtColor(np.ascontiguousarray(cut), cv2.COLOR_RGB2GRAY), (5, 5), 0)
    for low, high in _CANNY:
        edges = cv2.Canny(grey, low, high)
        away_px = cv2.distanceTransform(255 - edges, cv2.DIST_L2, 3)
        for curve in cv2.findContours(edges, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]:
            if len(curve) < _LEAST_POINTS:
                continue
            (u, v), (across, along), turn = cv2.fitEllipse(curve)
            longer, shorter = max(across, along), min(across, along)
            # OpenCV's turn is that of the first axis; the longer one is mostly the second.
            lies = math.radians(turn if across >= along else turn + 90.0)
            level = abs(math.remainder(lies, math.pi)) < _LEVEL_RAD
            fits = _NARROWEST < longer / (x1 - x0) < _WIDEST and _FLATTEST < shorter / max(longer, 1e-6) < _ROUNDEST
            inside = y0 < v + top < y1 and x0 < u + left < x1
            if not (level and fits and inside):
                continue
            edge_share = _edge_share(away_px, (u, v), (across, along), turn)
            if edge_share > _LEAST_EDGE_SHARE:
                ellipse = (u + left + 0.5, v + top + 0.5), (across, along), turn
                up, distance = tilted_circle(ellipse, camera)
                yield LevelCircle(up, distance, ellipse, edge_share)


def _edge_share(away_px: Array, middle: tuple[float, float], axes: tuple[float, float], turn_deg: float) -> float:
    """Return the share of an ellipse that lies next to an edge."""
    angle = np.linspace(0.0, 2.0 * math.pi, 180, endpoint=False)
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    x, y = axes[0] / 2 * np.cos(angle), axes[1] / 2 * np.sin(angle)
    columns, rows = np.round(middle[0] + c * x - s * y).astype(int), np.round(middle[1] + s * x + c * y).astype(int)
    height, width = away_px.shape
    within = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    return float((away_px[rows[within], columns[within]] < _NEAR_PX).sum() / len(angle))
