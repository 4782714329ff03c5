"""Where a thing may stand and how large it may be: searches from many starts, of which few are followed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.body import Guess, body_of
from executor.photo.fitting.descent import descended
from executor.photo.fitting.likelihood import Around, Likelihood, RatedGuess, best_of_models, by_cost
from executor.photo.fitting.options import dressed
from executor.photo.fitting.starts import LEAST_POINTS, flat_among, opened_starts, outline_starts, starts
from executor.photo.fitting.turns import cheapest_openings, cheapest_turns, distinct

_FOLLOWED = 10  # Starts: what they learn of a thing's sides is shared by all models and turns.
_SKETCHED, _SKETCH, _SEARCH = 30, 120, 240  # Starts that are followed roughly, and renderings of a search.
_TURNS = 20  # Of these, the first are of as many models and turns.
_MOSTLY = 0.9  # Of its pixels, what is shut and right explains, but for handles and edges.
_FAR_WORSE = 200.0  # Of a start's cost, which a search mostly halves.
_RIVALS = 6  # Models of other names that are followed.


def likely_boxes(
    around: Around,
    box_px: tuple[float, float, float, float],
    entries: Sequence[ModelEntry],
    bottoms_m: Sequence[float],
    points: Array,
    coarse: Likelihood,
    search: Likelihood,
) -> list[RatedGuess]:
    """Returns where searches for a thing end, the cheapest first; what they learn of sides counts for all models.

    Args:
        around: What else is known.
        box_px: The thing's box.
        entries: Models that it may be.
        bottoms_m: Heights that it may stand on.
        points: (N, 3) that are its own; none where its box tells more, or there is no depth.
        coarse, search: What guesses are judged by to choose starts, and to search.
    """
    near = around.near

    by_sight = around.seen.by_sight
    outlined = entries if by_sight else flat_among(entries)
    begun: list[Guess] = []
    for bottom in bottoms_m:
        begun += starts(points, entries, bottom, near.walls)
        begun += outline_starts(around.seen, box_px, outlined, bottom, near.headings_rad)
    if by_sight:
        boxes = _sketched(coarse, search, begun)
    else:
        # Where hardly anything stands out, colours tell more than depths do.
        by_look = not len(points)
        followed = _worth_following([coarse.rated(guess, colours=by_look) for guess in begun])
        boxes = by_cost(_searched(search, followed, colours=by_look))
    named = {entry.category for entry in entries}
    if boxes and len(points) and len(named) == 1 and not _explains(search, boxes):
        # A door that stands wide open makes the points' rectangle another thing's.
        out = search.patch.own_points_m
        ajar = (guess for bottom in bottoms_m for guess in opened_starts(out, entries, bottom, near.walls))
        openings = cheapest_openings(coarse.rated(guess, colours=False) for guess in ajar)
        boxes = by_cost([*boxes, *_searched(search, openings, colours=False)])
    return boxes


def boxes_of_others(
    coarse: Likelihood, points: Array, entries: Sequence[ModelEntry], bottom_m: float, most_cost: float
) -> list[Guess]:
    """Returns where rough searches for some models end that begin where points lie, one of each model.

    What is round has no sides that are worth trying out with a book's.

    Args:
        coarse: What guesses are judged by.
        points: (N, 3) that are a thing's own.
        entries: The models.
        bottom_m: Height of what it stands on.
        most_cost: By depths, that one may end with.
    """
    if len(points) < LEAST_POINTS:
        return []
    begun = best_of_models(coarse.rated(guess, colours=False) for guess in starts(points, entries, bottom_m, ()))
    near = [one for one in begun if one.cost < most_cost + _FAR_WORSE][:_RIVALS]
    return [descended(coarse, one.guess, _SKETCH, colours=False) for one in near]


def _sketched(coarse: Likelihood, search: Likelihood, begun: Iterable[Guess]) -> list[RatedGuess]:
    """Where searches by the picture alone end, first by few of its pixels, the cheapest first."""
    rated = [one for one in by_cost(map(coarse.rated, begun)) if math.isfinite(one.cost)]
    # One model's many starts would take the places of all others.
    first = cheapest_turns(rated)[:_TURNS]
    likely = [*first, *(one for one in rated if all(one is not other for other in first))][:_SKETCHED]
    rough = by_cost(coarse.rated(descended(coarse, one.guess, _SKETCH, colours=True)) for one in likely)
    return by_cost(_searched(search, distinct(rough)[:_FOLLOWED], colours=True))


def _searched(search: Likelihood, begun: Iterable[RatedGuess], *, colours: bool) -> Iterable[RatedGuess]:
    """Where searches end that begin at some starts."""
    for one in begun:
        guess = descended(search, dressed(search, one.guess), _SEARCH, colours=colours)
        yield search.rated(guess, colours=colours)


def _explains(search: Likelihood, boxes: Sequence[RatedGuess]) -> bool:
    """Whether the first of some guesses explains most of what stands out, and may be right."""
    body = body_of(boxes[0].guess) if boxes else None
    return body is not None and search.patch.explained(boxes[0].guess, body) > _MOSTLY


def _worth_following(begun: list[RatedGuess]) -> list[RatedGuess]:
    """The cheapest start of each model, then those of other turns and heights; those that are far worse left out."""
    found = cheapest_turns(begun)
    models = best_of_models(found)
    first = [*models, *(one for one in found if all(one is not model for model in models))]
    return [one for one in first if one.cost < found[0].cost + _FAR_WORSE][:_FOLLOWED]
