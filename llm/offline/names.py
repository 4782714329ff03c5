"""What the objects of a scene are called: by their ids, by their kinds, by their parts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import bddl
from llm.offline.lexicon import Category, Lexicon, names_of
from llm.offline.reader import NounPhrase
from llm.offline.surroundings import Affordances, Front, Surroundings
from llm.offline.wish import Refusal, alternatives
from oag import Scene


@dataclass(frozen=True, slots=True)
class Named:
    """Objects that bear a name, the describing words before it that nothing in the scene can confirm, and notes."""

    ids: tuple[str, ...]
    name: str
    descriptions: tuple[str, ...] = ()
    passed_over: tuple[str, ...] = ()
    by_door: bool = False
    plural: bool = False
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Names:
    """Which objects of a scene bear a name.

    Attributes:
        scene: The scene.
        affordances: What can be done with each object.
        lexicon: What things are called.
        entries: The lexicon's entry of each category of the scene.
        bearers: For each name, the objects that it fits best, then those that it fits less.
        words: Every word of a name, of the scene's and of the lexicon's.
    """

    scene: Scene
    affordances: Mapping[str, Affordances]
    lexicon: Lexicon
    entries: Mapping[str, Category | None]
    bearers: Mapping[str, Sequence[Sequence[str]]]
    words: frozenset[str]

    @classmethod
    def of(cls, around: Surroundings, lexicon: Lexicon, entries: Mapping[str, Category | None]) -> Self:
        """Returns the names of a scene's objects; `entries` are the lexicon's of their categories."""
        objects = around.scene.objects
        bearers: dict[str, tuple[list[str], ...]] = {}
        for key, thing in objects.items():
            tiers = names_of(thing, entries[thing.category])
            for rank, names in enumerate(tiers):
                for name in names:
                    bearers.setdefault(name, tuple([] for _ in tiers))[rank].append(key)
        known = (*bearers, *(name for entry in lexicon.categories.values() for name in entry.names))
        words = frozenset(word for name in known for word in name.split())
        return cls(around.scene, around.affordances, lexicon, entries, bearers, words)

    def knows(self, word: str) -> bool:
        """Decides whether a word, or what it may be the plural of, is a part of any name or may stand before one."""
        if word in self.lexicon.descriptions or word in self.lexicon.which:
            return True
        return any(form in self.words for form in (word, *singulars(word)))

    def mentioned(self, words: Sequence[str]) -> tuple[str, ...]:
        """Returns the objects that any run of words names, for suggestions."""
        longest = max((name.count(" ") + 1 for name in self.bearers), default=0)
        found: dict[str, None] = {}
        for start in range(len(words)):
            for stop in range(min(len(words), start + longest), start, -1):
                found.update(dict.fromkeys(self.by_name(" ".join(words[start:stop])).ids))
        return tuple(found)

    def described(self, words: tuple[str, ...]) -> Named:
        """Returns the objects named by the longest ending that is a name, if only descriptions precede it."""
        for start in range(len(words)):
            named = self.by_name(" ".join(words[start:]))
            if named.ids:
                return Named(named.ids, named.name, words[:start], named.passed_over)
            if words[start] not in self.lexicon.descriptions:
                break
        return Named((), " ".join(words))

    def by_name(self, name: str) -> Named:
        """Return the objects that a name fits best, in the order of `names_of`; the others were passed over."""
        tiers = [tier for tier in self.bearers.get(name, ()) if tier]
        if not tiers:
            return Named((), name)
        return Named(tuple(tiers[0]), name, passed_over=tuple(key for tier in tiers[1:] for key in tier))

    def doors(self, phrase: NounPhrase, front: Front) -> Named:
        """Returns the objects whose door or drawer is meant: those of the name before the word, or all that have one.

        Raises:
            Refusal: None of them is known to have one, or the words say which one of an object's is meant.
        """
        before = phrase.words[:-1]
        named = self.described(before) if before else Named(tuple(self.affordances), phrase.words[-1])
        if phrase.side is not None and (not before or len(named.ids) == 1):
            # "The left cabinet door" of several cabinets is that of the left one.
            raise self.untold(phrase, (phrase.side,))
        if not named.ids:
            return named
        ids = tuple(key for key in named.ids if self.affordances[key].opens_by(front))
        if not ids:
            raise self.without(named.ids, front, by_name=bool(before))
        return Named(ids, named.name, named.descriptions, by_door=True)

    def door_of(self, whole: str, phrase: NounPhrase) -> Named:
        """Returns an object whose door or drawer is meant.

        Args:
            whole: The object.
            phrase: What is said before "of".

        Raises:
            Refusal: It has no such part, or is not known to have one, or the words say which one of several is meant.
        """
        before, front = phrase.words[:-1], phrase.front
        which = (*((phrase.side,) if phrase.side else ()), *self._which(before))
        if front is not None and which:
            raise self.untold(phrase, which)
        named = all(word in self.lexicon.descriptions for word in before)
        if front is None or not named or not self.affordances[whole].door:
            problem = f'{whole} has no "{" ".join(phrase.words)}" that can be told apart from it'
            raise Refusal("unknown-object", problem)
        if not self.affordances[whole].opens_by(front):
            raise self.without((whole,), front, by_name=True)
        return Named((whole,), " ".join(phrase.words), before, by_door=True)

    def without(self, ids: Iterable[str], front: Front, *, by_name: bool) -> Refusal:
        """Returns the refusal of a door or drawer that objects are not known to have."""
        can_open = [key for key in ids if self.affordances[key].door]
        has = [_opened_by(key, self.affordances[key]) for key in can_open]
        if by_name and has:
            return Refusal("affordance", f"{has[0]}; no plan opens a {front} of it")
        return Refusal("unknown-object", f"nothing in {self.scene.name} is known to open by a {front}", scene=has)

    def unknown(self, phrase: NounPhrase, around: Surroundings) -> Refusal:
        """Returns the refusal of a name that nothing in the scene bears, with the nearest names."""
        which = self._which(phrase.words)
        if which:
            return self.untold(phrase, which)
        wanted = " ".join(phrase.words)
        return Refusal(
            "unknown-object",
            f'nothing in {self.scene.name} is called "{wanted}"{self.meant(wanted)}',
            scene=[around.described(key) for key in self.scene.objects],
        )

    def meant(self, *wanted: str) -> str:
        """Returns the question whether one of the nearest names of the scene was meant; empty where none is near."""
        near: dict[tuple[str, ...], str] = {}
        for words in wanted:
            for name in bddl.near_names(words, sorted(self.bearers)):
                near.setdefault(self.by_name(name).ids, name)
        meant = [name if ids == (name,) else f"{name} ({alternatives(ids)})" for ids, name in near.items()]
        return f"; did you mean {' or '.join(meant)}?" if meant else ""

    def untold(self, phrase: NounPhrase, which: Sequence[str]) -> Refusal:
        """Returns the refusal of words that say which of several is meant, as no plan can."""
        said = " and ".join(f'"{word}"' for word in which)
        if phrase.door:
            problem = f"{said} says which {phrase.words[-1]} is meant, and a plan opens and closes a thing as a whole"
        else:
            problem = f"{said} says which of several is meant, and nothing in {self.scene.name} tells that"
        return Refusal("unknown-object", f"{problem}; name the object alone, by its id where there are several")

    def _which(self, words: Sequence[str]) -> tuple[str, ...]:
        return tuple(word for word in words if word in self.lexicon.which)


def _opened_by(key: str, can: Affordances) -> str:
    if not can.fronts:
        return f"neither the category nor the model of {key} says whether it has doors or drawers"
    return f"{key} opens by its {'doors' if can.opens_by('door') else 'drawers'}"


def singulars(word: str) -> tuple[str, ...]:
    """Returns what a plural may be the plural of; empty for a word that is none."""
    endings = (("shelves", "shelf"), ("knives", "knife"), ("ies", "y"), ("es", ""), ("s", ""))
    return tuple(word.removesuffix(many) + one for many, one in endings if word.endswith(many) and word != many)
