"""Grounding: the objects that a quantifier ranges over, and formulas with every quantifier expanded.

The scene is finite, so a ground formula has no variables.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, TypeAlias, get_args

from bddl.ast import And, Atom, Binder, Exists, ForAll, Formula, FormulaNode, ForN, ForPairs, Imply, Not, Or, Quantified
from bddl.errors import CountedWildcard, ObjectsRequired, UnknownPairSemantics
from bddl.problem import ROOT_CATEGORY, WILDCARD, Objects, categories_of

# A row for each object of the first category, a column for each of the second; None where both are the same object.
PairTable: TypeAlias = tuple[tuple[tuple[str, str] | None, ...], ...]

PairSemantics: TypeAlias = Literal["matching", "reference"]
PAIR_SEMANTICS: Final[tuple[PairSemantics, ...]] = get_args(PairSemantics)


def check_pair_semantics(pairs: str) -> None:
    """Raise UnknownPairSemantics unless the word names one of the two semantics of `forpairs`."""
    if pairs not in PAIR_SEMANTICS:
        raise UnknownPairSemantics(pairs, PAIR_SEMANTICS)


class Members:
    """The objects of a scene by category, in the scene's order; looked up once for each category.

    Args:
        objects: Category of each object, or the objects as a problem declares them; None when the caller has none.
        warns: Warn by CountedWildcard of each wildcard among them that is looked up.
    """

    __slots__ = ("_known", "_objects", "_warns")

    def __init__(self, objects: Objects | None, *, warns: bool = False) -> None:
        self._warns = warns
        self._objects = objects if objects is None or type(objects) is dict else categories_of(objects)
        self._known: dict[str, tuple[str, ...]] = {}

    def of(self, binder: Binder) -> tuple[str, ...]:
        """Return the names of the objects that the binder's variable can denote.

        A category has the objects that are listed under it by exactly this name; `object` has all of them.
        """
        variable, category = binder
        if self._objects is None:
            raise ObjectsRequired(variable, category)
        if category not in self._known:
            self._known[category] = tuple(
                name for name, own in self._objects.items() if category in (own, ROOT_CATEGORY)
            )
            for name in self._known[category] if self._warns else ():
                if name.endswith(WILDCARD):
                    warnings.warn(CountedWildcard(name, category), stacklevel=2)
        return self._known[category]

    def pairs(self, rows: Binder, columns: Binder, *, closed_up: bool = False) -> PairTable:
        """Return the table of pairs that two variables can stand for.

        Args:
            rows: The variable that the rows stand for.
            columns: The variable that the columns stand for.
            closed_up: Leave out the cells where both would name one object, as the reference does. Where a category
                is paired with itself, column j then speaks of different objects in different rows.
        """
        others = self.of(columns)
        if closed_up:
            return tuple(tuple((name, other) for other in others if name != other) for name in self.of(rows))
        return tuple(tuple(None if name == other else (name, other) for other in others) for name in self.of(rows))


def count_ground_parts(formula: Formula, objects: Objects | None, most: int) -> int:
    """Return the number of parts of a formula once every quantifier is expanded over the objects.

    Nested quantifiers multiply, so a short text can have more parts than any machine evaluates. Check this number first
    where texts come from elsewhere.

    Example:
        >>> import bddl
        >>> goal = bddl.parse_formula("(forall (?c - cup) (exists (?t - table) (ontop ?c ?t)))")
        >>> count_ground_parts(goal, {"cup_0": "cup", "cup_1": "cup", "table_0": "table"}, most=100)
        5
    """
    members = Members(objects)
    pending: list[tuple[Formula, int]] = [(formula, 1)]
    total = 0
    while pending and total <= most:
        node, copies = pending.pop()
        total += copies
        for binder in node.binders if isinstance(node, Quantified) else ():
            copies *= len(members.of(binder))
        if copies:
            pending.extend((operand, copies) for operand in node.operands)
    return total


def smaller_side(table: Sequence[Sequence[object]]) -> int:
    """Return how many pairs `forpairs` asks for: the smaller of the numbers of rows and columns."""
    # The reference takes the length of its first row for the number of columns; in full tables it is.
    return min(len(table), len(table[0])) if table else 0


# Bodies with more variables than this are expanded each time instead of being cached.
_MAX_SHARED_VARIABLES = 8


@dataclass(frozen=True, slots=True, eq=False)
class Leaf:
    """An atom, by its position in `Ground.atoms`."""

    atom: int


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Negation:
    """True when the body is false."""

    body: GroundNode


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class All:
    """True when every part is; so true without parts."""

    parts: tuple[GroundNode, ...]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Some:
    """True when at least one part is; so false without parts."""

    parts: tuple[GroundNode, ...]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class AtLeast:
    """True when at least `count` of the parts are; only in `reference` semantics."""

    count: int
    parts: tuple[GroundNode, ...]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Exactly:
    """True when exactly `count` of the parts are."""

    count: int
    parts: tuple[GroundNode, ...]


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Matching:
    """True when `count` true cells can be chosen, no two of them in one row or in one column.

    Attributes:
        count: How many pairs are wanted; it can be more than there are rows or columns, and is then out of reach.
        cells: One row for each object of the first category, one column for each of the second; None where both
            variables would name the same object, which is no pair.
    """

    count: int
    cells: tuple[tuple[GroundNode | None, ...], ...]


GroundNode: TypeAlias = Leaf | Negation | All | Some | AtLeast | Exactly | Matching


@dataclass(frozen=True, slots=True)
class Ground:
    """A formula without variables.

    Attributes:
        atoms: The distinct atoms, in the order in which the formula first names them.
        root: The formula over them. Equal parts are one and the same node, so it is a graph rather than a tree.
    """

    atoms: tuple[Atom, ...]
    root: GroundNode


def children(node: GroundNode) -> tuple[GroundNode, ...]:
    """Return the nodes directly inside a ground node, cells row by row."""
    match node:
        case Leaf():
            return ()
        case Negation(body=body):
            return (body,)
        case All(parts=parts) | Some(parts=parts) | AtLeast(parts=parts) | Exactly(parts=parts):
            return parts
        case Matching(cells=cells):
            return tuple(cell for row in cells for cell in row if cell is not None)


def operands_first(root: GroundNode) -> Iterator[GroundNode]:
    """Yield every node once, after the nodes inside it; no recursion, whatever the depth."""
    done: set[int] = set()
    pending: list[tuple[GroundNode, bool]] = [(root, False)]
    while pending:
        node, entered = pending.pop()
        if id(node) in done:
            continue
        if entered:
            done.add(id(node))
            yield node
        else:
            pending.append((node, True))
            pending.extend((child, False) for child in reversed(children(node)))


def ground(formula: Formula, objects: Objects | None, pairs: PairSemantics = "matching") -> Ground:
    """Expand every quantifier of a formula over the objects of a scene.

    `imply` becomes a disjunction, `forall` a conjunction and `exists` a disjunction over the objects of the category;
    a variable that hides an object or an outer variable stands for the innermost. Arguments are those of `evaluate`.

    Source: docs/bddl.md, Grounding.

    Example:
        >>> import bddl
        >>> goal = bddl.parse_formula("(forall (?x - glass) (inside ?x fridge))")
        >>> scene = {"glass_0": "glass", "glass_1": "glass", "fridge": "refrigerator"}
        >>> [str(atom) for atom in bddl.ground(goal, scene).atoms]
        ['(inside glass_0 fridge)', '(inside glass_1 fridge)']
    """
    check_pair_semantics(pairs)
    return _Grounding(formula, objects, pairs).run()


_Key: TypeAlias = tuple[object, ...]


class _Frame:
    """A form whose operands are being ground; `bodies` binds its variables while it yields them."""

    __slots__ = ("bodies", "form", "key", "parts")

    def __init__(self, form: Formula, bodies: Iterator[Formula], key: _Key | None) -> None:
        self.form = form
        self.bodies = bodies
        self.key = key
        self.parts: list[GroundNode] = []


class _Grounding:
    """One run of `ground`: the values of the variables in scope, and the nodes made so far."""

    def __init__(self, formula: Formula, objects: Objects | None, pairs: PairSemantics) -> None:
        self._formula = formula
        self._members = Members(objects, warns=True)
        self._pairs = pairs
        self._free = _free_variables(formula)
        self._bound: dict[str, str] = {}
        self._atoms: list[Atom] = []
        self._leaves: dict[tuple[str, tuple[str, ...]], Leaf] = {}
        self._made: dict[_Key, GroundNode] = {}
        self._expanded: dict[_Key, GroundNode] = {}

    def run(self) -> Ground:
        """Grounds the formula with a stack of its own, depth first and from left to right."""
        stack: list[_Frame] = []
        entering: Formula | None = self._formula
        while True:
            node: GroundNode | None = None
            if isinstance(entering, Atom):
                node = self._leaf(entering)
            elif entering is not None:
                key = self._key(entering)
                node = None if key is None else self._expanded.get(key)
                if node is None:
                    stack.append(_Frame(entering, self._bodies(entering), key))
            if node is None:
                frame = stack[-1]
                entering = next(frame.bodies, None)
                if entering is not None:
                    continue
                stack.pop()
                node = self._close(frame.form, frame.parts)
                if frame.key is not None:
                    self._expanded[frame.key] = node
            if not stack:
                return Ground(tuple(self._atoms), node)
            stack[-1].parts.append(node)
            entering = None

    def _leaf(self, atom: Atom) -> Leaf:
        args = tuple([self._bound.get(name, name) for name in atom.args])
        leaf = self._leaves.get((atom.predicate, args))
        if leaf is None:
            leaf = self._leaves[atom.predicate, args] = Leaf(len(self._atoms))
            self._atoms.append(Atom(atom.predicate, args))
        return leaf

    def _key(self, form: Formula) -> _Key | None:
        """Return the key of a quantifier's ground form: itself and the values of its free variables."""
        free = self._free.get(id(form))
        return None if free is None else (id(form), *[self._bound.get(name) for name in free])

    def _bodies(self, form: Formula) -> Iterator[Formula]:
        """Yield the operands of a form, a quantifier's once for each choice of objects, which is then bound."""
        if not isinstance(form, Quantified):
            yield from form.operands
            return
        outer = {binder.variable: self._bound.get(binder.variable) for binder in form.binders}
        choices: Iterable[tuple[str, ...]] = (
            (cell for row in self._table(form) for cell in row if cell is not None)
            if isinstance(form, ForPairs)
            else ((name,) for name in self._members.of(form.binders[0]))
        )
        for choice in choices:
            # Set again each time, since a body may have hidden a variable; of two equal ones the last counts.
            self._bound.update(zip((binder.variable for binder in form.binders), choice, strict=True))
            yield form.operands[0]
        for variable, value in outer.items():
            if value is None:
                self._bound.pop(variable, None)
            else:
                self._bound[variable] = value

    def _close(self, form: Formula, parts: list[GroundNode]) -> GroundNode:
        match form:
            case And() | ForAll():
                return self._all(parts)
            case Or() | Exists():
                return self._some(parts)
            case Not():
                return self._negation(parts[0])
            case Imply():
                return self._some([self._negation(parts[0]), parts[1]])
            case ForN(count=count):
                return self._intern((Exactly, count, *map(id, parts)), lambda: Exactly(count, tuple(parts)))
            case ForPairs():
                return self._paired(form, iter(parts))
        raise TypeError(f"A formula was expected, not {form!r}.")

    def _intern(self, key: _Key, make: Callable[[], GroundNode]) -> GroundNode:
        """Return the node of this kind and these parts, made at the first call; parts are compared by identity."""
        if key not in self._made:
            self._made[key] = make()
        return self._made[key]

    def _all(self, parts: list[GroundNode]) -> GroundNode:
        return self._intern((All, *map(id, parts)), lambda: All(tuple(parts)))

    def _some(self, parts: list[GroundNode]) -> GroundNode:
        return self._intern((Some, *map(id, parts)), lambda: Some(tuple(parts)))

    def _negation(self, body: GroundNode) -> GroundNode:
        return self._intern((Negation, id(body)), lambda: Negation(body))

    def _table(self, form: ForPairs) -> PairTable:
        return self._members.pairs(*form.binders, closed_up=self._pairs == "reference")

    def _paired(self, form: ForPairs, parts: Iterator[GroundNode]) -> GroundNode:
        table = self._table(form)
        count = smaller_side(table) if form.number is None else form.number
        if self._pairs == "reference":
            # Rows leave out the pairs of an object with itself and close up, so where a category is paired with itself
            # column j speaks of different objects in different rows. The reference counts it so.
            rows = [[next(parts) for _ in row] for row in table]
            width = max(map(len, rows), default=0)
            columns = [[row[column] for row in rows if column < len(row)] for column in range(width)]
            return self._all([self._at_least(count, rows), self._at_least(count, columns)])
        cells = tuple(tuple(None if pair is None else next(parts) for pair in row) for row in table)
        identity = (Matching, count, *(tuple(map(id, row)) for row in cells))
        return self._intern(identity, lambda: Matching(count, cells))

    def _at_least(self, count: int, lines: list[list[GroundNode]]) -> GroundNode:
        parts = tuple(self._some(line) for line in lines)
        return self._intern((AtLeast, count, *map(id, parts)), lambda: AtLeast(count, parts))


def _free_variables(formula: Formula) -> dict[int, tuple[str, ...]]:
    """Return the free variables of each quantifier inside a formula, by its identity; those with many are left out."""
    nodes = list(formula.walk())
    bindable = frozenset(b.variable for node in nodes if isinstance(node, Quantified) for b in node.binders)
    if not bindable:
        return {}
    free: dict[int, frozenset[str] | None] = {}
    # Backwards, so that operands come before what they are in.
    for node in reversed(nodes):
        free[id(node)] = bindable.intersection(node.args) if isinstance(node, Atom) else _free_of(node, free)
    return {
        id(node): tuple(sorted(names))
        for node in nodes
        if isinstance(node, Quantified) and (names := free[id(node)]) is not None
    }


def _free_of(node: FormulaNode, free: Mapping[int, frozenset[str] | None]) -> frozenset[str] | None:
    names: set[str] = set()
    for operand in node.operands:
        inner = free[id(operand)]
        if inner is None:
            return None
        names |= inner
    if isinstance(node, Quantified):
        names.difference_update(binder.variable for binder in node.binders)
    return None if len(names) > _MAX_SHARED_VARIABLES else frozenset(names)
