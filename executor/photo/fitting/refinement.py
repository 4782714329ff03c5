"""Local search: pose and size by Nelder-Mead, model options, orientations.

The sides of a box hold for every model and whichever side is the front, except for protruding handles. Handles belong
to the box, so that the panels of a front are behind the box's face.

An object that is round except for an ear, such as a mug, is turned as its visible ear is. If the ear is hidden, it gets
the mean of all orientations that hide it. Few pixels of a mug are of its ear: a body slightly too large or too near
costs as much as the ear does. So the search for orientations also searches for the body, and restarts from other sizes
while that gains.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.optimize import minimize

from executor.assets.library import LIBRARY, asset_for
from executor.assets.parameters import ChoiceParameter, ModelEntry, NumericParameter
from executor.geometry import Array, rotation_z, wrap_angle
from executor.photo.fitting.hypothesis import (
    PoseHypothesis,
    Size,
    body_middle_m,
    has_ear,
    is_round,
    largest_m,
    raycaster_of,
)
from executor.photo.fitting.likelihood import Likelihood, RatedHypothesis, by_cost
from oag.model.symbols import Kind, kind_of

_FURNITURE_STEP = np.array([0.05, 0.05, 0.06, 0.05, 0.05, 0.03])
_ITEM_STEP = np.array([0.012, 0.012, 0.3, 0.010, 0.008, 0.010])
_HIGHEST = 1e6  # Cost of impossible hypotheses: the search compares finite numbers.


def refine_nelder_mead(
    likelihood: Likelihood, guess: PoseHypothesis, renderings: int, *, colours: bool, reach: float = 1.0
) -> PoseHypothesis:
    """Refine a hypothesis by Nelder-Mead. The point nearest to the camera is moved.

    Hidden sides are the far ones: with the near corner held, a longer side changes nothing visible. For a round object
    with an ear it is the near point of the body, so that the body stays while the ear turns.

    Args:
        likelihood: The objective.
        guess: The start.
        renderings: Maximum number of evaluations.
        colours: Whether colours are evaluated.
        reach: Scale of the first steps; 1 for a rough start.
    """
    body = raycaster_of(guess)
    if body is None:
        return guess
    entry = guess.entry
    is_item = kind_of(entry.category, guess.size_m[1]) is Kind.ITEM
    scale = (_ITEM_STEP if is_item else _FURNITURE_STEP) / 2
    turns = not body.symmetric and not is_round(entry)
    active = np.flatnonzero([True, True, turns, not _fixed(entry, 0), True, not _fixed(entry, 2)])
    held = _near_point_of_body(guess) if has_ear(entry) else near_corner(guess)
    start = np.array([*(held(guess.yaw_rad, *guess.size_m[:2]) + [guess.x_m, guess.y_m]), guess.yaw_rad, *guess.size_m])

    def at(values: Array) -> PoseHypothesis:
        full = start.copy()
        full[active] = start[active] + values * scale[active]
        width = full[4]
        length = width * entry.length.low if _fixed(entry, 0) else full[3]
        height = width * entry.height.low if _fixed(entry, 2) else full[5]
        x, y = full[:2] - held(full[2], length, width)
        size = float(length), float(width), float(height)
        return replace(guess, x_m=float(x), y_m=float(y), yaw_rad=float(wrap_angle(full[2])), size_m=size)

    def cost(values: Array) -> float:
        return min(likelihood.cost(at(values), body, colours=colours), _HIGHEST)

    simplex = np.vstack([np.zeros(len(active)), 2.0 * reach * np.eye(len(active))])
    options = {"initial_simplex": simplex, "maxfev": renderings, "xatol": 0.01, "fatol": 0.01}
    best = at(minimize(cost, np.zeros(len(active)), method="Nelder-Mead", options=options).x)
    best = replace(best, size_m=(round(best.size_m[0], 4), round(best.size_m[1], 4), round(best.size_m[2], 4)))
    # A hypothesis that was scaled during the search may be too flat to be built.
    return best if raycaster_of(best) is not None else guess


Held = Callable[[float, float, float], Array]
"""Heading, length and width -> (2,) offset of the held point from the middle of the box."""


def near_corner(guess: PoseHypothesis) -> Held:
    """Return the position of the box corner nearest to the camera as a function of heading and sides."""
    sign = np.where(rotation_z(-guess.yaw_rad)[:2, :2] @ [guess.x_m, guess.y_m] < 0.0, 0.5, -0.5)
    return lambda yaw_rad, length, width: rotation_z(yaw_rad)[:2, :2] @ (sign * [length, width])


def _near_point_of_body(guess: PoseHypothesis) -> Held:
    towards = -np.array([guess.x_m, guess.y_m]) / max(math.hypot(guess.x_m, guess.y_m), 1e-9)
    return lambda yaw_rad, length, width: body_middle_m(yaw_rad, length, width) + towards * width / 2


def _fixed(entry: ModelEntry, axis: int) -> bool:
    span = entry.length if axis == 0 else entry.height
    return span.of_width and span.low == span.high


_SHAPING = ("hinge", "drawers", "drawer_side", "below", "boards")
_INSIDE = ("shelves", "racks")  # Visible through an open door.
_DETAILS = ("handle_height_m", "handle_length_m", "lean")
_DETAIL_SHARES = (0.1, 0.35, 0.65, 0.9)  # Of a detail's range.
_DETAIL_STEPS = (0.12, 0.06)
_OPEN = "open_fraction"
_OPENED = (0.0, 0.25, 0.5, 0.75, 1.0)
_OPENED_STEPS = (0.12, 0.06, 0.03)


def with_options(likelihood: Likelihood, guess: PoseHypothesis) -> RatedHypothesis:
    """Choose the options of a hypothesis that explain depth and colours best."""
    best = min((likelihood.rated(one) for one in shapes(guess)), key=lambda one: one.cost)
    if kind_of(guess.entry.category, guess.size_m[1]) is Kind.ARTICULATED:
        for fraction in _OPENED:
            best = likelihood.better(best, best.guess.with_parameters(**{_OPEN: fraction}))
        now = _opened(best.guess)
        for step in _OPENED_STEPS if now > 0.0 else ():
            for sign in (-step, step):
                at = round(min(max(now + sign, 0.0), 1.0), 3)
                best = likelihood.better(best, best.guess.with_parameters(**{_OPEN: at}))
            now = _opened(best.guess)
        if now > 0.0:
            # A door that stands open shows on which side it hangs.
            for one in shapes(best.guess):
                best = likelihood.better(best, one)
    return _detailed(likelihood, best, colours=True)


def refit_handles(likelihood: Likelihood, best: RatedHypothesis) -> RatedHypothesis:
    """Search handle positions and lengths together, with decreasing steps.

    A long handle that is too high may cost as much as a short one that is too low; changing one of the two gains
    nothing.
    """
    known = [one for one in best.guess.entry.parameters if isinstance(one, NumericParameter) and one.name in _DETAILS]
    if not known:
        return best
    for shape in shapes(best.guess):
        for shares in itertools.product(_DETAIL_SHARES, repeat=len(known)):
            best = likelihood.better(best, _detailed_by(shape, known, shares))
    for step in _DETAIL_STEPS:
        now = [
            (float(str(dict(best.guess.parameters).get(one.name, one.default))) - one.low) / (one.high - one.low)
            for one in known
        ]
        for signs in itertools.product((-1, 0, 1), repeat=len(known)):
            shares = tuple(min(max(share + step * sign, 0.0), 1.0) for share, sign in zip(now, signs, strict=True))
            best = likelihood.better(best, _detailed_by(best.guess, known, shares))
    return best


def _detailed_by(guess: PoseHypothesis, details: Sequence[NumericParameter], shares: Sequence[float]) -> PoseHypothesis:
    """Set every detail to a share of its range."""
    values = {
        one.name: round(one.low + share * (one.high - one.low), 3) for one, share in zip(details, shares, strict=True)
    }
    return guess.with_parameters(**values)


def fit_handles(likelihood: Likelihood, guess: PoseHypothesis) -> PoseHypothesis:
    """Place handles where depth has them, so that a search does not shrink the object because of wrong ones."""
    best = min((likelihood.rated(one, colours=False) for one in shapes(guess)), key=lambda one: one.cost)
    return _detailed(likelihood, best, colours=False).guess


def shapes(guess: PoseHypothesis) -> Iterator[PoseHypothesis]:
    """Yield every combination of the discrete options of a model."""
    choices: list[list[tuple[str, object]]] = []
    for parameter in guess.entry.parameters:
        if parameter.name not in _SHAPING and not (parameter.name in _INSIDE and _opened(guess) > 0.0):
            continue
        if isinstance(parameter, ChoiceParameter):
            choices.append([(parameter.name, word) for word in parameter.words])
        else:
            choices.append([(parameter.name, n) for n in range(round(parameter.low), round(parameter.high) + 1)])
    for combination in itertools.product(*choices):
        yield guess.with_parameters(**dict(combination))


def with_parts(entries: Sequence[ModelEntry], doors: int | None, drawers: int | None) -> list[ModelEntry]:
    """Return the models that can have so many doors and drawers; all of them if none can.

    Args:
        entries: The models.
        doors, drawers: How many; None if unknown.
    """
    if doors is None and drawers is None:
        return list(entries)
    matching = [
        entry
        for entry in entries
        if any((doors is None or doors == a) and (drawers is None or drawers == b) for a, b in _parts(entry.model))
    ]
    return matching or list(entries)


@cache
def _parts(model: str) -> frozenset[tuple[int, int]]:
    """Return the possible numbers of doors and drawers of a model."""
    entry = LIBRARY[model]
    counts = set()
    for guess in shapes(PoseHypothesis(entry, 0.0, 0.0, 0.0, 0.0, largest_m(entry))):
        kinds = [joint.kind for joint in asset_for(guess.as_object()).joints]
        counts.add((kinds.count("revolute"), kinds.count("prismatic")))
    return frozenset(counts)


def _detailed(likelihood: Likelihood, best: RatedHypothesis, *, colours: bool) -> RatedHypothesis:
    for parameter in best.guess.entry.parameters:
        if isinstance(parameter, NumericParameter) and parameter.name in _DETAILS:
            for share in _DETAIL_SHARES:
                value = round(parameter.low + share * (parameter.high - parameter.low), 3)
                best = likelihood.better(best, best.guess.with_parameters(**{parameter.name: value}), colours=colours)
    return best


def _opened(guess: PoseHypothesis) -> float:
    return float(str(dict(guess.parameters).get(_OPEN, 0.0)))


_LOOKED = np.linspace(-0.4, 0.4, 7)  # Shares of width and height at which a front is looked at.

_HEIGHTS = (0.88, 0.92, 0.96, 1.04, 1.08, 1.12)  # Shares of furniture's height that are tried before polishing.
_EAR_TURNS = 24  # Of the circle, in which an ear is looked for.
_ALIKE = 6.0  # Extra cost that makes an orientation e times less likely.
_FIRST, _SECOND = 4, 2  # Turns that are followed, and once more with the body that was found so.
_RENDERINGS, _FINELY = 120, 0.5
_ROUNDS, _GAINED = 2, 1.0
_SCALES = (0.94, 1.06)

_SAME_M, _ASKEW_RAD = 0.02, math.radians(2.0)  # Effect of depth noise on sides and headings.


def all_turns(found: PoseHypothesis, entries: Sequence[ModelEntry]) -> Iterator[PoseHypothesis]:
    """Yield a hypothesis's box as that of every model, in four orientations where they differ.

    Args:
        found: The hypothesis, whose sides are about right.
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


def with_other_heights(found: PoseHypothesis) -> Iterator[PoseHypothesis]:
    """Yield furniture of slightly different heights."""
    length, width, height = found.size_m
    for share in _HEIGHTS:
        yield replace(found, size_m=(length, width, round(share * height, 4)))


def quarter_of(guess: PoseHypothesis) -> int:
    """Return the quarter of the circle of its heading, to tell orientations apart."""
    return round(guess.yaw_rad / (math.pi / 2)) % 4


def is_same_box(first: PoseHypothesis, second: PoseHypothesis) -> bool:
    """Return whether two hypotheses have the same box within two centimetres, whichever side is the front."""
    turned = first.yaw_rad - second.yaw_rad
    length, width = second.size_m[:2] if abs(math.cos(turned)) > math.sqrt(0.5) else second.size_m[1::-1]
    sizes_m = np.subtract(first.size_m, (length, width, second.size_m[2]))
    apart_m = np.subtract((first.x_m, first.y_m, first.bottom_m), (second.x_m, second.y_m, second.bottom_m))
    askew = abs(math.remainder(turned, math.pi / 2)) > _ASKEW_RAD
    return not askew and bool(np.abs(sizes_m).max() < _SAME_M and np.abs(apart_m).max() < _SAME_M)


def distinct(boxes: Sequence[RatedHypothesis]) -> list[RatedHypothesis]:
    """Drop hypotheses whose box occurs before: several models find the same sides."""
    found: list[RatedHypothesis] = []
    for one in boxes:
        if not any(is_same_box(one.guess, other.guess) for other in found):
            found.append(one)
    return found


def cheapest_turns(guesses: Iterable[RatedHypothesis]) -> list[RatedHypothesis]:
    """Return the cheapest hypothesis of each model, quarter turn and height, cheapest first."""
    best: dict[tuple[str, int, float], RatedHypothesis] = {}
    for one in by_cost(guesses):
        if math.isfinite(one.cost):
            best.setdefault((one.guess.entry.model, quarter_of(one.guess), one.guess.bottom_m), one)
    return list(best.values())


def cheapest_openings(guesses: Iterable[RatedHypothesis]) -> list[RatedHypothesis]:
    """Return the cheapest hypothesis of each model, hinge side and opening, cheapest first."""
    best: dict[tuple[object, ...], RatedHypothesis] = {}
    for one in by_cost(guesses):
        chosen = dict(one.guess.parameters)
        if math.isfinite(one.cost):
            best.setdefault((one.guess.entry.model, chosen.get("hinge"), chosen.get("open_fraction")), one)
    return list(best.values())


def orient_by_ear(fine: Likelihood, found: RatedHypothesis) -> RatedHypothesis:
    """Orient an object by its visible ear; if it is hidden, by the weighted mean of the orientations that hide it.

    Args:
        fine: The likelihood with all pixels.
        found: The object in any orientation.
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
    # For a clearly visible ear other orientations hardly count, and the mean stays.
    mean_rad = math.atan2(float(likely @ np.sin(yaws)), float(likely @ np.cos(yaws)))
    middle = fine.rated(_with_body_kept(best.guess, mean_rad, best.guess.size_m))
    return middle if middle.cost < best.cost + _ALIKE else best


def _pushed(guess: PoseHypothesis, by_m: float) -> PoseHypothesis:
    """Move the front backwards, with the back held."""
    length, width, height = guess.size_m
    c, s = math.cos(guess.yaw_rad), math.sin(guess.yaw_rad)
    size = max(length - by_m, length / 2), width, height
    return replace(guess, x_m=guess.x_m + c * by_m / 2, y_m=guess.y_m + s * by_m / 2, size_m=size)


def _inset_m(guess: PoseHypothesis) -> float:
    """Return how far the panels of a front are behind the face of its box."""
    body = raycaster_of(guess) if kind_of(guess.entry.category, guess.size_m[1]) is Kind.ARTICULATED else None
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


def _cheapest(
    fine: Likelihood, found: RatedHypothesis, begun: Iterable[PoseHypothesis], reach: float
) -> RatedHypothesis:
    """Return the cheapest of a hypothesis and the ends of searches from some starts."""
    ended = (fine.rated(refine_nelder_mead(fine, guess, _RENDERINGS, colours=True, reach=reach)) for guess in begun)
    return min([found, *ended], key=lambda one: one.cost)


def _likeliest(fine: Likelihood, found: RatedHypothesis, count: int) -> list[PoseHypothesis]:
    turns = sorted(_all_around(fine, found), key=lambda one: one.cost)
    return [one.guess for one in turns[:count]]


def _all_around(fine: Likelihood, found: RatedHypothesis) -> list[RatedHypothesis]:
    """Return the object and its other orientations."""
    guess = found.guess
    turns = (guess.yaw_rad + turn * 2.0 * math.pi / _EAR_TURNS for turn in range(1, _EAR_TURNS))
    return [found, *(fine.rated(_with_body_kept(guess, yaw_rad, guess.size_m)) for yaw_rad in turns)]


def _resized(guess: PoseHypothesis) -> Iterator[PoseHypothesis]:
    """Yield the object larger and smaller, and with the shortest and the longest ear."""
    length, width, height = guess.size_m
    sizes = [(scale * length, scale * width, scale * height) for scale in _SCALES]
    sizes += [(share * width, width, height) for share in (guess.entry.length.low, guess.entry.length.high)]
    for length, width, height in sizes:
        again = _with_body_kept(guess, guess.yaw_rad, (round(length, 4), round(width, 4), round(height, 4)))
        if raycaster_of(again) is not None:
            yield again


def _with_body_kept(guess: PoseHypothesis, yaw_rad: float, size_m: Size) -> PoseHypothesis:
    """Change yaw and size with the middle of the body held."""
    before = body_middle_m(guess.yaw_rad, *guess.size_m[:2])
    x, y = before - body_middle_m(yaw_rad, *size_m[:2]) + [guess.x_m, guess.y_m]
    return replace(guess, x_m=float(x), y_m=float(y), yaw_rad=math.remainder(yaw_rad, 2.0 * math.pi), size_m=size_m)
