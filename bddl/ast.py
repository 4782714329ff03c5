"""Syntax tree of formulas: immutable nodes, and questions about their conjuncts, atoms and literals.

Nodes compare, hash and print without recursion, whatever their depth.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, TypeAlias

from bddl.errors import IllegalName

QUANTIFIER_WORDS = frozenset({"forall", "exists", "forn", "forpairs", "fornpairs"})
RESERVED_WORDS = frozenset({"and", "or", "not", "imply", "define"}) | QUANTIFIER_WORDS
NAME_RULE = "a name is not empty, begins with neither '?' nor ':', and holds no blank, parenthesis or ';'"
_NAME = re.compile(r"(?!-\Z)[^\s();?:\ufeff][^\s();\ufeff]*")


class Span(NamedTuple):
    """A place in a text: line and column count from 1, the offset from 0, the length in characters."""

    line: int
    column: int
    offset: int
    length: int


class Binder(NamedTuple):
    """A variable, without its question mark, and the category that it ranges over."""

    variable: str
    category: str


class HasPlaces(Protocol):
    """A text that computes places from offsets (`bddl.diagnostics.Source`)."""

    def span(self, offset: int, length: int = 0) -> Span:
        """Return the place that begins at an offset."""


# A text, and the offsets at which a form of it begins and ends.
Place: TypeAlias = tuple[HasPlaces, int, int]


class Placed:
    """Base of what has a place in a text; `make_placed` leaves the places to be computed when they are asked for."""

    __slots__ = ("_place",)
    _place: Place

    # Called for an empty slot; hidden from type checkers, for which an unknown attribute stays a mistake.
    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            if name not in ("span", "variable_spans", "word_spans"):
                raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}", name=name, obj=self)
            source, start, end = self._place
            if name == "span":
                found = source.span(start, end - start)
            elif name == "word_spans":
                found = source.word_spans(start + 1, end - 1)
            else:
                found = source.variable_spans(start, len(self.binders))
            object.__setattr__(self, name, found)
            return found


class FormulaNode(Placed):
    """Base of all formulas: equality, hash and text, each computed with an explicit stack.

    Spans take no part in equality, so a parsed formula equals the same formula built by hand.
    """

    __slots__ = ()

    @property
    def operands(self) -> tuple[Formula, ...]:
        """The formulas directly inside this one, in order."""
        return ()

    @property
    def label(self) -> tuple[str, ...]:
        """What distinguishes this node from another of its class with equal operands."""
        return ()

    def __eq__(self, other: object) -> bool:
        if self is other:
            return True
        if not isinstance(other, FormulaNode):
            return NotImplemented
        pending: list[tuple[FormulaNode, FormulaNode]] = [(self, other)]
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

    def walk(self) -> Iterator[FormulaNode]:
        """Yield this node and every node below it, parents first, left to right."""
        pending: list[FormulaNode] = [self]
        while pending:
            node = pending.pop()
            yield node
            operands = node.operands
            if operands:
                pending.extend(reversed(operands))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Atom(FormulaNode):
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
        return (self.predicate, *self.args)

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Atom):
            return self.predicate == other.predicate and self.args == other.args
        return False if isinstance(other, FormulaNode) else NotImplemented

    def __hash__(self) -> int:
        return hash((self.predicate, self.args))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Not(FormulaNode):
    """The negation of a formula."""

    body: Formula
    span: Span | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        _check_parts("not", (self.body,))

    @property
    def operands(self) -> tuple[Formula, ...]:
        return (self.body,)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Junction(FormulaNode):
    """Any number of formulas, joined."""

    parts: tuple[Formula, ...]
    span: Span | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        _check_parts(_WORDS[type(self)], self.parts)

    @property
    def operands(self) -> tuple[Formula, ...]:
        return self.parts


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class And(Junction):
    """A conjunction; the empty one is true."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Or(Junction):
    """A disjunction; the empty one is false."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Imply(FormulaNode):
    """A material implication."""

    left: Formula
    right: Formula
    span: Span | None = field(default=None, kw_only=True)

    def __post_init__(self) -> None:
        _check_parts("imply", (self.left, self.right))

    @property
    def operands(self) -> tuple[Formula, ...]:
        return (self.left, self.right)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Quantified(FormulaNode, ABC):
    """Base of all quantifiers: a formula about some number of the objects of one or two categories.

    Attributes:
        span: Where the form stands in its text, or None when it was not parsed.
        variable_spans: Where its variables are introduced; empty when it was not parsed.
    """

    span: Span | None = field(default=None, kw_only=True)
    variable_spans: tuple[Span, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        for binder in self.binders:
            check_name("variable", binder.variable)
            check_name("category", binder.category)
        _check_parts(_WORDS[type(self)], self.operands)
        word, number = _WORDS[type(self)], self.number
        if word in ("forn", "fornpairs") and (not isinstance(number, int) or isinstance(number, bool) or number < 0):
            raise ValueError(f"`{word}` takes a whole number from 0 up, not {number!r}.")

    @property
    @abstractmethod
    def binders(self) -> tuple[Binder, ...]:
        """The variables that it binds, outermost first."""

    @property
    def number(self) -> int | None:
        """The number N of `forn` and `fornpairs`, None for the other quantifiers."""
        return None

    @property
    def label(self) -> tuple[str, ...]:
        """The number, if there is one, and the variables with their categories."""
        number = () if self.number is None else (str(self.number),)
        return (*number, *(name for binder in self.binders for name in binder))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class _Single(Quantified):
    """A quantifier over one category.

    Attributes:
        variable: The bound name, without the question mark; it hides an object of the same name.
        category: The category whose objects it ranges over.
        body: The formula about the variable.
    """

    variable: str
    category: str
    body: Formula

    @property
    def operands(self) -> tuple[Formula, ...]:
        return (self.body,)

    @property
    def binders(self) -> tuple[Binder, ...]:
        return (Binder(self.variable, self.category),)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ForAll(_Single):
    """True when the body holds for every object of the category."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Exists(_Single):
    """True when the body holds for at least one object of the category."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ForN(_Single):
    """True when the body holds for exactly `count` objects of the category.

    Source: the reference counts exactly, where its documentation says "at least" (docs/bddl.md).
    """

    count: int = field(default=1, kw_only=True)

    @property
    def number(self) -> int | None:
        return self.count


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ForPairs(Quantified):
    """True when the objects of the smaller category can be paired off with different objects of the other.

    Attributes:
        variable: The first bound name, without the question mark.
        category: Its category.
        other_variable: The second bound name.
        other_category: Its category.
        body: The formula about both variables, which must hold for each pair.
    """

    variable: str
    category: str
    other_variable: str
    other_category: str
    body: Formula

    @property
    def operands(self) -> tuple[Formula, ...]:
        return (self.body,)

    @property
    def binders(self) -> tuple[Binder, ...]:
        return (Binder(self.variable, self.category), Binder(self.other_variable, self.other_category))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ForNPairs(ForPairs):
    """True when `count` objects of the first category can be paired off with different objects of the second."""

    count: int = field(default=1, kw_only=True)

    @property
    def number(self) -> int | None:
        return self.count


Formula: TypeAlias = Atom | Not | And | Or | Imply | ForAll | Exists | ForN | ForPairs | ForNPairs

# The node class of each word of the language.
FORMS: Mapping[str, type[Formula]] = {
    "not": Not,
    "and": And,
    "or": Or,
    "imply": Imply,
    "forall": ForAll,
    "exists": Exists,
    "forn": ForN,
    "forpairs": ForPairs,
    "fornpairs": ForNPairs,
}
_WORDS: Mapping[type[FormulaNode], str] = {kind: word for word, kind in FORMS.items()}


def make_placed(kind: type[Any], place: Place, **fields: object) -> Any:
    """Return an instance of a class of frozen values whose fields need no check, with its places not yet computed."""
    made = object.__new__(kind)
    for name, value in fields.items():
        object.__setattr__(made, name, value)
    object.__setattr__(made, "_place", place)
    return made


# Atoms and objects are most of a text: their slots are set by the quickest way there is.
_set_predicate, _set_args = Atom.__dict__["predicate"].__set__, Atom.__dict__["args"].__set__
set_place = Placed.__dict__["_place"].__set__


def make_atom(predicate: str, args: tuple[str, ...], place: Place) -> Atom:
    """Return an atom whose names need no check, with its places not yet computed."""
    made = object.__new__(Atom)
    _set_predicate(made, predicate)
    _set_args(made, args)
    set_place(made, place)
    return made


@lru_cache(maxsize=4096)
def is_name(text: str) -> bool:
    """Decide whether BDDL text can carry a name."""
    return _NAME.fullmatch(text) is not None


def check_name(role: str, name: object) -> None:
    """Raise IllegalName when BDDL text cannot carry the name, so that whatever is built can be printed."""
    if not isinstance(name, str) or not is_name(name):
        raise IllegalName(role, name, NAME_RULE)


def _check_parts(word: str, parts: object) -> None:
    if not isinstance(parts, tuple):
        raise TypeError(f"The parts of `{word}` are a tuple of formulas, not {type(parts).__name__}.")
    for part in parts:
        if not isinstance(part, FormulaNode):
            raise TypeError(f"`{word}` takes formulas, such as Atom('open', ('box_0',)), not {part!r}.")


def formula_text(formula: FormulaNode, marked: bool | None = False) -> str:
    """Return the formula as BDDL on one line; names bound by a quantifier inside it are marked with `?`.

    Args:
        marked: Whether other names are marked too: False for never, None where the text that was parsed marks them,
            True also where there was no text.
    """
    pieces: list[str] = []
    bound: dict[str, int] = {}
    # The stack holds nodes still to be written, finished text, and variables whose scope ends.
    pending: list[FormulaNode | str | tuple[Binder, ...]] = [formula]
    while pending:
        item = pending.pop()
        if isinstance(item, str):
            pieces.append(item)
        elif isinstance(item, tuple):
            for binder in item:
                bound[binder.variable] -= 1
        elif isinstance(item, Atom):
            words = zip(item.args, _marks(item, marked), strict=True)
            names = (f"?{name}" if mark or bound.get(name) else name for name, mark in words)
            pieces.append(f"({' '.join((item.predicate, *names))})")
        else:
            pieces.append(f"({_WORDS[type(item)]}")
            pending.append(")")
            if isinstance(item, Quantified):
                pieces.append("" if item.number is None else f" ({item.number})")
                for binder in item.binders:
                    pieces.append(f" (?{binder.variable} - {binder.category})")
                    bound[binder.variable] = bound.get(binder.variable, 0) + 1
                pending.append(item.binders)
            for operand in reversed(item.operands):
                pending.append(operand)
                pending.append(" ")
    return "".join(pieces)


def _marks(atom: Atom, marked: bool | None) -> Sequence[bool]:
    """Return which arguments of an atom are marked with `?` although nothing binds them."""
    if marked is False or not atom.word_spans:
        return (marked is True,) * len(atom.args)
    # A word that is longer than its name was written with its mark.
    return [span.length > len(name) for span, name in zip(atom.word_spans[1:], atom.args, strict=True)]


class Literal(NamedTuple):
    """An atom with the value it must have.

    Attributes:
        value: True for the atom itself, False for its negation.
    """

    atom: Atom
    value: bool

    @property
    def formula(self) -> Formula:
        """The literal as a formula."""
        return self.atom if self.value else Not(self.atom)

    def __str__(self) -> str:
        return str(self.formula)


def conjuncts(formula: Formula) -> tuple[Formula, ...]:
    """Return the parts of a conjunction, nested conjunctions opened, in order; any other formula alone.

    Example:
        >>> import bddl
        >>> [str(part) for part in bddl.conjuncts(bddl.parse_formula("(and (open a) (and (open b) (open c)))"))]
        ['(open a)', '(open b)', '(open c)']
    """
    if not isinstance(formula, And):
        return (formula,)
    found: list[Formula] = []
    pending: list[Formula] = [formula]
    while pending:
        node = pending.pop()
        if isinstance(node, And):
            pending.extend(reversed(node.parts))
        else:
            found.append(node)
    return tuple(found)


def atoms(formula: Formula) -> frozenset[Atom]:
    """Return every atom that occurs in the formula; under a quantifier, with the variable as it is written."""
    return frozenset(node for node in formula.walk() if isinstance(node, Atom))


def affirmed(formula: Formula) -> Iterator[Atom]:
    """Yield the atoms that are not negated: those under an even number of negations."""
    pending: list[tuple[Formula, bool]] = [(formula, True)]
    while pending:
        node, value = pending.pop()
        if isinstance(node, Atom) and value:
            yield node
        flips = isinstance(node, Not)
        pending.extend((operand, value != flips) for operand in reversed(node.operands))
        if isinstance(node, Imply):
            pending[-1] = (node.left, not value)


def literals(formula: Formula) -> tuple[Literal, ...] | None:
    """Return the literals of a conjunction of literals, in order, or None when the formula is no such conjunction.

    A doubled negation counts as none, so `(not (not (open a)))` is the literal `(open a)`.
    """
    if isinstance(formula, Atom):
        return (Literal(formula, True),)
    if isinstance(formula, Not) and isinstance(formula.body, Atom):
        return (Literal(formula.body, False),)
    found: list[Literal] = []
    for part in conjuncts(formula):
        value, core = True, part
        while isinstance(core, Not):
            value, core = not value, core.body
        if not isinstance(core, Atom):
            return None
        found.append(Literal(core, value))
    return tuple(found)
