"""Every finding about texts that can be read, in one place."""

from __future__ import annotations

from collections.abc import Mapping

from bddl.diagnostics.lint.goal import find_impossible_goal, find_reached_goal, is_spelt_out
from bddl.diagnostics.lint.roles import find_swapped_arguments, find_swapped_roles
from bddl.diagnostics.lint.start import (
    find_forgotten_futures,
    find_repeated_literals,
    find_unmentioned_objects,
)
from bddl.diagnostics.lint.variables import (
    find_empty_ranges,
    find_idle_variables,
    find_mixed_instances,
    find_reflexive_atoms,
)
from bddl.reading.problems.rules import find_contradictions
from bddl.syntax import Formula
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.problem import Problem


def examine_problem(problem: Problem, objects: Mapping[str, str], reporter: Reporter, *, prove: bool) -> None:
    """Reports what is wrong with a problem or suspicious about it.

    Args:
        problem: The problem, as it was read from the reporter's text.
        objects: Category of each object that it may speak of, its own included.
        reporter: Receives the findings.
        prove: Whether to ask z3 if some state satisfies the goal.
    """
    find_contradictions(problem, reporter)
    find_repeated_literals(problem, reporter)
    find_forgotten_futures(problem, reporter)
    find_unmentioned_objects(problem, reporter)
    find_swapped_roles(problem, objects, reporter)
    for formula in problem.init:
        find_reflexive_atoms(formula, objects, reporter)
    _examine_quantifiers(problem.goal, objects, reporter)
    if is_spelt_out(problem.goal, objects, reporter):
        find_reached_goal(problem, objects, reporter)
        if prove:
            find_impossible_goal(problem.goal, objects, reporter)


def examine_formula(formula: Formula, objects: Mapping[str, str] | None, reporter: Reporter, *, prove: bool) -> None:
    """Reports what is wrong with a formula or suspicious about it; without objects, what does not depend on them."""
    find_swapped_arguments(formula, objects or {}, reporter)
    if objects is None:
        find_idle_variables(formula, {}, reporter)
        find_reflexive_atoms(formula, {}, reporter)
        return
    _examine_quantifiers(formula, objects, reporter)
    if prove and is_spelt_out(formula, objects, reporter):
        find_impossible_goal(formula, objects, reporter)


def _examine_quantifiers(formula: Formula, objects: Mapping[str, str], reporter: Reporter) -> None:
    for find in (find_empty_ranges, find_idle_variables, find_mixed_instances, find_reflexive_atoms):
        find(formula, objects, reporter)
