"""What can be done with an object: put things in or on it, open and close it by a door or a drawer."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, get_args

import bddl
from oag import SceneObject

# What closes an opening.
Front = Literal["door", "drawer"]
FRONTS: tuple[Front, ...] = get_args(Front)


@dataclass(frozen=True, slots=True)
class Affordances:
    """What can be done with an object.

    Attributes:
        interior: Things can be put inside.
        surface: Things can be put on top.
        door: It can be opened and closed.
        fronts: By what it is opened, as far as that is known; empty where nothing says so.
    """

    interior: bool = False
    surface: bool = False
    door: bool = False
    fronts: frozenset[Front] = frozenset()

    def opens_by(self, front: Front) -> bool:
        """Whether opening it can be called opening a door, or a drawer.

        A plan opens a thing as a whole. What has both is opened by its doors, which close its larger compartments; what
        is not known to have a drawer has none.
        """
        return self.door and (self.fronts == {"drawer"}) is (front == "drawer")


FIXTURE_WITH_DOOR = Affordances(interior=True, door=True)
NOTHING = Affordances()


def affordances(thing: SceneObject, listed: Affordances | None, facts: Mapping[bddl.Atom, bool]) -> Affordances:
    """Returns what can be done with an object: what its category says, and what the scene's facts show beside it.

    Args:
        thing: The object.
        listed: What a lexicon says of its category, or None when it has no entry. Then a fixture (type A) counts as
            one with a door and an item (type B) as neither container nor support.
        facts: Stated atoms. Where something is inside an object it has an interior, whatever its category; a fixture
            that is said to be open or not has one behind its door, such as a nightstand with a drawer.

    Returns:
        The affordances. Doors and drawers are known from the lexicon, and from the words of the category and of the
        model, such as `cabinet_two_doors`.
    """
    base = listed or (FIXTURE_WITH_DOOR if thing.role == "A" else NOTHING)
    shown = {
        atom.predicate
        for atom, value in facts.items()
        if atom.args[-1] == thing.id and (value or atom.predicate == "open")
    }
    return Affordances(
        interior=base.interior or "inside" in shown or ("open" in shown and thing.role == "A"),
        surface=base.surface or "ontop" in shown,
        door=base.door or "open" in shown,
        fronts=base.fronts | fronts_in(thing.category) | fronts_in(thing.model.rsplit("/", 1)[-1]),
    )


def fronts_in(name: str) -> frozenset[Front]:
    """Returns the doors and drawers that a category or the name of a model speaks of."""
    words = set(re.split(r"[^a-z]+", name.lower()))
    return frozenset(front for front in FRONTS if words & {front, f"{front}s"})
