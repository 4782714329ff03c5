"""Which objects a quantifier ranges over, and how much a formula says of them."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Final, Literal, TypeAlias, get_args

from bddl.syntax.errors import CountedWildcard, ObjectsRequired, UnknownPairSemantics
from bddl.syntax.problem import ROOT_CATEGORY, WILDCARD, Objects, categories_of
from bddl.syntax.tree import Binder, Formula, Quantified

# A row for each object of the first category, a column for each of the second; None where both are the same object.
PairTable: TypeAlias = tuple[tuple[tuple[str, str] | None, ...], ...]

PairSemantics: TypeAlias = Literal["matching", "reference"]
PAIR_SEMANTICS: Final[tuple[PairSemantics, ...]] = get_args(PairSemantics)


def check_pair_semantics(pairs: str) -> None:
    """Raises UnknownPairSemantics unless the word names one of the two readings of `forpairs`."""
    if pairs not in PAIR_SEMANTICS:
        raise UnknownPairSemantics(pairs, PAIR_SEMANTICS)


class Members:
    """The objects of a scene by category, in the scene's order; looked up once for each category.

    Args:
        objects: Category of each object, or the objects as a problem declares them; None when the caller has none.
        warns: Warn by CountedWildcard of each wildcard among them that is looked up.

    Raises:
        TypeError: The objects are in neither form.
    """

    __slots__ = ("_known", "_objects", "_warns")

    def __init__(self, objects: Objects | None, *, warns: bool = False) -> None:
        self._warns = warns
        self._objects = objects if objects is None or type(objects) is dict else categories_of(objects)
        self._known: dict[str, tuple[str, ...]] = {}

    def of(self, binder: Binder) -> tuple[str, ...]:
        """Returns the names of the objects that the binder's variable can stand for.

        A category has the objects that are listed under it by exactly this name; `object` has all of them.

        Raises:
            ObjectsRequired: There are no objects to look into.
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
        """Returns the table of pairs that two variables can stand for.

        Args:
            rows: The variable that the rows stand for.
            columns: The variable that the columns stand for.
            closed_up: Leave out the cells where both would name one object, as the reference does. Where a category
                is paired with itself, column j then speaks of different objects in different rows.

        Raises:
            ObjectsRequired: There are no objects to look into.
        """
        others = self.of(columns)
        if closed_up:
            return tuple(tuple((name, other) for other in others if name != other) for name in self.of(rows))
        return tuple(tuple(None if name == other else (name, other) for other in others) for name in self.of(rows))


def spelled_out(formula: Formula, objects: Objects | None, most: int) -> int:
    """Returns how many parts a formula has once every quantifier is spelled out over the objects.

    Nested quantifiers multiply, so that a short text can say more than any machine evaluates; whoever takes texts from
    elsewhere looks at this number first.

    Args:
        formula: Any formula, of any depth.
        objects: Category of each object, or the objects as a problem declares them.
        most: Beyond this it is not counted on.

    Returns:
        The number of parts, or some number above `most`.

    Raises:
        ObjectsRequired: A quantifier was met and `objects` is None.

    Example:
        >>> import bddl
        >>> goal = bddl.parse_formula("(forall (?c - cup) (exists (?t - table) (ontop ?c ?t)))")
        >>> spelled_out(goal, {"cup_0": "cup", "cup_1": "cup", "table_0": "table"}, most=100)
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
    """Returns how many pairs `forpairs` asks for: the smaller of the numbers of rows and columns."""
    # The reference takes the length of its first row for the number of columns; in full tables it is.
    return min(len(table), len(table[0])) if table else 0
