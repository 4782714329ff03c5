"""Lexicon of the offline planner: classes of words, names of categories, and what can be done with them."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from bddl.files import read_bounded_text
from llm.errors import LlmError
from llm.offline.intents import CROWNS, FRONTS, PREPOSITION, Affordances, Relation, fronts_in
from oag import SceneObject

_TERMINAL_TABLES = ("verbs", "prepositions", "sides", "structure")
_DROPPED = ("courtesy", "manner", "rooms")
_SIGNS = ("which", "goes", "stands", "upright", "fallen", "people", "foreign")
_COUNTERS = ("units", "vessels", "anything")
_AFTER_THE_NOUN = frozenset({"with", "of", "for", "without"})


class LexiconError(LlmError):
    """A lexicon file has an entry that the planner cannot use."""

    def __init__(self, place: str, problem: str) -> None:
        super().__init__(f"lexicon {place}: {problem}")


@dataclass(frozen=True, slots=True)
class Category:
    """One category: all its names, those of its top such as "countertop", and what can be done with it.

    `waste`: what is thrown away goes there. `ground`: it is what everything stands on, and no place to bring things to.
    `seat`: "in" it is on it. `soft`: like onto a seat, things are put away there last. `fitted`: "under" it is in what
    of this category stands there.
    """

    names: tuple[str, ...]
    surface_names: frozenset[str]
    affordances: Affordances
    waste: bool = False
    ground: bool = False
    seat: bool = False
    soft: bool = False
    fitted: str = ""
    compact: frozenset[str] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "compact", frozenset(name.replace(" ", "") for name in self.names))


@dataclass(frozen=True, slots=True)
class Usual:
    """Where people usually keep things of some categories: at places of some categories, the best one first."""

    things: tuple[str, ...]
    places: tuple[tuple[Relation, str], ...]


@dataclass(frozen=True, slots=True)
class Lexicon:
    """All words of the offline planner.

    Attributes:
        terminals: Phrase (lower case, single blanks) -> terminal of the grammar.
        courtesy: Phrases that are dropped.
        manner: Phrases that are dropped with a note.
        rooms: The same, where they name the room.
        descriptions: Words that may stand before a name without changing its meaning.
        which: Words that select one of several, such as "second", and that no scene can resolve.
        goes: Verbs of moving that mean going where no thing follows.
        stands: Names of things that are verbs of putting where they begin a clause.
        people: Words for recipients to whom nothing can be handed.
        foreign: Words that indicate another language.
        units: Words that count what follows "of", such as "set" in "a set of keys".
        vessels: Words for what holds what follows "of", such as "bottle".
        anything: Words for any item, such as "object".
        features: Words for parts of things that are not moved alone, such as "handle".
        nicknames: Last word of a category -> further names of its things, where nothing else is called so.
        upright: Manners that ask that a thing stands, where it lies.
        fallen: Words for what lies and stands by nature.
        landmarks: Words for what only says where furniture stands, such as "window"; a scene may lack it.
        beyond: Verb that no plan can follow -> reason.
        usual: Usual places of things.
        categories: Entry by key.
    """

    terminals: Mapping[str, str]
    courtesy: frozenset[str]
    manner: frozenset[str]
    rooms: frozenset[str]
    descriptions: frozenset[str]
    which: frozenset[str]
    goes: frozenset[str]
    stands: frozenset[str]
    upright: frozenset[str]
    fallen: frozenset[str]
    people: frozenset[str]
    foreign: frozenset[str]
    units: frozenset[str]
    vessels: frozenset[str]
    anything: frozenset[str]
    features: frozenset[str]
    nicknames: Mapping[str, tuple[str, ...]]
    landmarks: frozenset[str]
    beyond: Mapping[str, str]
    usual: tuple[Usual, ...]
    categories: Mapping[str, Category]

    @classmethod
    def from_toml(cls, text: str) -> Lexicon:
        """Parse a lexicon from a TOML text of the form of `lexicon.toml`.

        Raises:
            LexiconError: The text is no TOML, a table is missing, or a phrase belongs to two classes.
        """
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as problem:
            raise LexiconError("file", f"is no TOML: {problem}") from problem
        except RecursionError:
            raise LexiconError("file", "is no TOML of a lexicon: it is nested too deeply") from None
        for table in (*_TERMINAL_TABLES, "ignored", "categories"):
            if not isinstance(data.get(table), dict):
                raise LexiconError(f"[{table}]", "the table is missing")
        owner: dict[str, str] = {}
        for table in _TERMINAL_TABLES:
            for terminal, phrases in data[table].items():
                _claim(owner, terminal, phrases, f"[{table}] {terminal}")
        _claim(owner, "PARTOF", _parts(data.get("parts", {})), "[parts]")
        terminals = dict(owner)
        words = {**data["ignored"], **data.get("signs", {})}
        for key in (*_DROPPED, *_SIGNS):
            place = f"[{'ignored' if key in _DROPPED else 'signs'}] {key}"
            _claim(owner if key in _DROPPED else {}, key, words.get(key, []), place)
        return cls(
            terminals=terminals,
            **{key: frozenset(words.get(key, ())) for key in (*_DROPPED, "descriptions", *_SIGNS)},
            **{key: frozenset(data.get("counters", {}).get(key, ())) for key in _COUNTERS},
            features=frozenset(data.get("parts", {}).get("features", ())),
            nicknames={noun: tuple(names) for noun, names in data.get("nicknames", {}).items()},
            landmarks=frozenset(data.get("landmarks", {}).get("names", ())),
            beyond={verb: reason for reason, verbs in data.get("beyond", {}).items() for verb in verbs},
            usual=tuple(_usual(entry, data["categories"]) for entry in data.get("usual", ())),
            categories={key: _category(key, entry) for key, entry in data["categories"].items()},
        )

    def phrases(self, terminal: str) -> tuple[str, ...]:
        """Return the phrases of a terminal, in the file's order."""
        return tuple(phrase for phrase, name in self.terminals.items() if name == terminal)

    def category_of(self, category: str) -> Category | None:
        """Return the entry of a scene's category: its own, or that of the words it ends in; None without one."""
        words = category.lower().split(".", 1)[0].replace("-", "_").split("_")
        for start in range(len(words)):
            key, compact = "_".join(words[start:]), "".join(words[start:])
            if key in self.categories:
                return self.categories[key]
            for entry in self.categories.values():
                if compact in entry.compact:
                    return entry
        return None

    def owners(self, name: str) -> tuple[Category, ...]:
        """Return the entries that have a name."""
        return tuple(entry for entry in self.categories.values() if name in entry.names)

    def usual_places(self, entry: Category | None) -> tuple[tuple[Relation, Category], ...]:
        """Return where people usually keep things of an entry, the best place first."""
        kept = (usual for usual in self.usual if any(self.categories.get(key) is entry for key in usual.things))
        return tuple((relation, self.categories[key]) for usual in kept for relation, key in usual.places)


def names_of(
    thing: SceneObject, entry: Category | None, kinds: frozenset[str] = frozenset()
) -> tuple[frozenset[str], ...]:
    """Return the names of an object in tiers, the best-fitting first.

    Args:
        thing: The object.
        entry: The lexicon's entry of its category.
        kinds: Categories of the scene; `apple_0` of the category `half_apple` is no "apple" if another thing is one.

    Returns:
        Its own names (id, stem of the id, category, model); names of its kind with the noun of its own name, as
            `water_glass` has "glass" and `desk_with_drawers` has "desk"; other names of its kind; names of its top.
            An object called after its doors or drawers ranks lower for the noun alone: "the cabinet" is
            `bottom_cabinet_0` rather than `drawer_cabinet_0`.
    """
    key, category, model = thing.id.lower(), thing.category.lower().split(".", 1)[0], thing.model.lower()
    # "The cabinet drawers" are not `cabinet_drawers` itself.
    written = (key, category) if fronts_in(model) else (key, category, model)
    stem = _spoken(key).rstrip("0123456789 ")
    stems = {stem} if stem == _spoken(category) or stem not in kinds else set()
    own = frozenset({*written, *map(_spoken, written), *stems} - {""})
    of_kind = frozenset(() if entry is None else entry.names) - own
    tops = of_kind & (frozenset() if entry is None else entry.surface_names)
    nouns = {_noun(name) for name in (stem, _spoken(category)) if name}
    same = frozenset(name for name in of_kind - tops if _noun(name) in nouns)
    by_front = bool(fronts_in(stem) | fronts_in(category))
    return own, frozenset() if by_front else same, same if by_front else frozenset(), of_kind - tops - same, tops


def short_names(thing: SceneObject, entry: Category | None, lexicon: Lexicon) -> frozenset[str]:
    """Return shorter names of an item: its noun and, of a vessel, what it holds.

    A `baseball_bat` is a bat, a `salt_shaker` is salt, and each is a thing. A noun that names another category is none
    of its names: a garbage can is no can.
    """
    if thing.role != "B":
        return frozenset()
    stem = _spoken(thing.id.lower()).rstrip("0123456789 ")
    whole = (stem, _spoken(thing.category.lower().split(".", 1)[0]), *(() if entry is None else entry.names))
    found: set[str] = set()
    for words in (name.split() for name in whole if not _AFTER_THE_NOUN & set(name.split())):
        for start in range(1, len(words)):
            tail = " ".join(words[start:])
            if all(owner is entry for owner in lexicon.owners(tail)):
                found.add(tail)
        if len(words) > 1 and words[-1] in lexicon.vessels:
            found.add(" ".join(words[:-1]))
    return frozenset(found) | lexicon.anything


def _noun(name: str) -> str:
    """Return the noun of a name: "glass" of "water glass", "desk" of "desk with drawers"."""
    words = name.split()
    stop = next((index for index, word in enumerate(words) if index and word in _AFTER_THE_NOUN), len(words))
    return words[stop - 1]


def _spoken(name: str) -> str:
    return " ".join(name.replace("_", " ").replace("-", " ").split())


def _claim(owner: dict[str, str], name: str, phrases: Any, place: str) -> None:
    """Assign phrases to a class; with a phrase of two classes the tokens would depend on the file's order."""
    if not isinstance(phrases, list) or not all(isinstance(phrase, str) for phrase in phrases):
        raise LexiconError(place, f"expected a list of phrases, got {phrases!r}")
    for phrase in phrases:
        if phrase != " ".join(phrase.lower().split()) or not phrase:
            raise LexiconError(place, f"{phrase!r} is not in lower case with single blanks")
        if owner.setdefault(phrase, name) != name:
            raise LexiconError(place, f"{phrase!r} belongs to {owner[phrase]} already")


def _parts(data: Mapping[str, Sequence[str]]) -> list[str]:
    """Return every "the far left corner of": the names of parts with and without an article and a word before them."""
    whole = [f"{which} {name}".strip() for name in data.get("names", ()) for which in ("", *data.get("which", ()))]
    return [f"{article}{part} of" for part in whole for article in ("the ", "")]


def _category(key: str, entry: Any) -> Category:
    if not isinstance(entry, dict) or not isinstance(entry.get("names"), list):
        raise LexiconError(f"[categories.{key}]", "expected a list `names`")
    flags = {flag: bool(entry.get(flag, False)) for flag in ("interior", "surface", "door", "top")}
    fronts = entry.get("fronts", [])
    if not isinstance(fronts, list) or not all(front in FRONTS for front in fronts):
        raise LexiconError(f"[categories.{key}]", f"expected `fronts` from {' and '.join(FRONTS)}, got {fronts!r}")
    surface_names = tuple(entry.get("surface_names", ()))
    crown = entry.get("crown")
    if crown is not None and crown not in CROWNS:
        raise LexiconError(f"[categories.{key}]", f"expected `crown` as {' or '.join(CROWNS)}, got {crown!r}")
    affordances = Affordances(**flags, fronts=frozenset(fronts), crown=crown)
    kind = {flag: bool(entry.get(flag, False)) for flag in ("waste", "ground", "seat", "soft")}
    # "The seat of the sofa" is a part of it, and so is "the sofa seat".
    parts = ("seat", "cushion") if kind["seat"] else ()
    seats = tuple(f"{name} {part}" for name in entry["names"] for part in parts)
    names = (*entry["names"], *seats, *surface_names)
    fitted = str(entry.get("fitted", ""))
    return Category(tuple(dict.fromkeys(names)), frozenset(surface_names), affordances, **kind, fitted=fitted)


def _usual(entry: Any, categories: Mapping[str, Any]) -> Usual:
    """Return an entry of `usual`; its names are keys of categories, those of places after "into" or "onto"."""
    relations: dict[str, Relation] = {preposition: relation for relation, preposition in PREPOSITION.items()}
    places = [str(place).partition(" ") for place in entry.get("places", ())]
    things = [str(key) for key in entry.get("things", ())]
    unknown = [key for key in (*things, *(key for _, _, key in places)) if key not in categories]
    if unknown or any(preposition not in relations for preposition, _, _ in places):
        raise LexiconError("[[usual]]", f'expected categories, and places such as "into drawer", got {entry!r}')
    return Usual(tuple(things), tuple((relations[preposition], key) for preposition, _, key in places))


@cache
def built_in() -> Lexicon:
    """Return the lexicon that the package ships."""
    return Lexicon.from_toml(files("llm.offline").joinpath("lexicon.toml").read_text(encoding="utf-8"))


def load(path: Path) -> Lexicon:
    """Load a lexicon from a file, for scenes with words of their own."""
    return Lexicon.from_toml(read_bounded_text(path))
