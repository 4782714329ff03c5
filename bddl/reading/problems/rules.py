"""Rules that a problem as a whole must obey where its profile says so: about its start, and about start and goal."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from types import MappingProxyType
from typing import TypeAlias

from bddl.syntax import Atom, Formula, Not, Quantified, Span
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.libero import LiberoProblem
from bddl.syntax.names import near_names
from bddl.syntax.problem import Problem
from bddl.syntax.profiles import Profile
from bddl.syntax.structure import Literal, literals
from bddl.syntax.vocabulary import ROOM

Rule: TypeAlias = Callable[[Problem, Profile, Reporter], None]

# Substances that a machine makes: they need not be asked for by the goal.
_MADE_BY = {"water.n.06": "washer.n.03"}
_WILDCARD = "_*"


def check_rules(problem: Problem, profile: Profile, reporter: Reporter) -> None:
    """Reports what breaks the rules of a profile."""
    for name, rule in _RULES.items():
        if name in profile.rules:
            rule(problem, profile, reporter)


def _check_kinematics(problem: Problem, profile: Profile, reporter: Reporter) -> None:
    """Reports denials of how things lie: a simulator can place a thing somewhere, but not nowhere."""
    for literal in problem.init:
        atom = literal.body if isinstance(literal, Not) else None
        if isinstance(atom, Atom) and literal.span is not None:
            spec = profile.predicates.get(atom.predicate)
            if spec is not None and (spec.kinematic or ROOM in spec.parameters):
                reporter.add(
                    "negative-kinematics",
                    literal.span,
                    f"The section :init says where things are, not where they are not: {literal}.",
                    expected=("(PREDICATE NAME ...)",),
                    hint=f"say where {atom.args[0] if atom.args else 'it'} is, or remove this literal",
                )


def init_literals(problem: Problem) -> Iterator[tuple[Literal, Span | None]]:
    """Yields the literals of `:init`, each with its place; a doubled negation counts as none."""
    for formula in problem.init:
        for literal in literals(formula) or ():
            yield literal, formula.span


def find_contradictions(problem: Problem, reporter: Reporter) -> None:
    """Reports atoms that `:init` both affirms and denies: no state is such a start. The place is that of the denial."""
    seen: dict[Atom, tuple[bool, Span | None]] = {}
    for literal, span in init_literals(problem):
        value, first = seen.setdefault(literal.atom, (literal.value, span))
        place, other = (first, span) if literal.value else (span, first)
        if value != literal.value and place is not None:
            reporter.add(
                "contradictory-init",
                place,
                f"The section :init says both {literal.atom} and (not {literal.atom}).",
                hint="remove the one that is not meant",
                related=other,
            )


def _check_futures(problem: Problem, profile: Profile, reporter: Reporter) -> None:
    """Reports objects that do not exist at the start and whose coming into being the goal does not ask for."""
    category = {item.name: item.category for item in problem.objects}
    real = {name for atom in _atoms((problem.goal,)) if atom.predicate == "real" for name in atom.args}
    ranges = {
        binder.variable: binder.category
        for node in problem.goal.walk()
        if isinstance(node, Quantified)
        for binder in node.binders
    }
    real_categories = {ranges[name] for name in real if name in ranges}
    for atom in _atoms(problem.init):
        if atom.predicate != "future" or atom.span is None or not atom.args:
            continue
        name = atom.args[0]
        kind = category.get(name, "")
        if name in real or kind in real_categories or _MADE_BY.get(kind, "") in category.values():
            continue
        reporter.add(
            "future-without-real",
            atom.span,
            f"`{name}` does not exist at the start, and the goal does not ask that it come into being.",
            expected=(f"(real {name})",),
            hint=f"add (real ?{name}) to the goal",
        )


def _check_wildcards(problem: Problem, profile: Profile, reporter: Reporter) -> None:
    """Reports wildcards that are not the last of their category, or of which more than the room is said."""
    if not any(item.name.endswith(_WILDCARD) for item in problem.objects):
        return
    for item, following in pairwise(problem.objects):
        if item.name.endswith(_WILDCARD) and following.category == item.category and item.span is not None:
            _report_wildcard(item.name, item.span, "put it last in the line of its category", reporter)
    for atom in _atoms((*problem.init, problem.goal)):
        for position, name in enumerate(atom.args):
            spec = profile.predicates.get(atom.predicate)
            if name.endswith(_WILDCARD) and atom.word_spans and (spec is None or ROOM not in spec.parameters):
                hint = f"name one object, such as {name[:-1]}1"
                _report_wildcard(name, atom.word_spans[position + 1], hint, reporter)


def _report_wildcard(name: str, span: Span, hint: str, reporter: Reporter) -> None:
    reporter.add(
        "bad-wildcard",
        span,
        f"`{name}` stands for all further objects of its category in a room, and can do so only as the last of its "
        "line and in (inroom ...).",
        hint=hint,
    )


def _check_targets(problem: Problem, profile: Profile, reporter: Reporter) -> None:
    """Warns of regions that are parts of nothing: LIBERO reads them, and nothing can ever be in them."""
    if not isinstance(problem, LiberoProblem):
        return
    known = [thing.name for thing in (*problem.fixtures, *problem.objects)]
    for region in problem.regions:
        if region.target not in known and region.span is not None:
            near = near_names(region.target, known)
            reporter.add(
                "unknown-object",
                region.span,
                f"The region `{region.name}` is a part of `{region.target}`, which the problem does not declare.",
                expected=near or known,
                hint=f"did you mean {' or '.join(near)}?" if near else f"declare {region.target} under :fixtures",
                severity="warning",
            )


def _atoms(formulas: tuple[Formula, ...]) -> Iterator[Atom]:
    for formula in formulas:
        for node in formula.walk():
            if isinstance(node, Atom):
                yield node


_RULES: Mapping[str, Rule] = MappingProxyType(
    {
        "kinematics": _check_kinematics,
        "consistency": lambda problem, _, reporter: find_contradictions(problem, reporter),
        "futures": _check_futures,
        "wildcards": _check_wildcards,
        "targets": _check_targets,
    }
)
