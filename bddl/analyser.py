"""What is suspicious about a text that can be read, such as a goal out of reach or a start that denies itself."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from bddl.lint.goal import find_impossible_goal, find_reached_goal, is_spelt_out
from bddl.lint.quantifiers import (
    find_counted_wildcards,
    find_empty_ranges,
    find_idle_variables,
    find_mixed_instances,
    find_reflexive_atoms,
    walk_scoped,
)
from bddl.lint.roles import find_swapped_arguments, find_swapped_roles
from bddl.parser import read
from bddl.printer import format
from bddl.reading.problem_reader import find_contradictions, init_literals
from bddl.syntax.diagnostic import BDDLError, Diagnostic, Reporter
from bddl.syntax.problem import Domain, Objects, Problem, categories_of
from bddl.syntax.profiles import Profile, find_profile
from bddl.syntax.structure import Literal
from bddl.syntax.tree import Atom, Formula, Quantified, Span


def analyse(
    subject: str | Problem | Formula,
    profile: str | Profile = "scene",
    objects: Objects | None = None,
    *,
    prove: bool = True,
) -> tuple[Diagnostic, ...]:
    """Returns everything that is wrong with a problem or a formula, or suspicious about it.

    A text that cannot be read yields what `check` yields. One that can is examined further: a start that contradicts
    or repeats itself; a goal that holds at the start, or in no state; variables that are unused or hide others; the
    body of a quantifier that names an object of the category it ranges over; atoms about an object and itself;
    quantifiers over nothing; arguments that seem to be swapped; objects that the goal names or that are yet to come
    and of which the rest says nothing; quantifiers over wildcards.

    Args:
        subject: A text, a problem or a formula. The places in the diagnostics of a tree refer to what `format`
            prints for it.
        profile: The dialect, or its name.
        objects: Category of each object of the scene that a problem need not declare. Without it, a formula alone is
            not examined for what depends on objects.
        prove: Whether to ask z3 if some state satisfies the goal.

    Returns:
        The diagnostics in the order of their places. `contradictory-init` and `impossible-goal` are errors, as is all
        that keeps a text from being read; the rest are warnings, but that `unchecked-goal` is a note, and so is
        `counted-wildcard` where other objects of the category are named.

    Raises:
        UnknownProfile: There is no such profile.

    Source: docs/codes-bddl.md has a section on each code.

    Example:
        >>> import bddl
        >>> print(bddl.analyse("(exists (?x - cup) (open box_0))", objects={"cup_0": "cup", "box_0": "box"})[0])
        line 1, column 10: The body never names ?x, so it says the same for every object of `cup`. [unused-variable]
        1 | (exists (?x - cup) (open box_0))
          |          ^^
        hint: name ?x in the body
    """
    text = subject if isinstance(subject, str) else format(subject)
    dialect, known = find_profile(profile), None if objects is None else categories_of(objects)
    try:
        found, warnings = read(text, "any", dialect, known)
    except BDDLError as error:
        return error.diagnostics
    reporter = Reporter(text)
    if isinstance(found, Problem):
        _examine_problem(found, {**(known or {}), **dialect.builtin_objects, **found.categories}, reporter, prove)
    elif not isinstance(found, Domain):
        _examine_formula(found, None if known is None else {**dialect.builtin_objects, **known}, reporter, prove)
    # What the profile's own rules have reported while reading is not reported again.
    read_already = {(item.code, item.line, item.column) for item in warnings}
    fresh = [item for item in reporter.diagnostics if (item.code, item.line, item.column) not in read_already]
    return tuple(sorted((*warnings, *fresh), key=lambda item: (item.line, item.column)))


def _examine_problem(problem: Problem, objects: Mapping[str, str], reporter: Reporter, prove: bool) -> None:
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


def _examine_formula(formula: Formula, objects: Mapping[str, str] | None, reporter: Reporter, prove: bool) -> None:
    """Reports what is suspicious about a formula; without objects, what does not depend on them."""
    find_swapped_arguments(formula, objects or {}, reporter)
    if objects is None:
        find_idle_variables(formula, {}, reporter)
        find_reflexive_atoms(formula, {}, reporter)
        return
    _examine_quantifiers(formula, objects, reporter)
    if prove and is_spelt_out(formula, objects, reporter):
        find_impossible_goal(formula, objects, reporter)


def _examine_quantifiers(formula: Formula, objects: Mapping[str, str], reporter: Reporter) -> None:
    for find in (
        find_empty_ranges,
        find_counted_wildcards,
        find_idle_variables,
        find_mixed_instances,
        find_reflexive_atoms,
    ):
        find(formula, objects, reporter)


def find_repeated_literals(problem: Problem, reporter: Reporter) -> None:
    """Reports literals that `:init` says twice: harmless, yet often another object was meant."""
    seen: dict[Literal, Span | None] = {}
    for literal, span in init_literals(problem):
        if literal in seen and span is not None:
            reporter.add(
                "repeated-literal",
                span,
                f"The section :init says {literal} more than once.",
                hint="remove one of them, or name the object that was meant",
                related=seen[literal],
                severity="warning",
            )
        seen.setdefault(literal, span)


def find_forgotten_futures(problem: Problem, reporter: Reporter) -> None:
    """Reports objects that do not exist at the start (`future`) and of which the goal says nothing.

    Such an object never has to come into being. The goal may ask for it by `real` or by any other atom about it.
    """
    wanted = {name for name, _ in _objects_in(problem.goal)}
    nodes = problem.goal.walk()
    ranged = {binder.category for node in nodes if isinstance(node, Quantified) for binder in node.binders}
    category = problem.categories
    for literal, span in init_literals(problem):
        name = literal.atom.args[0] if literal.atom.args else ""
        if literal.atom.predicate != "future" or not literal.value or span is None:
            continue
        if name not in wanted and category.get(name) not in ranged:
            reporter.add(
                "future-without-real",
                span,
                f"`{name}` does not exist at the start, and the goal does not ask for it.",
                expected=(f"(real {name})",),
                hint=f"add (real {name}) to the goal, or remove this literal",
                severity="warning",
            )


def find_unmentioned_objects(problem: Problem, reporter: Reporter) -> None:
    """Reports objects that the goal names and of which a start that says something else says nothing."""
    said = frozenset(name for literal, _ in init_literals(problem) for name in literal.atom.args)
    declared = {item.name for item in problem.objects}
    if not said:
        return
    reported: set[str] = set()
    for name, span in _objects_in(problem.goal):
        if span is not None and name in declared and name not in said and name not in reported:
            reported.add(name)
            reporter.add(
                "unmentioned-object",
                span,
                f"The goal is about `{name}`, and the section :init says nothing of it.",
                expected=(f"a literal about {name} in :init",),
                hint=f"say in :init where `{name}` is at the start",
                severity="warning",
            )


def _objects_in(goal: Formula) -> Iterator[tuple[str, Span | None]]:
    """Yields every name of an object in a goal, with its place."""
    for node, scope in walk_scoped(goal):
        if isinstance(node, Atom):
            places = node.word_spans[1:] or (None,) * len(node.args)
            yield from (
                (name, span) for name, span in zip(node.args, places, strict=True) if scope.binding(name) is None
            )
