"""Findings about the order of arguments: `(ontop table_0 glass_0)` where the glass is meant to stand on the table."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import chain

from bddl.lint.quantifiers import walk_scoped
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.problem import Problem
from bddl.syntax.structure import atoms
from bddl.syntax.tree import Atom, Formula
from bddl.syntax.vocabulary import ITEM_FIRST, misplaced, size_of


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
            first, second = map(reporter.quote, node.word_spans[1:])
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


def _reason(atom: Atom, categories: list[str], at_start: frozenset[Atom]) -> str:
    first, second = categories
    reason = misplaced(atom.predicate, first, second)
    if reason or first == second or atom.predicate not in ITEM_FIRST:
        return reason
    reverse = Atom(atom.predicate, atom.args[::-1])
    alike = size_of(first) is not None and size_of(first) is size_of(second)
    return ":init says it the other way round" if reverse in at_start and not alike else ""
