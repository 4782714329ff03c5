"""From the form `(define (problem ...) ...)` to a problem, section by section, as a table says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType

from bddl.reading.formulas.terms import TermReader
from bddl.reading.problems.libero_sections import LIBERO_READERS
from bddl.reading.problems.objects import ObjectsReader
from bddl.reading.problems.rules import check_rules
from bddl.reading.problems.sections import (
    UNNAMED,
    ProblemDraft,
    SectionNames,
    SectionReader,
    collect_sections,
    read_name,
)
from bddl.reading.words.forest import Group
from bddl.syntax import And, Atom, Formula, Not
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.names import near_names
from bddl.syntax.problem import Domain, Problem
from bddl.syntax.profiles import Profile


def read_problem(
    group: Group, profile: Profile, scene: Mapping[str, str] | None, domain: Domain | None, reporter: Reporter
) -> Problem | None:
    """Returns the problem that a form defines, or None when something in it was wrong and has been reported.

    Args:
        group: The form.
        profile: The dialect.
        scene: Objects that exist besides those declared, or None; when given, a declared object must be among them.
        domain: The domain that the problem must belong to, or None when the problem may say.
        reporter: Receives the diagnostics.
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
    check_rules(problem, draft.profile, reporter)
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
        near = near_names(name, legal)
        reporter.add(
            "unknown-domain",
            word.span,
            f"The domain that was given is `{legal[0]}`, not `{word.text}`."
            if draft.given is not None
            else f"The profile `{profile.name}` has no domain `{word.text}`.",
            expected=near or legal,
            hint=f"did you mean {near[0]}?" if near else f"the domains are: {', '.join(legal)}",
        )
        return
    _use_domain(draft, name)


def _use_domain(draft: ProblemDraft, name: str) -> None:
    draft.domain = name
    if draft.given is not None:
        draft.profile = draft.profile.for_domain(draft.given.specs)
    elif name in draft.profile.domains:
        draft.profile = draft.profile.for_domain(draft.profile.domains[name])


def _read_objects(draft: ProblemDraft, sections: Sequence[Group]) -> None:
    terms = TermReader(draft.profile, draft.scene, draft.reporter)
    reader = ObjectsReader(draft.profile, terms, draft.reporter)
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
