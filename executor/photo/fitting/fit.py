"""The search for what explains one thing of the picture: every model, many starts, few of them followed to the end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.body import Guess, as_built, body_of, has_ear
from executor.photo.fitting.boxes import boxes_of_others, likely_boxes
from executor.photo.fitting.colours import coloured, seen_colour, unlike_seen
from executor.photo.fitting.descent import descended
from executor.photo.fitting.likelihood import (
    Around,
    Fit,
    Likelihood,
    RatedGuess,
    best_of_fits,
    best_of_models,
    by_cost,
    place_spread_m,
)
from executor.photo.fitting.options import dressed, redressed, shapes, thickened, with_options
from executor.photo.fitting.patch import Patch
from executor.photo.fitting.prior import in_rows, is_large
from executor.photo.fitting.starts import LEAST_POINTS, flat_among, points_of
from executor.photo.fitting.turns import (
    all_turns,
    at_other_distances,
    boxes_beside,
    cheapest_turns,
    distinct,
    flatter_and_higher,
    is_alike,
    quarter_of,
    turned_by_ear,
    with_other_heights,
)
from oag import Kind, kind_of

COARSE_PX, SEARCH_PX, FINE_PX, SHARP_PX = 250, 700, 5000, 40_000
"""How many pixels of a thing are compared to choose starts, to search, to choose options, and at the end by sight."""

_TURNED, _LIKELY = 4, 40  # Boxes that are tried out with every model and turn, and how many of these are looked at.
_OPENED, _FINISHED, _POLISHED = 12, 6, 2  # Guesses whose options are tried, that are searched with colours, and again.
_NAMES = 8  # What may be called by more of them may be anything.
_SECOND, _LAST, _BRIEF = 160, 120, 60  # Renderings of a search.
_THICKER = ((-0.12, 0.12), (-0.06, 0.06))  # Steps from a top's thickness, as shares of its range.
_ROUNDS, _GAINED = 3, 2.0  # Of polishing, as long as each gains that much.
_SHAKEN = 4  # Beginnings that are searched on from, of those beside a fit.
_WORTH_A_LOOK, _RIVALS = 40.0, 2  # What another model may cost more before it has handles and sides of its own.
MISNAMED = 12.0
"""Less, a model of another name has to cost: a name is wrong once in twenty, and then one of forty, 6.6 by itself."""

_LOOK = 20.0  # Of a thing without a name, another colour by a third of its light is as unlikely as a wrong name.


def fit_thing(
    around: Around,
    box_px: tuple[float, float, float, float],
    entries: Sequence[ModelEntry],
    bottoms_m: Sequence[float],
    points: Array | None = None,
    *,
    roughly: bool = False,
) -> Fit | None:
    """Returns the best fit of a thing among some models, or None where nothing of it stands out.

    Args:
        around: What else is known.
        box_px: The thing's box.
        entries: Models that it may be.
        bottoms_m: Heights that it may stand on.
        points: (N, 3) that are its own; by default those that stand out in its box. None where there is no depth.
        roughly: Whether it is enough to tell what it may be at all.
    """
    has_depth = around.seen.has_depth
    if points is None and has_depth:
        points = points_of(around.seen, box_px, around.other_m, around.smaller)
    if points is None or len(points) < LEAST_POINTS:
        points = np.zeros((0, 3))
        # Of what is flat and far hardly a point stands out: its box tells more.
        entries = entries if around.seen.by_sight else flat_among(entries)
    if not entries:
        return None
    likelihoods = coarse, search, fine = _likelihoods(around, box_px)
    if not len(coarse.patch.z_m):
        return None
    boxes = likely_boxes(around, box_px, entries, bottoms_m, points, coarse, search)
    ranked = _ranked(boxes, entries, likelihoods, roughly)
    if not ranked or not math.isfinite(ranked[0].cost):
        return None
    best, *others = ranked
    if has_depth and has_ear(best.guess.entry):
        best = turned_by_ear(fine, best)
    if around.seen.by_sight and not is_large(best.guess.entry):
        best = _heightened(fine, best)
    return _described(fine, best, others)


def fit_anything(
    around: Around,
    box_px: tuple[float, float, float, float],
    entries: Sequence[ModelEntry],
    bottoms_m: Sequence[float],
    points: Array | None,
) -> Fit | None:
    """Returns the best fit of a thing among models of any name, searched for once more among those of likely names.

    Among many models, few turns of each are followed. By sight each name is searched for by itself, since costs from
    afar say too little of which one it is. Arguments are those of `fit_thing`.
    """
    named = {entry.category: [one for one in entries if one.category == entry.category] for entry in entries}
    several = named.values() if around.seen.by_sight else [entries]
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


def renamed(
    around: Around,
    found: Fit,
    box_px: tuple[float, float, float, float],
    own: Sequence[ModelEntry],
    others: Sequence[ModelEntry],
    points: Array,
) -> Fit:
    """Returns a thing as one of other models where that explains it clearly better than what it is called, or as it is.

    Only what is no worse by depths alone, with the sides that were found or as its points lie, is looked at with its
    options and colours. Where something is, all are, and what it is called once more, with the sides that are found so.

    Args:
        around: What else is known.
        found: The best fit of what it is called.
        box_px: The thing's box.
        own: The models of what it is called.
        others: The other models.
        points: (N, 3) that are its own.
    """
    coarse, search, fine = _likelihoods(around, box_px)
    if not others or not len(coarse.patch.z_m):
        return found
    most = coarse.cost(found.guess, colours=False) + _WORTH_A_LOOK
    turned = cheapest_turns(
        coarse.rated(dressed(coarse, guess), colours=False) for guess in all_turns(found.guess, others)
    )
    as_it_is = [one.guess for one in turned[:_OPENED] if one.cost < most]
    anew = boxes_of_others(coarse, points, others, found.guess.bottom_m, most)
    now = fine.rated(found.guess)
    rivals = []
    # A box from its points costs less before it is searched for, and is not always nearer.
    for likely in (as_it_is, anew):
        for one in cheapest_turns(search.rated(dressed(search, guess)) for guess in likely)[:_RIVALS]:
            rival = with_options(fine, descended(search, one.guess, _SECOND, colours=True))
            rivals.append(_polished(fine, rival) if rival.cost < now.cost + _WORTH_A_LOOK else rival)
    ranked = best_of_models([now, *rivals])
    if ranked[0].guess is found.guess or _with_look(fine, now) - _with_look(fine, ranked[0]) < MISNAMED:
        return found
    ranked = _compared(ranked, others, search, fine)
    return _named(ranked, own, search, fine) or _described(fine, ranked[0], ranked[1:]) or found


def called(around: Around, box_px: tuple[float, float, float, float], found: Fit, own: Sequence[ModelEntry]) -> Fit:
    """Returns what was found by another name as one of the models that its box is called, unless that is worse."""
    _, search, fine = _likelihoods(around, box_px)
    guesses = (found.guess, *(one.guess for one in found.alternatives))
    return _named([fine.rated(one) for one in guesses], own, search, fine) or found


def _named(found: Sequence[RatedGuess], own: Sequence[ModelEntry], search: Likelihood, fine: Likelihood) -> Fit | None:
    """A thing as one of the models that its box is called, if one of those found or with the sides of the first is."""
    called_so = (one for one in found if one.guess.entry in own)
    named = best_of_models([*_with_sides_of(found[0].guess, own, search, fine), *called_so])
    if named and has_ear(named[0].guess.entry):
        named[0] = turned_by_ear(fine, named[0])
    if not named or _with_look(fine, named[0]) - _with_look(fine, found[0]) > MISNAMED:
        return None
    return _described(fine, named[0], named[1:])


def retouched(around: Around, box_px: tuple[float, float, float, float], found: Fit) -> Fit:
    """Returns a fit moved by what is known around it since, where its box shows hardly anything else than before."""
    _, _, fine = _likelihoods(around, box_px)
    best, *others = by_cost(
        [_polished(fine, fine.rated(found.guess)), *(fine.rated(one.guess) for one in found.alternatives)]
    )
    return _described(fine, best, others) or found


def judged(around: Around, box_px: tuple[float, float, float, float], found: Fit, in_box: float) -> Fit:
    """Return a fit with what it explains among all that is known now.

    Args:
        around: What else is known.
        box_px: The thing's box.
        found: The fit.
        in_box: IoU of that box with what is visible of the fit.
    """
    patch, body = _likelihoods(around, box_px)[2].patch, body_of(found.guess)
    if body is None or not len(patch.z_m):
        return replace(found, explained=0.0, in_box=in_box)
    explained, residual_m = patch.explained(found.guess, body), patch.residual_m(found.guess, body)
    return replace(found, explained=explained, residual_m=residual_m, in_box=in_box)


def sharpened(around: Around, box_px: tuple[float, float, float, float], found: Fit) -> Fit:
    """Returns a fit searched on by nearly every pixel: what stands on a top is moved far by a little of its height."""
    _, _, fine = _likelihoods(around, box_px)
    patch = Patch.around(around.seen, box_px, around.other_m, around.other, SHARP_PX, around.smaller, around.own)
    sharp = Likelihood(patch, around.near)

    def searched(guess: Guess, renderings: int) -> RatedGuess:
        return sharp.rated(descended(sharp, guess, renderings, colours=True, reach=0.3))

    def ended(begun: Guess) -> RatedGuess:
        farther = at_other_distances(begun, around.seen.eye_m)
        near = [fine.rated(descended(fine, one, _BRIEF, colours=True, reach=0.5)) for one in farther]
        nearest = min([fine.rated(begun), *near], key=lambda one: one.cost)
        best = searched(_polished(fine, nearest).guess, _LAST)
        # A thicker top looks much like a wider and lower one.
        for steps in ((), *_THICKER):
            others = [searched(guess, _BRIEF) for guess in thickened(best.guess, steps)]
            best = min([best, *others], key=lambda one: one.cost)
        return best

    begun = [found.guess, *in_rows(found.guess, around.near.pieces)]
    best = min(map(ended, begun), key=lambda one: one.cost)
    return replace(found, guess=best.guess, cost=fine.cost(best.guess))


def shaken(around: Around, box_px: tuple[float, float, float, float], found: Fit, entries: Sequence[ModelEntry]) -> Fit:
    """Returns a fit, or what is cheaper and not on the way down from where its search began.

    Tried are other sides, as neighbours may have come or gone since, with all turns and models, and the likeliest of
    these with every hinge side and number of drawers.

    Args:
        around: What else is known.
        box_px: The thing's box.
        found: The fit.
        entries: The models.
    """
    coarse, search, fine = _likelihoods(around, box_px)
    now = fine.rated(found.guess)
    beside = (*around.near.headings_rad, *(piece.yaw_rad for piece in around.near.pieces))
    others = (turned for box in boxes_beside(found.guess, beside) for turned in (box, *all_turns(box, entries)))
    likely = by_cost(coarse.rated(guess, colours=around.seen.by_sight) for guess in others)[:_LIKELY]
    tried = by_cost(search.rated(shape) for one in likely for shape in shapes(one.guess))
    best: dict[tuple[object, ...], RatedGuess] = {}
    for one in tried:
        if one.cost < tried[0].cost + _WORTH_A_LOOK:
            best.setdefault((one.guess.entry.model, quarter_of(one.guess), one.guess.parameters), one)
    begun = by_cost(map(fine.rated, {dressed(search, one.guess): None for one in list(best.values())[:_OPENED]}))
    ended = [fine.rated(descended(search, one.guess, _SECOND, colours=True)) for one in begun[:_SHAKEN]]
    near = (one for one in ended if one.cost < now.cost + _WORTH_A_LOOK and not is_alike(one.guess, now.guess))
    polished = [_polished(fine, one) for one in best_of_models(near)[:_POLISHED]]
    ranked = best_of_models([now, *polished, *ended, *(fine.rated(one.guess) for one in found.alternatives)])
    if ranked[0].cost > now.cost - _GAINED:
        return found
    return _described(fine, ranked[0], ranked[1:]) or found


def cheaper(around: Around, box_px: tuple[float, float, float, float], first: Fit, second: Fit, by: float = 0.0) -> Fit:
    """Returns the second of two fits of a thing where it costs so much less among all that is known now."""
    return second if cost_among(around, box_px, second) < cost_among(around, box_px, first) - by else first


def cost_among(around: Around, box_px: tuple[float, float, float, float], found: Fit) -> float:
    """Returns what a fit costs among all that is known now."""
    return _likelihoods(around, box_px)[2].cost(found.guess)


def _likelihoods(
    around: Around, box_px: tuple[float, float, float, float]
) -> tuple[Likelihood, Likelihood, Likelihood]:
    """What guesses are judged by to choose starts, to search, and to choose options."""
    coarse, search, fine = (
        Likelihood(
            Patch.around(around.seen, box_px, around.other_m, around.other, most, around.smaller, around.own),
            around.near,
            around.scale_share,
        )
        for most in (COARSE_PX, SEARCH_PX, FINE_PX)
    )
    return coarse, search, fine


def _described(fine: Likelihood, best: RatedGuess, others: Sequence[RatedGuess]) -> Fit | None:
    """Returns a fit with its quality; None where it cannot be built."""
    body = body_of(best.guess)
    if body is None:
        return None
    patch = fine.patch
    return Fit(
        coloured(patch, as_built(best.guess)),
        best.cost,
        tuple(RatedGuess(coloured(patch, as_built(one.guess)), one.cost) for one in others),
        patch.explained(best.guess, body),
        patch.residual_m(best.guess, body),
        len(patch.z_m),
        seen_colour(patch, best.guess),
        None if patch.has_depth else place_spread_m(fine, best.guess),
        beside_box=patch.box_cost(best.guess),
    )


def _ranked(
    boxes: list[RatedGuess],
    entries: Sequence[ModelEntry],
    likelihoods: tuple[Likelihood, Likelihood, Likelihood],
    roughly: bool,
) -> list[RatedGuess]:
    """The best of every model and turn of some boxes, with their options and colours, the best first."""
    coarse, search, fine = likelihoods
    turned = [
        coarse.rated(guess, colours=coarse.patch.seen.by_sight)
        for one in distinct(boxes)[:_TURNED]
        for guess in all_turns(one.guess, entries)
    ]
    likely = [*boxes, *by_cost(turned)[:_LIKELY]]
    found = cheapest_turns(search.rated(dressed(search, one.guess)) for one in likely)
    if roughly or len({entry.category for entry in entries}) > _NAMES:
        # Where it may be anything, six turns of a carton leave no place for a glass.
        found = best_of_models(found)
    opened = cheapest_turns(with_options(search, one.guess) for one in found[:_OPENED])
    finished = [with_options(fine, descended(search, one.guess, _SECOND, colours=True)) for one in opened[:_FINISHED]]
    ranked = best_of_models(finished)
    if roughly or not ranked:
        return _by_look(fine, ranked)
    ranked = best_of_models([*(_polished(fine, one) for one in ranked[:_POLISHED]), *ranked[_POLISHED:]])
    rivals = [one.guess.entry for one in ranked[1:] if one.cost < ranked[0].cost + _WORTH_A_LOOK]
    return _by_look(fine, _compared(ranked, rivals, search, fine))


def _compared(
    ranked: list[RatedGuess], rivals: Sequence[ModelEntry], search: Likelihood, fine: Likelihood
) -> list[RatedGuess]:
    """The best of every model, the best first: each rival of the best searched for from where that one is, too.

    Ends of searches differ by more than models do.
    """
    best = ranked[0]
    turned = best_of_models(search.rated(dressed(search, guess)) for guess in all_turns(best.guess, rivals))
    ended = [
        with_options(fine, descended(search, one.guess, _SECOND, colours=True, reach=0.5)) for one in turned[:_OPENED]
    ]
    likely = [one for one in best_of_models(ended) if one.cost < best.cost + _WORTH_A_LOOK / 2]
    return best_of_models([*ranked, *ended, *(_polished(fine, one) for one in likely[:_POLISHED])])


def _by_look(fine: Likelihood, guesses: Iterable[RatedGuess]) -> list[RatedGuess]:
    """The cheapest guess of each model, the cheapest first; items, which may be of one shape, by their colours too."""
    ranked = best_of_models(guesses)
    items = [one for one in ranked if kind_of(one.guess.entry.category, 0.0) is Kind.ITEM]
    if len({one.guess.entry.category for one in items}) < 2 or items[0] is not ranked[0]:
        return ranked
    best = min(items, key=lambda one: _with_look(fine, one))
    return [best, *(one for one in ranked if one is not best)]


def _with_look(fine: Likelihood, one: RatedGuess) -> float:
    """Returns what a guess costs, and of an item how unlike its own colours it looks, too."""
    is_item = kind_of(one.guess.entry.category, 0.0) is Kind.ITEM
    return one.cost + (_LOOK * unlike_seen(fine.patch, one.guess) if is_item else 0.0)


def _with_sides_of(
    found: Guess, entries: Sequence[ModelEntry], search: Likelihood, fine: Likelihood
) -> list[RatedGuess]:
    """A box as that of other models, searched on from there: ends of searches differ by more than models do."""
    turned = cheapest_turns(search.rated(dressed(search, guess)) for guess in all_turns(found, entries))
    return [with_options(fine, descended(fine, one.guess, _LAST, colours=True, reach=0.5)) for one in turned[:_RIVALS]]


def _heightened(fine: Likelihood, best: RatedGuess) -> RatedGuess:
    """An item searched for with other heights, too: farther off and flatter it looks much the same."""
    begun = flatter_and_higher(best.guess, fine.patch.seen.eye_m)
    ended = (fine.rated(descended(fine, one, _BRIEF, colours=True, reach=0.5)) for one in begun)
    return min([best, *ended], key=lambda one: one.cost)


def _polished(fine: Likelihood, best: RatedGuess) -> RatedGuess:
    """Searched from where a search ended, with the options that were chosen there, as long as that gains something.

    Every pixel counts here: handles that are far are two pixels thick.
    """
    if kind_of(best.guess.entry.category, best.guess.size_m[1]) is not Kind.ITEM:
        # What is thin before a wall, such as a headboard, is no slope that a search goes down.
        others = list(with_other_heights(best.guess))
        if fine.patch.seen.by_sight:
            others += at_other_distances(best.guess, fine.patch.seen.eye_m)
            others += [thicker for one in (best.guess, *others) for thicker in thickened(one)]
        best = min([best, *(fine.rated(one) for one in others)], key=lambda one: one.cost)
    for _ in range(_ROUNDS):
        again = redressed(fine, with_options(fine, descended(fine, best.guess, _LAST, colours=True, reach=0.5)))
        gained = best.cost - again.cost
        best = again if gained > 0.0 else best
        if gained < _GAINED:
            break
    return best
