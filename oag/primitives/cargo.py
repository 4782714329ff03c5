"""What a thing carries: places follow from what carries it, as detectors read them.

A thing in a bowl goes where the bowl goes; so does what stands on a tray, and what lies in a bowl on a tray. It is
inside whatever its carrier is inside. Part of the table of primitives: what a motion or a release writes about cargo.

Who may ever carry whom is known before a plan runs: by the start, and by the places that the plan's goals name. Where
nothing can be carried, a primitive writes what its row says. Furniture is inside what the start says, and in nothing
else. Where the start and the steps leave open whether a thing is carried, its place is left open by what may move it.

Source: docs/semantics.md, Cargo.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cached_property
from itertools import product
from typing import NamedTuple

from oag.model.symbols import ANY, GRIPPER, Fact, Value

Reader = Callable[[Fact], Value]
_Writes = dict[Fact, Value]
# Where an item rests, and relations that motion of an item makes unknown.
RESTING = ("ontop", "inside")
VAGUE = ("nextto", "touching", "under")
# Beginnings of towers that are continued, the lowest first: all of them where it is known what rests where.
_MOST_TOWERS = 1_000


def is_place(fact: Fact) -> bool:
    """Decide whether a fact says where a thing is."""
    return len(fact) == 3 and fact[0] in RESTING


class Carriage(NamedTuple):
    """Who may carry whom in a plan, and what may be inside what.

    Attributes:
        riders: Pairs of an item and what may rest on or in it, directly or through others.
        places: Pairs of a thing and what it may be on or inside of, as pairs (relation, place).
    """

    riders: tuple[tuple[str, tuple[str, ...]], ...] = ()
    places: tuple[tuple[str, tuple[tuple[str, str], ...]], ...] = ()

    def riding(self, carrier: str) -> tuple[str, ...]:
        """Return what an item may carry."""
        return next((things for name, things in self.riders if name == carrier), ())

    def places_of(self, thing: str) -> tuple[tuple[str, str], ...]:
        """Return the relations that a thing may have to others."""
        return next((found for name, found in self.places if name == thing), ())

    def around(self, thing: str) -> tuple[str, ...]:
        """Return what a thing may be inside of."""
        return tuple(place for relation, place in self.places_of(thing) if relation == "inside")


NOTHING_CARRIED = Carriage()


def carriage_of(
    objects: Iterable[str], items: Collection[str], stated: Mapping[Fact, Value], placed: Iterable[Fact]
) -> Carriage:
    """Return who may carry whom.

    Args:
        objects: Ids of all things.
        items: Ids of those that can be carried.
        stated: What is known of the start, with patterns.
        placed: The facts that goals of the plan place their targets by.
    """
    names = dict.fromkeys(objects)
    resting: set[Fact] = {f for f, value in stated.items() if value is True and is_place(f)}
    resting |= set(placed)
    for relation in RESTING:
        if stated.get((relation, ANY, ANY)) is not False:
            resting |= set(_open_facts(relation, names, items, stated))
    resting = {fact for fact in resting if fact[1] != fact[2] and GRIPPER not in fact and fact[1] in names}
    # Nothing carries, and no furniture is inside furniture: the usual plan.
    if all(thing in items and place not in items for _, thing, place in resting):
        return NOTHING_CARRIED
    above: dict[str, dict[str, None]] = {}
    for _, thing, place in sorted(resting):
        above.setdefault(place, {})[thing] = None
    within = closed(resting)
    riders = {name: tuple(thing for thing in reached(name, above) if thing in items) for name in names}
    places: dict[str, list[tuple[str, str]]] = {}
    for relation, thing, place in sorted(within):
        places.setdefault(thing, []).append((relation, place))
    return Carriage(
        tuple((name, things) for name, things in riders.items() if name in items and things),
        tuple((name, tuple(found)) for name, found in places.items()),
    )


def _open_facts(
    relation: str, names: Collection[str], items: Collection[str], stated: Mapping[Fact, Value]
) -> Iterator[Fact]:
    for thing in (name for name in names if name in items):
        for place in names:
            covering = ((relation, thing, place), (relation, thing, ANY), (relation, ANY, place))
            if next((stated[fact] for fact in covering if fact in stated), None) is None:
                yield relation, thing, place


def reached(name: str, steps: Mapping[str, Mapping[str, None]]) -> tuple[str, ...]:
    """Return what can be reached from a name in one step or more, itself left out."""
    found: dict[str, None] = {}
    pending = [name]
    while pending:
        for thing in steps.get(pending.pop(), ()):
            if thing not in found and thing != name:
                found[thing] = None
                pending.append(thing)
    return tuple(found)


def below(name: str, resting: Collection[Fact]) -> tuple[str, ...]:
    """Return what a thing rests on or in by some facts, directly or through others."""
    under: dict[str, dict[str, None]] = {}
    for _, thing, place in sorted(resting):
        under.setdefault(thing, {})[place] = None
    return reached(name, under)


def denied(resting: Iterable[Fact], stated: Mapping[Fact, Value]) -> set[Fact]:
    """Return what is not so of carriers: they are inside nothing that their cargo is known not to be inside."""
    if stated.get(("inside", ANY, ANY)) is False:
        return set()
    outside = [fact for fact, value in stated.items() if value is False and is_place(fact) and fact[0] == "inside"]
    under: dict[str, dict[str, None]] = {}
    for _, thing, place in sorted(resting) if outside else ():
        under.setdefault(thing, {})[place] = None
    found: set[Fact] = {("inside", place, f[2]) for f in outside for place in reached(f[1], under) if place != f[2]}
    return found - stated.keys()


def closed(resting: Iterable[Fact]) -> set[Fact]:
    """Return facts about places with what follows: a thing is inside whatever its carrier is inside."""
    found = set(resting)
    new = set(found)
    while new:
        inside: dict[str, set[str]] = {}
        for relation, thing, place in found:
            if relation == "inside":
                inside.setdefault(thing, set()).add(place)
        implied: set[Fact] = {
            ("inside", thing, outer) for _, thing, place in found for outer in inside.get(place, ()) if outer != thing
        }
        new = implied - found
        found |= new
    return found


def circle(resting: Iterable[Fact]) -> tuple[Fact, ...]:
    """Return facts of which each thing rests on or in the next, and the last on or in the first; () without any."""
    below: dict[str, dict[str, Fact]] = {}
    for fact in resting:
        below.setdefault(fact[1], {})[fact[2]] = fact
    for start in below:
        pending: list[tuple[str, tuple[Fact, ...]]] = [(start, ())]
        visited: set[str] = set()
        while pending:
            name, path = pending.pop()
            for place, fact in below.get(name, {}).items():
                if place == start:
                    return (*path, fact)
                if place not in visited:
                    visited.add(place)
                    pending.append((place, (*path, fact)))
    return ()


def towers(carriage: Carriage, above: str, below: str) -> Iterator[tuple[Fact, ...]]:
    """Yield the ways in which a thing may stand on or in another: chains of facts that would all hold.

    Of towers that are too many to be listed, the first fact and the last one are yielded, which hold in each of them.
    """
    pending: list[tuple[str, tuple[Fact, ...]]] = [(above, ())]
    riding = carriage.riding(below)
    unfinished: dict[Fact, None] = {}
    for name, path in pending:
        for relation, place in carriage.places_of(name):
            chain = (*path, (relation, name, place))
            # What is in a thing that is in another is in that one too, so that only the first may be inside.
            if path and relation != "ontop":
                continue
            if place == below:
                yield chain
            elif place in riding and all(fact[1] != place for fact in path):
                if len(pending) < _MOST_TOWERS:
                    pending.append((place, chain))
                else:
                    unfinished[chain[0]] = None
    last = [("ontop", name, below) for name in riding if unfinished and ("ontop", below) in carriage.places_of(name)]
    yield from product(unfinished, last)


class Starts:
    """What can be so where a plan starts, by what carries what: no circles, and cargo is inside what its carrier is in.

    Attributes:
        carriage: Who may carry whom.
    """

    def __init__(self, carriage: Carriage, read: Reader) -> None:
        """Take what is known of the start as a reader of facts."""
        self.carriage, self._read = carriage, read
        places = ((relation, thing, place) for thing, found in carriage.places for relation, place in found)
        self._true = {fact for fact in places if read(fact) is True}

    def exclude(self, fact: Fact, value: bool, given: Mapping[Fact, Value]) -> bool:
        """Decide whether no start gives a fact a value, where others have the given values."""
        if self.carriage == NOTHING_CARRIED or not is_place(fact):
            return False
        stated = {**given, fact: value}
        true = self._true | {each for each, truth in stated.items() if truth is True and is_place(each)}
        follows = (stated[each] if each in stated else self._read(each) for each in closed(true) - self._true)
        return bool(circle(true)) or False in follows


class Load:
    """What a carried item carries at one moment."""

    def __init__(self, carriage: Carriage, carrier: str, read: Reader) -> None:
        self._carriage, self._carrier, self._read = carriage, carrier, read

    @cached_property
    def riding(self) -> dict[str, bool | None]:
        """Whether each thing that may ride does, None where that is unknown; what does not is left out."""
        riders = self._carriage.riding(self._carrier)
        known: dict[str, bool | None] = {self._carrier: True}
        # Known ones first: what is known through one carrier is not made unknown through another.
        for wanted in (True, None):
            grown = True
            while grown:
                grown = False
                for thing in riders:
                    if thing not in known and self._rests(thing, known, sure=wanted is True):
                        known[thing] = wanted
                        grown = True
        del known[self._carrier]
        return known

    def _rests(self, thing: str, known: Mapping[str, bool | None], *, sure: bool) -> bool:
        for relation, place in self._carriage.places_of(thing):
            if place in known:
                value = self._read((relation, thing, place))
                if (value is True and known[place] is True) if sure else value is not False:
                    return True
        return False

    def carried_off(self, kept: Callable[[Fact], bool]) -> _Writes:
        """Return what a motion writes: cargo leaves all places but those that come along, and those that are kept."""
        written: _Writes = {}
        moving = {self._carrier: True, **self.riding}
        for thing, sure in self.riding.items():
            for relation, place in self._carriage.places_of(thing):
                fact = (relation, thing, place)
                if moving.get(place, False) is True or kept(fact) or self._read(fact) is False:
                    continue
                written[fact] = False if sure is True and place not in moving else None
            for relation in VAGUE:
                written[relation, thing, ANY] = written[relation, ANY, thing] = None
        return written

    def set_down(self, relation: str, support: str) -> _Writes:
        """Return what a release on or in a support writes: it and its cargo are inside what the support is inside."""
        read, written = self._read, dict[Fact, Value]()
        around: dict[str, Value] = {place: read(("inside", support, place)) for place in self._carriage.around(support)}
        moved: dict[str, bool | None] = {self._carrier: True, **self.riding}
        # Nothing is put on what it carries: the support stays where it is.
        moved.pop(support, None)
        for thing, sure in moved.items():
            own = {support: True, **around} if relation == "inside" and thing != self._carrier else around
            for place, value in own.items():
                fact = ("inside", thing, place)
                # Where a thing is already, it stays if it is not carried; if it is, it is where the support is.
                known = read(fact)
                if value is False or place in (thing, self._carrier) or (known is True and value is True):
                    continue
                written[fact] = True if sure is True and value is True else None
        return written
