"""From the words of a noun phrase to the one object of the scene that they name."""

from __future__ import annotations

from dataclasses import dataclass

import bddl
from llm.offline.commands import NounPhrase, Place
from llm.offline.lexicon import Lexicon
from llm.offline.refusal import Refusal
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
        named = self._bearers(phrase)
        ids = self._in_state(phrase, named.ids)
        for place in (phrase.location, source):
            ids = self._at(ids, place)
        if len(ids) > 1:
            raise Refusal(
                "ambiguous-object",
                f'"{phrase}" can mean {" or ".join(ids)}; say which one by its id',
                scene=[self.around.described(key) for key in ids],
            )
        notes = [f'"{word}" is taken on trust: the scene does not describe {ids[0]} so' for word in named.descriptions]
        if named.passed_over:
            notes.append(
                f'"{named.name}" is the name of {ids[0]} itself; {", ".join(named.passed_over)} was passed over'
            )
        entry = self.lexicon.category_of(self.around.scene.objects[ids[0]].category)
        return Grounded(ids[0], entry is not None and named.name in entry.surface_names, named.by_door, tuple(notes))

    def mentioned(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """Returns the objects that any run of words names, for suggestions."""
        found: dict[str, None] = {}
        for start in range(len(words)):
            for stop in range(len(words), start, -1):
                found.update(dict.fromkeys(self._by_name(" ".join(words[start:stop])).ids))
        return tuple(found)

    def _bearers(self, phrase: NounPhrase) -> _Named:
        """Returns the objects that the words alone name."""
        if phrase.pronoun:
            raise Refusal("not-understood", f'"{phrase}" does not say which object is meant')
        if phrase.several:
            raise Refusal("several-objects", f'"{phrase}" means several objects; a query is about one object at a time')
        if phrase.owner is not None:
            return self._owned(phrase, phrase.owner)
        named = self._described(phrase.words)
        if not named.ids and phrase.door:
            named = self._doors(phrase)
        if named.ids:
            return named
        singular = [
            word for ending in ("s", "es") if (word := phrase.words[-1].removesuffix(ending)) != phrase.words[-1]
        ]
        if any(self._described((*phrase.words[:-1], word)).ids for word in singular):
            raise Refusal("several-objects", f'"{phrase}" means several objects; a query is about one object at a time')
        raise self._unknown(phrase)

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
        relation = _RELATION.get(place.direction)
        supports = self._in_state(place.phrase, self._bearers(place.phrase).ids)
        supports = self._at(supports, place.phrase.location)
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
