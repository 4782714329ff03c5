"""Domain files as values: the predicates that problems of the domain may use, its types and its actions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from bddl.behavior import KNOWN_SPECS
from bddl.diagnostics import Diagnostic
from bddl.problem import TypedObject
from bddl.syntax import Binder, Span, check_name
from bddl.vocabulary import PredicateSpec


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
