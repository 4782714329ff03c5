"""From the form `(define (problem ...) ...)` to a problem, section by section, and the rules for it as a whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from itertools import pairwise
from types import MappingProxyType
from typing import TypeAlias

from bddl.reading.libero_sections import LIBERO_READERS
from bddl.reading.sections import (
    UNNAMED,
    ObjectsReader,
    ProblemDraft,
    SectionNames,
    SectionReader,
    collect_sections,
    read_name,
    report_unknown,
)
from bddl.reading.words import Group
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.libero import LiberoProblem
from bddl.syntax.names import near_names
from bddl.syntax.problem import WILDCARD, Domain, Problem
from bddl.syntax.profiles import Profile
from bddl.syntax.structure import Literal, affirmed, literals
from bddl.syntax.tree import And, Atom, Formula, Not, Quantified, Span
from bddl.syntax.vocabulary import ROOM


def read_problem(
    group: Group, profile: Profile, scene: Mapping[str, str] | None, domain: Domain | None, reporter: Reporter
) -> Problem | None:
    """Returns the problem that a form defines, or None when something in it was wrong and has been reported.

    Args are as for `ProblemDraft`.
    """
    draft = ProblemDraft(profile, reporter, scene, domain)
    _use_domain(draft, domain.name if domain is not None else next(iter(profile.domains), UNNAMED))
    names = SectionNames(
        f"profile `{profile.name}`",
        "problem",
        ("problem", *profile.sections),
        ("problem", *profile.required_sections),
        profile.ignored_sections,
    )
    for name, sections in collect_sections(group, names, reporter).items():
        SECTION_READERS[name](draft, sections)
    if draft.goal is None:
        return None
    try:
        problem = profile.problem_type(
            draft.name, draft.domain, draft.objects, draft.init, draft.goal, **draft.fields, span=group.span
        )
    except ValueError as error:
        # What no section of its own can see: the sections do not fit into one problem.
        reporter.add("bad-section", group.opened.span, str(error), hint="write the sections as bddl.format prints them")
        return None
    for name, rule in _RULES.items():
        if name in profile.rules:
            rule(problem, draft.profile, reporter)
    return problem


def _read_title(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    word = read_name(sections[0], draft.reporter)
    if word is not None:
        draft.name = word.text


def _read_domain(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    profile, reporter = draft.profile, draft.reporter
    word = read_name(sections[0], reporter)
    if word is None:
        return
    name = word.key if profile.folds_case else word.text
    legal = (draft.given.name,) if draft.given is not None else tuple(profile.domains)
    if legal and name not in legal:
        message = f"The profile `{profile.name}` has no domain `{word.text}`."
        if draft.given is not None:
            message = f"The domain that was given is `{draft.given.name}`, not `{word.text}`."
        report_unknown(reporter, "unknown-domain", word.span, message, name, legal)
        return
    _use_domain(draft, name)


def _use_domain(draft: ProblemDraft, name: str) -> None:
    draft.domain = name
    if draft.given is not None:
        draft.profile = draft.profile.for_domain(draft.given.specs)
    elif name in draft.profile.domains:
        draft.profile = draft.profile.for_domain(draft.profile.domains[name])


def _read_objects(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    reader = ObjectsReader(draft)
    for section in reversed(sections):
        reader.read(section)
    draft.objects = reader.objects


def _read_init(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    reader, found = draft.formulas(), []
    for item in sections[0].items[1:]:
        formula = reader.read(item, ":init")
        if formula is None:
            continue
        literal = isinstance(formula.body if isinstance(formula, Not) else formula, Atom)
        if literal or draft.reporter.add(
            "bad-init",
            item.span,
            "The section :init lists literals: atoms and negated atoms.",
            expected=("(PREDICATE NAME ...)", "(not (PREDICATE NAME ...))"),
            hint="list the literals one after the other, without (and ...)",
            case="formula",
        ):
            found.append(formula)
    draft.init = tuple(found)


def _read_goal(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    goals = [_one_goal(draft, section) for section in reversed(sections)]
    found = [goal for goal in goals if goal is not None]
    if len(found) < len(goals):
        return
    if len(found) == 1:
        draft.goal = found[0]
    else:
        parts = [part for goal in found for part in (goal.parts if isinstance(goal, And) else (goal,))]
        draft.goal = And(tuple(parts), span=found[0].span)


def _one_goal(draft: ProblemDraft, section: Group) -> Formula | None:
    reporter, reader, items = draft.reporter, draft.formulas(), section.items[1:]
    if not items:
        reporter.add(
            "bad-section",
            section.items[0].span,
            "The section :goal holds no formula.",
            expected=("(",),
            hint="write (:goal FORMULA); a goal that always holds is (and)",
        )
        return None
    if len(items) > 1:
        parts = [reporter.quote(item.span) for item in items]
        tolerated = reporter.add(
            "several-formulas",
            items[1].span,
            f"The section :goal holds {len(items)} formulas, and only one belongs in it.",
            expected=(")",),
            hint=f"write (:goal (and {' '.join(parts)}))" if all(parts) else "join them with (and ...)",
            related=items[0].span,
            case="goal",
        )
        if tolerated:
            items = items[:1]
    goals = [reader.read(item, ":goal") for item in items]
    return goals[0] if len(goals) == 1 else None


# How each section of any dialect is read.
SECTION_READERS: Mapping[str, SectionReader] = MappingProxyType(
    {
        "problem": _read_title,
        ":domain": _read_domain,
        ":objects": _read_objects,
        ":init": _read_init,
        ":goal": _read_goal,
        **LIBERO_READERS,
    }
)


Rule: TypeAlias = Callable[[Problem, Profile, Reporter], None]

# Substances that a machine makes: they need not be asked for by the goal.
_MADE_BY = {"water.n.06": "washer.n.03"}


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
    """Report what cannot be meant of objects that do not exist at the start, and of those that do.

    The goal has to ask that the former come into being, :init can say nothing of them, and of the latter it is idle to
    ask that.
    """
    category = {item.name: item.category for item in problem.objects}
    real = {name for atom in affirmed(problem.goal) if atom.predicate == "real" for name in atom.args}
    ranges = {
        binder.variable: binder.category
        for node in problem.goal.walk()
        if isinstance(node, Quantified)
        for binder in node.binders
    }
    real_categories = {ranges[name] for name in real if name in ranges}
    futures = {
        name: span
        for literal, span in init_literals(problem)
        if literal.atom.predicate == "future" and literal.value
        for name in literal.atom.args[:1]
    }
    _report_described(problem, futures, reporter)
    _report_idle(problem, futures.keys(), ranges, reporter)
    for name, span in futures.items():
        kind = category.get(name, "")
        if span is None or name in real or kind in real_categories or _MADE_BY.get(kind, "") in category.values():
            continue
        reporter.add(
            "future-without-real",
            span,
            f"`{name}` does not exist at the start, and the goal does not ask that it come into being.",
            expected=(f"(real {name})",),
            hint=f"add (real ?{name}) to the goal",
        )


# What may hold of an object that does not exist yet.
_OF_FUTURES = frozenset({"future", "insource"})


def _report_described(problem: Problem, futures: Mapping[str, Span | None], reporter: Reporter) -> None:
    """Report literals of :init that say where, or how, an object is that does not exist."""
    for literal, span in init_literals(problem):
        name = next((name for name in literal.atom.args if name in futures), "")
        if name and literal.value and literal.atom.predicate not in _OF_FUTURES and span is not None:
            reporter.add(
                "described-future",
                span,
                f"`{name}` does not exist at the start, and the section :init says {literal} of it.",
                hint=f"remove this literal, or (future {name})",
                related=futures[name],
            )


def _report_idle(problem: Problem, futures: Set[str], ranges: Mapping[str, str], reporter: Reporter) -> None:
    """Warn of `real` about objects all of which exist from the start."""
    for atom in affirmed(problem.goal):
        name = atom.args[0] if atom.predicate == "real" and atom.args else ""
        category = ranges.get(name)
        meant = [name] if category is None else [item.name for item in problem.objects if item.category == category]
        if not (name and meant) or atom.span is None or not futures.isdisjoint(meant):
            continue
        subject = f"`{name}` exists" if category is None else f"Every object of `{category}` exists"
        reporter.add(
            "idle-real",
            atom.span,
            f"{subject} from the start, so this asks for nothing.",
            hint=f"remove it, or say (future {meant[0]}) in :init",
            severity="warning",
        )


def _check_wildcards(problem: Problem, profile: Profile, reporter: Reporter) -> None:
    """Report wildcards that are not the last of their category, or of which more than the room is said."""
    if not any(item.name.endswith(WILDCARD) for item in problem.objects):
        return
    for item, following in pairwise(problem.objects):
        if item.name.endswith(WILDCARD) and following.category == item.category and item.span is not None:
            _report_wildcard(item.name, item.span, "put it last in the line of its category", reporter)
    for atom in _atoms((*problem.init, problem.goal)):
        for position, name in enumerate(atom.args):
            spec = profile.predicates.get(atom.predicate)
            if name.endswith(WILDCARD) and atom.word_spans and (spec is None or ROOM not in spec.parameters):
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
