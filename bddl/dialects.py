"""Dialects (profiles) of BDDL: the forms, predicates and sections of each, and detection of a text's dialect."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import NamedTuple

from bddl.ast import RESERVED_WORDS
from bddl.diagnostics import Reporter
from bddl.errors import UnknownProfile
from bddl.problem import LIBERO_PREDICATES, LiberoProblem, Problem
from bddl.vocabulary import DOMAINS, OMNIGIBSON, PREDICATES, ROOMS, SYNSET, SYNSET_RULE, PredicateSpec, near_names

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

    def for_domain(self, predicates: Mapping[str, PredicateSpec]) -> Profile:
        """Return the dialect with the predicates of a domain."""
        return self if predicates is self.predicates else replace(self, predicates=predicates)


ALL_FORMS = RESERVED_WORDS - {"define"}

# The dialect of scene files and of the paper's tables: ids such as `glass_0` are free, no synsets; the gripper and the
# robot are objects like any other, so that `(inside glass_0 gripper)` says that the glass is held.
_SCENE = Profile(
    name="scene",
    forms=ALL_FORMS,
    predicates=PREDICATES,
    builtin_objects=MappingProxyType({"gripper": "gripper", "robot": "robot"}),
    object_name=re.compile(r"\w[\w.\-]*"),
    object_name_rule="a name has letters, digits, '_', '.' and '-' only",
    sections=(":domain", ":objects", ":init", ":goal"),
    required_sections=(":domain", ":goal"),
    ignored_sections=(":requirements",),
)

# BEHAVIOR's activities as its documentation and its own checks have them.
_BEHAVIOR = Profile(
    name="behavior",
    forms=ALL_FORMS,
    predicates=OMNIGIBSON,
    builtin_objects=MappingProxyType({}),
    object_name=re.compile(r"\w[\w.\-]*\*?"),
    object_name_rule="a name has letters, digits, '_', '.' and '-' only; one that ends in '_*' stands for several",
    sections=(":domain", ":objects", ":init", ":goal"),
    required_sections=(":domain", ":objects", ":init", ":goal"),
    ignored_sections=(":requirements",),
    domains=DOMAINS,
    folds_case=True,
    free_marks=True,
    category_name=SYNSET,
    category_name_rule=SYNSET_RULE,
    rooms=ROOMS,
    rules=frozenset({"instances", "marks", "sections", "kinematics", "consistency", "futures", "wildcards"}),
    tolerated=frozenset({"repeated-object"}),
)

# The mistakes that the reference implementation lets pass (PyPI bddl 3.6.0: `scan_tokens`, `parse_problem`,
# `compile_state`), as codes or as `code:case`. Reading one goes on as described beside it.
REFERENCE_TOLERATES = frozenset(
    {
        # Sections. The first of two counts, except that two goals are joined, the later one first, and that objects
        # are merged category by category, the first line of a category winning over those of a later section.
        "bad-section:stray",  # a word, or a form without a head, between sections: dropped
        "bad-section:name",  # several words where one name belongs: the last is the name
        "missing-section:problem",
        "missing-section::domain",  # the caller names the domain
        "missing-section::objects",
        "repeated-section",
        "unknown-section",  # dropped
        "several-formulas:goal",  # dropped, but for the first
        # Objects.
        "bad-objects:untyped",  # names without a category at the end: their category is `object`
        "bad-name:odd",  # any word can be a name
        "repeated-category",  # the later line replaces the earlier one
        "repeated-object",  # stays twice
        "wrong-category",
        # Formulas. Question marks are stripped from both ends of a name.
        "wrong-arity:surplus",  # what follows the first formula inside `not`: dropped
        "bad-binder:hyphen",  # another word in place of the hyphen, for two variables only
        "bad-count:loose",  # a number without parentheses: its first digit counts
        "bad-count:surplus",  # several numbers: the first counts
        # The initial state. Atoms with `inroom` are never examined, so any room, object and number of names passes.
        "bad-init:formula",
        "bad-init:mark",
        "contradictory-init",
        "described-future",
        "negative-kinematics",
        "unknown-object:inroom",
        "unknown-room",
        "wrong-arity:inroom",
        # Across sections.
        "bad-wildcard",
        "future-without-real",
        "misplaced-predicate",
    }
)

# The same language as the reference implementation reads it: what it drops or lets pass is read as it reads it.
_BEHAVIOR_COMPAT = replace(_BEHAVIOR, name="behavior-compat", tolerated=REFERENCE_TOLERATES)

# LIBERO's problems: typed by assets, with regions as names; a goal is a conjunction of atoms, since its simulator
# evaluates nothing else.
_LIBERO = Profile(
    name="libero",
    forms=frozenset({"and"}),
    predicates=LIBERO_PREDICATES,
    builtin_objects=MappingProxyType({}),
    object_name=re.compile(r"\w[\w.\-]*"),
    object_name_rule="a name has letters, digits, '_', '.' and '-' only",
    sections=(
        ":domain",
        ":language",
        ":regions",
        ":fixtures",
        ":objects",
        ":obj_of_interest",
        ":scene_properties",
        ":init",
        ":goal",
    ),
    required_sections=(":domain", ":language", ":goal"),
    ignored_sections=(":requirements",),
    problem_type=LiberoProblem,
    domains=MappingProxyType({"robosuite": LIBERO_PREDICATES}),
    folds_case=True,
    rules=frozenset({"targets"}),
    free_text=frozenset({":language"}),
)

PROFILES: Mapping[str, Profile] = MappingProxyType(
    {profile.name: profile for profile in (_SCENE, _BEHAVIOR, _BEHAVIOR_COMPAT, _LIBERO)}
)


def find_profile(name: str | Profile) -> Profile:
    """Return the profile of that name; a profile is returned as it is.

    Raises:
        UnknownProfile: There is none; the message lists those there are.
        TypeError: It is neither a profile nor a name.
    """
    if isinstance(name, Profile):
        return name
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
    the meaning of the rest.

    Example:
        >>> detect_dialect("(define (problem p) (:domain omnigibsn) (:objects apple.n.01_1 - apple.n.01) ...")
        'behavior'
        >>> detect_dialect("(define (problem p) (:domain kitchen) (:objects apple_0 - apple) ...")
        'scene'
    """
    signs = _signs_in(text)
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
        styles += [name for name, profile in PROFILES.items() if profile.category_name is SYNSET]
    domain, offset = ("", 0) if found is None else (found.group(1).lower(), found.start(1))
    return _Signs(domain, offset, tuple(styles))
