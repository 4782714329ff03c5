"""From the words of a noun phrase to the objects of the scene that they name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import bddl
from llm.offline.commands import BESIDES, NounPhrase, Place
from llm.offline.lexicon import Lexicon
from llm.offline.refusal import Refusal
from llm.offline.spatial import beside, on_side
from llm.surroundings import Surroundings

_RELATION = {"IN": "inside", "INTO": "inside", "ON": "ontop", "ONTO": "ontop"}


@dataclass(frozen=True, slots=True)
class Grounded:
    """An object that a phrase names.

    Attributes:
        object_id: Its id.
        by_surface: Whether it was named by its top ("countertop").
        by_door: Whether it was named by its door.
        notes: What had to be taken on trust.
    """

    object_id: str
    by_surface: bool = False
    by_door: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Named:
    """Objects that bear a name, and the describing words before it that nothing in the scene can confirm."""

    ids: tuple[str, ...]
    name: str
    descriptions: tuple[str, ...] = ()
    passed_over: tuple[str, ...] = ()
    by_door: bool = False
    plural: bool = False


@dataclass(frozen=True, slots=True)
class Grounding:
    """Names objects of one scene.

    Attributes:
        around: The scene and its facts.
        lexicon: What things are called.
    """

    around: Surroundings
    lexicon: Lexicon

    def one(self, phrase: NounPhrase, source: Place | None = None) -> Grounded:
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
        ids = self._narrowed(named.ids, phrase, source)
        if phrase.side is not None:
            ids = on_side(ids, phrase.side, self.around.scene)
        if len(ids) > 1:
            raise Refusal(
                "ambiguous-object",
                f'"{phrase}" can mean {" or ".join(ids)}; say which one by its id',
                scene=[self.around.described(key) for key in ids],
            )
        return self._grounded(ids[0], named)

    def every(self, phrase: NounPhrase, source: Place | None = None) -> tuple[Grounded, ...]:
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
        ids = self._narrowed(named.ids, phrase, source)
        wanted = phrase.count
        if wanted is not None and len(ids) > wanted:
            raise Refusal(
                "ambiguous-object",
                f'"{phrase}" can mean any {wanted} of {", ".join(ids)}; say which ones by their ids',
                scene=[self.around.described(key) for key in ids],
            )
        if len(ids) < (wanted or (1 if phrase.several else 2)):
            raise Refusal(
                "several-objects",
                f'"{phrase}" speaks of {wanted or "several"} objects, and the scene has {len(ids)} of them: '
                f"{', '.join(ids)}",
            )
        return tuple(self._grounded(key, named) for key in ids)

    def items(self, phrase: NounPhrase, source: Place | None, besides: Sequence[str]) -> tuple[Grounded, ...]:
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
        for place in (phrase.location, source):
            if place is not None and ids:
                ids = self._held_by(ids, place)
        if not ids:
            where = next((f" {place}" for place in (phrase.location, source) if place is not None), "")
            raise Refusal("already-so", f"there is nothing{where} to move")
        return tuple(Grounded(key) for key in ids)

    def _held_by(self, ids: tuple[str, ...], place: Place) -> tuple[str, ...]:
        """Returns those of the objects that stand at a place themselves, not on something that stands there."""
        if place.direction in BESIDES:
            return self._at(ids, place)
        where = self.one(place.phrase).object_id
        relation = _RELATION.get(place.direction)
        return tuple(
            key
            for key in ids
            if any(s.object_id == where and relation in (None, s.relation) for s in self.around.supports(key))
        )

    def mentioned(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """Returns the objects that any run of words names, for suggestions."""
        found: dict[str, None] = {}
        for start in range(len(words)):
            for stop in range(len(words), start, -1):
                found.update(dict.fromkeys(self._by_name(" ".join(words[start:stop])).ids))
        return tuple(found)

    def _grounded(self, object_id: str, named: _Named) -> Grounded:
        """Returns an object with what its name says and leaves open."""
        notes = [
            f'"{word}" is taken on trust: the scene does not describe {object_id} so' for word in named.descriptions
        ]
        if named.passed_over:
            notes.append(
                f'"{named.name}" is the name of {object_id} itself; {", ".join(named.passed_over)} was passed over'
            )
        entry = self.lexicon.category_of(self.around.scene.objects[object_id].category)
        by_surface = entry is not None and named.name in entry.surface_names
        return Grounded(object_id, by_surface, named.by_door, tuple(notes))

    def _of_one_name(self, phrase: NounPhrase) -> NounPhrase:
        """Returns "the bottle of medicine" as one name where something is called so, and else as it is."""
        owner = phrase.owner
        if owner is None or owner.pronoun or owner.owner is not None:
            return phrase
        words = (*phrase.words, "of", *owner.words)
        if not self._described(words).ids:
            return phrase
        return replace(phrase, words=words, owner=None, location=owner.location, door=False)

    def _bearers(self, phrase: NounPhrase) -> _Named:
        """Returns the objects that the words alone name."""
        if phrase.pronoun:
            raise Refusal("not-understood", f'"{phrase}" does not say which object is meant')
        if phrase.owner is not None:
            return self._owned(phrase, phrase.owner)
        named = self._described(phrase.words)
        if not named.ids and phrase.door:
            named = self._doors(phrase)
        if named.ids:
            return named
        for singular in _singulars(phrase.words[-1]):
            named = self._described((*phrase.words[:-1], singular))
            if named.ids:
                return replace(named, plural=not phrase.one_of)
        raise self._unknown(phrase)

    def _narrowed(self, ids: tuple[str, ...], phrase: NounPhrase, source: Place | None) -> tuple[str, ...]:
        """Returns those of the objects that are as the phrase says, and stand where it says."""
        ids = self._in_state(phrase, ids)
        for place in (phrase.location, source):
            ids = self._at(ids, place)
        return ids

    def _described(self, words: tuple[str, ...]) -> _Named:
        """Returns the objects named by the longest ending that is a name, if only descriptions precede it."""
        for start in range(len(words)):
            before = words[:start]
            if all(word in self.lexicon.descriptions for word in before):
                named = self._by_name(" ".join(words[start:]))
                if named.ids:
                    return _Named(named.ids, named.name, before, named.passed_over)
        return _Named((), " ".join(words))

    def _by_name(self, name: str) -> _Named:
        """Returns the objects of a name; an object's own name counts before a name of its kind."""
        own: list[str] = []
        of_kind: list[str] = []
        for key, thing in self.around.scene.objects.items():
            names = self.lexicon.names_of(thing)
            if name in names[0]:
                own.append(key)
            elif name in names[1]:
                of_kind.append(key)
        if own:
            return _Named(tuple(own), name, passed_over=tuple(of_kind))
        return _Named(tuple(of_kind), name)

    def _owned(self, phrase: NounPhrase, owner: NounPhrase) -> _Named:
        """Returns the object meant by "the door of X" or "the countertop of X"."""
        whole = self.one(owner).object_id
        words = " ".join(phrase.words)
        part = self._by_name(words).ids
        is_door = phrase.door and self.around.affordances[whole].door
        if not is_door and whole not in part:
            raise Refusal("unknown-object", f'{whole} has no "{words}" that can be told apart from it')
        return _Named((whole,), words, by_door=whole not in part)

    def _doors(self, phrase: NounPhrase) -> _Named:
        """Returns the objects whose door is meant: those of the name before the word, or all that have one."""
        before = phrase.words[:-1]
        with_door = tuple(key for key, can in self.around.affordances.items() if can.door)
        if not before:
            return _Named(with_door, "door", by_door=True)
        named = self._described(before)
        return _Named(tuple(key for key in named.ids if key in with_door), named.name, named.descriptions, by_door=True)

    def _in_state(self, phrase: NounPhrase, ids: tuple[str, ...]) -> tuple[str, ...]:
        """Returns those of the objects that are open or closed as the phrase says."""
        for state in phrase.states:
            fitting = tuple(key for key in ids if self.around.is_open(key) is (state == "open"))
            if not fitting:
                raise Refusal(
                    "wrong-place",
                    f'no "{phrase}" of the scene is {state}',
                    scene=[self.around.described(key) for key in ids],
                )
            ids = fitting
        return ids

    def _at(self, ids: tuple[str, ...], place: Place | None) -> tuple[str, ...]:
        """Returns those of the objects that stand where the place says."""
        if place is None:
            return ids
        phrase = self._of_one_name(place.phrase)
        supports = self._in_state(phrase, self._bearers(phrase).ids)
        supports = self._at(supports, phrase.location)
        if phrase.side is not None:
            supports = on_side(supports, phrase.side, self.around.scene)
        if place.direction in BESIDES:
            return self._beside(ids, place, supports)
        relation = _RELATION.get(place.direction)
        fitting = tuple(
            key
            for key in ids
            if any(s.object_id in supports and relation in (None, s.relation) for s in self.around.chain(key))
        )
        if fitting:
            return fitting
        stands = "; ".join(
            f"{key} is {self.around.support(key) or 'at a place that the scene does not state'}" for key in ids
        )
        raise Refusal(
            "wrong-place",
            f"{' or '.join(ids)} is not {'on or in' if relation is None else place.preposition} "
            f"{' or '.join(supports)}: {stands}",
        )

    def _beside(self, ids: tuple[str, ...], place: Place, others: tuple[str, ...]) -> tuple[str, ...]:
        """Returns those of the objects that stand beside what the place names."""
        fitting = beside(ids, place.direction, others, self.around.scene)
        if not fitting:
            raise Refusal(
                "wrong-place",
                f"{' or '.join(ids)} is not {place.preposition} {' or '.join(others)}, seen from the robot's start",
                scene=[f"{key} is {self.around.bearing(key)}" for key in (*ids, *others)],
            )
        return fitting

    def _unknown(self, phrase: NounPhrase) -> Refusal:
        """Returns the refusal of a name that nothing in the scene bears, with the nearest names."""
        objects = self.around.scene.objects
        wanted = " ".join(phrase.words)
        names = {name: key for key, thing in objects.items() for tier in self.lexicon.names_of(thing) for name in tier}
        near = {names[name]: name for name in reversed(bddl.near_names(wanted, sorted(names)))}
        meant = [name if name == key else f"{name} ({key})" for key, name in reversed(near.items())]
        return Refusal(
            "unknown-object",
            f'nothing in {self.around.scene.name} is called "{wanted}"'
            + (f"; did you mean {' or '.join(meant)}?" if meant else ""),
            scene=[self.around.described(key) for key in objects],
        )


def _singulars(word: str) -> tuple[str, ...]:
    """Returns what a plural may be the plural of; empty for a word that is none."""
    endings = (("shelves", "shelf"), ("knives", "knife"), ("ies", "y"), ("es", ""), ("s", ""))
    return tuple(word.removesuffix(many) + one for many, one in endings if word.endswith(many) and word != many)
