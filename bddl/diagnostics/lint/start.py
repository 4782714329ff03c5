"""Findings about what a problem says of its start: repetitions, and things that are yet to come or never mentioned."""

from __future__ import annotations

from bddl.diagnostics.lint.scopes import walk_scoped
from bddl.reading.problems.rules import init_literals
from bddl.syntax import Atom, Formula, Quantified, Span
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.problem import Problem
from bddl.syntax.structure import Literal

_FUTURE = "future"


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
    wanted = frozenset(
        name
        for node, scope in walk_scoped(problem.goal)
        if isinstance(node, Atom)
        for name in node.args
        if scope.binding(name) is None
    )
    ranged = _categories_of(problem.goal)
    category = {item.name: item.category for item in problem.objects}
    for literal, span in init_literals(problem):
        name = literal.atom.args[0] if literal.atom.args else ""
        if literal.atom.predicate != _FUTURE or not literal.value or span is None:
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
    for node, scope in walk_scoped(problem.goal):
        if not isinstance(node, Atom) or not node.word_spans:
            continue
        for name, span in zip(node.args, node.word_spans[1:], strict=True):
            if name in declared and name not in said and name not in reported and scope.binding(name) is None:
                reported.add(name)
                reporter.add(
                    "unmentioned-object",
                    span,
                    f"The goal is about `{name}`, and the section :init says nothing of it.",
                    expected=(f"a literal about {name} in :init",),
                    hint=f"say in :init where `{name}` is at the start",
                    severity="warning",
                )


def _categories_of(goal: Formula) -> frozenset[str]:
    return frozenset(binder.category for node in goal.walk() if isinstance(node, Quantified) for binder in node.binders)
