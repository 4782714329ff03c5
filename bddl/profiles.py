"""The dialects of BDDL, as a table: which forms, predicates, sections and built-in objects each one has."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from bddl.errors import UnknownProfile
from bddl.names import near_names
from bddl.syntax import RESERVED_WORDS
from bddl.vocabulary import PREDICATES, PredicateSpec

# Forms with a fixed number of parts; `and` and `or` take any number of formulas.
FORM_SHAPES: Mapping[str, str] = MappingProxyType(
    {
        "not": "(not FORMULA)",
        "imply": "(imply FORMULA FORMULA)",
        "forall": "(forall (?x - CATEGORY) FORMULA)",
        "exists": "(exists (?x - CATEGORY) FORMULA)",
    }
)


def operand_count(form: str) -> int | None:
    """Returns how many formulas a connective or quantifier takes, or None for any number."""
    return FORM_SHAPES[form].count("FORMULA") if form in FORM_SHAPES else None


def inner_forms(form: str) -> int:
    """Returns how many parenthesised forms stand inside a form of fixed shape, binders included."""
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

    @property
    def words(self) -> tuple[str, ...]:
        """Every word that may open a formula, predicates first."""
        return (*self.predicates, *sorted(self.forms))

    @property
    def absent_forms(self) -> frozenset[str]:
        """Forms of the language that this dialect leaves out."""
        return RESERVED_WORDS - self.forms - {"define"}


# The dialect of scene files and of the paper's tables: ids such as `glass_0` are free, no synsets; the gripper and the
# robot are objects like any other, so that `(inside glass_0 gripper)` says that the glass is held.
_SCENE = Profile(
    name="scene",
    forms=frozenset({"and", "or", "not", "imply", "forall", "exists"}),
    predicates=PREDICATES,
    builtin_objects=MappingProxyType({"gripper": "gripper", "robot": "robot"}),
    object_name=re.compile(r"\w[\w.\-]*"),
    object_name_rule="a name has letters, digits, '_', '.' and '-' only",
    sections=(":domain", ":objects", ":init", ":goal"),
    required_sections=(":domain", ":goal"),
    ignored_sections=(":requirements",),
)

PROFILES: Mapping[str, Profile] = MappingProxyType({profile.name: profile for profile in (_SCENE,)})


def find_profile(name: str) -> Profile:
    """Returns the profile of that name.

    Raises:
        UnknownProfile: There is none; the message lists those there are.
    """
    if name not in PROFILES:
        raise UnknownProfile(name, PROFILES, near_names(name, PROFILES))
    return PROFILES[name]
