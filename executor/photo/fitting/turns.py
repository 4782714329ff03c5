"""A box that was found, as the box of other models, turned otherwise, and of other sizes.

What a search learns of a thing's sides holds for whatever it is and whichever side is its front, but for what stands
out in front: handles belong to the box, so that the panels of a front are behind the box's face.

What has no sides and an ear, such as a mug, is turned as its ear is seen, and where that is hidden, between all turns
that hide it. Of a mug's pixels few are of the ear, and where the body is a little too large or too near, its outline
costs as much as the ear does. So a search for turns is one for the body as well, begun again from other sizes as long
as that gains.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.body import Guess, Size, body_middle_m, body_of, has_ear, is_round
from executor.photo.fitting.descent import descended, near_corner
from executor.photo.fitting.likelihood import Likelihood, RatedGuess, by_cost
from executor.photo.fitting.options import shape_of
from oag import Kind, kind_of

_LOOKED = np.linspace(-0.4, 0.4, 7)  # Shares of width and height at which a front is looked at.

_SIDES_M = (-0.35, -0.2, -0.1, -0.05, 0.05, 0.1, 0.2, 0.35)  # By which sides are moved that may have been misjudged.
_LEAST_M = 0.2  # Of a side that is.

_HEIGHTS, _DISTANCES = (0.88, 0.92, 0.96, 1.04, 1.08, 1.12), (0.91, 0.94, 0.97, 1.03, 1.06, 1.09)
"""Shares of furniture's height, and by sight of how far off it is, that are tried before it is polished."""

_ITEM_HEIGHTS = (0.7, 0.85, 1.2, 1.4)  # Shares of an item's height that are tried by sight.
_EAR_TURNS = 24  # Of the circle, in which an ear is looked for.
_ALIKE = 6.0  # So much more in cost makes a turn e times less likely.
_FIRST, _SECOND = 8, 4  # Turns that are followed, and once more with the body that was found so.
_RENDERINGS, _FINELY = 120, 0.5
_ROUNDS, _GAINED = 3, 1.0
_SCALES = (0.94, 1.06)

_SAME_M, _ASKEW_RAD = 0.02, math.radians(2.0)  # About what the noise of depths does to sides and turns.
_MOST_ASKEW_RAD = math.radians(20.0)  # What is farther off stands as it does on purpose.


def all_turns(found: Guess, entries: Sequence[ModelEntry]) -> Iterator[Guess]:
    """Yields a guess's box as that of every model, turned four ways where turns can be told apart.

    Args:
        found: Whose sides are about right.
        entries: The models.
    """
    panels = _pushed(found, _inset_m(found))
    for entry in entries:
        for quarter in range(1 if is_round(entry) else 4):
            length, width, height = panels.size_m
            size = (width, length, height) if quarter % 2 else (length, width, height)
            if has_ear(entry):
                # The box was one's without an ear, or its ear lay otherwise.
                round_m = min(length, width)
                size = entry.length.clipped(length, round_m), round_m, height
            bare = replace(
                panels, entry=entry, parameters=(), size_m=size, yaw_rad=panels.yaw_rad + quarter * math.pi / 2
            )
            yield _pushed(bare, -_inset_m(bare))


def boxes_beside(found: Guess, headings_rad: Iterable[float]) -> Iterator[Guess]:
    """Yields a guess, and other boxes that it may be of: turned as what is beside it is, with other sides, or both.

    Args:
        found: The guess.
        headings_rad: Of what is beside it, each up to quarter turns.
    """
    for turned in (found, *_straightened(found, headings_rad)):
        yield turned
        yield from _reshaped(turned)


def with_other_heights(found: Guess) -> Iterator[Guess]:
    """Yields a piece of furniture that is a little higher or lower."""
    length, width, height = found.size_m
    for share in _HEIGHTS:
        yield replace(found, size_m=(length, width, round(share * height, 4)))


def at_other_distances(found: Guess, eye_m: Array) -> Iterator[Guess]:
    """Yields a piece as much farther off as larger: where its foot is hidden, its top looks the same.

    Args:
        found: The guess.
        eye_m: (3,) the camera.
    """
    length, width, height = found.size_m
    for share in _DISTANCES:
        top_m = float(eye_m[2]) - share * (float(eye_m[2]) - found.bottom_m - height)
        size = round(share * length, 4), round(share * width, 4), round(top_m - found.bottom_m, 4)
        yield replace(found, x_m=share * found.x_m, y_m=share * found.y_m, size_m=size)


def flatter_and_higher(found: Guess, eye_m: Array) -> Iterator[Guess]:
    """Yields an item of other heights, where it is and where its top looks the same.

    Args:
        found: The guess.
        eye_m: (3,) the camera.
    """
    length, width, height = found.size_m
    above_m = float(eye_m[2]) - found.bottom_m
    for other in (round(share * height, 4) for share in _ITEM_HEIGHTS):
        nearer = 1.0 - (other - height) / above_m if above_m > other else 1.0
        for share in (1.0, nearer):
            yield replace(found, x_m=share * found.x_m, y_m=share * found.y_m, size_m=(length, width, other))


def _reshaped(found: Guess) -> Iterator[Guess]:
    """With one of its upright sides farther out or farther in, the side behind it where it is."""
    c, s = math.cos(found.yaw_rad), math.sin(found.yaw_rad)
    for axis, side, by_m in itertools.product(range(2), (-0.5, 0.5), _SIDES_M):
        length, width, height = (own + by_m * (index == axis) for index, own in enumerate(found.size_m))
        x, y = (side * by_m * (index == axis) for index in range(2))
        if min(length, width) > _LEAST_M:
            at = found.x_m + c * x - s * y, found.y_m + s * x + c * y
            yield replace(found, x_m=at[0], y_m=at[1], size_m=(length, width, height))


def _straightened(found: Guess, headings_rad: Iterable[float]) -> Iterator[Guess]:
    """Where it is a little askew, turned as something beside it is, its near corner held."""
    turned: list[float] = []
    size, held = found.size_m[:2], near_corner(found)
    for heading in headings_rad:
        by_rad = math.remainder(heading - found.yaw_rad, math.pi / 2)
        if _ASKEW_RAD < abs(by_rad) < _MOST_ASKEW_RAD and all(abs(by_rad - one) > _ASKEW_RAD for one in turned):
            turned.append(by_rad)
            x, y = held(found.yaw_rad, *size) - held(found.yaw_rad + by_rad, *size) + [found.x_m, found.y_m]
            yield replace(found, x_m=float(x), y_m=float(y), yaw_rad=found.yaw_rad + by_rad)


def quarter_of(guess: Guess) -> int:
    """Returns which quarter of the circle its heading is in, for telling turns apart."""
    return round(guess.yaw_rad / (math.pi / 2)) % 4


def is_same_box(first: Guess, second: Guess) -> bool:
    """Decides whether two guesses are of one box but for a centimetre or two, whichever of its sides is the front."""
    turned = first.yaw_rad - second.yaw_rad
    length, width = second.size_m[:2] if abs(math.cos(turned)) > math.sqrt(0.5) else second.size_m[1::-1]
    sizes_m = np.subtract(first.size_m, (length, width, second.size_m[2]))
    apart_m = np.subtract((first.x_m, first.y_m, first.bottom_m), (second.x_m, second.y_m, second.bottom_m))
    askew = abs(math.remainder(turned, math.pi / 2)) > _ASKEW_RAD
    return not askew and bool(np.abs(sizes_m).max() < _SAME_M and np.abs(apart_m).max() < _SAME_M)


def is_alike(first: Guess, second: Guess) -> bool:
    """Decides whether a search that begins at one of two guesses most likely ends where one from the other does."""
    one, other = ((guess.entry.model, quarter_of(guess), shape_of(guess)) for guess in (first, second))
    return one == other and is_same_box(first, second)


def distinct(boxes: Sequence[RatedGuess]) -> list[RatedGuess]:
    """Returns those that are another box than all before them: the same sides are found for several models."""
    found: list[RatedGuess] = []
    for one in boxes:
        if not any(is_same_box(one.guess, other.guess) for other in found):
            found.append(one)
    return found


def cheapest_turns(guesses: Iterable[RatedGuess]) -> list[RatedGuess]:
    """Returns the cheapest guess of each model, quarter that it may be turned by and height, the cheapest first."""
    best: dict[tuple[str, int, float], RatedGuess] = {}
    for one in by_cost(guesses):
        if math.isfinite(one.cost):
            best.setdefault((one.guess.entry.model, quarter_of(one.guess), one.guess.bottom_m), one)
    return list(best.values())


def cheapest_openings(guesses: Iterable[RatedGuess]) -> list[RatedGuess]:
    """Returns the cheapest guess of each model, hinge side, and way that it stands open, the cheapest first."""
    best: dict[tuple[object, ...], RatedGuess] = {}
    for one in by_cost(guesses):
        told = dict(one.guess.parameters)
        if math.isfinite(one.cost):
            best.setdefault((one.guess.entry.model, told.get("hinge"), told.get("open_fraction")), one)
    return list(best.values())


def turned_by_ear(fine: Likelihood, found: RatedGuess) -> RatedGuess:
    """Returns a thing turned as its ear is seen; as far between all turns that hide it as they are alike.

    Args:
        fine: What guesses are judged by, with all pixels.
        found: The thing, turned somehow.
    """
    best = _cheapest(fine, found, _likeliest(fine, found, _FIRST), reach=1.0)
    for _ in range(_ROUNDS):
        before = best
        # Another body may make another turn the likeliest.
        best = _cheapest(fine, best, _likeliest(fine, best, _SECOND), reach=_FINELY)
        best = _cheapest(fine, best, _resized(best.guess), reach=_FINELY)
        if before.cost - best.cost < _GAINED:
            break
    turns = _all_around(fine, best)
    likely = np.array([math.exp(min(0.0, (best.cost - one.cost) / _ALIKE)) for one in turns])
    yaws = np.array([one.guess.yaw_rad for one in turns])
    # Of what is seen clearly, hardly any other turn counts, and the mean is where it was.
    mean_rad = math.atan2(float(likely @ np.sin(yaws)), float(likely @ np.cos(yaws)))
    middle = fine.rated(_with_body_kept(best.guess, mean_rad, best.guess.size_m))
    return middle if middle.cost < best.cost + _ALIKE else best


def _pushed(guess: Guess, by_m: float) -> Guess:
    """With its front moved backwards, its back where it is."""
    length, width, height = guess.size_m
    c, s = math.cos(guess.yaw_rad), math.sin(guess.yaw_rad)
    size = max(length - by_m, length / 2), width, height
    return replace(guess, x_m=guess.x_m + c * by_m / 2, y_m=guess.y_m + s * by_m / 2, size_m=size)


def _inset_m(guess: Guess) -> float:
    """How far the panels of a front are behind the face of its box."""
    body = body_of(guess) if kind_of(guess.entry.category, guess.size_m[1]) is Kind.ARTICULATED else None
    if body is None:
        return 0.0
    length, width, height = guess.size_m
    still = replace(guess, x_m=0.0, y_m=0.0, yaw_rad=0.0, bottom_m=-height / 2)
    across, up = np.meshgrid(_LOOKED * width, _LOOKED * height)
    before = 2.0 * length
    targets = np.stack([np.zeros(across.size), across.ravel(), up.ravel()], axis=1)
    # Rays from far away are as good as parallel ones.
    eye = np.array([-before * 100.0, 0.0, 0.0])
    rays = targets + [-length / 2, 0.0, 0.0] - eye
    share = body.depth(still, eye, rays)
    hit_x = eye[0] + rays[:, 0] * share
    hits = hit_x[np.isfinite(hit_x)]
    return float(np.clip(np.median(hits) + length / 2, 0.0, length / 4)) if len(hits) else 0.0


def _cheapest(fine: Likelihood, found: RatedGuess, begun: Iterable[Guess], reach: float) -> RatedGuess:
    """The cheapest of what was found and where searches end that begin at some guesses."""
    ended = (fine.rated(descended(fine, guess, _RENDERINGS, colours=True, reach=reach)) for guess in begun)
    return min([found, *ended], key=lambda one: one.cost)


def _likeliest(fine: Likelihood, found: RatedGuess, count: int) -> list[Guess]:
    turns = sorted(_all_around(fine, found), key=lambda one: one.cost)
    return [one.guess for one in turns[:count]]


def _all_around(fine: Likelihood, found: RatedGuess) -> list[RatedGuess]:
    """The thing and its other turns."""
    guess = found.guess
    turns = (guess.yaw_rad + turn * 2.0 * math.pi / _EAR_TURNS for turn in range(1, _EAR_TURNS))
    return [found, *(fine.rated(_with_body_kept(guess, yaw_rad, guess.size_m)) for yaw_rad in turns)]


def _resized(guess: Guess) -> Iterator[Guess]:
    """Yields it larger and smaller, and with the shortest and the longest ear."""
    length, width, height = guess.size_m
    sizes = [(scale * length, scale * width, scale * height) for scale in _SCALES]
    sizes += [(share * width, width, height) for share in (guess.entry.length.low, guess.entry.length.high)]
    for length, width, height in sizes:
        again = _with_body_kept(guess, guess.yaw_rad, (round(length, 4), round(width, 4), round(height, 4)))
        if body_of(again) is not None:
            yield again


def _with_body_kept(guess: Guess, yaw_rad: float, size_m: Size) -> Guess:
    """Turned, and of another size, with the middle of its body where it is."""
    before = body_middle_m(guess.yaw_rad, *guess.size_m[:2])
    x, y = before - body_middle_m(yaw_rad, *size_m[:2]) + [guess.x_m, guess.y_m]
    return replace(guess, x_m=float(x), y_m=float(y), yaw_rad=math.remainder(yaw_rad, 2.0 * math.pi), size_m=size_m)
