"""Lint legal texts: goals that hold at the start or in no state, swapped arguments, forgotten objects.

`analyse` runs all checks, those of `lint_quantifiers` included.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import chain

from bddl.ast import (
    And,
    Atom,
    Exists,
    ForAll,
    Formula,
    ForN,
    ForPairs,
    Literal,
    Or,
    Quantified,
    Span,
    affirmed,
    atoms,
    conjuncts,
    literals,
)
from bddl.definitions import find_contradictions, init_literals
from bddl.diagnostics import BDDLError, Diagnostic, Reporter
from bddl.dialects import ITEM_FIRST, Profile, find_profile, size_of, swap_reason
from bddl.errors import SolverMissing
from bddl.evaluation import evaluate
from bddl.grounding import children, count_ground_parts, ground
from bddl.lint_quantifiers import (
    find_counted_wildcards,
    find_empty_ranges,
    find_idle_variables,
    find_mixed_instances,
    find_reflexive_atoms,
    ranges_over_wildcard,
    walk_scoped,
)
from bddl.parser import read
from bddl.printer import format
from bddl.problem import Domain, Objects, Problem, categories_of
from bddl.smt import Script, Solver


def analyse(
    subject: str | Problem | Formula,
    profile: str | Profile = "scene",
    objects: Objects | None = None,
    *,
    prove: bool = True,
) -> tuple[Diagnostic, ...]:
    """Return everything that is wrong with a problem or a formula, or suspicious about it.

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
    dialect, known = find_profile(profile, text), None if objects is None else categories_of(objects)
    try:
        found, warnings = read(text, "any", dialect, known)
    except BDDLError as error:
        return error.diagnostics
    reporter = Reporter(text)
    if isinstance(found, Problem):
        _examine_problem(found, {**(known or {}), **dialect.builtin_objects, **found.categories}, reporter, prove)
    elif not isinstance(found, Domain):
        _examine_formula(found, None if known is None else {**dialect.builtin_objects, **known}, reporter, prove)
    # Findings of the profile's own rules were reported while reading and are not repeated.
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
    if is_examinable(problem.goal, objects, reporter):
        find_reached_goal(problem, objects, reporter)
        if prove:
            find_impossible_goal(problem.goal, objects, reporter)


def _examine_formula(formula: Formula, objects: Mapping[str, str] | None, reporter: Reporter, prove: bool) -> None:
    find_swapped_arguments(formula, objects or {}, reporter)
    if objects is None:
        find_idle_variables(formula, {}, reporter)
        find_reflexive_atoms(formula, {}, reporter)
        return
    _examine_quantifiers(formula, objects, reporter)
    if prove and is_examinable(formula, objects, reporter):
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
    """Report repeated literals of `:init`: harmless, yet often another object was meant."""
    first_spans: dict[Literal, Span | None] = {}
    for literal, formula in init_literals(problem):
        span = formula.span
        if literal in first_spans and span is not None:
            reporter.add(
                "repeated-literal",
                span,
                f"The section :init says {literal} more than once.",
                hint="remove one of them, or name the object that was meant",
                related=first_spans[literal],
                severity="warning",
            )
        first_spans.setdefault(literal, span)


def find_forgotten_futures(problem: Problem, reporter: Reporter) -> None:
    """Report objects that do not exist at the start (`future`) and that the goal does not mention.

    Such an object never has to come into being. The goal may demand it by `real` or by any other atom about it.
    """
    wanted = {name for name, _ in _objects_in(problem.goal)}
    nodes = problem.goal.walk()
    ranged = {binder.category for node in nodes if isinstance(node, Quantified) for binder in node.binders}
    category = problem.categories
    for literal, formula in init_literals(problem):
        name, span = literal.atom.args[0] if literal.atom.args else "", formula.span
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
    """Report objects of the goal that a non-empty `:init` does not mention."""
    described = frozenset(name for literal, _ in init_literals(problem) for name in literal.atom.args)
    declared = {item.name for item in problem.objects}
    if not described:
        return
    reported: set[str] = set()
    for name, span in _objects_in(problem.goal):
        if span is not None and name in declared and name not in described and name not in reported:
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
    for node, scope in walk_scoped(goal):
        if isinstance(node, Atom):
            places = node.word_spans[1:] or (None,) * len(node.args)
            yield from (
                (name, span) for name, span in zip(node.args, places, strict=True) if scope.binding(name) is None
            )


# A goal that grounds to more atoms than this is not examined; the largest of the 1016 BEHAVIOR activities has 216.
MOST_ATOMS = 20_000
# Limit of the contradicting conjuncts that are minimized.
_MOST_CONJUNCTS = 60
_MOST_SHOWN = 6
_SATISFIABLE = "whether some state satisfies the goal"


def is_examinable(goal: Formula, objects: Mapping[str, str], reporter: Reporter) -> bool:
    """Decide whether a goal is small enough for its states to be examined; report it when it is not."""
    if count_ground_parts(goal, objects, MOST_ATOMS) <= MOST_ATOMS:
        return True
    if goal.span is not None:
        reason = f"it spells out to more than {MOST_ATOMS} atoms"
        advice = "give fewer objects, or fewer nested quantifiers"
        question = "whether the goal holds at the start, or in any state at all"
        _report_unchecked(goal.span, question, reason, advice, reporter)
    return False


def find_reached_goal(problem: Problem, objects: Mapping[str, str], reporter: Reporter) -> None:
    """Report a goal that the start satisfies, so that doing nothing reaches it.

    The start is read as the simulators read it: an atom that `:init` does not list is false; an object is `real`
    unless it is listed as `future`; a container that is `filled` with a substance `contains` it.
    """
    span = problem.goal.span
    if span is None:
        return
    if ranges_over_wildcard(problem.goal, objects):
        reason, advice = "it ranges over a wildcard", "declare the objects that are meant by name"
        _report_unchecked(span, "whether the goal holds at the start", reason, advice, reporter)
        return
    state = start_state(problem)
    if not evaluate(problem.goal, state, objects):
        return
    if isinstance(problem.goal, And) and not problem.goal.parts:
        message, hint = "The goal asks for nothing.", "write what is to be achieved"
    else:
        message = "The goal holds at the start, so doing nothing reaches it."
        denied = [str(literal.atom) for literal in literals(problem.goal) or () if not literal.value]
        listed = f": {', '.join(denied[:_MOST_SHOWN])}" if denied else ""
        hint = f"what :init does not list is false at the start{listed}; correct the goal, or add to :init"
    reporter.add("goal-holds-at-start", span, message, hint=hint, severity="warning")


def start_state(problem: Problem) -> Callable[[Atom], bool]:
    """Return the state in which a problem starts, complete under the closed-world assumption."""
    listed = frozenset(literal.atom for literal, _ in init_literals(problem) if literal.value)

    def holds(atom: Atom) -> bool:
        if atom.predicate == "real" and atom not in listed:
            return Atom("future", atom.args) not in listed
        if atom.predicate == "contains" and Atom("filled", atom.args) in listed:
            return True
        return atom in listed

    return holds


def find_impossible_goal(goal: Formula, objects: Mapping[str, str], reporter: Reporter) -> None:
    """Report a goal that no state satisfies, and the fewest conjuncts that contradict each other.

    The proof regards atoms as independent: it assumes nothing about what a world allows. Conjuncts that range over a
    wildcard are left out, since the number of its objects is unknown.
    """
    span = goal.span
    if span is None:
        return
    whole = conjuncts(goal)
    parts = tuple(part for part in whole if not ranges_over_wildcard(part, objects))
    known = And(parts)
    if any(evaluate(known, guess, objects) for guess in _guesses(known)):
        return
    try:
        clash = _find_clash(parts, objects)
    except SolverMissing:
        _report_unchecked(span, _SATISFIABLE, "z3 is not installed", "pip install z3-solver", reporter)
        return
    if clash is None:
        _report_unchecked(span, _SATISFIABLE, "z3 did not decide it in time", "the goal may be all right", reporter)
    elif clash:
        _report_impossible(span, clash, len(whole), reporter)


def _find_clash(parts: tuple[Formula, ...], objects: Mapping[str, str]) -> tuple[Formula, ...] | None:
    """Return conjuncts that contradict each other and of which none can be left out; none when all can hold."""
    grounded = ground(And(parts), objects)
    script = Script()
    atoms = [f"a{index}" for index in range(len(grounded.atoms))]
    script.declare(*atoms)
    names = [script.name(script.term(root, atoms.__getitem__)) for root in children(grounded.root)]
    session = Solver(script.text())
    answer = session.check([(name, True) for name in names])
    if answer.status != "unsat":
        return () if answer.status == "sat" else None
    core = [name for name, _ in answer.core]
    for name in list(core)[:_MOST_CONJUNCTS]:
        fewer = [other for other in core if other != name]
        if session.check([(other, True) for other in fewer]).status == "unsat":
            core = fewer
    return tuple(part for part, name in zip(parts, names, strict=True) if name in core)


def _guesses(goal: Formula) -> Iterator[Callable[[Atom], bool]]:
    """Yield states that satisfy most goals: the atoms that the goal affirms, all atoms of its predicates, or none."""
    wanted = frozenset(affirmed(goal))
    predicates = frozenset(atom.predicate for atom in wanted)
    yield lambda atom: atom in wanted
    yield lambda atom: atom.predicate in predicates
    yield lambda atom: False


def _report_impossible(span: Span, clash: tuple[Formula, ...], count: int, reporter: Reporter) -> None:
    if len(clash) == 1:
        own = clash[0].span or span
        message = "No state satisfies the goal." if count == 1 else "No state satisfies this conjunct of the goal."
        reporter.add("impossible-goal", own, message, hint=_advice(clash))
        return
    places = [part.span for part in clash if part.span is not None]
    shown = ", ".join(f"{place.line}:{place.column}" for place in places[:_MOST_SHOWN])
    more = ", ..." if len(places) > _MOST_SHOWN else ""
    reporter.add(
        "impossible-goal",
        span,
        f"No state satisfies the goal: {len(clash)} of its {count} conjuncts, at {shown}{more}, cannot hold together."
        if len(clash) < count
        else f"No state satisfies the goal: its {count} conjuncts, at {shown}{more}, cannot hold together.",
        hint=_advice(clash),
    )


def _advice(clash: tuple[Formula, ...]) -> str:
    nodes = [node for part in clash for node in part.walk()]
    thoughts: list[str] = []
    if any(isinstance(node, ForN) for node in nodes):
        thoughts.append("forn counts exactly")
    if any(isinstance(node, ForPairs) for node in nodes):
        thoughts.append("no object is paired with itself, or twice")
    if any(isinstance(node, ForAll | Exists | ForN) for node in nodes):
        thoughts.append("a quantifier speaks of every object of its category")
    if thoughts:
        return f"remember that {', and that '.join(thoughts)}"
    if any(isinstance(node, Or) and not node.parts for node in nodes):
        return "(or) is never true: write what may hold instead"
    return "remove what contradicts the rest, or join alternatives with or"


def _report_unchecked(span: Span, question: str, reason: str, hint: str, reporter: Reporter) -> None:
    reporter.add("unchecked-goal", span, f"It was not examined {question}: {reason}.", hint=hint, severity="note")


def find_swapped_roles(problem: Problem, objects: Mapping[str, str], reporter: Reporter) -> None:
    """Report atoms whose arguments seem to be swapped.

    There are three kinds of evidence. An atom of `:init` is the reverse of one in the goal. The first thing is
    furniture and the second fits into a hand. A substance stands in the place of the thing that it fills or covers, or
    the gripper in that of the thing that it holds. A word outside of the small lexicon is no evidence.
    """
    at_start = frozenset(chain.from_iterable(atoms(formula) for formula in problem.init))
    for formula in (*problem.init, problem.goal):
        in_goal = formula is problem.goal
        find_swapped_arguments(formula, objects, reporter, at_start if in_goal else frozenset())


def find_swapped_arguments(
    formula: Formula, objects: Mapping[str, str], reporter: Reporter, at_start: frozenset[Atom] = frozenset()
) -> None:
    """Report atoms of one formula whose arguments seem to be swapped."""
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
                replacement=reporter.replacement_for(node.span, swapped),
            )


def _reason(atom: Atom, categories: list[str], at_start: frozenset[Atom]) -> str:
    first, second = categories
    reason = swap_reason(atom.predicate, first, second)
    if reason or first == second or atom.predicate not in ITEM_FIRST:
        return reason
    reverse = Atom(atom.predicate, atom.args[::-1])
    alike = size_of(first) is not None and size_of(first) is size_of(second)
    return ":init says it the other way round" if reverse in at_start and not alike else ""
