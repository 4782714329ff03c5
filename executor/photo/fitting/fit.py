"""Fit one detection: every model, many starts, few of them refined to the end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.evidence import PixelEvidence, colour_distance, median_colour, with_colour
from executor.photo.fitting.hypothesis import PoseHypothesis, as_built, has_ear, raycaster_of
from executor.photo.fitting.likelihood import (
    Fit,
    Likelihood,
    RatedHypothesis,
    SearchContext,
    best_of_fits,
    best_of_models,
    by_cost,
    in_rows,
    is_large,
    place_spread_m,
)
from executor.photo.fitting.refinement import (
    all_turns,
    at_other_distances,
    cheapest_turns,
    distinct,
    fit_handles,
    flatter_and_higher,
    is_alike,
    neighbouring_boxes,
    orient_by_ear,
    quarter_of,
    refine_nelder_mead,
    refit_handles,
    shapes,
    with_options,
    with_other_heights,
    with_top_thickness,
)
from executor.photo.fitting.starts import LEAST_POINTS, boxes_of_others, flat_among, likely_boxes, points_of
from oag.model.symbols import Kind, kind_of

COARSE_PX, SEARCH_PX, FINE_PX, SHARP_PX = 250, 700, 5000, 40_000
"""Pixels of an object to choose starts, to search, to choose options, and for the monocular full resolution."""

_TURNED, _LIKELY = 4, 40  # Boxes that are tried out with every model and turn, and how many of these are looked at.
_OPENED, _FINISHED, _POLISHED = 12, 6, 2  # Guesses whose options are tried, that are searched with colours, and again.
_NAMES = 8  # With more categories the object may be anything.
_SECOND, _LAST, _BRIEF = 160, 120, 60  # Renderings of a search.
_THICKER = ((-0.12, 0.12), (-0.06, 0.06))  # Steps from a top's thickness, as shares of its range.
_ROUNDS, _GAINED = 3, 2.0  # Of polishing, as long as each gains that much.
_PERTURBED = 4  # Perturbed starts that are refined.
_WORTH_A_LOOK, _RIVALS = 40.0, 2  # Largest extra cost of a rival without own handles and sides; number of rivals.
MISNAMED = 12.0
"""Cost margin to override a label; prior: 5 % of labels wrong, 40 classes (-> 6.6), rounded up."""

_LOOK = 20.0  # Without a label, a colour off by a third of its light is as unlikely as a wrong label.


def fit_thing(
    around: SearchContext,
    box_px: tuple[float, float, float, float],
    entries: Sequence[ModelEntry],
    bottoms_m: Sequence[float],
    points: Array | None = None,
    *,
    roughly: bool = False,
) -> Fit | None:
    """Return the best fit of a detection among some models; None if nothing of it stands out.

    Args:
        around: The context.
        box_px: The detection's box.
        entries: Candidate models.
        bottoms_m: Heights that it may stand on.
        points: (N, 3) its own points; by default the residual points of its box. None without depth.
        roughly: Whether a rough answer about its model is enough.
    """
    has_depth = around.observation.has_depth
    if points is None and has_depth:
        points = points_of(around.observation, box_px, around.other_m, around.smaller)
    if points is None or len(points) < LEAST_POINTS:
        points = np.zeros((0, 3))
        # Hardly a point of flat distant objects stands out: the box is better evidence.
        entries = entries if around.observation.monocular else flat_among(entries)
    if not entries:
        return None
    likelihoods = coarse, search, fine = _likelihoods(around, box_px)
    if not len(coarse.evidence.z_m):
        return None
    boxes = likely_boxes(around, box_px, entries, bottoms_m, points, coarse, search)
    ranked = _ranked(boxes, entries, likelihoods, roughly)
    if not ranked or not math.isfinite(ranked[0].cost):
        return None
    best, *others = ranked
    if has_depth and has_ear(best.guess.entry):
        best = orient_by_ear(fine, best)
    if around.observation.monocular and not is_large(best.guess.entry):
        best = _heightened(fine, best)
    return _described(fine, best, others)


def fit_anything(
    around: SearchContext,
    box_px: tuple[float, float, float, float],
    entries: Sequence[ModelEntry],
    bottoms_m: Sequence[float],
    points: Array | None,
) -> Fit | None:
    """Return the best fit among models of any category, searched again among the likely categories.

    With many models, few orientations of each are refined. If the picture is monocular, each category is searched
    separately: costs far from the optimum hardly discriminate. Arguments are those of `fit_thing`.
    """
    named = {entry.category: [one for one in entries if one.category == entry.category] for entry in entries}
    several = named.values() if around.observation.monocular else [entries]
    roughly = [fit_thing(around, box_px, some, bottoms_m, points, roughly=True) for some in several]
    found = best_of_fits(one for one in roughly if one is not None)
    if found is None:
        return None
    rivals = (one.guess.entry for one in found.alternatives if one.cost < found.cost + _WORTH_A_LOOK)
    likely = {found.guess.entry.category, *(entry.category for entry in rivals)}
    again = fit_thing(
        around, box_px, [one for one in entries if one.category in likely], [found.guess.bottom_m], points
    )
    if again is None or again.cost > found.cost:
        return found
    others = [one for one in found.alternatives if one.guess.entry.category not in likely]
    return replace(again, alternatives=tuple(by_cost([*again.alternatives, *others])))


def reclassify(
    around: SearchContext,
    found: Fit,
    box_px: tuple[float, float, float, float],
    own: Sequence[ModelEntry],
    others: Sequence[ModelEntry],
    points: Array,
) -> Fit:
    """Return the fit of another category if it explains the object clearly better than the label does.

    Only models that are no worse by depth alone are tried with options and colours. Their sides are those found, or
    those of the points. If one qualifies, all do, and the labelled category is tried again with the sides found.

    Args:
        around: The context.
        found: The best fit of the labelled category.
        box_px: The detection's box.
        own: Models of the label.
        others: The other models.
        points: (N, 3) its own points.
    """
    coarse, search, fine = _likelihoods(around, box_px)
    if not others or not len(coarse.evidence.z_m):
        return found
    most = coarse.cost(found.guess, colours=False) + _WORTH_A_LOOK
    turned = cheapest_turns(
        coarse.rated(fit_handles(coarse, guess), colours=False) for guess in all_turns(found.guess, others)
    )
    as_it_is = [one.guess for one in turned[:_OPENED] if one.cost < most]
    restarted = boxes_of_others(coarse, points, others, found.guess.bottom_m, most)
    now = fine.rated(found.guess)
    rivals = []
    # A box from its points costs less before it is searched for, and is not always nearer.
    for likely in (as_it_is, restarted):
        for one in cheapest_turns(search.rated(fit_handles(search, guess)) for guess in likely)[:_RIVALS]:
            rival = with_options(fine, refine_nelder_mead(search, one.guess, _SECOND, colours=True))
            rivals.append(_polished(fine, rival) if rival.cost < now.cost + _WORTH_A_LOOK else rival)
    ranked = best_of_models([now, *rivals])
    if ranked[0].guess is found.guess or _with_look(fine, now) - _with_look(fine, ranked[0]) < MISNAMED:
        return found
    ranked = _compared(ranked, others, search, fine)
    return _named(ranked, own, search, fine) or _described(fine, ranked[0], ranked[1:]) or found


def with_label(
    around: SearchContext, box_px: tuple[float, float, float, float], found: Fit, own: Sequence[ModelEntry]
) -> Fit:
    """Return a fit of another category as one of the labelled models, unless that is worse."""
    _, search, fine = _likelihoods(around, box_px)
    guesses = (found.guess, *(one.guess for one in found.alternatives))
    return _named([fine.rated(one) for one in guesses], own, search, fine) or found


def _named(
    found: Sequence[RatedHypothesis], own: Sequence[ModelEntry], search: Likelihood, fine: Likelihood
) -> Fit | None:
    """Return the best fit of the labelled models: those among the fits, and those with the first fit's sides."""
    called_so = (one for one in found if one.guess.entry in own)
    named = best_of_models([*_with_sides_of(found[0].guess, own, search, fine), *called_so])
    if named and has_ear(named[0].guess.entry):
        named[0] = orient_by_ear(fine, named[0])
    if not named or _with_look(fine, named[0]) - _with_look(fine, found[0]) > MISNAMED:
        return None
    return _described(fine, named[0], named[1:])


def update_fit(around: SearchContext, box_px: tuple[float, float, float, float], found: Fit) -> Fit:
    """Update a fit to what is known around it since, if its box shows hardly anything else than before."""
    _, _, fine = _likelihoods(around, box_px)
    best, *others = by_cost(
        [_polished(fine, fine.rated(found.guess)), *(fine.rated(one.guess) for one in found.alternatives)]
    )
    return _described(fine, best, others) or found


def assess_fit(around: SearchContext, box_px: tuple[float, float, float, float], found: Fit, in_box: float) -> Fit:
    """Return a fit with the share that it explains among everything known now.

    Args:
        around: The context.
        box_px: The detection's box.
        found: The fit.
        in_box: IoU of that box with the visible part of the fit.
    """
    evidence, body = _likelihoods(around, box_px)[2].evidence, raycaster_of(found.guess)
    if body is None or not len(evidence.z_m):
        return replace(found, explained=0.0, in_box=in_box)
    explained, residual_m = evidence.explained(found.guess, body), evidence.residual_m(found.guess, body)
    return replace(found, explained=explained, residual_m=residual_m, in_box=in_box)


def refine_full_resolution(around: SearchContext, box_px: tuple[float, float, float, float], found: Fit) -> Fit:
    """Refine a fit at full resolution; a support's height strongly moves what stands on it."""
    _, _, fine = _likelihoods(around, box_px)
    evidence = PixelEvidence.around(
        around.observation, box_px, around.other_m, around.other, SHARP_PX, around.smaller, around.own
    )
    sharp = Likelihood(evidence, around.near)

    def searched(guess: PoseHypothesis, renderings: int) -> RatedHypothesis:
        return sharp.rated(refine_nelder_mead(sharp, guess, renderings, colours=True, reach=0.3))

    def ended(begun: PoseHypothesis) -> RatedHypothesis:
        farther = at_other_distances(begun, around.observation.eye_m)
        near = [fine.rated(refine_nelder_mead(fine, one, _BRIEF, colours=True, reach=0.5)) for one in farther]
        nearest = min([fine.rated(begun), *near], key=lambda one: one.cost)
        best = searched(_polished(fine, nearest).guess, _LAST)
        # A thicker top looks similar to a wider and lower one.
        for steps in ((), *_THICKER):
            others = [searched(guess, _BRIEF) for guess in with_top_thickness(best.guess, steps)]
            best = min([best, *others], key=lambda one: one.cost)
        return best

    begun = [found.guess, *in_rows(found.guess, around.near.pieces)]
    best = min(map(ended, begun), key=lambda one: one.cost)
    return replace(found, guess=best.guess, cost=fine.cost(best.guess))


def perturb_and_refine(
    around: SearchContext, box_px: tuple[float, float, float, float], found: Fit, entries: Sequence[ModelEntry]
) -> Fit:
    """Return a fit, or a cheaper one that local search from its start does not reach.

    Tried are other sides (neighbours may have come or gone since) with all orientations and models. The likeliest of
    these are tried with every hinge side and number of drawers.

    Args:
        around: The context.
        box_px: The detection's box.
        found: The fit.
        entries: The models.
    """
    coarse, search, fine = _likelihoods(around, box_px)
    now = fine.rated(found.guess)
    headings = (*around.near.headings_rad, *(piece.yaw_rad for piece in around.near.pieces))
    others = (turned for box in neighbouring_boxes(found.guess, headings) for turned in (box, *all_turns(box, entries)))
    likely = by_cost(coarse.rated(guess, colours=around.observation.monocular) for guess in others)[:_LIKELY]
    tried = by_cost(search.rated(shape) for one in likely for shape in shapes(one.guess))
    best: dict[tuple[object, ...], RatedHypothesis] = {}
    for one in tried:
        if one.cost < tried[0].cost + _WORTH_A_LOOK:
            best.setdefault((one.guess.entry.model, quarter_of(one.guess), one.guess.parameters), one)
    begun = by_cost(map(fine.rated, {fit_handles(search, one.guess): None for one in list(best.values())[:_OPENED]}))
    ended = [fine.rated(refine_nelder_mead(search, one.guess, _SECOND, colours=True)) for one in begun[:_PERTURBED]]
    near = (one for one in ended if one.cost < now.cost + _WORTH_A_LOOK and not is_alike(one.guess, now.guess))
    polished = [_polished(fine, one) for one in best_of_models(near)[:_POLISHED]]
    ranked = best_of_models([now, *polished, *ended, *(fine.rated(one.guess) for one in found.alternatives)])
    if ranked[0].cost > now.cost - _GAINED:
        return found
    return _described(fine, ranked[0], ranked[1:]) or found


def cheaper(
    around: SearchContext, box_px: tuple[float, float, float, float], first: Fit, second: Fit, by: float = 0.0
) -> Fit:
    """Return the second of two fits if it costs less by a margin among everything known now."""
    return second if cost_among(around, box_px, second) < cost_among(around, box_px, first) - by else first


def cost_among(around: SearchContext, box_px: tuple[float, float, float, float], found: Fit) -> float:
    """Return the cost of a fit among everything known now."""
    return _likelihoods(around, box_px)[2].cost(found.guess)


def _likelihoods(
    around: SearchContext, box_px: tuple[float, float, float, float]
) -> tuple[Likelihood, Likelihood, Likelihood]:
    """Return the likelihoods for choosing starts, for searching, and for choosing options."""
    coarse, search, fine = (
        Likelihood(
            PixelEvidence.around(
                around.observation, box_px, around.other_m, around.other, most, around.smaller, around.own
            ),
            around.near,
            around.scale_share,
        )
        for most in (COARSE_PX, SEARCH_PX, FINE_PX)
    )
    return coarse, search, fine


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
        None if evidence.has_depth else place_spread_m(fine, best.guess),
        outline_misfit=evidence.box_cost(best.guess),
    )


def _ranked(
    boxes: list[RatedHypothesis],
    entries: Sequence[ModelEntry],
    likelihoods: tuple[Likelihood, Likelihood, Likelihood],
    roughly: bool,
) -> list[RatedHypothesis]:
    """Rank the best of every model and orientation of some boxes, with options and colours."""
    coarse, search, fine = likelihoods
    turned = [
        coarse.rated(guess, colours=coarse.evidence.observation.monocular)
        for one in distinct(boxes)[:_TURNED]
        for guess in all_turns(one.guess, entries)
    ]
    likely = [*boxes, *by_cost(turned)[:_LIKELY]]
    found = cheapest_turns(search.rated(fit_handles(search, one.guess)) for one in likely)
    if roughly or len({entry.category for entry in entries}) > _NAMES:
        # With many categories, six orientations of a carton would leave no place for a glass.
        found = best_of_models(found)
    opened = cheapest_turns(with_options(search, one.guess) for one in found[:_OPENED])
    finished = [
        with_options(fine, refine_nelder_mead(search, one.guess, _SECOND, colours=True)) for one in opened[:_FINISHED]
    ]
    ranked = best_of_models(finished)
    if roughly or not ranked:
        return _by_look(fine, ranked)
    ranked = best_of_models([*(_polished(fine, one) for one in ranked[:_POLISHED]), *ranked[_POLISHED:]])
    rivals = [one.guess.entry for one in ranked[1:] if one.cost < ranked[0].cost + _WORTH_A_LOOK]
    return _by_look(fine, _compared(ranked, rivals, search, fine))


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


def _by_look(fine: Likelihood, guesses: Iterable[RatedHypothesis]) -> list[RatedHypothesis]:
    """Return the cheapest hypothesis of each model, cheapest first; items of similar shape also by colour."""
    ranked = best_of_models(guesses)
    items = [one for one in ranked if kind_of(one.guess.entry.category, 0.0) is Kind.ITEM]
    if len({one.guess.entry.category for one in items}) < 2 or items[0] is not ranked[0]:
        return ranked
    best = min(items, key=lambda one: _with_look(fine, one))
    return [best, *(one for one in ranked if one is not best)]


def _with_look(fine: Likelihood, one: RatedHypothesis) -> float:
    """Return the cost of a hypothesis; for items including the distance from the model's own colours."""
    is_item = kind_of(one.guess.entry.category, 0.0) is Kind.ITEM
    return one.cost + (_LOOK * colour_distance(fine.evidence, one.guess) if is_item else 0.0)


def _with_sides_of(
    found: PoseHypothesis, entries: Sequence[ModelEntry], search: Likelihood, fine: Likelihood
) -> list[RatedHypothesis]:
    """Search for other models from a box: ends of searches differ by more than models do."""
    turned = cheapest_turns(search.rated(fit_handles(search, guess)) for guess in all_turns(found, entries))
    return [
        with_options(fine, refine_nelder_mead(fine, one.guess, _LAST, colours=True, reach=0.5))
        for one in turned[:_RIVALS]
    ]


def _heightened(fine: Likelihood, best: RatedHypothesis) -> RatedHypothesis:
    """Search an item with other heights too: farther off and flatter it looks much the same."""
    begun = flatter_and_higher(best.guess, fine.evidence.observation.eye_m)
    ended = (fine.rated(refine_nelder_mead(fine, one, _BRIEF, colours=True, reach=0.5)) for one in begun)
    return min([best, *ended], key=lambda one: one.cost)


def _polished(fine: Likelihood, best: RatedHypothesis) -> RatedHypothesis:
    """Search on from the end of a search with its options, as long as that gains something.

    Every pixel counts here: distant handles are two pixels thick.
    """
    if kind_of(best.guess.entry.category, best.guess.size_m[1]) is not Kind.ITEM:
        # Thin parts before a wall, such as a headboard, give no gradient to a search.
        others = list(with_other_heights(best.guess))
        if fine.evidence.observation.monocular:
            others += at_other_distances(best.guess, fine.evidence.observation.eye_m)
            others += [thicker for one in (best.guess, *others) for thicker in with_top_thickness(one)]
        best = min([best, *(fine.rated(one) for one in others)], key=lambda one: one.cost)
    for _ in range(_ROUNDS):
        again = refit_handles(
            fine, with_options(fine, refine_nelder_mead(fine, best.guess, _LAST, colours=True, reach=0.5))
        )
        gained = best.cost - again.cost
        best = again if gained > 0.0 else best
        if gained < _GAINED:
            break
    return best
