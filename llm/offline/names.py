"""What the objects of a scene are called: by their ids, by their kinds, by their parts."""

from __future__ import annotations

from dataclasses import dataclass

import bddl
from llm.offline.commands import NounPhrase
from llm.offline.lexicon import Lexicon
from llm.offline.refusal import Refusal
from llm.surroundings import Surroundings


@dataclass(frozen=True, slots=True)
class Named:
    """Objects that bear a name, and the describing words before it that nothing in the scene can confirm."""

    ids: tuple[str, ...]
    name: str
    descriptions: tuple[str, ...] = ()
    passed_over: tuple[str, ...] = ()
    by_door: bool = False
    plural: bool = False


@dataclass(frozen=True, slots=True)
class Names:
    """Which objects of a scene bear a name.

    Attributes:
        around: The scene and its facts.
        lexicon: What things are called.
    """

    around: Surroundings
    lexicon: Lexicon

    def mentioned(self, words: tuple[str, ...]) -> tuple[str, ...]:
        """Returns the objects that any run of words names, for suggestions."""
        found: dict[str, None] = {}
        for start in range(len(words)):
            for stop in range(len(words), start, -1):
                found.update(dict.fromkeys(self.by_name(" ".join(words[start:stop])).ids))
        return tuple(found)

    def described(self, words: tuple[str, ...]) -> Named:
        """Returns the objects named by the longest ending that is a name, if only descriptions precede it."""
        for start in range(len(words)):
            before = words[:start]
            if all(word in self.lexicon.descriptions for word in before):
                named = self.by_name(" ".join(words[start:]))
                if named.ids:
                    return Named(named.ids, named.name, before, named.passed_over)
        return Named((), " ".join(words))

    def by_name(self, name: str) -> Named:
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
            return Named(tuple(own), name, passed_over=tuple(of_kind))
        return Named(tuple(of_kind), name)

    def doors(self, phrase: NounPhrase) -> Named:
        """Returns the objects whose door is meant: those of the name before the word, or all that have one."""
        before = phrase.words[:-1]
        with_door = tuple(key for key, can in self.around.affordances.items() if can.door)
        if not before:
            return Named(with_door, "door", by_door=True)
        named = self.described(before)
        return Named(tuple(key for key in named.ids if key in with_door), named.name, named.descriptions, by_door=True)

    def unknown(self, phrase: NounPhrase) -> Refusal:
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


def singulars(word: str) -> tuple[str, ...]:
    """Returns what a plural may be the plural of; empty for a word that is none."""
    endings = (("shelves", "shelf"), ("knives", "knife"), ("ies", "y"), ("es", ""), ("s", ""))
    return tuple(word.removesuffix(many) + one for many, one in endings if word.endswith(many) and word != many)
