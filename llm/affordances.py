"""What can be done with an object: put things in or on it, open and close it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import bddl
from oag import SceneObject


@dataclass(frozen=True, slots=True)
class Affordances:
    """What can be done with an object.

    Attributes:
        interior: Things can be put inside.
        surface: Things can be put on top.
        door: It can be opened and closed.
    """

    interior: bool = False
    surface: bool = False
    door: bool = False


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
    )
