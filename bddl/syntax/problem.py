"""The files of BDDL as values: problems with their objects, and domains with their predicates."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from bddl.syntax.diagnostic import Diagnostic
from bddl.syntax.tree import Binder, Formula, Span, check_name
from bddl.syntax.vocabulary import KNOWN_SPECS, PredicateSpec

# The category that every object of a scene belongs to, as in typed PDDL.
ROOT_CATEGORY = "object"
# What the name of a wildcard ends in, which stands for all further objects of its category in a room.
WILDCARD = "_*"


@dataclass(frozen=True, slots=True)
class TypedObject:
    """An object that a problem declares, with its category."""

    name: str
    category: str
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        check_name("object", self.name)
        check_name("category", self.category)


# The objects of a scene: their categories by name, or as a problem declares them.
Objects: TypeAlias = Mapping[str, str] | Iterable[TypedObject]


def categories_of(objects: Objects) -> Mapping[str, str]:
    """Returns the category of each object, by name.

    Args:
        objects: A mapping from names to categories, which is returned as it is, or declared objects.

    Raises:
        TypeError: It is neither.

    Example:
        >>> categories_of([TypedObject("glass_0", "glass")])
        {'glass_0': 'glass'}
    """
    if isinstance(objects, Mapping):
        return objects
    found: dict[str, str] = {}
    given: Iterable[object] = objects if hasattr(objects, "__iter__") else [objects]
    for item in given:
        if not isinstance(item, TypedObject):
            raise TypeError(
                "Objects are given as a mapping from names to categories, such as {'glass_0': 'glass'}, or as the "
                f"declared objects of a problem; {item!r} is neither."
            )
        found[item.name] = item.category
    return found


@dataclass(frozen=True, slots=True)
class Problem:
    """A problem file: declared objects, what holds at the start, and the goal.

    Attributes:
        name: Name of the problem.
        domain: Name of the domain it belongs to.
        objects: Declared objects, in order.
        init: Literals that hold at the start, in order.
        goal: The goal.
        warnings: What was found in the text and did not keep it from being read.
        span: Where the problem stands in its text, or None when it was not parsed.
    """

    name: str
    domain: str
    objects: tuple[TypedObject, ...]
    init: tuple[Formula, ...]
    goal: Formula
    warnings: tuple[Diagnostic, ...] = field(default=(), compare=False, repr=False, kw_only=True)
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        check_name("problem", self.name)
        check_name("domain", self.domain)

    @property
    def categories(self) -> dict[str, str]:
        """The category of each declared object, by name: the `objects` that evaluation asks for."""
        return {item.name: item.category for item in self.objects}


@dataclass(frozen=True, slots=True)
class DomainPredicate:
    """A predicate that a domain declares.

    Attributes:
        name: Its name, in lower case.
        parameters: Its parameters with their types, in order; an untyped one has the type `object`.
        span: Where the declaration stands in its text, or None when it was not parsed.
    """

    name: str
    parameters: tuple[Binder, ...]
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        check_name("predicate", self.name)
        for parameter in self.parameters:
            check_name("variable", parameter.variable)
            check_name("category", parameter.category)

    @property
    def arity(self) -> int:
        """How many arguments it takes."""
        return len(self.parameters)


@dataclass(frozen=True, slots=True)
class DomainAction:
    """An action of a domain, which is kept and not interpreted.

    Attributes:
        name: Its name.
        text: The whole form on one line, comments left out.
        span: Where the form stands in its text, or None when it was not parsed.
    """

    name: str
    text: str
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class Domain:
    """A domain file.

    Attributes:
        name: Name of the domain.
        requirements: Its requirements, such as `:adl`, in order.
        types: Its types with their supertypes, in order; one without a supertype has `object`.
        predicates: Its predicates, in order.
        actions: Its actions, in order.
        warnings: What was found in the text and did not keep it from being read.
        span: Where the domain stands in its text, or None when it was not parsed.
    """

    name: str
    requirements: tuple[str, ...] = ()
    types: tuple[TypedObject, ...] = ()
    predicates: tuple[DomainPredicate, ...] = ()
    actions: tuple[DomainAction, ...] = ()
    warnings: tuple[Diagnostic, ...] = field(default=(), compare=False, repr=False, kw_only=True)
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        check_name("domain", self.name)

    @property
    def specs(self) -> Mapping[str, PredicateSpec]:
        """Its predicates as profiles have them; what a known one means and how its arguments are called is added."""
        return {predicate.name: _spec(predicate) for predicate in self.predicates}


def _spec(predicate: DomainPredicate) -> PredicateSpec:
    known = KNOWN_SPECS.get(predicate.name)
    if known is not None and known.arity == predicate.arity:
        return known
    return PredicateSpec(predicate.name, tuple(parameter.variable for parameter in predicate.parameters), "")
