"""Things of a picture without depth as pieces of one problem: their models, tops, edges, and usual sizes."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from executor.assets.families.generic import BOARDS, GENERIC, PANEL, SHELF, WITH_BACK
from executor.assets.footprint import solid_parts
from executor.assets.library import LIBRARY
from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.hypothesis import PoseHypothesis, is_round, raycaster_of
from executor.photo.fitting.likelihood import OF_RANGE, TopShares, is_large, top_shares, usual_size_m
from executor.photo.fitting.refinement import with_parts
from executor.photo.fitting.starts import generic_models, is_raised, named_models
from executor.photo.geometry.observation import Observation
from executor.photo.inputs.annotations import Detection
from executor.photo.inputs.usual import (
    is_inset,
    is_mostly_open,
    is_panel,
    usual_height_m,
    usual_length_m,
    usual_thickness_m,
)
from executor.photo.room.beneath import BORDER_SHARE, COMPARTMENTS, is_on_legs
from oag.model.symbols import has_boards

_SPREAD_LARGE, _SPREAD_TALL, _SPREAD_ITEM, _LEAST_SPREAD = 0.30, 0.12, 0.20, 0.08
"""Standard deviations of logarithms of sizes: sides and height of furniture, items, and at least."""

_LYING_SPREAD, _LONG_SPREAD, _ASPECT, _UPRIGHT = 0.20, 0.20, 0.45, 0.8
_ITEM_M, _PIECE_M, _HIGH_M = 0.18, 0.9, 0.6  # Sizes where a name tells nothing: longest sides; height of furniture.
_ANY_SPREAD, _PIECE_SPREAD = 1.0, 0.5
_MISFIT = math.log(1.7)  # Of a side, beyond the sizes of a model: a generic shape is fitted instead.
_ROUND_SIDES = 8
_TOP_SHARE, _SAME_BOARD = 0.15, 0.05  # Of the height of a shelf's box: its top; between ends of things on one board.
_SHELF_M, _SHELF_SPREADS = (
    (0.30, 0.80, 1.20),
    (0.25, 0.40, 0.50),
)  # Usual size of a shelf, and deviations of logarithms.


_WHOLE = TopShares()


@dataclass(frozen=True)
class Piece:
    """One thing of the problem.

    Attributes:
        thing: Its detection.
        entry: Its model.
        on: What carries it: another piece's number, FLOOR or WALL.
        region: Of its support's top.
        board: Number of the board that it is on, if its height is measured by what is on it; those of a support differ.
    """

    thing: Detection
    entry: ModelEntry
    on: int
    region: TopShares = _WHOLE
    board: int | None = None


@cache
def edges_of(entry: ModelEntry) -> Array:
    """Return (24, 2, 3) the edges of a model's hull in a unit box: of a box, or of a prism where it is round."""
    if is_round(entry):
        turns = 2 * math.pi * (np.arange(_ROUND_SIDES + 1) + 0.5) / _ROUND_SIDES
        ring = np.stack([np.cos(turns), np.sin(turns)], axis=1) / 2
        low, high = (np.column_stack([ring, np.full(len(ring), z)]) for z in (-0.5, 0.5))
        level = [np.stack([one[:-1], one[1:]], axis=1) for one in (low, high)]
        return np.concatenate([*level, np.stack([low[:-1], high[:-1]], axis=1)])
    corners = np.array(list(itertools.product((-0.5, 0.5), repeat=3)))
    pairs = [(a, b) for a, b in itertools.combinations(corners, 2) if int((a != b).sum()) == 1]
    return np.array(pairs + pairs)


@cache
def parts_of(entry: ModelEntry) -> Array:
    """Return (N, 2, 3) lowest and highest corners of the solid parts of a model in a unit box, boxes of all."""
    size_m = usual_size_m(entry)
    if entry.model in ("generic_box", "generic_cylinder"):
        return np.array([[[-0.5] * 3, [0.5] * 3]])
    thing = PoseHypothesis(entry, 0.0, 0.0, 0.0, 0.0, size_m).as_object()
    found = []
    for part in solid_parts(thing):
        c, s = abs(math.cos(part.yaw_rad)), abs(math.sin(part.yaw_rad))
        half = np.array([c * part.half_x_m + s * part.half_y_m, s * part.half_x_m + c * part.half_y_m])
        low = [*(np.array([part.x_m, part.y_m]) - half), part.low_m - size_m[2] / 2]
        high = [*(np.array([part.x_m, part.y_m]) + half), part.high_m - size_m[2] / 2]
        found.append(np.array([low, high]) / size_m)
    largest = sorted(found, key=lambda one: -float(np.prod(one[1] - one[0])))[:6]
    return np.array(largest)


def with_region(piece: Piece, below: Piece) -> Piece:
    """Return a piece with the top of its support that it is on: the board next to where its box ends."""
    tops = top_shares(below.entry, hollows=True)
    if not tops or piece.board is not None:
        return piece
    if not has_boards(below.entry.category):
        return replace(piece, region=tops[0])
    _, y0, _, y1 = below.thing.box_px
    share = (y1 - piece.thing.box_px[3]) / (y1 - y0)
    return replace(piece, region=min(tops, key=lambda top: abs(top.high - share)))


def on_boards(view: Observation, pieces: Sequence[Piece]) -> list[Piece]:
    """Return pieces with shelves whose boards are where what is on them ends, not where a model has them.

    What ends at about one height is on one board. What ends where a shelf shows its top is on that.
    """
    found = list(pieces)
    for number, shelf in enumerate(pieces):
        left, top, right, bottom = shelf.thing.box_px
        within = [one for one, piece in enumerate(pieces) if piece.on == number]
        # What is wide and low is a single board.
        if not has_boards(shelf.entry.category) or bottom - top < COMPARTMENTS * (right - left):
            continue
        highest = 0.0 if top < BORDER_SHARE * view.size_px[1] else top + _TOP_SHARE * (bottom - top)
        within = [one for one in within if pieces[one].thing.box_px[3] > highest]
        boards = boards_of({one: pieces[one].thing.box_px[3] for one in within}, _SAME_BOARD * (bottom - top))
        if not boards:
            continue
        for one, board in boards.items():
            found[one] = replace(found[one], board=board, region=_WHOLE)
        found[number] = replace(shelf, entry=replace(GENERIC[SHELF], category=shelf.entry.category))
    return found


def boards_of(ends: Mapping[int, float], same: float) -> dict[int, int]:
    """Return the number of the board of each thing, those with the least end first; none beyond what a shelf can have.

    Args:
        ends: Thing -> where it ends.
        same: Most that is between an end and the next one on the same board.
    """
    boards, last = dict[int, int](), -math.inf
    for one, end in sorted(ends.items(), key=lambda item: item[1]):
        boards[one] = max(boards.values(), default=-1) + int(end > last + same)
        last = end
    return boards if max(boards.values(), default=0) < len(BOARDS) else {}


def modelled(view: Observation, thing: Detection, guess: PoseHypothesis) -> PoseHypothesis:
    """Return a pose with the library's model that has its size, else with a generic shape."""
    named = library_models(thing)
    rated = sorted((_misfit(entry, guess), number) for number, entry in enumerate(named))
    for misfit, number in rated:
        one = replace(guess, entry=named[number])
        if misfit < _MISFIT and raycaster_of(one) is not None:
            return one
    shapes = shapes_of(view, thing)
    for entry in shapes:
        one = replace(guess, entry=entry)
        if raycaster_of(one) is not None:
            return one
    size = np.clip(guess.size_m, 0.01, 3.0)
    return replace(guess, entry=shapes[0], size_m=(float(size[0]), float(size[1]), float(size[2])))


def library_models(thing: Detection) -> list[ModelEntry]:
    """Return the library's models of a thing, with its doors and drawers; none of what is let into a top.

    The library's sink is a unit that stands on the floor.
    """
    if is_inset(thing.label):
        return []
    named = [entry for entry in named_models(thing) if entry.model in LIBRARY]
    return with_parts(named, thing.doors, thing.drawers)


def shapes_of(view: Observation, thing: Detection) -> list[ModelEntry]:
    """Return the generic shapes of a thing, the likeliest first.

    Under a table other things are seen, a laptop may stand open, and most bowls do.
    """
    shapes = generic_models(thing)
    if is_panel(thing.label):
        return [replace(GENERIC[PANEL], category=shapes[0].category), *shapes]
    likeliest = shapes[0].model
    if is_on_legs(thing):
        likeliest = "generic_slab_on_legs"
    elif is_raised(view, thing, 0.0):  # By a lower plane its proportions are the same.
        likeliest = WITH_BACK
    elif is_mostly_open(thing.label):
        likeliest = "generic_open_box"
    return sorted(shapes, key=lambda entry: entry.model != likeliest)


def _misfit(entry: ModelEntry, guess: PoseHypothesis) -> float:
    """Return the largest logarithm by which a side is beyond the sizes of a model."""
    width = guess.size_m[1]
    worst = 0.0
    for value, span in zip(guess.size_m, (entry.length, entry.width, entry.height), strict=True):
        unit = width if span.of_width else 1.0
        worst = max(worst, math.log(span.low * unit / value), math.log(value / (span.high * unit)))
    return worst


def sizes_of(piece: Piece) -> tuple[list[float], list[float]]:
    """Return means and standard deviations of logarithms of length, width, height, two aspects and the longest side."""
    entry, label = piece.entry, piece.thing.label
    if piece.thing.size_m is not None:
        logs = [math.log(one) for one in piece.thing.size_m]
        return [*logs, logs[0] - logs[1], logs[2] - logs[1], max(logs)], [0.01, 0.01, 0.01, 1e3, 1e3, 1e3]
    if entry.model not in GENERIC:
        logs, spreads = [], []
        width = (entry.width.low + entry.width.high) / 2
        large = is_large(entry)
        for number, span in enumerate((entry.length, entry.width, entry.height)):
            unit = width if span.of_width else 1.0
            least = (_SPREAD_TALL if number == 2 else _SPREAD_LARGE) if large else _SPREAD_ITEM
            logs.append(math.log((span.low + span.high) / 2 * unit))
            spreads.append(max(OF_RANGE * math.log(span.high / span.low), least, _LEAST_SPREAD))
        aspect = 0.02 if is_round(entry) else 0.2
        up = logs[2] - logs[1]
        return [*logs, logs[0] - logs[1], up, max(logs)], [*spreads, aspect, 0.5, 1e3]
    if entry.model == SHELF:
        logs = [math.log(one) for one in _SHELF_M]
        return [*logs, 0.0, 0.0, 0.0], [*_SHELF_SPREADS, 1e3, 1e3, 1e3]
    high_m, thick_m, long_m = usual_height_m(label), usual_thickness_m(label), usual_length_m(label)
    any_m = long_m or (_PIECE_M if is_large(entry) else _ITEM_M)
    logs, spreads = [math.log(any_m * 0.7)] * 3, [1e3] * 3
    aspects, around = [0.0, 0.0], [_ASPECT, _UPRIGHT]
    if is_round(entry):
        around[0] = 0.02
    if is_large(entry):
        logs[2], spreads[2] = math.log(_HIGH_M), _PIECE_SPREAD
    any_spread = _PIECE_SPREAD if is_large(entry) else _ANY_SPREAD
    if high_m is not None:
        logs[2], spreads[2], around[1] = math.log(high_m), _LYING_SPREAD, 1e3
    if thick_m is not None:
        logs[0], spreads[0], around[0] = math.log(thick_m), _LYING_SPREAD, 1e3
    return [*logs, *aspects, math.log(any_m)], [*spreads, *around, any_spread if long_m is None else _LONG_SPREAD]


def snapped(box_px: tuple[float, float, float, float], width: int, height: int) -> list[float]:
    """Return a box that ends at the picture's border where it ends next to it."""
    x0, y0, x1, y1 = box_px
    over_x, over_y = BORDER_SHARE * width, BORDER_SHARE * height
    return [
        0.0 if x0 < over_x else x0,
        0.0 if y0 < over_y else y0,
        float(width) if x1 > width - over_x else x1,
        float(height) if y1 > height - over_y else y1,
    ]
