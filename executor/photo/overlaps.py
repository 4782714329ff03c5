"""Overlaps of a reconstruction are resolved: furniture out of walls and of other furniture, things onto their tops."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from executor.assets.families.generic import GENERIC
from executor.assets.footprint import Footprint, overlap_depth_m, region_frame, solid_parts, swept_parts
from executor.assets.library import asset_for
from executor.geometry import rotation_z
from executor.photo.fitting.hypothesis import PoseHypothesis, is_round, raycaster_of
from executor.photo.fitting.likelihood import AT_WALLS
from executor.photo.geometry.walls import Wall
from executor.photo.inputs.usual import carries
from executor.photo.room.estimate import is_item, is_on_one, tops_of
from executor.photo.separation import CLEARANCE_M, Boxed, Fill, separated
from oag.model.symbols import Kind, has_boards, kind_of

SAME_HEIGHT_M = 0.02
"""Between a thing and the top that it is taken to stand on, where both were fitted to one picture."""

EDGE_M = 0.004
"""Between a thing's middle and the edge of its top, at least."""

_ROUNDS = 4
_SHAVED_M = 0.08
"""Two pieces in a row that overlap by less are both made narrower: their sides were misjudged."""

_OPENED_RAD, _SWING_STEPS = math.pi / 2, 16  # As doors are opened where people live.
_NOISE_RAD = math.radians(3.0)  # Uncertainty of a cabinet's heading by depth at 5 m.
_PARALLEL = math.sin(math.radians(8.0))
_EDGE_STEPS = 24
_HIGHER_M = 0.002
_SHALLOW = 0.2  # Height of a plate, in shares of its shorter side.
_BOARD_M, _BESIDE_M = 0.5, 0.1
"""Between a thing in a shelf and the board that it stands on, as boards are fitted evenly spaced; and the outline of a
shelf, whose depth is mostly hidden."""

_NEAR_HEIGHT_M = 0.13  # Between a thing on nothing that has a box, and a top next to it.
_FARTHEST_M = 0.5  # A thing is moved onto a top: the next one that is as high may be across the room.
_GUESSED_FAR_M = 1.5  # Of variations, whose heights are off by the error of both sizes.
_GROWN_M = 1.0  # A table is fitted to what is visible of it: things at the height of its top are on it so far off.
_ON_ITEM, _ON_TOP = 0.7, 0.4
"""Share of an item's half sides in which a middle is stable; share of a thing's own ones that lies on furniture."""

_REPORTED_M = 0.005


def resolve_overlaps(
    guesses: Mapping[str, PoseHypothesis],
    walls: Sequence[Wall],
    same_height_m: float = SAME_HEIGHT_M,
    hung: Collection[str] = (),
    fitted: Mapping[str, PoseHypothesis] | None = None,
    fills: Mapping[str, Fill] = MappingProxyType({}),
    on: Mapping[str, str] = MappingProxyType({}),
    sized: Collection[str] = (),
) -> tuple[dict[str, PoseHypothesis], list[str]]:
    """Move and shrink hypotheses until none overlap; report moves of more than half a centimetre as sentences.

    Args:
        guesses: id -> pose hypothesis.
        walls: The walls.
        same_height_m: Tolerance between an object and the top that it stands on.
        hung: Furniture among them that stays where it is.
        fitted: id -> pose with which reported moves are compared; None: the hypotheses themselves.
        fills: id -> how well it fills its box; what is moved stays in it as far as it can.
        on: id -> id of what carries it, where that is known: it is on no other top, and they are not separated.
        sized: Those whose size a person gave; it is never changed.
    """
    room = dict(guesses)
    boxed = {key: Boxed.of(fill, room[key], is_sized=key in sized) for key, fill in fills.items() if key in room}
    large = [key for key, one in room.items() if not is_item(one) and one.bottom_m == 0.0 and not one.fixed]
    # What carries others is placed before them.
    small = sorted(
        (key for key in room if key not in large), key=lambda key: (len(_below(key, on)), room[key].bottom_m)
    )
    for key in large:
        if room[key].entry.category in AT_WALLS or is_round(room[key].entry):
            room[key] = _aligned(room[key], walls)
    for key in small:
        if room[key].fixed:
            room[key] = _out_of_walls(_aligned(room[key], walls), walls)
            continue
        tops = tops_of(one for other, one in room.items() if other != key)
        if key not in hung and not is_on_one(room[key], tops, same_height_m):
            _let_carry(room, key, sized)
    for _ in range(_ROUNDS):
        for key in large:
            room[key] = _out_of_walls(room[key], walls)
        for number, key in enumerate(large):
            for other in large[number + 1 :]:
                known = (boxed[key], boxed[other]) if key in boxed and other in boxed else None
                room[key], room[other] = _apart(room[key], room[other], known, (key in sized, other in sized))
    for key, other in itertools.permutations(large, 2):
        room[other] = _clear_of_doors(room[key], room[other], other in sized)
    for key in small:
        _flatten(room, key, [room[one] for one in small if on.get(one) == key])
    notes = _put_on_tops(room, small, same_height_m, hung, on)
    for _ in range(_ROUNDS):
        for number, key in enumerate(small):
            for other in small[number + 1 :]:
                if other in _below(key, on) or key in _below(other, on):
                    continue
                if not _inside(room[key], room[other]) and not _inside(room[other], room[key]):
                    known = (boxed[key], boxed[other]) if key in boxed and other in boxed else None
                    room[key], room[other] = separated(room[key], room[other], known)
    return room, [*notes, *_moves(guesses if fitted is None else fitted, room)]


def _below(key: str, on: Mapping[str, str]) -> list[str]:
    """Return what carries a thing, and what carries that one."""
    found: list[str] = []
    while (key := on.get(key, "")) and key not in found:
        found.append(key)
    return found


def _flatten(room: dict[str, PoseHypothesis], key: str, carried: Sequence[PoseHypothesis]) -> None:
    """Make a plate flat on which things reach over its rim: there they stay where they were seen."""
    plate = room[key].as_object()
    if not carried or not is_item(room[key]) or room[key].size_m[2] > _SHALLOW * min(room[key].size_m[:2]):
        return
    for region in asset_for(plate).regions:
        T, half = region_frame(plate, region)
        sunk = region.kind == "surface" and float(T[2, 3]) < room[key].bottom_m + room[key].size_m[2] - _HIGHER_M
        reaches = (
            np.abs(T[:2, :2].T @ (np.array([one.x_m, one.y_m]) - T[:2, 3])) + min(one.size_m[:2]) / 2 for one in carried
        )
        if sunk and any((reach > half).any() for reach in reaches):
            shape = GENERIC["generic_cylinder" if is_round(room[key].entry) else "generic_box"]
            flat = replace(room[key], entry=replace(shape, category=room[key].entry.category), parameters=())
            room[key] = flat if raycaster_of(flat) is not None else room[key]
            return


def _put_on_tops(
    room: dict[str, PoseHypothesis],
    small: Sequence[str],
    same_height_m: float,
    hung: Collection[str],
    on: Mapping[str, str],
) -> list[str]:
    """Put each small thing onto its top, or down; report what hangs and what had no top."""
    farthest_m = _FARTHEST_M if same_height_m <= SAME_HEIGHT_M else _GUESSED_FAR_M
    notes = []
    for key in small:
        others = {other: room[other] for other in room if other != key}
        if room[key].fixed:
            notes.append(f"{key} hangs on a wall, {room[key].bottom_m:.2f} m above the floor")
            continue
        if key in hung and not is_item(room[key]):
            if not _stands(room[key], others):
                notes.append(f"{key} hangs {room[key].bottom_m:.2f} m above the floor, by its box alone")
            continue
        fitted = room[key]
        if key in on:
            carrier = {on[key]: room[on[key]]} if on[key] in room else {}
            room[key] = _on_its_top(fitted, carrier, _BOARD_M, farthest_m, is_known=True)
            if room[key] is not fitted:
                continue
        # A thing between boards is on one of them, however the others are fitted, and on no neighbour's.
        boarded = _boarded(fitted, others)
        items = {other: one for other, one in others.items() if is_item(one)}
        room[key] = _on_its_top(fitted, {**items, **boarded} if boarded else others, same_height_m, farthest_m)
        if room[key] is fitted and boarded:
            room[key] = _on_its_top(fitted, boarded, _BOARD_M, farthest_m)
        if room[key] is not fitted:
            continue
        if is_item(room[key]) and not _stands(room[key], others):
            # Its support may end too early: where nothing is below it, a near top is likelier than the floor.
            room[key] = _on_its_top(room[key], others, _NEAR_HEIGHT_M, farthest_m)
        if is_item(room[key]) and not _stands(room[key], others):
            room[key] = _put_down(room[key], list(others.values()))
            notes.append(f"{key} stands on nothing that has a box; it was put down")
    return notes


def _boarded(guess: PoseHypothesis, others: Mapping[str, PoseHypothesis]) -> dict[str, PoseHypothesis]:
    """Return the piece with boards, if any, between whose boards the middle of a thing is, or hardly outside."""
    found: list[tuple[float, str]] = []
    for key, one in others.items():
        local = rotation_z(one.yaw_rad)[:2, :2].T @ [guess.x_m - one.x_m, guess.y_m - one.y_m]
        aside_m = float(np.linalg.norm(np.maximum(np.abs(local) - np.divide(one.size_m[:2], 2), 0.0)))
        within = one.bottom_m < guess.bottom_m < one.bottom_m + one.size_m[2]
        if within and aside_m < _BESIDE_M and has_boards(one.entry.category):
            found.append((aside_m, key))
    return {key: others[key] for _, key in sorted(found)[:1]}


def _moves(fitted: Mapping[str, PoseHypothesis], room: Mapping[str, PoseHypothesis]) -> list[str]:
    notes = []
    for key, one in room.items():
        before = fitted[key]
        moved_m = math.dist((one.x_m, one.y_m, one.bottom_m), (before.x_m, before.y_m, before.bottom_m))
        grown_m = max(abs(a - b) for a, b in zip(one.size_m, before.size_m, strict=True))
        if moved_m > _REPORTED_M or grown_m > _REPORTED_M:
            notes.append(f"{key} was moved by {100 * moved_m:.1f} cm and resized by {100 * grown_m:.1f} cm")
    return notes


def _let_carry(room: dict[str, PoseHypothesis], key: str, sized: Collection[str]) -> None:
    """Let the nearest table whose top is as high as a thing's bottom, and ends before it, reach below its middle.

    A table whose size a person gave is as large as that.
    """
    thing, best = room[key], (_GROWN_M, "", np.zeros(2))
    margin_m = _ON_TOP * min(thing.size_m[:2]) / 2 + 2 * EDGE_M
    for name, piece in room.items():
        is_table = kind_of(piece.entry.category, 0.0) is Kind.SUPPORT and piece.bottom_m == 0.0
        if not is_table or name in sized or abs(piece.size_m[2] - thing.bottom_m) > SAME_HEIGHT_M:
            continue
        local = rotation_z(piece.yaw_rad)[:2, :2].T @ [thing.x_m - piece.x_m, thing.y_m - piece.y_m]
        out = np.maximum(np.abs(local) + margin_m - np.divide(piece.size_m[:2], 2), 0.0)
        if float(out.max()) < best[0]:
            best = float(out.max()), name, np.copysign(out, local)
    out_m, name, out = best
    if not name or out_m == 0.0:
        return
    piece = room[name]
    length, width, height = piece.size_m
    sides = length + abs(float(out[0])), width + abs(float(out[1]))
    grown = replace(piece, size_m=(*sides, height))
    if raycaster_of(grown) is None:
        slab = replace(GENERIC["generic_slab_on_legs"], category=piece.entry.category)
        grown = replace(grown, entry=slab, parameters=())
    room[name] = grown.shifted(rotation_z(piece.yaw_rad)[:2, :2] @ out / 2)


def _footprint(guess: PoseHypothesis) -> Footprint:
    return Footprint.of(guess.as_object())


def _aligned(guess: PoseHypothesis, walls: Sequence[Wall]) -> PoseHypothesis:
    """Align a piece with a nearly parallel wall: the rest is noise. Round objects have no corners there."""
    for wall in walls:
        turned = math.remainder(guess.yaw_rad - wall.yaw_rad, math.pi / 2)
        if abs(turned) < _NOISE_RAD or is_round(guess.entry):
            return replace(guess, yaw_rad=guess.yaw_rad - turned)
    return guess


def _out_of_walls(guess: PoseHypothesis, walls: Sequence[Wall]) -> PoseHypothesis:
    for wall in walls:
        corners = _footprint(guess).corners_m
        side = corners @ wall.along
        if side.max() < wall.span_m[0] or side.min() > wall.span_m[1]:
            continue
        nearest, farthest = float((corners @ wall.normal).max()), float((corners @ wall.normal).min())
        into_m = wall.offset_m + CLEARANCE_M - farthest
        # An object wholly behind a wall is in the next room, visible over the wall.
        if into_m > 0.0 and nearest > wall.offset_m:
            guess = guess.shifted(into_m * wall.normal)
    return guess


def _apart(
    first: PoseHypothesis,
    second: PoseHypothesis,
    boxed: tuple[Boxed, Boxed] | None,
    sized: tuple[bool, bool],
) -> tuple[PoseHypothesis, PoseHypothesis]:
    """Separate two pieces of furniture: both are narrowed if they stand in a row, else the smaller one is moved."""
    deep_m = _footprint(first).depth_m(_footprint(second))
    # A chair may stand under a table: their parts decide.
    if deep_m <= 0.0 or overlap_depth_m(solid_parts(first.as_object()), solid_parts(second.as_object())) <= 0.0:
        return first, second
    aside = np.array([-math.sin(first.yaw_rad), math.cos(first.yaw_rad)])
    away = np.array([second.x_m - first.x_m, second.y_m - first.y_m])
    in_row = _stand_alike(first, second)
    # Where one of them is turned a little, its corner is deeper in the other one than its side.
    over_m = max((first.size_m[1] + second.size_m[1]) / 2 - abs(float(away @ aside)), deep_m) + CLEARANCE_M
    if in_row and over_m < _SHAVED_M:
        sign = math.copysign(1.0, float(away @ aside))
        return _narrower(first, over_m / 2, sign, sized[0]), _narrower(second, over_m / 2, -sign, sized[1])
    return separated(first, second, boxed)


def _stand_alike(first: PoseHypothesis, second: PoseHypothesis) -> bool:
    """Return whether two pieces stand as in a row."""
    turned = first.yaw_rad - second.yaw_rad
    return abs(math.sin(turned)) < _PARALLEL and math.cos(turned) > 0


def _clear_of_doors(guess: PoseHypothesis, other: PoseHypothesis, is_sized: bool) -> PoseHypothesis:
    """Narrow another piece of a row if a door swings into its side.

    The piece with the door often hides that side.
    """
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
    return _narrower(other, into_m + CLEARANCE_M, side, is_sized) if 0.0 < into_m < _SHAVED_M else other


def _reach_m(part: Footprint, other: Footprint, side: float) -> float:
    """Return how far a part reaches into an object from one side, +1 its own +y; 0 if it does not."""
    if part.depth_m(other) <= 0.0:
        return 0.0
    along = np.linspace(part.corners_m, np.roll(part.corners_m, 1, axis=0), _EDGE_STEPS).reshape(-1, 2)
    local = (along - [other.x_m, other.y_m]) @ rotation_z(other.yaw_rad)[:2, :2]
    inside = (np.abs(local) < [other.half_x_m, other.half_y_m]).all(axis=1)
    return float((other.half_y_m - side * local[inside, 1]).max(initial=0.0))


def _narrower(guess: PoseHypothesis, by_m: float, side: float, is_sized: bool) -> PoseHypothesis:
    """Narrow a piece on one side, +1 its own +y; move it by what its model, or a given size, does not allow."""
    length, width, height = guess.size_m
    least = width if is_sized else guess.entry.width.low
    cut = min(by_m, max(0.0, width - least))
    aside = np.array([-math.sin(guess.yaw_rad), math.cos(guess.yaw_rad)])
    # The rest is moved.
    smaller = replace(guess, size_m=(length, width - cut, height))
    return smaller.shifted(-side * (cut / 2 + (by_m - cut)) * aside)


def _inside(thing: PoseHypothesis, other: PoseHypothesis) -> bool:
    """Return whether an object stands above another's bottom and within its outline: in a bowl, on a plate."""
    mine, theirs = _footprint(thing), _footprint(other)
    return thing.bottom_m > other.bottom_m + _HIGHER_M and mine.gap_m(theirs) < -min(mine.half_x_m, mine.half_y_m)


def _on_its_top(
    guess: PoseHypothesis,
    others: Mapping[str, PoseHypothesis],
    same_height_m: float,
    farthest_m: float,
    *,
    is_known: bool = False,
) -> PoseHypothesis:
    """Move an object onto the top or board that it stands on, at exactly its height, so far that it is stable.

    On an item, such as a saucer, its middle is enough. What is over an item, or a board on a top, and is no larger, is
    on that and not below.
    """
    best: tuple[tuple[bool, float], PoseHypothesis] | None = None
    for other in others.values():
        on_item = is_item(other)
        is_loose = on_item or other.bottom_m > 0.0
        if on_item and other.bottom_m > guess.bottom_m and not is_known:
            continue
        if on_item and same_height_m > SAME_HEIGHT_M and not is_known and not carries(other.entry.category):
            # Of a variation, what is before a thing may seem to be below it.
            continue
        carrier = other.as_object()
        for region in asset_for(carrier).regions:
            T, half = region_frame(carrier, region)
            level_m = float(T[2, 3])
            if on_item and min(guess.size_m[:2]) > 2 * min(half):
                # On a plate, what is wider than its hollow rests on the rim.
                level_m = other.bottom_m + other.size_m[2]
            stands_aside = on_item and not is_known and level_m > guess.bottom_m + guess.size_m[2] / 2
            if stands_aside or abs(level_m - guess.bottom_m) > same_height_m:
                continue
            turn = T[:2, :2]
            local = turn.T @ (np.array([guess.x_m, guess.y_m]) - T[:2, 3])
            if guess.bottom_m == 0.0 and bool((np.abs(local) > half).any()):
                # What stands on the floor stays there, beside what is hardly higher.
                continue
            own = guess.yaw_rad - math.atan2(turn[1, 0], turn[0, 0])
            c, s = abs(math.cos(own)), abs(math.sin(own))
            reach = np.array([c * guess.size_m[0] + s * guess.size_m[1], s * guess.size_m[0] + c * guess.size_m[1]]) / 2
            # It may reach over the edge of a top, not into the side of a sink.
            share = 1.0 if region.kind == "interior" else _ON_TOP
            share = 0.0 if on_item and is_known and region.kind == "surface" else share
            free = _ON_ITEM * half if on_item and share > 0.0 else np.maximum(half - share * reach - EDGE_M, 0.0)
            inside = np.clip(local, -free, free)
            aside_m = float(np.linalg.norm(inside - local))
            is_over = is_loose and aside_m == 0.0 and max(guess.size_m[:2]) <= max(other.size_m[:2])
            # Of a plate in a sink, what is over both is on the plate. In a raised shelf it is on the nearest board.
            off = -level_m if is_over and on_item else math.hypot(aside_m, float(T[2, 3]) - guess.bottom_m)
            by = not is_over, off
            near_m = min(other.size_m[:2]) / 2 if on_item and not is_known else farthest_m
            if aside_m < near_m and (best is None or by < best[0]):
                x, y = turn @ inside + T[:2, 3]
                best = by, replace(guess, x_m=float(x), y_m=float(y), bottom_m=level_m)
    return guess if best is None else best[1]


def _stands(guess: PoseHypothesis, others: Mapping[str, PoseHypothesis]) -> bool:
    """Return whether an object is on the floor, or over a top at its height."""
    return guess.bottom_m == 0.0 or is_on_one(guess, tops_of(others.values()), _HIGHER_M)


def _put_down(guess: PoseHypothesis, others: Sequence[PoseHypothesis]) -> PoseHypothesis:
    """Lower an object that stands on nothing to the nearest top below its middle, or to the floor."""
    at = np.array([guess.x_m, guess.y_m])
    below = [0.0]
    for other in others:
        carrier = other.as_object()
        for region in asset_for(carrier).regions:
            T, half = region_frame(carrier, region)
            inside = (np.abs(T[:2, :2].T @ (at - T[:2, 3])) <= half).all()
            if region.kind == "surface" and inside and T[2, 3] <= guess.bottom_m:
                below.append(float(T[2, 3]))
    return replace(guess, bottom_m=max(below))
