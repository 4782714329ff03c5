"""Vocabulary and dialects (profiles) of BDDL, read from `vocabulary.toml` and `dialects.toml`.

The usual size of a kind of thing tells which of two arguments comes first. `near_names` finds the legal names that a
misspelt or foreign name may mean.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import Any, NamedTuple

from bddl.ast import RESERVED_WORDS
from bddl.diagnostics import Reporter
from bddl.errors import UnknownProfile
from bddl.files import read_table
from bddl.problem import LiberoProblem, Problem

# The parameter name that stands for a room; rooms are names of their own and no objects of the scene.
ROOM = "room"


@dataclass(frozen=True, slots=True)
class PredicateSpec:
    """One predicate.

    Attributes:
        name: The name in BDDL text.
        parameters: What each argument stands for, in order; `room` marks the name of a room.
        meaning: When it holds, in words.
        synonyms: Other words for it; they are illegal in BDDL and serve the hints.
        section: The one section that may use it where a profile is strict about that; empty for both.
        kinematic: True for a relation of positions; a start can be set up with it, but not with its denial.
    """

    name: str
    parameters: tuple[str, ...]
    meaning: str
    synonyms: tuple[str, ...] = ()
    section: str = ""
    kinematic: bool = False

    @property
    def arity(self) -> int:
        """How many arguments it takes."""
        return len(self.parameters)

    @property
    def shape(self) -> str:
        """The predicate with its parameters, as shown in messages."""
        return f"({' '.join((self.name, *self.parameters))})"


_WORDS = read_table("vocabulary.toml")


def _predicate_table(name: str) -> Mapping[str, PredicateSpec]:
    kinematic, sections = _WORDS["kinematic"].split(), _WORDS["sections"]
    specs: dict[str, PredicateSpec] = {}
    for shape, (meaning, *synonyms) in _WORDS[name].items():
        word, *names = shape.split()
        others = tuple(" ".join(synonyms).split())
        specs[word] = PredicateSpec(word, tuple(names), meaning, others, sections.get(word, ""), word in kinematic)
    return MappingProxyType(specs)


def _meaning_of(words_by_meaning: Mapping[str, str]) -> Mapping[str, str]:
    return MappingProxyType({word: meaning for meaning, words in words_by_meaning.items() for word in words.split()})


# In the order in which messages list them.
PREDICATES = _predicate_table("predicates")
LIBERO_PREDICATES = _predicate_table("libero_predicates")
# Every predicate of any domain of BEHAVIOR that is known here.
KNOWN_SPECS: Mapping[str, PredicateSpec] = MappingProxyType({**PREDICATES, **_predicate_table("simulator_predicates")})
# Words that stand for a whole formula, as a template over the arguments.
REWRITES = _meaning_of(_WORDS["rewrites"])
ABSENT_CONNECTIVES: Mapping[str, str] = MappingProxyType(_WORDS["absent_connectives"])
VAGUE_PREDICATES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    dict.fromkeys(_WORDS["vague_predicates"].split(), tuple(_WORDS["vague_meanings"].split()))
)
COUNTING_WORDS = frozenset(_WORDS["counting_words"].split())
FORM_SYNONYMS = _meaning_of(_WORDS["form_synonyms"])
NOUN_GROUPS = tuple(frozenset(nouns.split()) for nouns in _WORDS["nouns"])
ROOMS = frozenset(_WORDS["rooms"].split())

_PREDICATES_OF = {
    name: MappingProxyType({word: KNOWN_SPECS[word] for word in words.split()})
    for name, words in _WORDS["domains"].items()
}
DOMAINS: Mapping[str, Mapping[str, PredicateSpec]] = MappingProxyType(
    {name: _PREDICATES_OF[domain] for name, domain in _meaning_of(_WORDS["domain_names"]).items()}
)

# A category is a synset of WordNet, or one that BEHAVIOR made up in the same form.
SYNSET = re.compile(r"[a-z_\-]+\.n\.[0-9]+")

_SYNSET_TAIL = re.compile(r"\.[a-z]\.\d+.*\Z")
_INDEX = re.compile(r"_\d+\Z")


class Size(Enum):
    """Size class of a kind of thing."""

    FIXTURE = "stands in a room"
    ITEM = "fits into a hand"
    SUBSTANCE = "fills or covers other things"


_NOUNS = {Size[name]: frozenset(nouns.split()) for name, nouns in _WORDS["sizes"].items()}


def size_of(category: str) -> Size | None:
    """Return the size class of a category, or None for an unknown word.

    Args:
        category: Such as `water_glass`, `refrigerator.n.01` or the name of an object, `glass_0`. The last word of a
            compound decides.

    Example:
        >>> size_of("breakfast_table.n.01"), size_of("water_glass"), size_of("thing")
        (<Size.FIXTURE: 'stands in a room'>, <Size.ITEM: 'fits into a hand'>, None)
    """
    stem = _INDEX.sub("", _SYNSET_TAIL.sub("", category.casefold()))
    last = stem.replace("-", "_").rsplit("_", 1)[-1]
    return next((size for size, nouns in _NOUNS.items() if last in nouns), None)


# Predicates whose first argument is the smaller thing, and those whose second one is a substance.
ITEM_FIRST = frozenset({"ontop", "inside"})
_SUBSTANCE_LAST = frozenset({"covered", "filled", "contains", "saturated", "insource"})
_HANDS = frozenset({"gripper", "robot"})


def swap_reason(predicate: str, first: str, second: str) -> str:
    """Return why the sizes of two things suggest that they are swapped, or "" when they do not.

    Example:
        >>> swap_reason("ontop", "table", "glass")
        '`table` is larger than `glass`'
    """
    sizes = size_of(first), size_of(second)
    if predicate in _SUBSTANCE_LAST and sizes[0] is Size.SUBSTANCE and sizes[1] not in (Size.SUBSTANCE, None):
        return f"a substance such as `{first}` comes last"
    if predicate in ITEM_FIRST and first in _HANDS and second not in _HANDS and sizes[1] is Size.ITEM:
        return "what is held comes first, the gripper last"
    if predicate in ITEM_FIRST and sizes == (Size.FIXTURE, Size.ITEM):
        return f"`{first}` is larger than `{second}`"
    return ""


_NUMBER = re.compile(r"(?:_|-|\.)?\d+$")
_DENIAL = re.compile(r"(?:is_?not|isn_?t|not|non|no)[_\-](?P<word>.+)")
_MOST = 3
# The word of the language that another word means.
SYNONYM_OF = {synonym: spec.name for spec in PREDICATES.values() for synonym in spec.synonyms} | dict(FORM_SYNONYMS)


def near_names(name: str, legal: Iterable[str]) -> tuple[str, ...]:
    """Return up to three legal names that the given one may have meant, the likeliest first.

    A synonym comes before the same noun with another number, that before another noun for the same kind of thing,
    that before a spelling slip of one or two letters (one in a short name). Letter case is ignored.

    Example:
        >>> near_names("on", PREDICATES)
        ('ontop',)
        >>> near_names("fridge_0", ["table_0", "refrigerator_0"])
        ('refrigerator_0',)
    """
    wanted = name.casefold()
    ranked = []
    denied = denied_word(wanted)
    for option in dict.fromkeys(legal):
        rank = _rank(wanted, option.casefold())
        # A word that says the contrary is not near, however alike the letters are.
        contrary = wanted in ABSENT_CONNECTIVES or denied_word(option.casefold()) != denied
        if rank is not None and option != name and (rank[0] < 2 or not contrary):
            ranked.append((rank, option))
    ranked.sort()
    return tuple(option for _, option in ranked[:_MOST])


def denied_word(name: str) -> str:
    """Return the word that a name such as `not_open` denies, or "" when it denies none.

    Example:
        >>> denied_word("not_open"), denied_word("notebook")
        ('open', '')
    """
    found = _DENIAL.fullmatch(name)
    return found["word"] if found is not None else ""


def _rank(wanted: str, option: str) -> tuple[int, int] | None:
    """Return how far the option is from the wanted name (smaller is nearer), or None when it is not near."""
    if wanted == option or SYNONYM_OF.get(wanted) == option:
        return (0, 0)
    wanted_stem, option_stem = _NUMBER.sub("", wanted), _NUMBER.sub("", option)
    same_index = 0 if wanted.removeprefix(wanted_stem) == option.removeprefix(option_stem) else 1
    if wanted_stem and _squeeze(wanted_stem) == _squeeze(option_stem):
        return (1, same_index)
    if any(wanted_stem in group and option_stem in group for group in NOUN_GROUPS):
        return (2, same_index)
    longest = max(len(wanted_stem), len(option_stem))
    allowed = 0 if longest < 3 else 1 if longest < 6 else 2
    slips = edit_distance(wanted_stem, option_stem, at_most=allowed)
    if slips is not None and slips > 0:
        return (2 + slips, same_index)
    parts = set(wanted_stem.split("_")) & set(option_stem.split("_"))
    if any(len(part) > 2 for part in parts):
        return (5, same_index)
    if min(len(wanted_stem), len(option_stem)) >= 4 and (wanted_stem in option_stem or option_stem in wanted_stem):
        return (6, same_index)
    return None


def _squeeze(stem: str) -> str:
    return stem.replace("_", "").replace("-", "")


def edit_distance(left: str, right: str, at_most: int) -> int | None:
    """Return how many letters to insert, delete, replace or swap with a neighbour, or None when more than allowed."""
    if abs(len(left) - len(right)) > at_most:
        return None
    before: list[int] = []
    above = list(range(len(right) + 1))
    for row, letter in enumerate(left, start=1):
        current = [row]
        for column, other in enumerate(right, start=1):
            cost = min(above[column] + 1, current[-1] + 1, above[column - 1] + (letter != other))
            if row > 1 and column > 1 and letter == right[column - 2] and left[row - 2] == other:
                cost = min(cost, before[column - 2] + 1)
            current.append(cost)
        if min(current) > at_most:
            return None
        before, above = above, current
    return above[-1] if above[-1] <= at_most else None


# Forms with a fixed number of parts; `and` and `or` take any number of formulas.
FORM_SHAPES: Mapping[str, str] = MappingProxyType(
    {
        "not": "(not FORMULA)",
        "imply": "(imply FORMULA FORMULA)",
        "forall": "(forall (?x - CATEGORY) FORMULA)",
        "exists": "(exists (?x - CATEGORY) FORMULA)",
        "forn": "(forn (N) (?x - CATEGORY) FORMULA)",
        "forpairs": "(forpairs (?x - CATEGORY) (?y - CATEGORY) FORMULA)",
        "fornpairs": "(fornpairs (N) (?x - CATEGORY) (?y - CATEGORY) FORMULA)",
    }
)


def operand_count(form: str) -> int | None:
    """Return how many formulas a connective or quantifier takes, or None for any number."""
    return FORM_SHAPES[form].count("FORMULA") if form in FORM_SHAPES else None


def inner_forms(form: str) -> int:
    """Return how many parenthesised forms stand inside a form of fixed shape, binders included."""
    return FORM_SHAPES[form].count("FORMULA") + FORM_SHAPES[form].count("(") - 1


# The words that open the forms of a template.
_HEADS = re.compile(r"\((\w+)")


@dataclass(frozen=True, slots=True)
class Profile:
    """One dialect.

    Attributes:
        name: The name callers use.
        forms: The connectives and quantifiers it has.
        predicates: The predicates it has, by name.
        builtin_objects: Objects that exist without being declared, with their categories.
        object_name: What the name of an object looks like.
        object_name_rule: The same in words, for messages.
        sections: The sections of a problem, in the order in which they are printed.
        required_sections: Those that must be there.
        ignored_sections: Those that may be there and are not read.
        problem_type: What a problem is read into; a dialect with sections of its own has a class of its own.
        domains: The predicates by domain, where the problem's domain decides; `predicates` are those of a formula
            alone. Empty where any domain may be named and the predicates are the same for all.
        folds_case: True when letter case is of no account in names, which are read in lower case.
        free_marks: True when a constant may be written with a question mark: scope alone decides what is a variable.
        category_name: What the name of a category looks like; None when it is like that of an object.
        category_name_rule: The same in words, for messages.
        rooms: The names of rooms; empty when any name will do.
        rules: Checks that it makes: `instances` (objects are named after their categories, each of which has one
            line), `marks` (no question marks in :init), `sections` (some predicates belong in one section), and the
            rules for problems as a whole in `bddl/definitions.py`.
        tolerated: Mistakes that are warnings here, as codes or as `code:case`.
        free_text: The sections whose content is prose.
        types: Categories that exist although no object has them: the types of a domain.
        typed: True when there are no other categories.
    """

    name: str
    forms: frozenset[str]
    predicates: Mapping[str, PredicateSpec]
    builtin_objects: Mapping[str, str]
    object_name: re.Pattern[str]
    object_name_rule: str
    sections: tuple[str, ...]
    required_sections: tuple[str, ...]
    ignored_sections: tuple[str, ...]
    problem_type: type[Problem] = Problem
    domains: Mapping[str, Mapping[str, PredicateSpec]] = field(default_factory=dict)
    folds_case: bool = False
    free_marks: bool = False
    category_name: re.Pattern[str] | None = None
    category_name_rule: str = ""
    rooms: frozenset[str] = frozenset()
    rules: frozenset[str] = frozenset()
    tolerated: frozenset[str] = frozenset()
    free_text: frozenset[str] = frozenset()
    types: frozenset[str] = frozenset()
    typed: bool = False

    @property
    def words(self) -> tuple[str, ...]:
        """Every word that may open a formula, predicates first."""
        return (*self.predicates, *sorted(self.forms))

    @property
    def absent_forms(self) -> frozenset[str]:
        """Forms of the language that this dialect lacks."""
        return RESERVED_WORDS - self.forms - {"define"}

    def name_of(self, text: str) -> str:
        """Return the name in a word, without its question mark."""
        if self.folds_case:
            text = text.lower()
        return text[1:] if text[:1] == "?" else text

    def rewrite(self, word: str, names: Sequence[str]) -> str:
        """Return the formula that an everyday word stands for, or "" when the dialect cannot express it."""
        denied = self.predicates.get(denied_word(word))
        if word not in REWRITES and denied is not None and denied.arity == len(names) and "not" in self.forms:
            return f"(not ({' '.join([denied.name, *names])}))"
        template = REWRITES.get(word, "")
        # A template names each argument once, by its number.
        if template.count("{") != len(names):
            return ""
        names_gripper = "gripper" in template and "gripper" not in self.builtin_objects
        expressible = all(head in self.forms or head in self.predicates for head in _HEADS.findall(template))
        return "" if names_gripper or not expressible else template.format(*names)

    def for_domain(self, predicates: Mapping[str, PredicateSpec]) -> Profile:
        """Return the dialect with the predicates of a domain."""
        return self if predicates is self.predicates else replace(self, predicates=predicates)


def _read_profiles() -> Mapping[str, Profile]:
    tables = read_table("dialects.toml")
    profiles: dict[str, Profile] = {}
    for name, table in tables.items():
        fields = {**tables.get(table.get("extends", ""), {}), **table}
        fields.pop("extends", None)
        domains = _DOMAIN_GROUPS[fields.pop("domains")]
        profiles[name] = Profile(
            name=name,
            forms=frozenset(fields.pop("forms", _ALL_FORMS)),
            predicates=next(iter(domains.values()), PREDICATES),
            builtin_objects=MappingProxyType(fields.pop("builtin_objects", {})),
            object_name=re.compile(fields.pop("object_name")),
            problem_type=LiberoProblem if ":language" in fields["sections"] else Problem,
            domains=domains,
            category_name=SYNSET if "category_name_rule" in fields else None,
            rooms=ROOMS if fields.pop("known_rooms", False) else frozenset(),
            **{word: kind(fields.pop(word, ())) for word, kind in _COLLECTIONS.items()},
            **fields,
        )
    return MappingProxyType(profiles)


_ALL_FORMS = RESERVED_WORDS - {"define"}
# The predicates of each domain that a dialect tells apart, by the group that its table names.
_DOMAIN_GROUPS: Mapping[str, Mapping[str, Mapping[str, PredicateSpec]]] = {
    "any": {},
    "behavior": DOMAINS,
    "libero": MappingProxyType({"robosuite": LIBERO_PREDICATES}),
}
_COLLECTIONS: Mapping[str, Callable[[Iterable[str]], Any]] = {
    "sections": tuple,
    "required_sections": tuple,
    "ignored_sections": tuple,
    "rules": frozenset,
    "tolerated": frozenset,
    "free_text": frozenset,
}
PROFILES = _read_profiles()


# The name under which the text decides.
AUTO = "auto"


def find_profile(name: str | Profile, text: str = "") -> Profile:
    """Return the profile of that name; a profile is returned as it is, and `auto` is that of the text."""
    if isinstance(name, Profile):
        return name
    if name == AUTO:
        return PROFILES[detect_dialect(text)]
    if not isinstance(name, str):
        raise TypeError(f"A profile is given as its name, such as 'scene', or as a Profile, not as {name!r}.")
    if name not in PROFILES:
        raise UnknownProfile(name, tuple(PROFILES), near_names(name, PROFILES))
    return PROFILES[name]


DEFAULT = "scene"
_COMMENT = re.compile(r";[^\n]*")
_DOMAIN = re.compile(r"\(\s*:domain\s+([^\s();]+)", re.IGNORECASE)
_SECTION = re.compile(r"\(\s*(:[\w-]+)")
_SYNSET_CATEGORY = re.compile(rf"\s-\s+{SYNSET.pattern}(?![^\s();])", re.IGNORECASE)

_INSTANCE = re.compile(rf"[\s(]\??{SYNSET.pattern}(?:_\d+)?(?![^\s();])", re.IGNORECASE)
_DEFINITION = re.compile(r"\(\s*(?:define|problem|:)", re.IGNORECASE)


class _Signs(NamedTuple):
    """The domain that a text names, in lower case and with its offset, and the dialects whose style it has."""

    domain: str
    offset: int
    styles: tuple[str, ...]

    def likely_dialect(self) -> str | None:
        """Return the dialect whose style the text has and whose domain it names, misspelt or not."""
        for name in self.styles:
            domains = PROFILES[name].domains
            if self.domain in domains or near_names(self.domain, domains):
                return name
        return None


def detect_dialect(text: str) -> str:
    """Return the name of the profile for reading a text.

    The domain of the text decides. A domain that only resembles a known one counts as that one when the text has the
    style of its dialect: synsets for categories, or sections that only LIBERO has. So a misspelt domain does not change
    the meaning of the rest. A formula alone is one of BEHAVIOR when it names an object after a synset.

    Example:
        >>> detect_dialect("(define (problem p) (:domain omnigibsn) (:objects apple.n.01_1 - apple.n.01) ...")
        'behavior'
        >>> detect_dialect("(define (problem p) (:domain kitchen) (:objects apple_0 - apple) ...")
        'scene'
    """
    signs = _signs_in(text)
    if not signs.domain and _INSTANCE.search(text) and not _DEFINITION.search(text):
        # A formula alone names no domain.
        return "behavior"
    exact = next((name for name, profile in PROFILES.items() if signs.domain in profile.domains), None)
    return exact or signs.likely_dialect() or DEFAULT


def report_other_dialect(text: str, profile: Profile, reporter: Reporter) -> None:
    """Report that a wrong text is written in another dialect than the one it was read in, if it is."""
    signs = _signs_in(text)
    likely_dialect = signs.likely_dialect()
    if likely_dialect is None or PROFILES[likely_dialect].domains == profile.domains:
        return
    # Whatever else is reported may follow from this, so it is never an echo.
    reporter.restrict(["other-profile"])
    reporter.add(
        "other-profile",
        reporter.place(signs.offset, len(signs.domain)),
        f"The text is written in the profile `{likely_dialect}`, and it was read in the profile `{profile.name}`.",
        hint=f'pass profile="{likely_dialect}"',
        severity="warning",
    )


def _signs_in(text: str) -> _Signs:
    plain = _COMMENT.sub(lambda comment: " " * len(comment.group()), text)
    found = _DOMAIN.search(plain)
    # Sections that scenes do not have indicate the dialect, and so do categories that are synsets.
    sections = {match.group(1).lower() for match in _SECTION.finditer(plain)}.difference(PROFILES[DEFAULT].sections)
    styles = [name for name, profile in PROFILES.items() if sections.intersection(profile.sections)]
    if _SYNSET_CATEGORY.search(plain):
        styles += [name for name, profile in PROFILES.items() if profile.category_name == SYNSET]
    domain, offset = ("", 0) if found is None else (found.group(1).lower(), found.start(1))
    return _Signs(domain, offset, tuple(styles))
