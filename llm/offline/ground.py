"""From the words of a noun phrase to the objects of the scene that they name."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

from llm.offline.lexicon import Lexicon
from llm.offline.names import Named, Names, singulars
from llm.offline.reader import BESIDES, Direction, Location, NounPhrase, Side
from llm.offline.surroundings import Surroundings
from llm.offline.wish import Refusal, alternatives
from oag import Scene, SceneObject
from oag.task.sizes import TO_THE_AIM, Sizing

# Two things are beside each other when the gap between their boxes is at most this wide.
BESIDE_M = 0.20
# What differs by less than this is neither left nor right, nor nearer.
MARGIN_M = 0.05
_RELATION = {"IN": "inside", "INTO": "inside", "ON": "ontop", "ONTO": "ontop"}


@dataclass(frozen=True, slots=True)
class Grounded:
    """An object that a phrase names.

    Attributes:
        object_id: Its id.
        by_surface: Whether it was named by its top ("countertop").
        by_door: Whether it was named by its door.
        notes: What had to be taken on trust.
        hollow: Whether what it was named by is a part that holds things itself, such as a drawer.
    """

    object_id: str
    by_surface: bool = False
    by_door: bool = False
    notes: tuple[str, ...] = ()
    hollow: bool = False


# Objects, with what was taken on trust to find them.
_Noted = tuple[tuple[str, ...], tuple[str, ...]]


@dataclass(frozen=True, slots=True)
class Grounding:
    """Names objects of one scene.

    Attributes:
        around: The scene and its facts, as they are when the words are said.
        names: What its objects are called.
    """

    around: Surroundings
    names: Names

    @classmethod
    def of(cls, scene: Scene, lexicon: Lexicon, sizing: Sizing = TO_THE_AIM) -> Self:
        """Returns what names the objects of a scene at its start."""
        entries = {thing.category: lexicon.category_of(thing.category) for thing in scene.objects.values()}
        listed = {category: entry.affordances for category, entry in entries.items() if entry is not None}
        around = replace(Surroundings.of(scene, listed), sizing=sizing)
        return cls(around, Names.of(around, lexicon, entries))

    def one(self, phrase: NounPhrase, source: Location | None = None) -> Grounded:
        """Returns the one object that a phrase names.

        Args:
            phrase: The words.
            source: Where the object is said to be taken from; it must stand there.

        Raises:
            Refusal: The scene has no such object, or more than one, or it stands elsewhere.
        """
        if phrase.several:
            raise Refusal("several-objects", f'"{phrase}" means several objects where one is needed')
        phrase = self._of_one_name(phrase)
        named = self._bearers(phrase)
        if named.plural:
            raise Refusal("several-objects", f'"{phrase}" means several objects where one is needed')
        ids, notes = self._narrowed(named.ids, phrase, source)
        ids, more = self._on_side(ids, phrase)
        if len(ids) > 1:
            problem = f'"{phrase}" can mean {alternatives(ids)}; say which one by its id'
            raise Refusal("ambiguous-object", problem, scene=list(map(self.around.described, ids)))
        return self._grounded(ids[0], named, phrase, (*more, *notes))

    def every(self, phrase: NounPhrase, source: Location | None = None) -> tuple[Grounded, ...]:
        """Returns all objects that a phrase names: one for "the glass", each for "all glasses" and "the glasses".

        Args:
            phrase: The words; not those for all items whatever they are called.
            source: Where the objects are said to be taken from; those are meant that stand there.

        Raises:
            Refusal: The scene has none, or not as many as the phrase says.
        """
        phrase = self._of_one_name(phrase)
        named = self._bearers(phrase)
        if not phrase.several and not named.plural:
            return (self.one(phrase, source),)
        ids, notes = self._narrowed(named.ids, phrase, source)
        wanted = phrase.count
        if wanted is not None and len(ids) > wanted:
            problem = f'"{phrase}" can mean any {wanted} of {alternatives(ids, ", ")}; say which ones by their ids'
            raise Refusal("ambiguous-object", problem, scene=list(map(self.around.described, ids)))
        if len(ids) < (wanted or (1 if phrase.several else 2)):
            problem = f'"{phrase}" speaks of {wanted or "several"} objects, and the scene has {len(ids)} of them'
            raise Refusal("several-objects", f"{problem}: {alternatives(ids, ', ')}")
        return tuple(self._grounded(key, named, phrase, notes) for key in ids)

    def items(self, phrase: NounPhrase, source: Location | None, besides: Sequence[str]) -> tuple[Grounded, ...]:
        """Returns the items that "everything" means, those that stand in or on another item left out.

        Args:
            phrase: The words, with the place that they may name.
            source: Where they are said to be taken from.
            besides: What is not meant, since it is where the items go.
        """
        scene = self.around.scene
        own = {*besides, *(step.object_id for key in besides for step in self.around.chain(key))}
        others = [key for key, thing in scene.objects.items() if thing.role == "B" and key not in own]
        ids = tuple(key for key in others if not any(s.object_id in others for s in self.around.supports(key)))
        notes: tuple[str, ...] = ()
        for place in (phrase.location, source):
            if place is not None and ids:
                ids, more = self._held_by(ids, place)
                notes += more
        if not ids:
            where = next((f" {place}" for place in (phrase.location, source) if place is not None), "")
            raise Refusal("already-so", f"there is nothing{where} to move")
        return tuple(Grounded(key, notes=notes) for key in ids)

    def _held_by(self, ids: tuple[str, ...], place: Location) -> _Noted:
        """Returns those of the objects that stand at a place themselves, not on something that stands there."""
        if place.direction in BESIDES:
            return self._at(ids, place)
        named = self.one(place.phrase)
        relation = _RELATION.get(place.direction)
        held = tuple(
            key
            for key in ids
            if any(s.object_id == named.object_id and relation in (None, s.relation) for s in self.around.supports(key))
        )
        return held, named.notes

    def _grounded(self, object_id: str, named: Named, phrase: NounPhrase, more: tuple[str, ...]) -> Grounded:
        notes = [*named.notes, *_on_trust(named.descriptions, (object_id,)), *more]
        if named.passed_over:
            others = alternatives(named.passed_over, ", ")
            notes.append(f'"{named.name}" fits {object_id} best; {others} was passed over')
        entry = self.names.entries[self.around.scene.objects[object_id].category]
        by_surface = entry is not None and named.name in entry.surface_names
        part = self.names.lexicon.category_of(phrase.words[-1]) if named.by_door else None
        hollow = part is not None and part.affordances.interior
        return Grounded(object_id, by_surface, named.by_door, tuple(notes), hollow)

    def _of_one_name(self, phrase: NounPhrase) -> NounPhrase:
        """Returns "the bottle of medicine" as one name where something is called so, and else as it is."""
        owner = phrase.owner
        if owner is None or owner.pronoun or owner.owner is not None:
            return phrase
        words = (*phrase.words, "of", *owner.words)
        if not self.names.described(words).ids:
            return phrase
        return replace(phrase, words=words, owner=None, location=owner.location, door=False)

    def _bearers(self, phrase: NounPhrase) -> Named:
        if phrase.pronoun:
            raise Refusal("not-understood", f'"{phrase}" does not say which object is meant')
        if phrase.owner is not None:
            return self._owned(phrase, phrase.owner)
        named = self.names.described(phrase.words)
        if not named.ids and phrase.front is not None:
            named = self.names.doors(phrase, phrase.front)
        if named.ids:
            return named
        for singular in singulars(phrase.words[-1]):
            named = self.names.described((*phrase.words[:-1], singular))
            if named.ids:
                return replace(named, plural=not phrase.one_of)
        raise self.names.unknown(phrase, self.around)

    def _narrowed(self, ids: tuple[str, ...], phrase: NounPhrase, source: Location | None) -> _Noted:
        ids = self._in_state(phrase, ids)
        notes: tuple[str, ...] = ()
        for place in (phrase.location, source):
            if place is not None:
                ids, more = self._at(ids, place)
                notes += more
        return ids, notes

    def _owned(self, phrase: NounPhrase, owner: NounPhrase) -> Named:
        """Returns the object meant by "the door of X" or "the countertop of X"."""
        whole = self.one(owner)
        words = " ".join(phrase.words)
        if whole.object_id in self.names.by_name(words).ids:
            return Named((whole.object_id,), words, notes=whole.notes)
        return replace(self.names.door_of(whole.object_id, phrase), notes=whole.notes)

    def _in_state(self, phrase: NounPhrase, ids: tuple[str, ...]) -> tuple[str, ...]:
        for state in phrase.states:
            fitting = tuple(key for key in ids if self.around.is_open(key) is (state == "open"))
            if not fitting:
                problem = f'no "{phrase}" of the scene is {state}'
                raise Refusal("wrong-place", problem, scene=list(map(self.around.described, ids)))
            ids = fitting
        return ids

    def _at(self, ids: tuple[str, ...], place: Location) -> _Noted:
        phrase = self._of_one_name(place.phrase)
        named = self._bearers(phrase)
        supports, notes = self._narrowed(named.ids, phrase, None)
        supports, more = self._on_side(supports, phrase)
        notes = (*named.notes, *_on_trust(named.descriptions, supports), *more, *notes)
        if place.direction in BESIDES:
            fitting = _beside(ids, place.direction, supports, self.around.scene)
            if fitting:
                return fitting, notes
            problem = f"{alternatives(ids)} is not {place.preposition} {alternatives(supports)}"
            bearings = [f"{key} is {self.around.bearing(key)}" for key in (*ids, *supports)]
            raise Refusal("wrong-place", f"{problem}, seen from the robot's start", scene=bearings)
        relation = _RELATION.get(place.direction)
        fitting = tuple(
            key
            for key in ids
            if any(s.object_id in supports and relation in (None, s.relation) for s in self.around.chain(key))
        )
        if fitting:
            return fitting, notes
        unstated = "at a place that the scene does not state"
        stands = alternatives((f"{key} is {self.around.support(key) or unstated}" for key in ids), "; ")
        raise Refusal(
            "wrong-place",
            f"{alternatives(ids)} is not {'on or in' if relation is None else place.preposition} "
            f"{alternatives(supports)}: {stands}",
        )

    def _on_side(self, ids: tuple[str, ...], phrase: NounPhrase) -> _Noted:
        """Returns the object that is on the side that the phrase names; of one alone that is taken on trust."""
        if phrase.side is None:
            return ids, ()
        if len(ids) == 1:
            return ids, _on_trust((phrase.side,), ids)
        return on_side(ids, phrase.side, self.around.scene), ()


def _on_trust(words: Sequence[str], ids: Sequence[str]) -> tuple[str, ...]:
    things = alternatives(ids)
    return tuple(f'"{word}" is taken on trust: the scene does not describe {things} so' for word in words)


def on_side(ids: Sequence[str], side: Side, scene: Scene) -> tuple[str, ...]:
    """Returns the one of the objects that is furthest to the side, or nearest or farthest; all where it is too close.

    Sides are those that the robot sees from its start.
    """
    measure: Callable[[str], float] = {
        "left": lambda key: -left_m(key, scene),
        "right": lambda key: left_m(key, scene),
        "nearest": lambda key: math.hypot(*_from_robot(key, scene)),
        "farthest": lambda key: -math.hypot(*_from_robot(key, scene)),
    }[side]
    return _least(ids, measure)


def _beside(ids: Sequence[str], direction: Direction, others: Sequence[str], scene: Scene) -> tuple[str, ...]:
    """Returns those of the objects that stand to one of the others as a preposition says; none where none does."""
    pairs = [(key, other) for key in ids for other in others if key != other]
    if direction == "CLOSEST":
        gaps = {key: min(gap_m(first, other, scene) for first, other in pairs if first == key) for key, _ in pairs}
        return _least(tuple(gaps), gaps.__getitem__)

    def fits(key: str, other: str) -> bool:
        if direction == "NEXT":
            return gap_m(key, other, scene) <= BESIDE_M
        if direction == "UNDER":
            return is_under(key, other, scene)
        to_the_left_m = left_m(key, scene) - left_m(other, scene)
        return to_the_left_m > MARGIN_M if direction == "LEFTOF" else -to_the_left_m > MARGIN_M

    return tuple(dict.fromkeys(key for key, other in pairs if fits(key, other)))


def left_m(object_id: str, scene: Scene) -> float:
    """Returns how far to the robot's left an object is at the start."""
    dx, dy, yaw_rad = *_from_robot(object_id, scene), scene.robot.yaw_rad
    return dy * math.cos(yaw_rad) - dx * math.sin(yaw_rad)


def gap_m(first: str, second: str, scene: Scene) -> float:
    """Returns the gap between the footprints of two objects, their boxes taken along the axes of the world."""
    one, other = scene.objects[first], scene.objects[second]
    halves = (_half_footprint_m(one), _half_footprint_m(other))
    gaps = (
        max(0.0, abs(one.position[axis] - other.position[axis]) - halves[0][axis] - halves[1][axis]) for axis in (0, 1)
    )
    return math.hypot(*gaps)


def is_under(lower: str, upper: str, scene: Scene) -> bool:
    """Decides whether an object stands below another one: within its footprint the other's middle, its top no higher
    than the other's bottom.
    """
    below, above = scene.objects[lower], scene.objects[upper]
    half = _half_footprint_m(below)
    within = all(abs(above.position[axis] - below.position[axis]) <= half[axis] for axis in (0, 1))
    bottom, top = above.position[2] - above.height_m / 2, below.position[2] + below.height_m / 2
    return within and top <= bottom + MARGIN_M


def _half_footprint_m(thing: SceneObject) -> tuple[float, float]:
    """Half the size, along x and y of the world, of the box around an object that may be turned about z."""
    w, x, y, z = thing.orientation
    cos, sin = abs(1.0 - 2.0 * (y * y + z * z)), abs(2.0 * (x * y + w * z))
    along, across, _ = thing.extent_m
    return (cos * along + sin * across) / 2, (sin * along + cos * across) / 2


def _from_robot(object_id: str, scene: Scene) -> tuple[float, float]:
    place, robot = scene.objects[object_id].position, scene.robot.position
    return place[0] - robot[0], place[1] - robot[1]


def _least(ids: Sequence[str], measure: Callable[[str], float]) -> tuple[str, ...]:
    """Returns the object of the least measure together with all that are too close to it.

    What is too close to call is left undecided, so that the query is refused as ambiguous rather than guessed.
    """
    least = min(map(measure, ids), default=0.0)
    return tuple(key for key in ids if measure(key) <= least + MARGIN_M)
