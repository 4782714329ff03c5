"""What stands on what in a picture without depth, by boxes, names and the camera's pose alone.

Where a box ends in the picture, its thing touches what carries it. A support shows its upper face from the upper edge
of its box down to the front edge of its top. That edge is known: the box ends where the front meets the floor, and tops
of a kind are about equally high.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from executor.assets.families.generic import GENERIC
from executor.assets.library import LIBRARY
from executor.photo.fitting.hypothesis import largest_m
from executor.photo.fitting.likelihood import top_shares, usual_size_m
from executor.photo.fitting.starts import foot_of, named_models, stands_on_floor
from executor.photo.geometry.observation import Observation
from executor.photo.inputs.annotations import FLOOR, WALL, Detection, plain_name
from executor.photo.inputs.usual import (
    carries,
    hung_depth_m,
    is_cookware,
    is_hollow,
    is_hot,
    is_lounge,
    is_mostly_open,
    is_open,
    is_seat,
    is_soft,
    is_usual_on_floor,
    usual_height_m,
    usual_length_m,
)
from executor.photo.room.estimate import is_piece
from oag.model.symbols import carries_things, has_boards, kind_of

Box = tuple[float, float, float, float]

BORDER_SHARE = 0.012
"""Of the picture's sides: a box that ends so near to the border is cut."""

COMPARTMENTS = 0.5
"""Height by width of the box of a shelf from where on it has compartments."""

_TOP_M = 0.5  # Height of furniture of no known model.
_TOLERANT = 0.15  # Share of a front by which tops of a kind differ in height.
_TALLER = 1.6  # Than its kind: what would be so large on the floor is not there.
_WIDEST_ITEM_M, _FARTHEST_M = 1.2, 7.0  # Of an item on the floor of a room.
_HUNG_FROM_M, _TALL_M = 4.0, 0.5  # Nearer, and taller, what usually hangs stands on the floor.
_NARROW, _WIDE = 1.25, 1.4  # Times as wide as the item below it, lying or standing on it.
_UPRIGHT_OVER, _UPRIGHT_ABOVE, _UPRIGHT_ASIDE, _BETWEEN = 0.8, 0.5, 0.5, 0.4
"""Of what stands on an item that is not known to carry. The first is the share of its width over the item, the second
how far it stands out above it, in heights of the item. The others are how far its middle and its end are off the
item's, in halves of its sides. In 99 pictures every such pair is one on the other."""

_INTO = 0.06  # Share of a face: what ends nearer to its upper edge is behind it.
_OUTSIDE, _AREA, _UNUSUAL, _ON_SEAT, _ON_ITEM, _MAYBE_ON_ITEM = 0.7, 0.4, 1.0, 2.0, -1.5, 4.0
_IN_BOARDS, _OVERHANG, _NESTED = 1.0, 1.5, 0.1
_LEAST_WIDE = 0.6  # Of a thing's width, a support shows.
_OFF_SHARE, _NEAR_SHARE, _FRONT = 0.2, 0.06, 1.5
"""Of a thing's shorter side, beside a face; most of the width of the picture that such a side is; most that the front
edge of a face costs."""

_ON_FLOOR, _HIDDEN, _MOST = 2.5, 3.0, 12.0
_ON_LEGS = ("bed", "desk", "stand", "stool", "table")  # Other things are seen below them.
_HIDES, _HIDES_WIDE = 0.05, 0.3  # Shares of a box below its lower end, and of its width, where something is before it.
_SIZE_SPREAD, _SIZE_MOST, _WITHIN = 0.35, 3.0, 0.9


def supports_of(view: Observation, things: Sequence[Detection]) -> list[int]:
    """Return what carries each thing: the index of another one, FLOOR or WALL. Nothing carries itself."""
    found = [support_of(view, things, index) for index in range(len(things))]
    for index in range(len(things)):
        # Of things that seem to be on each other, the largest one is below, unless a person says what it is on.
        way = [index]
        while (on := found[way[-1]]) >= 0 and on not in way:
            way.append(on)
        if on >= 0:
            free = [one for one in way[way.index(on) :] if things[one].on is None]
            found[max(free or way[way.index(on) :], key=lambda one: things[one].area_px)] = FLOOR
    return found


def top_m(thing: Detection) -> float:
    """Return the usual height of a thing's top."""
    low_m = usual_height_m(thing.label)
    if low_m is not None:
        return low_m
    entry = named_models(thing)[0]
    shares = top_shares(entry)
    height_m = _TOP_M if entry.model in GENERIC else usual_size_m(entry)[2]
    return height_m * shares[0].high if shares else height_m


def is_foot_hidden(view: Observation, things: Sequence[Detection], index: int) -> bool:
    """Return whether nearer furniture is before the lower end of a piece: its box then ends too early."""
    x0, y0, x1, y1 = things[index].box_px
    if not is_piece(things[index]) or y1 > _cut_px(view):
        return False
    for other, thing in enumerate(things):
        left, top, right, bottom = thing.box_px
        over, behind = min(x1, right) - max(x0, left), top + 0.02 * (bottom - top) < y1
        # A coffee table stands before the sofa in whose box it is.
        before = is_piece(thing) and not (is_lounge(thing.label) and is_on_legs(things[index]))
        ends_before = behind and y1 < bottom - _HIDES * (y1 - y0)
        if other != index and before and over > _HIDES_WIDE * (x1 - x0) and ends_before:
            return True
    return False


def ends_above_horizon(view: Observation, things: Sequence[Detection], index: int) -> bool:
    """Return whether furniture ends where no floor is, and nothing hides its foot."""
    box_px = things[index].box_px
    is_level = is_piece(things[index]) and foot_of(view, box_px, 0.0) is None
    return is_level and not is_foot_hidden(view, things, index) and box_px[3] <= _cut_px(view)


def face_rows(view: Observation, things: Sequence[Detection], index: int) -> tuple[float, float]:
    """Return the first and last row in which a piece of furniture shows its top."""
    thing = things[index]
    _, y0, _, y1 = thing.box_px
    foot = None if is_foot_hidden(view, things, index) else foot_of(view, thing.box_px, 0.0)
    if y1 > _cut_px(view) or foot is None:
        return y0, y1
    edge = view.pixels(np.array([[*foot, top_m(thing)]]))[0, 1]
    front_px = y1 - float(edge)
    return y0, max(y0, y1 - (1.0 - _TOLERANT) * front_px) if math.isfinite(front_px) else y1


def support_of(view: Observation, things: Sequence[Detection], index: int) -> int:
    """Return the cheapest support of a thing: each costs by place, by size there, and by names."""
    thing = things[index]
    if thing.on is not None:
        return thing.on
    hung, piece = hung_depth_m(thing.label) is not None, is_piece(thing)
    standing = piece and stands_on_floor(thing)
    others = [other for other in range(len(things)) if other != index]
    # A shelf may hang, and stand on a desk.
    is_boarded = has_boards(_category(thing))
    if standing and not (is_boarded and (is_beyond_kind(view, thing) or _is_on_top(view, things, index, others))):
        return FLOOR
    rated = [
        (cost, other)
        for other in others
        if math.isfinite(cost := _cost_on(view, things, other, thing, bound=piece or hung))
    ]
    foot = foot_of(view, thing.box_px, 0.0)
    x0, y0, x1, y1 = thing.box_px
    far_m = math.inf if foot is None else float(np.hypot(*foot))
    large_m = min(x1 - x0, y1 - y0) / view.K.fx * far_m
    # A clock or a mirror that is so tall, and ends on a near floor, stands there.
    hung = hung and not (far_m < _HUNG_FROM_M and (y1 - y0) / view.K.fy * far_m > _TALL_M)
    if not (hung or standing or far_m > _FARTHEST_M or large_m > _WIDEST_ITEM_M):
        beneath = any(_is_beneath(view, things, other, thing) for other in others)
        hidden = not beneath and any(_shows(view, things, other, thing) for other in others)
        unusual = 0.0 if beneath or is_usual_on_floor(thing.label) else _ON_FLOOR
        rated.append((unusual + _size_cost(view, thing, 0.0) + _HIDDEN * hidden, FLOOR))
    best = min(rated, default=(math.inf, WALL))
    return best[1] if best[0] < _MOST else WALL


def _category(thing: Detection) -> str:
    return thing.category or plain_name(thing.label) or ""


def _is_beneath(view: Observation, things: Sequence[Detection], index: int, thing: Detection) -> bool:
    """Return whether all that is seen of a thing is between the front edge of a top and where its legs end."""
    (x0, y0, x1, y1), (left, _, right, bottom) = thing.box_px, things[index].box_px
    first, last = face_rows(view, things, index)
    inside = left < x0 and x1 < right + 0.2 * (x1 - x0) and last - _TOLERANT * (last - first) < y0 and y1 < bottom
    return inside and is_on_legs(things[index])


def is_on_legs(thing: Detection) -> bool:
    """Return whether a piece of furniture shows what is below it."""
    return (plain_name(thing.label) or "").split("_")[-1] in _ON_LEGS


def _is_on_top(view: Observation, things: Sequence[Detection], index: int, others: Sequence[int]) -> bool:
    """Return whether a piece is all in the box of other furniture, and ends where that one shows its top."""
    thing, found = things[index], False
    x0, _, x1, y1 = thing.box_px
    for other in others:
        left, top, right, _ = things[other].box_px
        inside = left <= x0 and x1 <= right and top <= y1 and thing.area_px < things[other].area_px
        found = found or (inside and not has_boards(_category(things[other])) and _shows(view, things, other, thing))
    return found


def _shows(view: Observation, things: Sequence[Detection], index: int, thing: Detection) -> bool:
    """Return whether a thing ends where a piece of furniture shows its top, which hides the floor."""
    support = things[index]
    x0, _, x1, y1 = thing.box_px
    left, _, right, _ = support.box_px
    first, last = face_rows(view, things, index)
    return is_piece(support) and not is_open(support.label) and left < (x0 + x1) / 2 < right and first < y1 < last


def _cost_on(view: Observation, things: Sequence[Detection], index: int, thing: Detection, *, bound: bool) -> float:
    """Return what a support costs; infinite where it carries nothing.

    Args:
        view: The picture.
        things: All things.
        index: Number of the support.
        thing: What may stand on it.
        bound: Whether the thing has to end within the support's face: it may as well hang.
    """
    support = things[index]
    (x0, y0, x1, y1), (left, top, right, bottom) = thing.box_px, support.box_px
    label, soft = support.label, is_soft(thing.label)
    side, cost = min(x1 - x0, y1 - y0, _NEAR_SHARE * view.size_px[0]), 0.0
    if is_piece(support):
        category, draped = _category(support), soft and is_seat(label)
        carrying = is_seat(label) or carries_things(category, kind_of(category, 0.0))
        if is_piece(thing) and (is_seat(label) or is_lounge(label)):
            return math.inf
        if not carrying or (right - left < _LEAST_WIDE * (x1 - x0) and not draped):
            return math.inf
        first, last = (top, bottom) if draped else face_rows(view, things, index)
        over = max(0.0, min(x1, right) - max(x0, left)) * max(0.0, min(y1, bottom) - max(y0, top)) / thing.area_px
        cost += _OUTSIDE * (1.0 - over) + _AREA * max(0.0, math.log(support.area_px / thing.area_px))
        for_people = is_seat(label) or is_lounge(label)
        cost += (_ON_SEAT if is_seat(label) and not soft else _UNUSUAL) * (for_people is not soft)
        cost += _UNUSUAL * (is_hot(label) and not is_cookware(thing.label))
        is_boarded = has_boards(category)
        cost += _size_cost(view, thing, top_m(support)) if not is_boarded else 0.0
        if is_boarded:
            cost -= _IN_BOARDS * (over > _WITHIN)
            if bottom - top > COMPARTMENTS * (right - left):
                # What is in a compartment is between its sides; on a single board it may reach beyond the end.
                cost += _OVERHANG * max(0.0, x1 - right, left - x0) / (x1 - x0)
            last = bottom
        if bound and not first + _INTO * (last - first) < y1 < last:
            return math.inf
    elif _is_on(thing, support, _INTO):
        first, last = top, bottom
        # Of a plate in a sink, what is on the plate.
        cost = _ON_ITEM + _NESTED * max(0.0, math.log(support.area_px / thing.area_px))
    elif _is_on(thing, support, -_INTO):
        first, last, cost = top - _INTO * (bottom - top), bottom, _MAYBE_ON_ITEM
    else:
        return math.inf
    middle = (x0 + x1) / 2
    aside, off = max(left - middle, middle - right, 0.0), max(first - y1, y1 - last, 0.0)
    if bound and aside > 0.0:
        return math.inf
    # The front edge of a top is a guess by its kind.
    front = 0.5 * (off / side / _OFF_SHARE) ** 2
    front = min(front, _FRONT) if last < y1 < bottom else front
    return cost + front + 0.5 * (aside / side / _OFF_SHARE) ** 2


def _size_cost(view: Observation, thing: Detection, height_m: float) -> float:
    """Return the cost of a thing's size where its box ends at a height; 0 where its name tells none."""
    usual_m = longest_m(thing)
    foot = foot_of(view, thing.box_px, height_m)
    if usual_m is None or foot is None:
        return 0.0 if usual_m is None else _SIZE_MOST
    x0, y0, x1, y1 = thing.box_px
    down_m = float(view.eye_m[2]) - height_m
    away_m = math.hypot(float(np.hypot(*foot)), down_m)
    off = math.log(max(x1 - x0, y1 - y0) / view.K.fx * away_m / usual_m)
    # What lies along the view is seen shortened.
    return min(0.5 * ((off if off > 0.0 else 0.5 * off) / _SIZE_SPREAD) ** 2, _SIZE_MOST)


def longest_m(thing: Detection) -> float | None:
    """Return the usual longest side of a thing; None where its name tells none."""
    entries = [entry for entry in named_models(thing) if entry.model in LIBRARY]
    named_m = usual_length_m(thing.label)
    return named_m if named_m is not None or not entries else max(max(usual_size_m(entry)) for entry in entries)


def _is_on(thing: Detection, item: Detection, into: float) -> bool:
    """Return whether a thing is on an item: its box ends well within that of one that usually carries others.

    What stands behind an item of some height ends at that one's outline, and what stands before it ends below it.
    Whatever is all between these is on it, and so is what stands out above another thing of its own name.

    Args:
        thing, item: The two.
        into: Share of the item's box, below its upper edge, from where on a thing's end is within it.
    """
    (x0, y0, x1, y1), (left, top, right, bottom) = thing.box_px, item.box_px
    aside, down = ((x0 + x1 - left - right) / (right - left), (2 * y1 - top - bottom) / (bottom - top))
    ends_in_it = math.hypot(aside, max(down, -1.0 + 2 * _INTO)) < 1.0 and down > 2 * into - 1.0
    over, above = (min(x1, right) - max(x0, left)) / (x1 - x0), (top - y0) / (bottom - top)
    wide = (x1 - x0) / (right - left)
    if not ends_in_it or is_open(item.label) or wide > (_WIDE if above > _UPRIGHT_ABOVE else _NARROW):
        return False
    upright = over > _UPRIGHT_OVER and above > _UPRIGHT_ABOVE and abs(aside) < _UPRIGHT_ASIDE
    between = upright and abs(down) < _BETWEEN
    alike = upright and thing.label == item.label and not is_soft(item.label) and wide > 1.0 / _NARROW
    return between or alike or carries(item.label) or is_hollow(item.label) or is_mostly_open(item.label)


def is_beyond_kind(view: Observation, thing: Detection) -> bool:
    """Return whether a thing that ends where its box does would be far too large on the floor."""
    x0, y0, x1, y1 = thing.box_px
    if y1 > _cut_px(view):
        return False
    foot = foot_of(view, thing.box_px, 0.0)
    if foot is None:
        return True
    scale = float(np.hypot(*foot)) / view.K.fy
    entries = named_models(thing)
    most_m = max(entry.height.high for entry in entries)
    wide_m = max(largest_m(entry)[side] for entry in entries for side in (0, 1))
    return (y1 - y0) * scale > _TALLER * most_m or (x1 - x0) * scale > _TALLER * wide_m


def _cut_px(view: Observation) -> float:
    return (1.0 - BORDER_SHARE) * view.size_px[1]
