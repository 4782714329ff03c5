"""Fit one detection: every model, many starts, few of them refined to the end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.evidence import PixelEvidence, median_colour, with_colour
from executor.photo.fitting.hypothesis import PoseHypothesis, as_built, has_ear, raycaster_of
from executor.photo.fitting.likelihood import (
    MOST_M,
    Fit,
    Likelihood,
    RatedHypothesis,
    SearchContext,
    best_of_models,
    by_cost,
    spreads_m,
)
from executor.photo.fitting.refinement import (
    all_turns,
    cheapest_turns,
    distinct,
    fit_handles,
    orient_by_ear,
    refine_nelder_mead,
    refit_handles,
    with_options,
    with_other_heights,
)
from executor.photo.fitting.starts import likely_boxes, starts_of
from executor.photo.geometry.observation import Observation
from executor.photo.geometry.walls import Wall
from oag.model.symbols import Kind, kind_of

COARSE_PX, SEARCH_PX, FINE_PX = 250, 700, 3000
"""Pixels of an object to choose starts, to search, and to choose options."""

_TURNED, _LIKELY = 4, 40  # Boxes that are tried out with every model and turn, and how many of these are looked at.
_OPENED, _FINISHED, _POLISHED = 12, 4, 2  # Guesses whose options are tried, that are searched with colours, and again.
_SECOND, _LAST = 160, 120  # Renderings of a search.
_OF_FEET = 0.1  # Of the points by which starts are chosen.
_ROUNDS, _GAINED = 3, 2.0  # Of polishing, as long as each gains that much.
_WORTH_A_LOOK = 40.0  # Largest extra cost of a rival without own handles and sides.
_WALL_ROUNDS, _LEAST_HUNG_M, _OFF_WALL_M, _LEAST_SLOPE = 4, 0.01, 0.002, 0.05
"""Of a thing on a wall: how often it is fitted to its box again, least side, gap to the wall, least slope of rays."""


def fit_thing(
    around: SearchContext,
    box_px: tuple[float, float, float, float],
    entries: Sequence[ModelEntry],
    bottoms_m: Sequence[float],
    points: Array,
    *,
    rough: bool = False,
) -> Fit | None:
    """Return the best fit of a detection among some models; None if there is no evidence or no place for them.

    Args:
        around: The context.
        box_px: The detection's box.
        entries: Candidate models.
        bottoms_m: Heights that it may stand on.
        points: (N, 3) its own points, at least `LEAST_POINTS`.
        rough: Whether the likeliest start of a search does, which takes a fraction of the time.
    """
    coarse = _likelihood(around, box_px, COARSE_PX)
    if not len(coarse.evidence.z_m):
        return None
    if len(around.feet_m):
        # Its top, which they hide, begins and ends with them.
        often = max(1, int(_OF_FEET * len(points) / len(around.feet_m)))
        points = np.concatenate([points, np.repeat(around.feet_m, often, axis=0)])
    if rough:
        begun = starts_of(around.near, entries, bottoms_m, points)
        likeliest = min((coarse.rated(guess, colours=False) for guess in begun), key=lambda one: one.cost, default=None)
        if likeliest is None or not math.isfinite(likeliest.cost):
            return None
        found = _described(coarse, likeliest, ())
        return None if found is None else replace(found, rough=True)
    search, fine = (_likelihood(around, box_px, most) for most in (SEARCH_PX, FINE_PX))
    boxes = likely_boxes(around.near, entries, bottoms_m, points, coarse, search)
    ranked = _ranked(boxes, entries, (coarse, search, fine))
    if not ranked or not math.isfinite(ranked[0].cost):
        return None
    best, *others = ranked
    if has_ear(best.guess.entry):
        best = orient_by_ear(fine, best)
    return _described(fine, best, others)


def fit_on_wall(
    around: SearchContext,
    box_px: tuple[float, float, float, float],
    entry: ModelEntry,
    wall: Wall,
    deep_m: float,
    assumption: str,
) -> Fit | None:
    """Return a thing with its back on a wall that fills its box, fixed there; None where the box looks beside the wall.

    Args:
        around: The context.
        box_px: The detection's box.
        entry: A box, as a model.
        wall: The upright plane behind it.
        deep_m: How far it stands out.
        assumption: What is assumed, for people.
    """
    view = around.observation
    front = replace(wall, offset_m=wall.offset_m + deep_m)
    wanted = np.array(box_px)
    asked = wanted.copy()
    guess: PoseHypothesis | None = None
    for _ in range(_WALL_ROUNDS):
        corners = [_on_plane(view, pixel, front) for pixel in (asked[:2], asked[2:])]
        if any(corner is None for corner in corners):
            return None
        low, high = np.sort(np.array(corners, dtype=float), axis=0)
        sides = np.maximum(high - low, _LEAST_HUNG_M)
        x, y = ((low[0] + high[0]) / 2) * wall.along + (wall.offset_m + deep_m / 2 + _OFF_WALL_M) * wall.normal
        size = deep_m, float(sides[0]), float(sides[1])
        guess = PoseHypothesis(entry, float(x), float(y), wall.yaw_rad, max(0.0, float(low[1])), size, (), True)
        shown = np.concatenate(view.bounds_px(guess.corners_m()))
        if not np.isfinite(shown).all():
            return None
        # From aside its side is seen too, within the same box.
        asked += wanted - shown
    if guess is None or raycaster_of(guess) is None:
        return None
    evidence = _likelihood(around, box_px, FINE_PX).evidence
    spread_m = max(around.scale_share * math.hypot(guess.x_m, guess.y_m), _LEAST_HUNG_M)
    coloured = with_colour(evidence, as_built(guess)) if len(evidence.z_m) else as_built(guess)
    colour = median_colour(evidence, guess) if len(evidence.z_m) else None
    spreads = spread_m, _LEAST_HUNG_M
    return Fit(coloured, 0.0, (), 1.0, math.inf, 0, colour, spreads, assumed=assumption, hangs=True)


def _on_plane(view: Observation, pixel: Array, plane: Wall) -> tuple[float, float] | None:
    """Return where the ray of a pixel (2,) meets an upright plane: along it and above the floor; None beside it."""
    K = view.K
    ray = view.R_camera_level.T @ np.array([(pixel[0] - K.cx) / K.fx, (pixel[1] - K.cy) / K.fy, 1.0])
    slope = float(ray[:2] @ plane.normal)
    if slope > -_LEAST_SLOPE:
        return None
    t = (plane.offset_m - float(view.eye_m[:2] @ plane.normal)) / slope
    at = view.eye_m + t * ray
    return (float(at[:2] @ plane.along), float(at[2])) if t > 0.0 else None


def update_fit(around: SearchContext, box_px: tuple[float, float, float, float], found: Fit) -> Fit:
    """Update a fit to what is known around it since, if its box shows hardly anything else than before."""
    fine = _likelihood(around, box_px, FINE_PX)
    if not len(fine.evidence.z_m):
        return found  # Nothing is measured there: it was fitted to its box.
    best, *others = by_cost(
        [_polished(fine, fine.rated(found.guess)), *(fine.rated(one.guess) for one in found.alternatives)]
    )
    return _described(fine, best, others) or found


def by_box(
    around: SearchContext,
    box_px: tuple[float, float, float, float],
    guess: PoseHypothesis,
    spread_m: tuple[float, float],
) -> Fit:
    """Return a hypothesis that was fitted to its box alone as a fit, with its colour and the share of the box.

    Args:
        around: The context, without depth.
        box_px: The detection's box.
        guess: The hypothesis, which can be built.
        spread_m: Standard deviations of its place and its worst side, but for the picture's scale.
    """
    evidence, body = _likelihood(around, box_px, FINE_PX).evidence, raycaster_of(guess)
    assert body is not None, "it can be built"
    far_m = math.hypot(spread_m[0], around.scale_share * math.hypot(guess.x_m, guess.y_m))
    return Fit(
        with_colour(evidence, guess),
        0.0,
        (),
        evidence.explained(guess, body),
        math.inf,
        len(evidence.z_m),
        median_colour(evidence, guess),
        (min(MOST_M, far_m), min(MOST_M, spread_m[1])),
    )


def assess_fit(around: SearchContext, box_px: tuple[float, float, float, float], found: Fit, in_box: float) -> Fit:
    """Return a fit with the share that it explains among everything known now.

    Args:
        around: The context.
        box_px: The detection's box.
        found: The fit.
        in_box: IoU of that box with the visible part of the fit.
    """
    evidence, body = _likelihood(around, box_px, FINE_PX).evidence, raycaster_of(found.guess)
    if body is None or not len(evidence.z_m):
        return replace(found, explained=0.0, in_box=in_box)
    explained, residual_m = evidence.explained(found.guess, body), evidence.residual_m(found.guess, body)
    return replace(found, explained=explained, residual_m=residual_m, in_box=in_box)


def _likelihood(around: SearchContext, box_px: tuple[float, float, float, float], most: int) -> Likelihood:
    """Return the likelihood by at most so many pixels."""
    pixels = PixelEvidence.around(
        around.observation, box_px, around.other_m, around.other, most, around.smaller, around.own
    )
    return Likelihood(pixels, around.near, around.scale_share, around.shows_boards, around.feet_m)


def _described(fine: Likelihood, best: RatedHypothesis, others: Sequence[RatedHypothesis]) -> Fit | None:
    """Return a fit with its quality; None if it cannot be built."""
    body = raycaster_of(best.guess)
    if body is None:
        return None
    evidence = fine.evidence
    return Fit(
        with_colour(evidence, as_built(best.guess)),
        best.cost,
        tuple(RatedHypothesis(with_colour(evidence, as_built(one.guess)), one.cost) for one in others),
        evidence.explained(best.guess, body),
        evidence.residual_m(best.guess, body),
        len(evidence.z_m),
        median_colour(evidence, best.guess),
        spreads_m(fine, best.guess),
    )


def _ranked(
    boxes: list[RatedHypothesis],
    entries: Sequence[ModelEntry],
    likelihoods: tuple[Likelihood, Likelihood, Likelihood],
) -> list[RatedHypothesis]:
    """Rank the best of every model and orientation of some boxes, with options and colours."""
    coarse, search, fine = likelihoods
    turned = [
        coarse.rated(guess, colours=False)
        for one in distinct(boxes)[:_TURNED]
        for guess in all_turns(one.guess, entries)
    ]
    likely = [*boxes, *by_cost(turned)[:_LIKELY]]
    found = cheapest_turns(search.rated(fit_handles(search, one.guess)) for one in likely)
    opened = cheapest_turns(with_options(search, one.guess) for one in found[:_OPENED])
    # Every model comes to its end, then other orientations.
    models = best_of_models(opened)
    begun = [*models, *(one for one in opened if all(one is not model for model in models))][:_FINISHED]
    finished = [with_options(fine, refine_nelder_mead(search, one.guess, _SECOND, colours=True)) for one in begun]
    ranked = best_of_models(finished)
    if not ranked:
        return []
    ranked = best_of_models([*(_polished(fine, one) for one in ranked[:_POLISHED]), *ranked[_POLISHED:]])
    rivals = [one.guess.entry for one in ranked[1:] if one.cost < ranked[0].cost + _WORTH_A_LOOK]
    return _compared(ranked, rivals, search, fine)


def _compared(
    ranked: list[RatedHypothesis], rivals: Sequence[ModelEntry], search: Likelihood, fine: Likelihood
) -> list[RatedHypothesis]:
    """Rank the models, each rival also searched for from the best fit's box.

    Ends of searches differ by more than models do.
    """
    best = ranked[0]
    turned = best_of_models(search.rated(fit_handles(search, guess)) for guess in all_turns(best.guess, rivals))
    ended = [
        with_options(fine, refine_nelder_mead(search, one.guess, _SECOND, colours=True, reach=0.5))
        for one in turned[:_OPENED]
    ]
    likely = [one for one in best_of_models(ended) if one.cost < best.cost + _WORTH_A_LOOK / 2]
    return best_of_models([*ranked, *ended, *(_polished(fine, one) for one in likely[:_POLISHED])])


def _polished(fine: Likelihood, best: RatedHypothesis) -> RatedHypothesis:
    """Search on from the end of a search with its options, as long as that gains something.

    Every pixel counts here: distant handles are two pixels thick.
    """
    if kind_of(best.guess.entry.category, best.guess.size_m[1]) is not Kind.ITEM:
        # Thin parts before a wall, such as a headboard, give no gradient to a search.
        others = (fine.rated(one) for one in with_other_heights(best.guess))
        best = min([best, *others], key=lambda one: one.cost)
    for _ in range(_ROUNDS):
        again = refit_handles(
            fine, with_options(fine, refine_nelder_mead(fine, best.guess, _LAST, colours=True, reach=0.5))
        )
        gained = best.cost - again.cost
        best = again if gained > 0.0 else best
        if gained < _GAINED:
            break
    return best
