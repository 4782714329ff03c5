"""Names of the objects of a scene: which of them a run of words fits best."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self, get_args

import bddl
from llm.offline.intents import Affordances, Front, Refusal, Surroundings, alternatives, distinct_doors
from llm.offline.lexicon import Category, Lexicon, names_of, short_names
from llm.offline.reader import NounPhrase
from llm.offline.viewpoint import COLORS, LEVELS, SIZES, stated_colors
from llm.offline.words import TaggedWord
from oag import Scene
from oag.model.symbols import Kind, kind_of
from oag.model.where import WHICH, Part, Where


@dataclass(frozen=True, slots=True)
class Named:
    """Objects with a name, the unconfirmed describing words before it, and notes."""

    ids: tuple[str, ...]
    name: str
    descriptions: tuple[str, ...] = ()
    passed_over: tuple[str, ...] = ()
    by_door: bool = False
    plural: bool = False
    notes: tuple[str, ...] = ()
    part: Where | None = None


@dataclass(frozen=True, slots=True)
class Names:
    """Names of the objects of a scene.

    The `bearers` of a name are the objects that it fits best, then those that it fits less.
    """

    scene: Scene
    affordances: Mapping[str, Affordances]
    lexicon: Lexicon
    entries: Mapping[str, Category | None]
    bearers: Mapping[str, Sequence[Sequence[str]]]
    words: frozenset[str]

    @classmethod
    def of(cls, around: Surroundings, lexicon: Lexicon, entries: Mapping[str, Category | None]) -> Self:
        """Return the names of a scene's objects; `entries` are the lexicon's, by category."""
        objects = around.scene.objects
        kinds = frozenset(thing.category.lower().replace("_", " ") for thing in objects.values())
        bearers: dict[str, tuple[list[str], ...]] = {}
        for key, thing in objects.items():
            tiers = names_of(thing, entries[thing.category], kinds)
            tiers = (*tiers, short_names(thing, entries[thing.category], lexicon).difference(*tiers))
            for rank, names in enumerate(tiers):
                for name in names:
                    bearers.setdefault(name, tuple([] for _ in tiers))[rank].append(key)
        further: dict[str, list[str]] = {}
        for key, thing in objects.items():
            for name in lexicon.nicknames.get(_last_word(thing.category), ()):
                further.setdefault(name, []).append(key)
        bearers |= {name: (keys,) for name, keys in further.items() if name not in bearers}
        known = (*bearers, *(name for entry in lexicon.categories.values() for name in entry.names))
        words = frozenset(word for name in known for word in name.split())
        return cls(around.scene, around.affordances, lexicon, entries, bearers, words)

    @property
    def plural_units(self) -> frozenset[str]:
        """Words such as "bars" and "bottles"."""
        return frozenset(f"{word}s" for word in self.lexicon.units | self.lexicon.vessels)

    def knows(self, word: str) -> bool:
        """Decide whether a word, or its singular, is part of any name or may stand before one."""
        forms = (word, *singulars(word))
        lexicon = self.lexicon
        if (
            word in lexicon.descriptions
            or word in lexicon.which
            or (lexicon.units | lexicon.vessels | lexicon.landmarks).intersection(forms)
        ):
            return True
        return any(form in self.words for form in forms)

    def mentioned(self, words: Sequence[str]) -> tuple[str, ...]:
        """Return the objects named by any run of words, for suggestions."""
        longest = max((name.count(" ") + 1 for name in self.bearers), default=0)
        found: dict[str, None] = {}
        for start in range(len(words)):
            for stop in range(min(len(words), start + longest), start, -1):
                found.update(dict.fromkeys(self.by_name(" ".join(words[start:stop])).ids))
        return tuple(found)

    def described(self, words: tuple[str, ...]) -> Named:
        """Return the objects named by the longest ending of the words, if only descriptions precede it."""
        for start in range(len(words)):
            named = self.by_name(" ".join(words[start:]))
            if named.ids:
                return Named(named.ids, named.name, words[:start], named.passed_over)
            if words[start] not in self.lexicon.descriptions:
                break
        return Named((), " ".join(words))

    def with_own_nouns(self, tokens: Sequence[TaggedWord]) -> tuple[TaggedWord, ...]:
        """Return words in which "the big and small boxes" are "all big boxes and all small boxes".

        "The yellow and blue jar" is one jar. A word that can name a thing, such as "orange", describes none here.
        """
        kept = list(tokens)
        for index in range(len(kept) - 3, 0, -1):
            one, link, other, noun = kept[index - 1 : index + 3]
            if link.terminal != "AND" or noun.terminal != "WORD":
                continue
            if any(self.by_name(word.text).ids or self.lexicon.owners(word.text) for word in (one, other)):
                continue
            end = next((i for i in range(index + 2, len(kept)) if kept[i].terminal != "WORD"), len(kept))
            name, before = kept[index + 2 : end], kept[index - 2] if index > 1 else None
            if self._are_distinguished(one.text, other.text, name):
                each = [TaggedWord("ALL", "all")]
                start = index - 1 - (before is not None and before.terminal in ("DETERMINER", "BOTH"))
                kept[start:end] = [*each, one, *name, link, *each, other, *name]
            elif one.text in COLORS and other.text in COLORS and not singulars(noun.text):
                del kept[index]
        return tuple(kept)

    def without_features(self, tokens: Sequence[TaggedWord]) -> tuple[tuple[TaggedWord, ...], tuple[str, ...]]:
        """Return words without "with the blue handle" after the name of a thing, and what was left out.

        A feature that something in the scene is called, such as a label, is a thing of its own.
        """
        kept: list[TaggedWord] = []
        dropped: list[str] = []
        index = 0
        while index < len(tokens):
            stop = self._feature_end(tokens, index) if kept and kept[-1].terminal == "WORD" else index
            if stop > index:
                dropped.append(" ".join(token.text for token in tokens[index:stop]))
            else:
                kept.append(tokens[index])
            index = max(stop, index + 1)
        return tuple(kept), tuple(dropped)

    def _feature_end(self, tokens: Sequence[TaggedWord], start: int) -> int:
        """Return where "with a long blue handle" ends that starts at a word; its start where there is none."""
        if tokens[start].terminal != "WITH":
            return start
        stop = start + 1 + (tokens[start + 1 : start + 2] != () and tokens[start + 1].terminal in ("A", "DETERMINER"))
        while stop < len(tokens) and tokens[stop].text in self.lexicon.descriptions:
            stop += 1
        is_one = stop < len(tokens) and tokens[stop].text in self.lexicon.features
        ends = stop + 1 >= len(tokens) or tokens[stop + 1].terminal not in ("WORD", "DOOR", "OF")
        return stop + 1 if is_one and ends and not self.by_name(tokens[stop].text).ids else start

    def _are_distinguished(self, one: str, other: str, name: Sequence[TaggedWord]) -> bool:
        """Decide whether two sizes, or two colours, tell those apart that the plural of a name means."""
        words = tuple(word.text for word in name)
        if self.described(words).ids:
            return False
        named = next(filter(None, (self.described((*words[:-1], last)).ids for last in singulars(words[-1]))), ())
        if one in SIZES and other in SIZES:
            return bool(named) and SIZES[one][0] != SIZES[other][0]
        colored = bool(named) and all(stated_colors(self.scene.objects[key]) for key in named)
        return colored and one in COLORS and other in COLORS

    def compound(self, words: tuple[str, ...]) -> Named:
        """Return what several names name: a thing by two of its own, or the one piece of furniture by the last.

        What stands before it in "the sink counter" is taken on trust. A name of several words is one of its own: "the
        towel rack" is no other rack. "The fridge drawer" is a part of the fridge, if that opens. "The table shelf" is
        one of a table, in the scene or not, while a drawer of a desk can be a thing of its own.
        """
        owners = [key for word in words[:-1] for key in self.by_name(word).ids]
        runs = (" ".join(words[start:stop]) for start, stop in combinations(range(len(words)), 2))
        a_part = words[-1] == "shelf" and any(self._is_furniture(run) and not self._is_shelf(run) for run in runs)
        if not all(map(self.knows, words)) or a_part or any(self.affordances[key].door for key in owners):
            return Named((), " ".join(words))
        for start in range(1, len(words)):
            named = self.described(words[start:])
            # "The hand soap bottle" is both.
            twice = tuple(key for key in self.described(words[:start]).ids if key in named.ids)
            if twice:
                return Named(twice, " ".join(words))
            known = any(self.lexicon.owners(" ".join(words[first:])) for first in range(start))
            if len(named.ids) == 1 and self.scene.objects[named.ids[0]].role == "A" and not known:
                return replace(named, descriptions=(*words[:start], *named.descriptions))
        return Named((), " ".join(words))

    def _is_shelf(self, name: str) -> bool:
        """Decide whether a name is one of shelves, so that "the bookcase shelf" is one thing named twice."""
        return self.lexicon.category_of("shelf") in self.lexicon.owners(name)

    def _is_furniture(self, name: str) -> bool:
        """Decide whether a name is one of furniture, in the scene or not."""
        categories = self.lexicon.categories.items()
        return any(self.scene.objects[key].role == "A" for key in self.by_name(name).ids) or any(
            name in entry.names and kind_of(key, 0.0) is not Kind.ITEM for key, entry in categories
        )

    def by_name(self, name: str) -> Named:
        """Return the objects that a name fits best, in the order of `names_of`; the others are passed over."""
        tiers = [tier for tier in self.bearers.get(name, ()) if tier]
        if not tiers:
            return Named((), name)
        return Named(tuple(tiers[0]), name, passed_over=tuple(key for tier in tiers[1:] for key in tier))

    def doors(self, phrase: NounPhrase, front: Front) -> Named:
        """Return the objects whose door or drawer is meant: those of the name before the word, or all that have one."""
        before = phrase.words[:-1]
        named = self.described(before) if before else Named(tuple(self.affordances), phrase.words[-1])
        if phrase.side is not None and (not before or len(named.ids) == 1):
            # "The left cabinet door" of several cabinets is that of the left one.
            raise self.unresolvable(phrase, (phrase.side,))
        if not named.ids:
            return named
        ids = tuple(key for key in named.ids if self.affordances[key].opens_by(front))
        if not ids:
            raise self.without(named.ids, front, by_name=bool(before))
        return Named(ids, named.name, named.descriptions, by_door=True)

    def may_have(self, key: str, phrase: NounPhrase) -> bool:
        """Decide whether an object can have a door, drawer or shelf, as far as its category and model say."""
        fronts, front = self.affordances[key].fronts, phrase.front
        if front is not None and fronts and front not in fronts:
            return False
        part, distinct = _part(phrase, self._which_part(phrase)), distinct_doors(self.scene.objects[key].model)
        return part is None or part.part != "door" or distinct is None or part.which in distinct

    def _which_part(self, phrase: NounPhrase) -> tuple[str, ...]:
        return (*((phrase.side,) if phrase.side else ()), *self.which(phrase.words[:-1]))

    def door_of(self, whole: str, phrase: NounPhrase) -> Named:
        """Return an object whose door or drawer is meant."""
        before, front = phrase.words[:-1], phrase.front
        which = self._which_part(phrase)
        can = self.affordances[whole]
        if (part := _part(phrase, which)) is not None and (front is None or can.door):
            if front is not None and can.fronts and front not in can.fronts:
                raise self.without((whole,), front, by_name=True)
            return Named((whole,), " ".join(phrase.words), by_door=front is not None, part=part)
        if front is not None and which:
            raise self.unresolvable(phrase, which)
        named = all(word in self.lexicon.descriptions for word in before)
        if front is None or not named or not self.affordances[whole].door:
            problem = f'{whole} has no "{" ".join(phrase.words)}" that can be distinguished from it'
            raise Refusal("unknown-object", problem)
        if not self.affordances[whole].opens_by(front):
            raise self.without((whole,), front, by_name=True)
        return Named((whole,), " ".join(phrase.words), before, by_door=True)

    def drawer_apart(self, whole: str, phrase: NounPhrase) -> Named | None:
        """Return the only drawer of the scene for "the top drawer of the desk", where the desk has none of its own."""
        which = self.which(phrase.words[:-1])
        named = self.by_name("drawer")
        levels = all(word in LEVELS for word in which) and len(which) + 1 == len(phrase.words)
        if phrase.words[-1] != "drawer" or not levels or self.affordances[whole].door or len(named.ids) != 1:
            return None
        if self.scene.objects[named.ids[0]].role != "A" or named.passed_over or named.ids[0] == whole:
            return None
        sides = () if phrase.side is None else (phrase.side,)
        note = f"{named.ids[0]} is the only drawer, and is taken for one of {whole}"
        return replace(named, descriptions=(*which, *sides), notes=(note,))

    def without(self, ids: Iterable[str], front: Front, *, by_name: bool) -> Refusal:
        """Return the refusal of a door or drawer that objects are not known to have."""
        can_open = [key for key in ids if self.affordances[key].door]
        has = [_opened_by(key, self.affordances[key]) for key in can_open]
        if by_name and has:
            return Refusal("affordance", f"{has[0]}; no plan opens a {front} of it")
        return Refusal("unknown-object", f"nothing in {self.scene.name} is known to open by a {front}", scene=has)

    def unknown(self, phrase: NounPhrase, around: Surroundings) -> Refusal:
        """Return the refusal of a name without an object in the scene, with the nearest names."""
        which = self.which(phrase.words)
        if which:
            return self.unresolvable(phrase, which)
        wanted = " ".join(phrase.words)
        if self.lexicon.descriptions.issuperset(phrase.words):
            problem = f'"{wanted}" describes a thing, and no name follows it; give each of several things its name'
            return Refusal("unknown-object", problem)
        return Refusal(
            "unknown-object",
            f'nothing in {self.scene.name} is called "{wanted}"{self.meant(wanted)}',
            scene=[around.described(key) for key in self.scene.objects],
        )

    def joined(self, words: tuple[str, ...], of: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
        """Yield the names that "a bottle of medicine", "two bars of soap" or "a set of keys" can stand for."""
        *before, noun = words
        for unit in dict.fromkeys((noun, *singulars(noun))):
            yield (*before, unit, "of", *of)
            if unit in self.lexicon.vessels:
                yield from ((*before, *of[:-1], last, unit) for last in (of[-1], *singulars(of[-1])))
            if unit in self.lexicon.units:
                yield (*before, *of)

    def are_vessels(self, unit: str, of: tuple[str, ...]) -> bool:
        """Decide whether all that "cleaner" names are bottles, so that "two bottles of cleaner" are two of them."""
        named = set(self.described(of).ids)
        units = (one for one in (unit, *singulars(unit)) if one in self.lexicon.vessels)
        return bool(named) and any(named.issubset(self.by_name(one).ids) for one in units)

    def meant(self, *wanted: str) -> str:
        """Return the question whether one of the nearest names was meant; empty if none is near."""
        near: dict[tuple[str, ...], str] = {}
        for words in wanted:
            for name in bddl.near_names(words, sorted(self.bearers)):
                near.setdefault(self.by_name(name).ids, name)
        meant = [name if ids == (name,) else f"{name} ({alternatives(ids)})" for ids, name in near.items()]
        return f"; did you mean {' or '.join(meant)}?" if meant else ""

    def unresolvable(self, phrase: NounPhrase, which: Sequence[str]) -> Refusal:
        """Return the refusal of words that select one of several, which no plan can do."""
        listed = " and ".join(f'"{word}"' for word in which)
        if (part := _part(phrase, which)) is not None:
            problem = f'{listed} says which {part.part} is meant, but not of what: say "the {part} of ..."'
            return Refusal("unknown-object", f"{problem}, with the name or the id of the thing")
        if phrase.door:
            problem = f"{listed} says which {phrase.words[-1]} is meant, and a plan opens and closes a thing as a whole"
        else:
            problem = f"{listed} says which of several is meant, and nothing in {self.scene.name} tells that"
        return Refusal("unknown-object", f"{problem}; name the object alone, by its id where there are several")

    def which(self, words: Sequence[str]) -> tuple[str, ...]:
        """Return the words that select one of several, such as "second"."""
        return tuple(word for word in words if word in self.lexicon.which)


_ORDERED = {
    **{word: level for word, level in LEVELS.items()},
    **dict(zip(("1st", "2nd", "3rd", "4th", "5th"), WHICH[5:10], strict=True)),
}


def _part(phrase: NounPhrase, which: Sequence[str]) -> Where | None:
    """Return the part that "the top drawer" or "the left door" of a thing names; None where it names none."""
    noun = next((n for n in (phrase.words[-1], *singulars(phrase.words[-1])) if n in get_args(Part)), None)
    words = [_ORDERED.get(word, word) for word in which]
    rest = len(phrase.words) - 1 - len(which) + (phrase.side is not None)
    return Where("", "", words[0], noun) if noun and len(words) == 1 and words[0] in WHICH and not rest else None


def _last_word(category: str) -> str:
    """Return the noun of a category: "lamp" of "floor_lamp"."""
    return category.lower().split(".", 1)[0].replace("-", "_").split("_")[-1]


def _opened_by(key: str, can: Affordances) -> str:
    if not can.fronts:
        return f"neither the category nor the model of {key} says whether it has doors or drawers"
    return f"{key} opens by its {'doors' if can.opens_by('door') else 'drawers'}"


def singulars(word: str) -> tuple[str, ...]:
    """Return the possible singulars of a plural; empty for a word that is none."""
    endings = (("lves", "lf"), ("ives", "ife"), ("oaves", "oaf"), ("ies", "y"), ("es", ""), ("s", ""))
    return tuple(word.removesuffix(many) + one for many, one in endings if word.endswith(many) and word != many)


def is_again(name: str, earlier: str) -> bool:
    """Decide whether a name can repeat an earlier one: no word of it is new, as in "the white mug" and "the mug"."""
    return {*name.split()} <= {*earlier.split(), "same"}
