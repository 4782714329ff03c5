"""Parse forms `(define ...)` to problems and domains, and check the rules for a problem as a whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from itertools import pairwise
from types import MappingProxyType
from typing import TypeAlias

from bddl.ast import (
    RESERVED_WORDS,
    And,
    Atom,
    Binder,
    Formula,
    Literal,
    Not,
    Quantified,
    Span,
    affirmed,
    is_name,
    literals,
)
from bddl.diagnostics import Reporter
from bddl.dialects import ROOM, Profile, near_names
from bddl.lexer import Group, Item, Word, form_text, words_in
from bddl.problem import (
    ROOT_CATEGORY,
    WILDCARD,
    Domain,
    DomainAction,
    DomainPredicate,
    LiberoProblem,
    Problem,
    TypedObject,
)
from bddl.sections import (
    LIBERO_READERS,
    UNNAMED,
    ObjectsReader,
    ProblemDraft,
    SectionNames,
    SectionReader,
    collect_sections,
    read_name,
    report_unknown,
)


def read_problem(group: Group, profile: Profile, scene: Mapping[str, str] | None, reporter: Reporter) -> Problem | None:
    """Return the problem that a form defines, or None after reporting a mistake."""
    draft = ProblemDraft(profile, reporter, scene)
    _use_domain(draft, next(iter(profile.domains), UNNAMED))
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
        # No single section shows this mistake: the sections do not fit into one problem.
        reporter.add("bad-section", group.opened.span, str(error), hint="write the sections as bddl.format prints them")
        return None
    apply_rules(problem, draft.profile, reporter)
    return problem


def apply_rules(problem: Problem, profile: Profile, reporter: Reporter, used: Set[str] | None = None) -> None:
    """Check the rules of a profile for a problem as a whole; `used` has its predicates, where they are known."""
    for name, rule in _RULES.items():
        about = _ABOUT.get(name)
        if name in profile.rules and (used is None or about is None or not used.isdisjoint(about)):
            rule(problem, profile, reporter)


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
    if profile.domains and name not in profile.domains:
        message = f"The profile `{profile.name}` has no domain `{word.text}`."
        report_unknown(reporter, "unknown-domain", word.span, message, name, tuple(profile.domains))
        return
    _use_domain(draft, name)


def _use_domain(draft: ProblemDraft, name: str) -> None:
    draft.domain = name
    if name in draft.profile.domains:
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


# Reader of each section of any dialect.
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

# Substances that a machine makes: the goal need not demand them.
_MADE_BY = {"water.n.06": "washer.n.03"}


def _check_kinematics(problem: Problem, profile: Profile, reporter: Reporter) -> None:
    for literal in problem.init:
        if not isinstance(literal, Not):
            continue
        atom = literal.body
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


def init_literals(problem: Problem) -> Iterator[tuple[Literal, Formula]]:
    """Yield the literals of `:init`, each with its formula; a doubled negation counts as none."""
    for formula in problem.init:
        for literal in literals(formula) or ():
            yield literal, formula


def find_contradictions(problem: Problem, reporter: Reporter) -> None:
    """Report atoms that `:init` both affirms and denies, at the place of the denial: no state is such a start."""
    if not [formula for formula in problem.init if not isinstance(formula, Atom)]:
        return
    stated: dict[Atom, tuple[bool, Formula]] = {}
    for literal, formula in init_literals(problem):
        value, first = stated.setdefault(literal.atom, (literal.value, formula))
        place, other = (first, formula) if literal.value else (formula, first)
        if value != literal.value and place.span is not None:
            reporter.add(
                "contradictory-init",
                place.span,
                f"The section :init says both {literal.atom} and (not {literal.atom}).",
                hint="remove the one that is not meant",
                related=other.span,
            )


def _check_futures(problem: Problem, profile: Profile, reporter: Reporter) -> None:
    """Check the objects that do not exist at the start (`future`), and the goal's demands that objects exist (`real`).

    The goal must demand each future object, and :init can list nothing else about it. To demand an object that exists
    at the start is idle.
    """
    nodes = list(problem.goal.walk())
    starts = [one for one in problem.init if not isinstance(one, Atom) or one.predicate == "future"]
    futures = {
        name: formula.span
        for formula in starts
        for literal in literals(formula) or ()
        if literal.atom.predicate == "future" and literal.value
        for name in literal.atom.args[:1]
    }
    demands = [node for node in nodes if isinstance(node, Atom) and node.predicate == "real"]
    if not futures and not demands:
        return
    category = {item.name: item.category for item in problem.objects}
    real = {name for atom in affirmed(problem.goal) if atom.predicate == "real" for name in atom.args}
    ranges = {
        binder.variable: binder.category for node in nodes if isinstance(node, Quantified) for binder in node.binders
    }
    real_categories = {ranges[name] for name in real if name in ranges}
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


# Predicates that may hold of an object that does not exist yet.
_FUTURE_PREDICATES = frozenset({"future", "insource"})


def _report_described(problem: Problem, futures: Mapping[str, Span | None], reporter: Reporter) -> None:
    for literal, formula in init_literals(problem) if futures else ():
        name = next((name for name in literal.atom.args if name in futures), "")
        if not (name and literal.value) or literal.atom.predicate in _FUTURE_PREDICATES:
            continue
        if formula.span is not None:
            reporter.add(
                "described-future",
                formula.span,
                f"`{name}` does not exist at the start, and the section :init says {literal} of it.",
                hint=f"remove this literal, or (future {name})",
                related=futures[name],
            )


def _report_idle(problem: Problem, futures: Set[str], ranges: Mapping[str, str], reporter: Reporter) -> None:
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
    if not [item for item in problem.objects if item.name.endswith(WILDCARD)]:
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
    """Warn of regions with an undeclared target: LIBERO reads them, and nothing can ever be in them."""
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


def _check_types(problem: Problem, profile: Profile, reporter: Reporter) -> None:
    for item in problem.objects if profile.typed else ():
        if item.category not in profile.types and item.span is not None:
            near = near_names(item.category, profile.types)
            listed = ", ".join(sorted(profile.types))
            reporter.add(
                "unknown-category",
                item.span,
                f"`{item.name}` has the category `{item.category}`, which is no type of the domain.",
                expected=near or sorted(profile.types),
                hint=f"did you mean {' or '.join(near)}?" if near else f"the types are: {listed}",
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
        "types": _check_types,
    }
)

# The predicates that a rule is about, without which there is nothing to check; of the others, any.
_ABOUT: Mapping[str, Set[str]] = MappingProxyType({"futures": frozenset({"future", "real"})})

# Requirements of a domain; only their names are checked.
REQUIREMENTS = (":strips", ":negative-preconditions", ":typing", ":adl")
_SECTIONS = ("domain", ":requirements", ":types", ":predicates", ":action")


def read_domain(group: Group, reporter: Reporter) -> Domain:
    """Return the domain that a form defines; mistakes in it are reported and left out.

    Source: the reference implementation, `parse_domain`, which reads the name of every action as `:parameters`.
    """
    names = SectionNames("language", "domain", _SECTIONS, ("domain", ":predicates"), repeatable=(":action",))
    sections = collect_sections(group, names, reporter)
    title = read_name(sections["domain"][0], reporter) if "domain" in sections else None
    inside = {name: [item for section in found for item in section.items[1:]] for name, found in sections.items()}
    types = _typed(inside.get(":types", ()), reporter, "TYPE ... - SUPERTYPE")
    return Domain(
        UNNAMED if title is None else title.text,
        _requirements(inside.get(":requirements", ()), reporter),
        tuple(TypedObject(word.key, kind, span=word.span) for word, kind in types if is_name(word.key)),
        _predicates(inside.get(":predicates", ()), reporter),
        _actions(sections.get(":action", ()), reporter),
        span=group.span,
    )


def _requirements(items: Sequence[Item], reporter: Reporter) -> tuple[str, ...]:
    for item in items:
        key = item.key if isinstance(item, Word) else ""
        if key not in REQUIREMENTS:
            message = f"There is no requirement `{reporter.quote(item.span)}`."
            report_unknown(reporter, "unknown-requirement", item.span, message, key, REQUIREMENTS)
    return tuple(word.key for word in words_in(items))


def _predicates(items: Sequence[Item], reporter: Reporter) -> tuple[DomainPredicate, ...]:
    found: dict[str, DomainPredicate] = {}
    for item in items:
        head = item.head if isinstance(item, Group) else None
        if not isinstance(item, Group) or head is None or head.kind != "NAME" or head.key in RESERVED_WORDS:
            reporter.add(
                "bad-predicate",
                item.span,
                "The declaration of a predicate belongs here.",
                expected=("(NAME ?a ?b)",),
                hint="write the predicate with its parameters, such as (ontop ?item ?support)",
            )
        elif head.key in found:
            reporter.add(
                "repeated-predicate",
                head.span,
                f"The predicate `{head.key}` is declared twice.",
                hint="declare it once",
                related=found[head.key].span,
            )
        else:
            parameters = _parameters(_typed(item.items[1:], reporter, "?a ?b - TYPE"), reporter)
            found[head.key] = DomainPredicate(head.key, parameters, span=item.span)
    return tuple(found.values())


def _parameters(pairs: Sequence[tuple[Word, str]], reporter: Reporter) -> tuple[Binder, ...]:
    parameters: list[Binder] = []
    for word, kind in pairs:
        name = word.key.removeprefix("?")
        if word.kind != "VARIABLE" or not is_name(name) or name in (parameter.variable for parameter in parameters):
            marked = f"?{name}" if is_name(name) and word.kind == "NAME" else ""
            reporter.add(
                "bad-predicate",
                word.span,
                f"`{word.text}` is no parameter: a parameter begins with a question mark, and has a name of its own.",
                expected=("?a",),
                hint=f"write {marked}" if marked else "",
                replacement=reporter.replacement_for(word.span, marked),
            )
        else:
            parameters.append(Binder(name, kind))
    return tuple(parameters)


def _typed(items: Sequence[Item], reporter: Reporter, shape: str) -> list[tuple[Word, str]]:
    """Return words with the type behind the next hyphen, `object` when there is none."""
    pairs: list[tuple[Word, str]] = []
    waiting: list[Word] = []
    position = 0
    while position < len(items):
        item = items[position]
        following = items[position + 1] if position + 1 < len(items) else None
        position += 1
        if isinstance(item, Word) and item.kind == "HYPHEN":
            position += 1
            if waiting and isinstance(following, Word) and following.kind == "NAME":
                pairs += [(word, following.key) for word in waiting]
                waiting = []
                continue
        elif isinstance(item, Word):
            waiting.append(item)
            continue
        reporter.add(
            "bad-objects",
            item.span,
            "Names belong here, and one type behind each hyphen.",
            expected=(shape,),
            hint=f"write {shape}",
        )
    return pairs + [(word, ROOT_CATEGORY) for word in waiting]


def _actions(sections: Sequence[Group], reporter: Reporter) -> tuple[DomainAction, ...]:
    found: dict[str, DomainAction] = {}
    for section in sections:
        word = section.items[1] if len(section.items) > 1 else None
        if not isinstance(word, Word) or word.kind != "NAME":
            reporter.add(
                "bad-section",
                section.items[0].span,
                "The name of the action belongs behind :action.",
                expected=("NAME",),
                hint="write (:action NAME :parameters (...) :precondition (...) :effect (...))",
            )
        elif word.text in found:
            reporter.add("repeated-section", word.span, f"The action `{word.text}` is there twice.")
        else:
            found[word.text] = DomainAction(word.text, form_text(section), span=section.span)
    return tuple(found.values())
