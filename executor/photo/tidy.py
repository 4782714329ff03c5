"""Fits side by side made into a room that can be: nothing in each other or in walls, and what is on a top is on it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from executor.assets.footprint import Footprint, region_frame, swept_parts
from executor.assets.library import asset_for
from executor.geometry import rotation_z
from executor.photo.fitting.body import Guess, is_round
from executor.photo.fitting.prior import AT_WALLS
from executor.photo.space.walls import Wall
from oag import Kind, kind_of

SAME_HEIGHT_M = 0.02
"""Between a thing and the top that it is taken to stand on, where both were fitted to one picture."""

_ROUNDS = 4
_CLEAR_M = 0.001
_SHAVED_M = 0.08
"""Two pieces in a row that overlap by less are both made narrower: it is their sides that were misjudged."""

_OPENED_RAD, _SWING_STEPS = math.pi / 2, 16  # As doors are opened where people live.
_NOISE_RAD = math.radians(3.0)  # What depths at 5 m leave unknown of a cabinet's turn.
_PARALLEL = math.sin(math.radians(8.0))
_EDGE_M, _EDGE_STEPS = 0.004, 24
_HIGHER_M = 0.002
_FARTHEST_M = 0.5  # A thing is moved onto a top: the next one that is as high may be across the room.
_TOLD_M = 0.005


def tidied(
    guesses: Mapping[str, Guess], walls: Sequence[Wall], same_height_m: float = SAME_HEIGHT_M
) -> tuple[dict[str, Guess], list[str]]:
    """Returns guesses that do not overlap, and in sentences what was moved by more than half a centimetre.

    Args:
        guesses: id -> guess.
        walls: The walls.
        same_height_m: Between a thing and the top that it is taken to stand on.
    """
    room = dict(guesses)
    large = [key for key, one in room.items() if not _is_item(one) and one.bottom_m == 0.0]
    small = [key for key in room if key not in large]
    for key in large:
        if room[key].entry.category in AT_WALLS or is_round(room[key].entry):
            room[key] = _aligned(room[key], walls)
    for _ in range(_ROUNDS):
        for key in large:
            room[key] = _out_of_walls(room[key], walls)
        for number, key in enumerate(large):
            for other in large[number + 1 :]:
                room[key], room[other] = _apart(room[key], room[other])
    for key, other in itertools.permutations(large, 2):
        room[other] = _beside_its_doors(room[key], room[other])
    for key in small:
        room[key] = _on_its_top(room[key], {other: room[other] for other in room if other != key}, same_height_m)
    for _ in range(_ROUNDS):
        for number, key in enumerate(small):
            for other in small[number + 1 :]:
                if not _inside(room[key], room[other]) and not _inside(room[other], room[key]):
                    room[key], room[other] = _pushed(room[key], room[other])
    notes = []
    for key, one in room.items():
        before = guesses[key]
        moved_m = math.dist((one.x_m, one.y_m, one.bottom_m), (before.x_m, before.y_m, before.bottom_m))
        grown_m = max(abs(a - b) for a, b in zip(one.size_m, before.size_m, strict=True))
        if moved_m > _TOLD_M or grown_m > _TOLD_M:
            notes.append(f"{key} was moved by {100 * moved_m:.1f} cm and resized by {100 * grown_m:.1f} cm")
    return room, notes


def _is_item(guess: Guess) -> bool:
    return kind_of(guess.entry.category, guess.size_m[1]) is Kind.ITEM


def _footprint(guess: Guess) -> Footprint:
    return Footprint.of(guess.as_object())


def _shifted(guess: Guess, by: np.ndarray) -> Guess:
    return replace(guess, x_m=guess.x_m + float(by[0]), y_m=guess.y_m + float(by[1]))


def _aligned(guess: Guess, walls: Sequence[Wall]) -> Guess:
    """Turned fully along a wall that it is nearly along: what is left is noise. Round things have no corners there."""
    for wall in walls:
        turned = math.remainder(guess.yaw_rad - wall.yaw_rad, math.pi / 2)
        if abs(turned) < _NOISE_RAD or is_round(guess.entry):
            return replace(guess, yaw_rad=guess.yaw_rad - turned)
    return guess


def _out_of_walls(guess: Guess, walls: Sequence[Wall]) -> Guess:
    for wall in walls:
        corners = _footprint(guess).corners_m
        side = corners @ wall.along
        if side.max() < wall.span_m[0] or side.min() > wall.span_m[1]:
            continue
        nearest, farthest = float((corners @ wall.normal).max()), float((corners @ wall.normal).min())
        into_m = wall.offset_m + _CLEAR_M - farthest
        # What stands wholly behind a wall is in the room into which the camera looks over it.
        if into_m > 0.0 and nearest > wall.offset_m:
            guess = _shifted(guess, into_m * wall.normal)
    return guess


def _apart(first: Guess, second: Guess) -> tuple[Guess, Guess]:
    """Two pieces of furniture without overlap: shaved where they stand in a row, else the smaller one gives way."""
    deep_m = _footprint(first).depth_m(_footprint(second))
    if deep_m <= 0.0:
        return first, second
    aside = np.array([-math.sin(first.yaw_rad), math.cos(first.yaw_rad)])
    away = np.array([second.x_m - first.x_m, second.y_m - first.y_m])
    in_row = _stand_alike(first, second)
    # Where one of them is turned a little, its corner is deeper in the other one than its side.
    over_m = max((first.size_m[1] + second.size_m[1]) / 2 - abs(float(away @ aside)), deep_m) + _CLEAR_M
    if in_row and over_m < _SHAVED_M:
        sign = math.copysign(1.0, float(away @ aside))
        return _narrower(first, over_m / 2, sign), _narrower(second, over_m / 2, -sign)
    return _pushed(first, second)


def _stand_alike(first: Guess, second: Guess) -> bool:
    """Whether two stand as in a row."""
    turned = first.yaw_rad - second.yaw_rad
    return abs(math.sin(turned)) < _PARALLEL and math.cos(turned) > 0


def _beside_its_doors(guess: Guess, other: Guess) -> Guess:
    """Another piece in a row, narrower where a door swings into its side, which the thing with the door often hides."""
    near_m = (guess.size_m[1] + other.size_m[1]) / 2 + _SHAVED_M
    away = np.array([other.x_m - guess.x_m, other.y_m - guess.y_m])
    aside = np.array([-math.sin(other.yaw_rad), math.cos(other.yaw_rad)])
    if not _stand_alike(guess, other) or abs(float(away @ aside)) > near_m:
        return other
    side, theirs = -math.copysign(1.0, float(away @ aside)), _footprint(other)
    into_m = max(
        (_reach_m(part, theirs, side) for part in swept_parts(guess.as_object(), _OPENED_RAD, _SWING_STEPS)),
        default=0.0,
    )
    return _narrower(other, into_m + _CLEAR_M, side) if 0.0 < into_m < _SHAVED_M else other


def _reach_m(part: Footprint, other: Footprint, side: float) -> float:
    """How far a part reaches into a thing from one of its sides, +1 its own +y; 0 where it does not."""
    if part.depth_m(other) <= 0.0:
        return 0.0
    along = np.linspace(part.corners_m, np.roll(part.corners_m, 1, axis=0), _EDGE_STEPS).reshape(-1, 2)
    local = (along - [other.x_m, other.y_m]) @ rotation_z(other.yaw_rad)[:2, :2]
    inside = (np.abs(local) < [other.half_x_m, other.half_y_m]).all(axis=1)
    return float((other.half_y_m - side * local[inside, 1]).max(initial=0.0))


def _narrower(guess: Guess, by_m: float, side: float) -> Guess:
    """Narrower by a length on one of its sides, +1 its own +y, unless its model cannot be."""
    length, width, height = guess.size_m
    least = guess.entry.width.low
    cut = min(by_m, max(0.0, width - least))
    aside = np.array([-math.sin(guess.yaw_rad), math.cos(guess.yaw_rad)])
    # What cannot be cut is moved.
    smaller = replace(guess, size_m=(length, width - cut, height))
    return _shifted(smaller, -side * (cut / 2 + (by_m - cut)) * aside)


def _pushed(first: Guess, second: Guess) -> tuple[Guess, Guess]:
    """The smaller one moved away along the axis on which the two overlap least."""
    a, b = _footprint(first), _footprint(second)
    if a.depth_m(b) <= 0.0:
        return first, second
    second_gives = second.size_m[0] * second.size_m[1] <= first.size_m[0] * first.size_m[1]
    least: tuple[float, np.ndarray] | None = None
    for yaw in (a.yaw_rad, b.yaw_rad):
        for axis in (np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])):
            mine, theirs = a.corners_m @ axis, b.corners_m @ axis
            for over_m, direction in ((mine.max() - theirs.min(), axis), (theirs.max() - mine.min(), -axis)):
                if least is None or over_m < least[0]:
                    least = float(over_m), direction
    if least is None:
        return first, second
    by = (least[0] + _CLEAR_M) * least[1]
    return (first, _shifted(second, by)) if second_gives else (_shifted(first, -by), second)


def _inside(thing: Guess, other: Guess) -> bool:
    """Whether a thing stands above another one's bottom and within its outline: in a bowl, on a plate."""
    mine, theirs = _footprint(thing), _footprint(other)
    return thing.bottom_m > other.bottom_m + _HIGHER_M and mine.gap_m(theirs) < -min(mine.half_x_m, mine.half_y_m)


def _on_its_top(guess: Guess, others: Mapping[str, Guess], same_height_m: float) -> Guess:
    """Wholly on the top or board that it stands on, and exactly at its height."""
    best: tuple[float, Guess] | None = None
    for other in others.values():
        if _is_item(other):
            continue
        carrier = other.as_object()
        for region in asset_for(carrier).regions:
            T, half = region_frame(carrier, region)
            if abs(float(T[2, 3]) - guess.bottom_m) > same_height_m:
                continue
            turn = T[:2, :2]
            local = turn.T @ (np.array([guess.x_m, guess.y_m]) - T[:2, 3])
            own = guess.yaw_rad - math.atan2(turn[1, 0], turn[0, 0])
            c, s = abs(math.cos(own)), abs(math.sin(own))
            reach = np.array([c * guess.size_m[0] + s * guess.size_m[1], s * guess.size_m[0] + c * guess.size_m[1]]) / 2
            free = np.maximum(half - reach - _EDGE_M, 0.0)
            inside = np.clip(local, -free, free)
            by_m = float(np.linalg.norm(inside - local))
            if by_m < _FARTHEST_M and (best is None or by_m < best[0]):
                x, y = turn @ inside + T[:2, 3]
                best = by_m, replace(guess, x_m=float(x), y_m=float(y), bottom_m=float(T[2, 3]))
    return guess if best is None else best[1]
