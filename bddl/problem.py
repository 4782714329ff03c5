"""The files of BDDL as values: problems with their objects, and domains with their predicates."""

from __future__ import annotations

from dataclasses import dataclass, field

from bddl.diagnostics import Diagnostic
from bddl.syntax import Formula, Span, check_name


@dataclass(frozen=True, slots=True)
class TypedObject:
    """An object that a problem declares, with its category."""

    name: str
    category: str
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        check_name("object", self.name)
        check_name("category", self.category)


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
