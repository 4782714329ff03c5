"""Findings about the order of arguments: `(ontop table_0 glass_0)` where the glass is meant to stand on the table."""

from __future__ import annotations

import re
from collections.abc import Mapping
from enum import Enum
from itertools import chain

from bddl.lint.quantifiers import walk_scoped
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.problem import Problem
from bddl.syntax.structure import atoms
from bddl.syntax.tree import Atom, Formula

_SYNSET = re.compile(r"\.[a-z]\.\d+.*\Z")
_INDEX = re.compile(r"_\d+\Z")


class Size(Enum):
    """How a kind of thing is usually met with."""

    FIXTURE = "stands in a room"
    ITEM = "fits into a hand"
    SUBSTANCE = "fills or covers other things"


_NOUNS_IN_WORDS = {
    Size.FIXTURE: (
        "table desk counter countertop shelf bookcase bench island sofa couch bed sink floor refrigerator fridge "
        "cabinet cupboard wardrobe microwave oven dishwasher freezer washer dryer stove dresser bathtub fireplace "
        "driveway lawn toilet"
    ),
    Size.ITEM: (
        "cup glass apple bottle bowl knife mug plate can jar fork spoon pan pot banana orange lemon peach pear tomato "
        "potato onion carrot egg book sponge teapot pitcher jug pen pencil fruit vegetable sandwich wineglass "
        "phone remote candle toy napkin sock teaspoon"
    ),
    Size.SUBSTANCE: (
        "water dust stain dirt mud milk juice oil sauce wine beer coffee tea soup salt pepper sugar flour rust grease "
        "vinegar detergent soap sand snow"
    ),
}
_NOUNS = {size: frozenset(nouns.split()) for size, nouns in _NOUNS_IN_WORDS.items()}


def size_of(category: str) -> Size | None:
    """Returns how big things of a category are, or None when the word does not tell.

    Args:
        category: Such as `water_glass`, `refrigerator.n.01` or the name of an object, `glass_0`. The last word of a
            compound says what a thing is.

    Example:
        >>> size_of("breakfast_table.n.01"), size_of("water_glass"), size_of("thing")
        (<Size.FIXTURE: 'stands in a room'>, <Size.ITEM: 'fits into a hand'>, None)
    """
    stem = _INDEX.sub("", _SYNSET.sub("", category.casefold()))
    last = stem.replace("-", "_").rsplit("_", 1)[-1]
    return next((size for size, nouns in _NOUNS.items() if last in nouns), None)


# Predicates whose first argument is the smaller thing, and those whose second one is a substance.
_ITEM_FIRST = frozenset({"ontop", "inside"})
_SUBSTANCE_LAST = frozenset({"covered", "filled", "contains", "saturated", "insource"})
_HANDS = frozenset({"gripper", "robot"})


def find_swapped_roles(problem: Problem, objects: Mapping[str, str], reporter: Reporter) -> None:
    """Reports atoms whose arguments seem to have changed places.

    Three things speak for it: an atom of `:init` says the reverse of one in the goal; the first thing is furniture and
    the second fits into a hand; a substance stands where the thing belongs that it fills or covers, or the gripper
    where the thing belongs that it holds. A word that is not in the small lexicon speaks for nothing.
    """
    at_start = frozenset(chain.from_iterable(atoms(formula) for formula in problem.init))
    for formula in (*problem.init, problem.goal):
        in_goal = formula is problem.goal
        find_swapped_arguments(formula, objects, reporter, at_start if in_goal else frozenset())


def find_swapped_arguments(
    formula: Formula, objects: Mapping[str, str], reporter: Reporter, at_start: frozenset[Atom] = frozenset()
) -> None:
    """Reports atoms of one formula whose arguments seem to have changed places.

    Args:
        formula: Any formula.
        objects: Category of each object; the name of one that is not there has to do.
        reporter: Receives the findings.
        at_start: Atoms that hold at the start, whose reverse is suspicious.
    """
    for node, scope in walk_scoped(formula):
        if not isinstance(node, Atom) or len(node.args) != 2 or node.span is None:
            continue
        categories: list[str] = []
        for name in node.args:
            bound = scope.binding(name)
            categories.append(objects.get(name, name) if bound is None else bound.binder.category)
        reason = _reason(node, categories, at_start)
        if reason:
            first, second = (f"?{name}" if scope.binding(name) else name for name in node.args)
            swapped = f"({node.predicate} {second} {first})"
            reporter.add(
                "swapped-roles",
                node.span,
                f"The arguments of `{node.predicate}` seem to be swapped: {reason}.",
                expected=(swapped,),
                hint=f"write {swapped}",
                severity="warning",
                replacement=reporter.instead(node.span, swapped),
            )


def misplaced(predicate: str, first: str, second: str) -> str:
    """Returns what in the nature of two things speaks for swapped arguments, or "" when nothing does.

    Args:
        predicate: A predicate of two arguments.
        first: Category of the first thing, or its name.
        second: Category of the second thing, or its name.

    Example:
        >>> misplaced("ontop", "table", "glass")
        '`table` is larger than `glass`'
    """
    sizes = size_of(first), size_of(second)
    if predicate in _SUBSTANCE_LAST and sizes[0] is Size.SUBSTANCE and sizes[1] not in (Size.SUBSTANCE, None):
        return f"a substance such as `{first}` comes last"
    if predicate in _ITEM_FIRST and first in _HANDS and second not in _HANDS and sizes[1] is Size.ITEM:
        return "what is held comes first, the gripper last"
    if predicate in _ITEM_FIRST and sizes == (Size.FIXTURE, Size.ITEM):
        return f"`{first}` is larger than `{second}`"
    return ""


def _reason(atom: Atom, categories: list[str], at_start: frozenset[Atom]) -> str:
    first, second = categories
    reason = misplaced(atom.predicate, first, second)
    if reason or first == second or atom.predicate not in _ITEM_FIRST:
        return reason
    reverse = Atom(atom.predicate, atom.args[::-1])
    alike = size_of(first) is not None and size_of(first) is size_of(second)
    return ":init says it the other way round" if reverse in at_start and not alike else ""
