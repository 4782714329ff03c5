"""All things of a picture without depth at once: one least-squares problem of places, turns and sizes.

The boxes are the evidence: each outline fills its box, as far as the picture shows it. What carries a thing gives the
height of its lower end. The sizes of kinds give the scale, and things are neither in each other nor beside their tops.

Source: bundle-like non-linear least squares, solved by SciPy's trust-region reflective method.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from executor.assets.families.generic import BOARDS, GENERIC, SHELF
from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.hypothesis import PoseHypothesis, is_round
from executor.photo.fitting.likelihood import is_large
from executor.photo.geometry.observation import Observation
from executor.photo.inputs.usual import is_hollow, is_lounge, is_seat
from executor.photo.room.beneath import BORDER_SHARE, is_foot_hidden
from executor.photo.room.pieces import Piece, edges_of, modelled, parts_of, shapes_of, sizes_of, snapped, with_region
from llm.vision import overlap
from oag.model.symbols import has_boards

_BOX_SHARE, _BOX_PX = 0.015, 1.0  # How exact boxes are.
_ROBUST = 4.0  # Standard deviations from where on a side of a box counts in proportion.
_NEAREST_M = 0.05
_HIDDEN = 0.2  # Weight of a lower end that something hides.
_EDGE_M, _ON_TOP = 0.01, 0.4  # Of a top; share of a thing's half sides that lies on it.
_ASIDE_M, _APART_M, _TOUCH_M, _SAME_M, _SEEN_M = 0.01, (0.01, 0.002), 0.008, 0.02, 0.02
_BEFORE_M, _AROUND_M = 0.2, 0.05  # Free way before the camera; deviation.
_HEADING_RAD, _FACING, _FACING_CARRIER = 0.15, 0.6, 3.0
_HEADINGS, _NEARER = 8, (1.0, 0.75)
_TURN = np.array([0.0, 0.0, math.pi / 2, 0.0, 0.0, 0.0])
MOST_STEPS = 12
"""Of the search for all things at once."""

_FIRST, _FOLLOWED, _SECOND = 6, 2, 12  # Steps of every start; how many of them are followed, and their steps.
_POOR, _BETTER = 0.7, 0.15  # IoU of an outline with its box, below which it is started again; gain by another shape.
_FARTHEST_M = 12.0
_TALLEST_M = 0.1  # Least distance between the camera and a top below it.
_LEVEL_M = 0.02
_LOGS = (-7.0, 3.0)  # Of sizes: a millimetre to 20 m. A step of a search may go far beyond any number.
_SLOPE, _LOOSEST = 1e-4, 1e-6  # Step of differences; of the sharpest direction: looser ones are unknown.


class Jointly:
    """The problem; its state is one row a piece: place, turn, and logarithms of length, width and height.

    Args:
        view: The picture, without depth.
        pieces: The things; what carries others comes with its number.
    """

    def __init__(self, view: Observation, pieces: Sequence[Piece]) -> None:
        self.view, self.pieces = view, list(pieces)
        count = len(pieces)
        self.X = np.zeros((count, 6))
        self._apart_m = _APART_M[0]
        self.base_m = np.zeros(count)  # Lower ends of what hangs.
        self.placed = np.zeros(count, dtype=bool)
        width, height = view.size_px
        self._box = np.array([snapped(piece.thing.box_px, width, height) for piece in pieces])
        things = [piece.thing for piece in pieces]
        self._hidden_low = np.array([is_foot_hidden(view, things, index) for index in range(count)])
        sides = np.tile(self._box[:, 2:] - self._box[:, :2], 2)
        self._sigma = _BOX_SHARE * sides + _BOX_PX * width / 1000.0
        near_m = np.array([0.0, 0.0, 0.0, 0.0, _NEAREST_M])
        K = view.K
        # What the picture shows is between four planes through the camera, and before it.
        self._planes = np.array(
            [[K.fx, 0, K.cx], [-K.fx, 0, width - K.cx], [0, K.fy, K.cy], [0, -K.fy, height - K.cy], [0, 0, 1.0]]
        )
        self._near_m = near_m
        self._edges = np.array([edges_of(piece.entry) for piece in pieces])
        self._prior, self._spread = (np.array(one) for one in zip(*(sizes_of(piece) for piece in pieces), strict=True))
        self._large = np.array([is_large(piece.entry) for piece in pieces])
        self._parts = [parts_of(piece.entry) for piece in pieces]
        self._facing = np.array([self._faces(index) for index in range(count)])
        self._order = sorted(range(count), key=self._depth)
        self._above = [[j for j in range(count) if self.pieces[j].on == i] for i in range(count)]
        self._known_pairs: dict[object, tuple[NDArray[np.int64], NDArray[np.int64]]] = {}
        self._known_sights: dict[tuple[int, ...], list[tuple[int, int]]] = {}
        self._ray = [self._ray_through(box) for box in self._box]
        self._foot = [self._ray_through(box[[0, 3, 2, 3]])[1] for box in self._box]
        for index, piece in enumerate(pieces):
            self._hidden_low[index] |= piece.board is not None and self._foot[index] > 0.0
        # What is on a board with each piece, itself too.
        self._level_with = [
            [other for other, two in enumerate(pieces) if (two.on, two.board) == (one.on, one.board)]
            if one.board is not None
            else []
            for one in pieces
        ]
        heading = view.heading_rad
        self._headings = [] if heading is None else [heading + turn * math.pi / 2 for turn in range(4)]

    def _faces(self, index: int) -> float:
        """Return how much a piece faces the camera: what is seen on a seat or in a shelf is before its back."""
        entry = self.pieces[index].entry
        if not is_large(entry):
            return 0.0
        label = self.pieces[index].thing.label
        has_back = is_seat(label) or is_lounge(label) or has_boards(entry.category)
        carries = any(piece.on == index for piece in self.pieces)
        return _FACING_CARRIER if has_back and carries else _FACING

    def _ray_through(self, box: Array) -> tuple[tuple[float, float], float]:
        """Return the heading (2,) of the view to the middle of a box, and its slope."""
        K, (x0, y0, x1, y1) = self.view.K, box
        pixel = np.array([((x0 + x1) / 2 - K.cx) / K.fx, ((y0 + y1) / 2 - K.cy) / K.fy, 1.0])
        x, y, z = (float(value) for value in self.view.R_camera_level.T @ pixel)
        level = max(math.hypot(x, y), 1e-6)
        return (x / level, y / level), z / level

    def _depth(self, index: int) -> int:
        on = self.pieces[index].on
        return 0 if on < 0 else 1 + self._depth(on)

    def _model(self, index: int, entry: ModelEntry) -> None:
        """Take a model for a piece, with the tops on which others are."""
        self.pieces[index] = replace(self.pieces[index], entry=entry)
        self._edges[index], self._parts[index] = edges_of(entry), parts_of(entry)
        self._prior[index], self._spread[index] = sizes_of(self.pieces[index])
        for one in self._above[index]:
            self.pieces[one] = with_region(self.pieces[one], self.pieces[index])

    def solve(self, free: Sequence[int], evaluations: int) -> None:
        """Start every free piece that has no place, what carries before what is carried, then optimise them at once."""
        for index in (one for one in self._order if one in free):
            if not self.placed[index]:
                self._start(index)
                own = self.pieces[index]
                is_shelf = own.entry.model == SHELF
                entry = own.entry if is_shelf else modelled(self.view, own.thing, self.pose(index)).entry
                if entry != self.pieces[index].entry:
                    self._model(index, entry)
                    self._start(index, [self.X[index] + turn * _TURN for turn in range(4)])
                self.placed[index] = True
        rows = list(free)
        if not rows or not evaluations:
            return

        def residuals(values: Array) -> Array:
            X = self.X.copy()
            X[rows] = values.reshape(-1, 6)
            return self._residuals(X, rows)

        # Overlaps count more in the end, when all else has found its place.
        for number, self._apart_m in enumerate(_APART_M):
            if number:
                self._start_again(rows)
            found = least_squares(residuals, self.X[rows].ravel(), x_scale="jac", max_nfev=evaluations)
            self.X[rows] = found.x.reshape(-1, 6)

    def pose(self, index: int) -> PoseHypothesis:
        """Return the hypothesis of a piece."""
        x, y, yaw, *logs = self.X[index].tolist()
        length, width, height = _sizes_m(np.array(logs)).tolist()
        if is_round(self.pieces[index].entry):
            length = width
        bottoms, entry = self._bottoms(self.X), self.pieces[index].entry
        bottom_m = max(0.0, float(bottoms[index]))
        guess = PoseHypothesis(entry, x, y, yaw, bottom_m, (length, width, height))
        if entry.model != SHELF:
            return guess
        boards = {self.pieces[one].board: one for one in self._above[index] if self.pieces[one].board is not None}
        levels = {
            int(board): (float(bottoms[one]) - bottom_m) / height for board, one in boards.items() if board is not None
        }
        shares = {BOARDS[board].name: min(max(level, 0.0), 1.0) for board, level in levels.items()}
        return guess.with_parameters(**shares)

    def put(self, index: int, guess: PoseHypothesis) -> None:
        """Place a piece where it is known to be."""
        self.X[index] = [guess.x_m, guess.y_m, guess.yaw_rad, *np.log(guess.size_m)]
        self.base_m[index], self.placed[index] = guess.bottom_m, True
        self._model(index, guess.entry)

    def go_on(self, begun: Jointly) -> None:
        """Take the state of the same problem as it was begun before."""
        self.X, self.base_m, self.placed = begun.X.copy(), begun.base_m.copy(), begun.placed.copy()
        for index, piece in enumerate(begun.pieces):
            self._model(index, piece.entry)

    def spread_m(self, index: int) -> tuple[float, float]:
        """Return the standard deviations of a piece's place, in its worst direction, and of its worst side.

        They follow from the slopes of its residuals, with all other pieces where they are (Laplace's approximation).
        """
        slopes = []
        for by in _SLOPE * np.eye(self.X.shape[1]):
            ends = []
            for sign in (-1.0, 1.0):
                X = self.X.copy()
                X[index] += sign * by
                ends.append(self._residuals(X, [index]))
            slopes.append((ends[1] - ends[0]) / (2 * _SLOPE))
        values, axes = np.linalg.eigh(np.array(slopes) @ np.array(slopes).T)
        variances = 1.0 / np.maximum(values, max(_LOOSEST * float(values.max()), 1e-9))
        covariance = (axes * variances) @ axes.T
        place = float(np.linalg.eigvalsh(covariance[:2, :2]).max())
        sides_m = np.sqrt(np.maximum(np.diag(covariance)[3:], 0.0)) * self.pose(index).size_m
        return math.sqrt(max(0.0, place)), float(sides_m.max())

    def _bottoms(self, X: Array) -> Array:
        bottoms, levels = self.base_m.copy(), dict[tuple[int, int], float]()
        for index in self._order:
            on, board = self.pieces[index].on, self.pieces[index].board
            if board is not None:
                if (on, board) not in levels:
                    levels[on, board] = self._level_m(X, index)
                bottoms[index] = max(levels[on, board], bottoms[on])
            elif on >= 0:
                bottoms[index] = bottoms[on] + self.pieces[index].region.high * math.exp(min(X[on, 5], _LOGS[1]))
        return bottoms

    def _level_m(self, X: Array, index: int) -> float:
        """Return the height of a board: where what is on it ends, at its distance.

        Of a board above the camera the front edge hides what is on it, and things end there in the picture.
        """
        on, (eye_x, eye_y, eye_z) = self.pieces[index].on, self.view.eye_m.tolist()
        levels = []
        for one in self._level_with[index]:
            if self.placed[one] or one == index:
                x, y, _, length, width, _ = X[on if self._foot[one] > 0.0 else one].tolist()
                away_m = math.hypot(x - eye_x, y - eye_y) - math.exp(min(length, width, _LOGS[1])) / 2
                levels.append(self._foot[one] * max(away_m, _NEAREST_M))
        return float(eye_z) + sum(levels) / len(levels)

    def _bounds(self, X: Array, bottoms: Array, rows: Sequence[int]) -> Array:
        """Return (N, 4) the boxes of what the picture shows of some pieces, or of all of each that it does not show."""
        some, sizes = X[rows], _sizes_m(X[rows, 3:])
        c, s = np.cos(some[:, 2]), np.sin(some[:, 2])
        local = self._edges[rows] * sizes[:, None, None]
        x = c[:, None, None] * local[..., 0] - s[:, None, None] * local[..., 1] + some[:, 0, None, None]
        y = s[:, None, None] * local[..., 0] + c[:, None, None] * local[..., 1] + some[:, 1, None, None]
        z = local[..., 2] + (bottoms[rows] + sizes[:, 2] / 2)[:, None, None]
        at = (np.stack([x, y, z], axis=-1) - self.view.eye_m) @ self.view.R_camera_level.T
        # Both ends' distances from each plane, above 0 in the picture.
        inside = at @ self._planes.T - self._near_m
        first, last = inside[:, :, 0], inside[:, :, 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = np.where(first * last < 0.0, first / (first - last), np.nan)
        begin = np.nanmax(np.where((first < 0.0) & (last >= 0.0), crossing, 0.0), axis=-1)
        end = np.nanmin(np.where((first >= 0.0) & (last < 0.0), crossing, 1.0), axis=-1)
        shown = ((first >= 0.0) | (last >= 0.0)).all(axis=-1) & (begin < end)
        t = np.stack([begin, end], axis=-1)[..., None]
        clipped = at[:, :, :1] + t * (at[:, :, 1:] - at[:, :, :1])
        nothing = ~shown.any(axis=1)
        points = np.where(nothing[:, None, None, None], at, clipped)
        depth = np.maximum(points[..., 2], _NEAREST_M)
        K = self.view.K
        pixels = np.stack([K.fx * points[..., 0] / depth + K.cx, K.fy * points[..., 1] / depth + K.cy], axis=-1)
        counts = (shown | nothing[:, None])[:, :, None, None]
        low = np.where(counts, pixels, np.inf).min(axis=(1, 2))
        high = np.where(counts, pixels, -np.inf).max(axis=(1, 2))
        return np.concatenate([low, high], axis=1)

    def _residuals(self, X: Array, rows: Sequence[int]) -> Array:
        bottoms = self._bottoms(X)
        parts = [
            self._box_residuals(X, bottoms, rows),
            self._size_residuals(X, rows),
            self._turn_residuals(X, bottoms, rows),
        ]
        parts += [self._on_top(X, bottoms, index) for index in rows if self.pieces[index].on >= 0]
        parts.append(self._apart(X, bottoms, rows))
        return np.concatenate(parts)

    def _box_residuals(self, X: Array, bottoms: Array, rows: Sequence[int]) -> Array:
        """Return how far outlines are off their boxes, in standard deviations; a hidden foot may be lower."""
        off = (self._bounds(X, bottoms, rows) - self._box[rows]) / self._sigma[rows]
        off[:, 3] = np.where(self._hidden_low[rows] & (off[:, 3] > 0.0), _HIDDEN * off[:, 3], off[:, 3])
        return _robust(off, _ROBUST).ravel()

    def _size_residuals(self, X: Array, rows: Sequence[int]) -> Array:
        """Return how far sizes are off those of their kinds: sides, aspects, and the longest side."""
        L, W, H = np.clip(X[rows, 3:], *_LOGS).T
        longest = np.log(np.exp(6 * L) + np.exp(6 * W) + np.exp(6 * H)) / 6
        values = np.stack([L, W, H, L - W, H - W, longest], axis=1)
        return np.asarray((values - self._prior[rows]) / self._spread[rows]).ravel()

    def _around_camera(self, X: Array, bottoms: Array, rows: Sequence[int]) -> Array:
        """Return how far pieces that are about as high as the camera are around it, (N,)."""
        some, sizes = X[rows], _sizes_m(X[rows, 3:])
        c, s = np.cos(some[:, 2]), np.sin(some[:, 2])
        off = self.view.eye_m[:2] - some[:, :2]
        local = np.abs(np.stack([c * off[:, 0] + s * off[:, 1], c * off[:, 1] - s * off[:, 0]], axis=1))
        within_m = (sizes[:, :2] / 2 + _BEFORE_M - local).min(axis=1)
        as_high = np.clip((bottoms[rows] + sizes[:, 2] - self.view.eye_m[2]) / _BEFORE_M + 2.0, 0.0, 1.0)
        return np.asarray(np.maximum(within_m, 0.0) * as_high / _AROUND_M)

    def _turn_residuals(self, X: Array, bottoms: Array, rows: Sequence[int]) -> Array:
        """Return how far furniture is turned out of the room's lines and away from the camera."""
        some = X[rows]
        away = np.arctan2(some[:, 1], some[:, 0])
        facing = self._facing[rows] * (1.0 - np.cos(some[:, 2] - away))
        facing = np.concatenate([facing, self._around_camera(X, bottoms, rows)])
        if not self._headings:
            return facing
        askew = np.sin(2 * (some[:, 2] - self._headings[0])) / (2 * _HEADING_RAD)
        return np.concatenate([facing, askew * self._large[rows]])

    def _on_top(self, X: Array, bottoms: Array, index: int) -> Array:
        """Return how far the middle of a piece is beside its top, (2,)."""
        piece, on = self.pieces[index], self.pieces[index].on
        size, own = _sizes_m(X[on, 3:5]), _sizes_m(X[index, 3:5])
        _, mid_x, mid_y, half_x, half_y = piece.region
        middle, half = np.array([mid_x, mid_y]) * size, np.array([half_x, half_y]) * size
        local = _turned(X[index, :2] - X[on, :2], -X[on, 2]) - middle
        turn = X[index, 2] - X[on, 2]
        c, s = abs(math.cos(turn)), abs(math.sin(turn))
        reach = np.array([c * own[0] + s * own[1], s * own[0] + c * own[1]]) / 2
        # On an item, and in a sink, all of a thing is within its top or its rim.
        is_top = self._large[on] and not is_hollow(self.pieces[on].thing.label)
        free = np.maximum(half - (_ON_TOP * reach + _EDGE_M if is_top else reach), 0.0)
        outside = np.maximum(np.abs(local) - free, 0.0) / _ASIDE_M
        if piece.board is None:
            return outside
        own_m, height_m = _sizes_m(X[[index, on], 5])
        above_m = float(bottoms[index] - bottoms[on] + own_m - height_m)
        return np.append(outside, max(0.0, above_m) / _LEVEL_M)

    def _solids(self, X: Array, bottoms: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return (N, 7) the solid parts of placed pieces: middle, half sides, lower end and turn; and whose (N,)."""
        boxes, owners = [], []
        for index in range(len(self.pieces)):
            if not self.placed[index]:
                continue
            size, parts = _sizes_m(X[index, 3:]), self._parts[index]
            middle = _turned(parts.mean(axis=1)[:, :2] * size[:2], X[index, 2]) + X[index, :2]
            half = (parts[:, 1] - parts[:, 0]) / 2 * size
            low = bottoms[index] + (parts[:, 0, 2] + 0.5) * size[2]
            turn = np.full(len(parts), X[index, 2])
            boxes.append(np.column_stack([middle, half, low, turn]))
            owners += [index] * len(parts)
        return np.concatenate(boxes), np.array(owners)

    def _to_uncover(self, X: Array, flat: Array, owner: NDArray[np.int64], rows: Sequence[int]) -> Array:
        """Return how far pieces are to be moved that hide what is seen in their boxes: behind it, aside, up or down."""
        found = []
        for hidden, before in self._sights(tuple(rows)):
            parts = flat[owner == before]
            if not len(parts) or not self.placed[hidden]:
                continue
            (along_x, along_y), slope = self._ray[hidden]
            c, s = np.cos(parts[:, 6]), np.sin(parts[:, 6])
            deep = parts[:, 2] * np.abs(along_x * c + along_y * s) + parts[:, 3] * np.abs(along_y * c - along_x * s)
            wide = parts[:, 2] * np.abs(along_y * c - along_x * s) + parts[:, 3] * np.abs(along_x * c + along_y * s)
            far = X[hidden, 0] * along_x + X[hidden, 1] * along_y
            away = parts[:, 0] * along_x + parts[:, 1] * along_y
            aside = np.abs(parts[:, 1] * along_x - parts[:, 0] * along_y)
            ray_m = self.view.eye_m[2] + slope * np.clip(away, 0.0, max(far, 0.0))
            high = parts[:, 5] + 2 * parts[:, 4]
            off = np.minimum.reduce([wide - aside, far - away + deep, high - ray_m, ray_m - parts[:, 5]])
            found.append(max(float(off.max()), 0.0) / _SEEN_M)
        return _robust(np.array(found), _ROBUST)

    def _sights(self, rows: tuple[int, ...]) -> list[tuple[int, int]]:
        """Return pairs of a piece and a larger one in whose box its middle is seen, and which it does not carry."""
        if rows not in self._known_sights:
            found = []
            for hidden, before in itertools.permutations(range(len(self.pieces)), 2):
                x0, y0, x1, y1 = self._box[hidden]
                left, top, right, bottom = self._box[before]
                within = left < (x0 + x1) / 2 < right and top < (y0 + y1) / 2 < bottom
                smaller = (x1 - x0) * (y1 - y0) < (right - left) * (bottom - top)
                if within and smaller and {hidden, before} & set(rows) and self.pieces[before].on != hidden:
                    found.append((hidden, before))
            self._known_sights[rows] = found
        return self._known_sights[rows]

    def _apart(self, X: Array, bottoms: Array, rows: Sequence[int]) -> Array:
        """Return how deep pieces are in each other, and how far before what is seen behind them."""
        flat, owner = self._solids(X, bottoms)
        owners = owner.tolist()
        covering = self._to_uncover(X, flat, owner, rows)
        first, second = self._pairs(tuple(owners), tuple(rows))
        if not len(first):
            return covering
        deep = _overlaps(flat[first], flat[second])
        pair = owner[first] * len(self.pieces) + owner[second]
        keys, where = np.unique(pair, return_inverse=True)
        worst = np.zeros(len(keys))
        np.maximum.at(worst, where, deep)
        return np.concatenate([worst / self._apart_m, covering])

    def _pairs(self, owners: tuple[int, ...], rows: tuple[int, ...]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the numbers of parts that may not be in each other: of two pieces, such as a pillow and a back."""
        if (owners, rows) in self._known_pairs:
            return self._known_pairs[owners, rows]
        free = set(rows)
        found = [
            (a, b)
            for a, b in itertools.combinations(range(len(owners)), 2)
            if owners[a] != owners[b] and (owners[a] in free or owners[b] in free)
        ]
        pairs = np.array(found, dtype=np.int64).reshape(-1, 2)
        self._known_pairs = {(owners, rows): (pairs[:, 0], pairs[:, 1])}
        return pairs[:, 0], pairs[:, 1]

    def _start_again(self, rows: Sequence[int]) -> None:
        """Start pieces again that do not fill their boxes: what they were started among has moved since."""
        poor = [index for index in rows if self._filled(index) < _POOR]
        for index in (one for one in self._order if one in poor):
            before, entry = self.X[index].copy(), self.pieces[index].entry
            cost, share = float(np.square(self._alone(self.X, index)).sum()), self._filled(index)
            self._start(index)
            if float(np.square(self._alone(self.X, index)).sum()) > cost:
                self.X[index] = before
            best, share = self.X[index].copy(), max(share, self._filled(index))
            if share > _POOR or entry.model in GENERIC:
                continue
            # Where no size of the library's model fills the box, the thing is built otherwise.
            self._model(index, shapes_of(self.view, self.pieces[index].thing)[0])
            self._start(index)
            if self._filled(index) < share + _BETTER:
                self._model(index, entry)
                self.X[index] = best

    def _filled(self, index: int) -> float:
        """Return the IoU of a piece's outline with its box."""
        return overlap(tuple(self._bounds(self.X, self._bottoms(self.X), [index])[0]), tuple(self._box[index]))

    def _alone(self, X: Array, index: int) -> Array:
        """Return the residuals that a piece has a part in, with what seems to stand on it."""
        bottoms = self._bottoms(X)
        parts = [self._box_residuals(X, bottoms, [index]), self._size_residuals(X, [index])]
        parts += [self._turn_residuals(X, bottoms, [index]), self._carried(X, bottoms, index)]
        on = [index] if self.pieces[index].on >= 0 else []
        parts += [
            self._on_top(X, bottoms, one) for one in (*on, *(one for one in self._above[index] if self.placed[one]))
        ]
        parts.append(self._apart(X, bottoms, [index]))
        return np.concatenate(parts)

    def _start(self, index: int, starts: Sequence[Array] = ()) -> None:
        """Place a piece alone: several turns and distances, each optimised with what seems to stand on it."""
        X = self.X.copy()

        def residuals(values: Array) -> Array:
            X[index] = values
            return self._alone(X, index)

        self.placed[index] = True
        begun = [least_squares(residuals, row, x_scale="jac", max_nfev=_FIRST) for row in starts or self._starts(index)]
        begun = sorted(begun, key=lambda one: float(one.cost))[:_FOLLOWED]
        ended = [least_squares(residuals, one.x, x_scale="jac", max_nfev=_SECOND) for one in begun]
        self.X[index] = min(ended, key=lambda one: float(one.cost)).x
        self.X[index, 2] = math.remainder(self.X[index, 2], 2 * math.pi)

    def _starts(self, index: int) -> list[Array]:
        piece, view = self.pieces[index], self.view
        x0, _, x1, y1 = piece.thing.box_px
        bottom_m = float(self._bottoms(self.X)[index])
        logs = self._prior[index, :3]
        wide = float(np.exp(logs[1]))
        K = view.K
        ray = view.R_camera_level.T @ np.array([((x0 + x1) / 2 - K.cx) / K.fx, (y1 - K.cy) / K.fy, 1.0])
        down_m = float(view.eye_m[2]) - bottom_m
        level = max(float(np.hypot(*ray[:2])), 1e-6)
        by_size_m = wide * K.fx / (x1 - x0)
        t = down_m / -ray[2] if ray[2] < -1e-3 and down_m > 0.0 else math.inf
        cut = bool(self._hidden_low[index]) or y1 > (1 - BORDER_SHARE) * view.size_px[1]
        if not math.isfinite(t) or t * level > _FARTHEST_M:
            t = by_size_m
        if piece.board is not None:
            t = float(np.hypot(*(self.X[piece.on, :2] - view.eye_m[:2]))) / level
        reaches = [t * share for share in _NEARER] if not cut else [t, math.sqrt(t * by_size_m), by_size_m]
        away = math.atan2(ray[1], ray[0])
        if is_round(piece.entry):
            turns = [away]
        elif self._large[index] and self._headings:
            turns = list(self._headings)
        else:
            count = _HEADINGS if self._large[index] else _HEADINGS // 2
            turns = [away + 2 * math.pi * turn / _HEADINGS for turn in range(count)]
        found = []
        for reach, turn in itertools.product(reaches if self._large[index] else reaches[:1], turns):
            size = logs.copy()
            if not self._large[index] or (piece.on >= 0 and piece.entry.model in GENERIC):
                size = size + math.log(max((x1 - x0) / K.fx * reach, 0.01)) - float(logs[1])
            along = reach * level + 0.4 * math.exp(min(size[0], size[1]))
            found.append(np.array([along * math.cos(away), along * math.sin(away), turn, *size]))
        return found

    def _carried(self, X: Array, bottoms: Array, index: int) -> Array:
        """Return how far things that have no place yet seem to be beside a piece, and off the sizes of their kinds."""
        piece = self.pieces[index]
        others = [one for one in self._above[index] if not self.placed[one]]
        if not others:
            return np.zeros(0)
        size = _sizes_m(X[index, 3:])
        bottom_m = bottoms[index]
        K, view = self.view.K, self.view
        found = []
        for one in others:
            share, mid_x, mid_y, half_x, half_y = self.pieces[one].region
            middle, half = np.array([mid_x, mid_y]) * size[:2], np.array([half_x, half_y]) * size[:2]
            x0, _, x1, y1 = self.pieces[one].thing.box_px
            ray = view.R_camera_level.T @ np.array([((x0 + x1) / 2 - K.cx) / K.fx, (y1 - K.cy) / K.fy, 1.0])
            down_m = max(float(view.eye_m[2]) - bottom_m - share * size[2], _TALLEST_M)
            t = min(down_m / max(-float(ray[2]), 1e-2), _FARTHEST_M)
            if self.pieces[one].board is not None:
                t = min(float(np.hypot(*(X[index, :2] - view.eye_m[:2])) / np.hypot(*ray[:2])), _FARTHEST_M)
            at = _turned(view.eye_m[:2] + t * ray[:2] - X[index, :2], -X[index, 2])
            outside = np.maximum(np.abs(at - middle) - half, 0.0) / 0.05
            wide = (math.log((x1 - x0) / K.fx * t) - self._prior[one, 5]) / max(2 * self._spread[one, 5], 0.5)
            found += [*_robust(outside, 2.0), wide if is_seat(piece.thing.label) is False else 0.5 * wide]
        return np.array(found)


def _sizes_m(logs: Array) -> Array:
    """Return the sizes of logarithms, which a step of a search may make as large as it likes."""
    return np.asarray(np.exp(np.clip(logs, *_LOGS)))


def _robust(values: Array, most: float) -> Array:
    """Return residuals whose squares grow in proportion beyond some standard deviations (Huber)."""
    size = np.abs(values)
    return np.sign(values) * np.where(size < most, size, np.sqrt(np.maximum(2 * most * size - most * most, 0.0)))


def _turned(at: Array, turn: float) -> Array:
    c, s = math.cos(turn), math.sin(turn)
    return np.asarray(at @ np.array([[c, s], [-s, c]]))


def _overlaps(first: Array, second: Array) -> Array:
    """Return (N,) how far upright boxes (N, 7) are to be moved aside: middle, half sides, lower end and turn.

    One that is over the other is not in it; that none escapes by becoming flat, the overlap of heights hardly counts.
    """
    high = np.minimum(first[:, 5] + 2 * first[:, 4], second[:, 5] + 2 * second[:, 4])
    same = np.clip((high - np.maximum(first[:, 5], second[:, 5]) - _TOUCH_M) / _SAME_M, 0.0, 1.0)
    deep = np.full(len(first), np.inf)
    apart = second[:, :2] - first[:, :2]
    for turn in (first[:, 6], second[:, 6]):
        for axis in ((np.cos(turn), np.sin(turn)), (-np.sin(turn), np.cos(turn))):
            reach = sum(
                one[:, 2] * np.abs(axis[0] * np.cos(one[:, 6]) + axis[1] * np.sin(one[:, 6]))
                + one[:, 3] * np.abs(axis[1] * np.cos(one[:, 6]) - axis[0] * np.sin(one[:, 6]))
                for one in (first, second)
            )
            deep = np.minimum(deep, reach - np.abs(apart[:, 0] * axis[0] + apart[:, 1] * axis[1]))
    return np.asarray(np.maximum(deep, 0.0) * same)
