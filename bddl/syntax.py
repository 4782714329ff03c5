"""The syntax tree: immutable formulas that compare, hash and print without recursion, whatever their depth."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TypeAlias

from bddl.errors import IllegalName

QUANTIFIER_WORDS = frozenset({"forall", "exists", "forn", "forpairs", "fornpairs"})
RESERVED_WORDS = frozenset({"and", "or", "not", "imply", "define"}) | QUANTIFIER_WORDS
NAME_RULE = "a name is not empty, begins with neither '?' nor ':', and holds no blank, parenthesis or ';'"
_NAME = re.compile(r"(?!-\Z)[^\s();?:\ufeff][^\s();\ufeff]*")


@dataclass(frozen=True, slots=True)
class Span:
    """A place in a text: line and column count from 1, the offset from 0, the length in characters."""

    line: int
    column: int
    offset: int
    length: int


class Node:
    """What all formulas share: equality, hash and text, each computed with an explicit stack.

    Spans take no part in equality, so a formula that was parsed equals the same formula built by hand.
    """

    __slots__ = ()

    @property
    def operands(self) -> tuple[Formula, ...]:
        """The formulas directly inside this one, in order."""
        return ()

    @property
    def label(self) -> tuple[str, ...]:
        """What distinguishes this node from another of its class with the same operands."""
        return ()

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, Node):
            return NotImplemented
        pending: list[tuple[Node, Node]] = [(self, other)]
        while pending:
            left, right = pending.pop()
            if left is right:
                continue
            if type(left) is not type(right) or left.label != right.label:
                return False
            ours, theirs = left.operands, right.operands
            if len(ours) != len(theirs):
                return False
            pending.extend(zip(ours, theirs, strict=True))
        return True

    def __hash__(self) -> int:
        return hash(tuple((type(node).__name__, node.label, len(node.operands)) for node in self.walk()))

    def __str__(self) -> str:
        return formula_text(self)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {formula_text(self)}>"

    def walk(self) -> Iterator[Node]:
        """Yields this node and every node below it, parents first, left to right."""
        pending: list[Node] = [self]
        while pending:
            node = pending.pop()
            yield node
            pending.extend(reversed(node.operands))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Atom(Node):
    """A predicate applied to names, such as `(ontop glass_0 table_0)`.

    Attributes:
        predicate: Lower-case name of the predicate.
        args: Names of objects, rooms or bound variables, without the question mark.
        span: Where the atom stands in its text, or None when it was not parsed.
        word_spans: Where the predicate and then each argument stand; empty when it was not parsed.
    """

    predicate: str
    args: tuple[str, ...]
    span: Span | None = field(default=None, kw_only=True)
    word_spans: tuple[Span, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        if not isinstance(self.args, tuple):
            raise TypeError(f"The arguments of an atom are a tuple of names, not {self.args!r}.")
        check_name("predicate", self.predicate)
        if self.predicate != self.predicate.lower() or self.predicate in RESERVED_WORDS:
            raise IllegalName("predicate", self.predicate, "a predicate is lower case and no word of the language")
        for name in self.args:
            check_name("object", name)

    @property
    def label(self) -> tuple[str, ...]:
        """The predicate and its arguments."""
        return (self.predicate, *self.args)

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Atom):
            return self.predicate == other.predicate and self.args == other.args
        return False if isinstance(other, Node) else NotImplemented

    def __hash__(self) -> int:
        return hash((self.predicate, self.args))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Not(Node):
    """The negation of a formula."""

    body: Formula
    span: Span | None = field(default=None, kw_only=True)

    @property
    def operands(self) -> tuple[Formula, ...]:
        """The negated formula."""
        return (self.body,)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class And(Node):
    """A conjunction; the empty one is true."""

    parts: tuple[Formula, ...]
    span: Span | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        _check_parts("and", self.parts)

    @property
    def operands(self) -> tuple[Formula, ...]:
        """The conjuncts."""
        return self.parts


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Or(Node):
    """A disjunction; the empty one is false."""

    parts: tuple[Formula, ...]
    span: Span | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        _check_parts("or", self.parts)

    @property
    def operands(self) -> tuple[Formula, ...]:
        """The disjuncts."""
        return self.parts


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Imply(Node):
    """A material implication."""

    left: Formula
    right: Formula
    span: Span | None = field(default=None, kw_only=True)

    @property
    def operands(self) -> tuple[Formula, ...]:
        """The antecedent and the consequent."""
        return (self.left, self.right)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class _Quantified(Node):
    """A formula that holds for some number of the objects of a category.

    Attributes:
        variable: The bound name, without the question mark; it hides an object of the same name.
        category: The category whose objects it ranges over.
        body: The formula about the variable.
        span: Where the form stands in its text, or None when it was not parsed.
    """

    variable: str
    category: str
    body: Formula
    span: Span | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        check_name("variable", self.variable)
        check_name("category", self.category)

    @property
    def operands(self) -> tuple[Formula, ...]:
        """The body."""
        return (self.body,)

    @property
    def label(self) -> tuple[str, ...]:
        """The variable and its category."""
        return (self.variable, self.category)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ForAll(_Quantified):
    """True when the body holds for every object of the category."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Exists(_Quantified):
    """True when the body holds for at least one object of the category."""


Formula: TypeAlias = Atom | Not | And | Or | Imply | ForAll | Exists

_WORDS: dict[type[Node], str] = {
    Not: "not",
    And: "and",
    Or: "or",
    Imply: "imply",
    ForAll: "forall",
    Exists: "exists",
}


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
        span: Where the problem stands in its text, or None when it was not parsed.
    """

    name: str
    domain: str
    objects: tuple[TypedObject, ...]
    init: tuple[Formula, ...]
    goal: Formula
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        check_name("problem", self.name)
        check_name("domain", self.domain)


def check_name(role: str, name: object) -> None:
    """Raises IllegalName when BDDL text cannot carry the name, so that whatever is built can be printed."""
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise IllegalName(role, name, NAME_RULE)


def _check_parts(word: str, parts: object) -> None:
    if not isinstance(parts, tuple):
        raise TypeError(f"The parts of `{word}` are a tuple of formulas, not {type(parts).__name__}.")


def formula_text(formula: Node) -> str:
    """Returns the formula as BDDL on one line; names bound by a quantifier inside it are marked with `?`."""
    pieces: list[str] = []
    bound: dict[str, int] = {}
    # The stack holds nodes still to be written, finished text, and variables whose scope ends.
    pending: list[Node | str | _Quantified | tuple[str]] = [formula]
    while pending:
        item = pending.pop()
        if isinstance(item, str):
            pieces.append(item)
        elif isinstance(item, tuple):
            bound[item[0]] -= 1
        elif isinstance(item, Atom):
            names = (f"?{name}" if bound.get(name) else name for name in item.args)
            pieces.append(f"({' '.join((item.predicate, *names))})")
        else:
            pieces.append(f"({_WORDS[type(item)]}")
            pending.append(")")
            if isinstance(item, _Quantified):
                pieces.append(f" (?{item.variable} - {item.category})")
                bound[item.variable] = bound.get(item.variable, 0) + 1
                pending.append((item.variable,))
            for operand in reversed(item.operands):
                pending.append(operand)
                pending.append(" ")
    return "".join(pieces)
