"""The lexicon: which words belong to which class, what things are called, and what can be done with them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from bddl.boundedfile import read_bounded_text
from llm.affordances import Affordances
from llm.errors import LlmError
from oag import SceneObject

_TERMINAL_TABLES = ("verbs", "prepositions", "sides", "structure")
_IGNORED = ("courtesy", "manner", "descriptions")


class LexiconError(LlmError):
    """A lexicon file holds something that the planner cannot use."""

    def __init__(self, place: str, problem: str) -> None:
        super().__init__(f"lexicon {place}: {problem}")


@dataclass(frozen=True, slots=True)
class Category:
    """One entry: what such a thing is called, and what can be done with it.

    Attributes:
        key: The category.
        names: All its names.
        surface_names: Those of the names that mean its top, such as "countertop".
        affordances: What can be done with it.
    """

    key: str
    names: tuple[str, ...]
    surface_names: frozenset[str]
    affordances: Affordances


@dataclass(frozen=True, slots=True)
class Lexicon:
    """All words of the offline planner.

    Attributes:
        terminals: Phrase (lower case, single blanks) -> terminal of the grammar.
        courtesy: Phrases that are dropped.
        manner: Phrases that are dropped with a note.
        descriptions: Words that may stand before a name without changing what it names.
        categories: Entry by key.
    """

    terminals: Mapping[str, str]
    courtesy: frozenset[str]
    manner: frozenset[str]
    descriptions: frozenset[str]
    categories: Mapping[str, Category]

    @classmethod
    def from_toml(cls, text: str) -> Lexicon:
        """Returns the lexicon that a TOML text of the form of `lexicon.toml` describes.

        Raises:
            LexiconError: The text is no TOML, a table is missing, or a phrase belongs to two classes.
        """
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as problem:
            raise LexiconError("file", f"is no TOML: {problem}") from problem
        for table in (*_TERMINAL_TABLES, "ignored", "categories"):
            if not isinstance(data.get(table), dict):
                raise LexiconError(f"[{table}]", "the table is missing")
        owner: dict[str, str] = {}
        for table in _TERMINAL_TABLES:
            for terminal, phrases in data[table].items():
                _claim(owner, terminal, phrases, f"[{table}] {terminal}")
        terminals = dict(owner)
        for key in _IGNORED[:2]:
            _claim(owner, key, data["ignored"].get(key, []), f"[ignored] {key}")
        return cls(
            terminals=terminals,
            courtesy=frozenset(data["ignored"].get("courtesy", ())),
            manner=frozenset(data["ignored"].get("manner", ())),
            descriptions=frozenset(data["ignored"].get("descriptions", ())),
            categories={key: _category(key, entry) for key, entry in data["categories"].items()},
        )

    def phrases(self, terminal: str) -> tuple[str, ...]:
        """Returns the phrases of a terminal, in the file's order."""
        return tuple(phrase for phrase, name in self.terminals.items() if name == terminal)

    def category_of(self, category: str) -> Category | None:
        """Returns the entry of a scene's category: its own, or that of the words it ends in; None without one."""
        words = category.lower().split(".", 1)[0].replace("-", "_").split("_")
        for start in range(len(words)):
            key = "_".join(words[start:])
            spoken = key.replace("_", " ")
            if key in self.categories:
                return self.categories[key]
            for entry in self.categories.values():
                if spoken in entry.names:
                    return entry
        return None

    def names_of(self, thing: SceneObject) -> tuple[frozenset[str], frozenset[str]]:
        """Returns the names an object has of its own (id, stem of the id, category) and those of its kind."""
        spoken = thing.id.lower().replace("_", " ")
        stem = spoken.rstrip("0123456789 ")
        own = {thing.id.lower(), spoken, stem, thing.category.lower().split(".", 1)[0].replace("_", " ")}
        entry = self.category_of(thing.category)
        return frozenset(own - {""}), frozenset(entry.names if entry else ()) - own


def _claim(owner: dict[str, str], name: str, phrases: Any, place: str) -> None:
    """Files phrases under a class; a phrase of two classes would make the tokens depend on the file's order."""
    if not isinstance(phrases, list) or not all(isinstance(phrase, str) for phrase in phrases):
        raise LexiconError(place, f"expected a list of phrases, got {phrases!r}")
    for phrase in phrases:
        if phrase != " ".join(phrase.lower().split()) or not phrase:
            raise LexiconError(place, f"{phrase!r} is not in lower case with single blanks")
        if owner.setdefault(phrase, name) != name:
            raise LexiconError(place, f"{phrase!r} belongs to {owner[phrase]} already")


def _category(key: str, entry: Any) -> Category:
    """Returns one entry of the categories."""
    if not isinstance(entry, dict) or not isinstance(entry.get("names"), list):
        raise LexiconError(f"[categories.{key}]", "expected a list `names`")
    flags = {flag: bool(entry.get(flag, False)) for flag in ("interior", "surface", "door")}
    surface_names = tuple(entry.get("surface_names", ()))
    return Category(key, (*entry["names"], *surface_names), frozenset(surface_names), Affordances(**flags))


@cache
def built_in() -> Lexicon:
    """Returns the lexicon that the package ships."""
    return Lexicon.from_toml(files("llm.offline").joinpath("lexicon.toml").read_text(encoding="utf-8"))


def load(path: Path) -> Lexicon:
    """Returns the lexicon of a file, for scenes with words of their own."""
    return Lexicon.from_toml(read_bounded_text(path))
