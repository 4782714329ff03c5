"""What shapes a model besides its size: hinge side, drawers, how far open, where its handles are and how long."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from functools import cache

from executor.assets.library import LIBRARY, asset_for
from executor.assets.parameters import ModelEntry, Option, Quantity
from executor.photo.fitting.body import Guess, largest_m
from executor.photo.fitting.likelihood import Likelihood, RatedGuess
from oag import Kind, kind_of

_SHAPING = ("hinge", "drawers", "drawer_side", "below", "boards")
_INSIDE = ("shelves", "racks")  # Seen where a door is open.
_DETAILS = ("handle_height_m", "handle_length_m")
_THICKNESS = "top_thickness_m"
_DETAIL_SHARES = (0.1, 0.35, 0.65, 0.9)  # Of a detail's range.
_DETAIL_STEPS = (0.12, 0.06)
_OPEN = "open_fraction"
_OPENED = (0.0, 0.25, 0.5, 0.75, 1.0)
_OPENED_STEPS = (0.12, 0.06, 0.03)


def with_options(likelihood: Likelihood, guess: Guess) -> RatedGuess:
    """Returns a guess with the options that explain best what was seen, by depths and colours."""
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


def redressed(likelihood: Likelihood, best: RatedGuess) -> RatedGuess:
    """Returns a guess with its handles moved and stretched at once on either side, and then by less and less.

    A long handle that is too high may cost as much as a short one that is too low, and one alone gains nothing.
    """
    known = [one for one in best.guess.entry.parameters if isinstance(one, Quantity) and one.name in _DETAILS]
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


def _detailed_by(guess: Guess, details: Sequence[Quantity], shares: Sequence[float]) -> Guess:
    """With every detail at a share of its range."""
    values = {
        one.name: round(one.low + share * (one.high - one.low), 3) for one, share in zip(details, shares, strict=True)
    }
    return guess.with_parameters(**values)


def thickened(guess: Guess, steps: Sequence[float] = ()) -> Iterator[Guess]:
    """Yields the guess with tops of other thickness, where its model has one.

    Args:
        guess: The guess.
        steps: From its own thickness, as shares of the model's range; by default all of that is gone through.
    """
    for one in guess.entry.parameters:
        if isinstance(one, Quantity) and one.name == _THICKNESS:
            now = (float(str(dict(guess.parameters).get(_THICKNESS, one.default))) - one.low) / (one.high - one.low)
            for share in [now + step for step in steps] or _DETAIL_SHARES:
                yield _detailed_by(guess, [one], [min(max(share, 0.0), 1.0)])


def dressed(likelihood: Likelihood, guess: Guess) -> Guess:
    """Returns a guess with its handles where depths have them, so that a search does not shrink from wrong ones."""
    colours = likelihood.patch.seen.by_sight
    best = min((likelihood.rated(one, colours=colours) for one in shapes(guess)), key=lambda one: one.cost)
    return _detailed(likelihood, best, colours=colours).guess


def shapes(guess: Guess) -> Iterator[Guess]:
    """Yields the guess with every combination of what its model can be built as."""
    choices: list[list[tuple[str, object]]] = []
    for parameter in guess.entry.parameters:
        if parameter.name not in _SHAPING and not (parameter.name in _INSIDE and _opened(guess) > 0.0):
            continue
        if isinstance(parameter, Option):
            choices.append([(parameter.name, word) for word in parameter.words])
        else:
            choices.append([(parameter.name, n) for n in range(round(parameter.low), round(parameter.high) + 1)])
    for combination in itertools.product(*choices):
        yield guess.with_parameters(**dict(combination))


def shape_of(guess: Guess) -> Mapping[str, object]:
    """Returns what a guess is built as, of all that its model can be, but for how far open it is and its handles."""
    return {name: value for name, value in guess.parameters if name in _SHAPING}


def with_parts(entries: Sequence[ModelEntry], doors: int | None, drawers: int | None) -> list[ModelEntry]:
    """Returns those of some models that can have so many doors and drawers; all of them where none can.

    Args:
        entries: The models.
        doors, drawers: How many; None where nobody says.
    """
    if doors is None and drawers is None:
        return list(entries)
    told = [
        entry
        for entry in entries
        if any((doors is None or doors == a) and (drawers is None or drawers == b) for a, b in _parts(entry.model))
    ]
    return told or list(entries)


@cache
def _parts(model: str) -> frozenset[tuple[int, int]]:
    """Returns how many doors and drawers a model can have."""
    entry = LIBRARY[model]
    counts = set()
    for guess in shapes(Guess(entry, 0.0, 0.0, 0.0, 0.0, largest_m(entry))):
        kinds = [joint.kind for joint in asset_for(guess.as_object()).joints]
        counts.add((kinds.count("revolute"), kinds.count("prismatic")))
    return frozenset(counts)


def _detailed(likelihood: Likelihood, best: RatedGuess, *, colours: bool) -> RatedGuess:
    for parameter in best.guess.entry.parameters:
        if isinstance(parameter, Quantity) and parameter.name in _DETAILS:
            for share in _DETAIL_SHARES:
                value = round(parameter.low + share * (parameter.high - parameter.low), 3)
                best = likelihood.better(best, best.guess.with_parameters(**{parameter.name: value}), colours=colours)
    return best


def _opened(guess: Guess) -> float:
    return float(str(dict(guess.parameters).get(_OPEN, 0.0)))
