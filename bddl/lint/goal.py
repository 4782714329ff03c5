"""Findings about the goal as a whole: already reached at the start, or out of reach in every state."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from bddl.lint.quantifiers import ranges_over_wildcard
from bddl.reading.problem_reader import init_literals
from bddl.semantics.ground import children, ground
from bddl.semantics.members import spelled_out
from bddl.semantics.truth import evaluate
from bddl.solver import Script, Solver
from bddl.syntax.diagnostic import Reporter
from bddl.syntax.errors import SolverMissing
from bddl.syntax.problem import Problem
from bddl.syntax.structure import affirmed, conjuncts, literals
from bddl.syntax.tree import And, Atom, Exists, ForAll, Formula, ForN, ForPairs, Or, Span

# A goal that spells out to more atoms than this is not examined; the largest of the 1016 BEHAVIOR activities has 216.
MOST_ATOMS = 20_000
# Conjuncts that contradict each other are singled out up to this number.
_MOST_CONJUNCTS = 60
_MOST_SHOWN = 6
_SATISFIABLE = "whether some state satisfies the goal"


def is_spelt_out(goal: Formula, objects: Mapping[str, str], reporter: Reporter) -> bool:
    """Decides whether a goal is small enough for its states to be examined; reports that it is not."""
    if spelled_out(goal, objects, MOST_ATOMS) <= MOST_ATOMS:
        return True
    if goal.span is not None:
        reason = f"it spells out to more than {MOST_ATOMS} atoms"
        advice = "give fewer objects, or fewer nested quantifiers"
        question = "whether the goal holds at the start, or in any state at all"
        _report_unchecked(goal.span, question, reason, advice, reporter)
    return False


def find_reached_goal(problem: Problem, objects: Mapping[str, str], reporter: Reporter) -> None:
    """Reports a goal that the start satisfies, so that doing nothing reaches it.

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
    """Returns the state in which a problem starts, complete under the closed-world assumption."""
    listed = frozenset(literal.atom for literal, _ in init_literals(problem) if literal.value)

    def holds(atom: Atom) -> bool:
        if atom.predicate == "real" and atom not in listed:
            return Atom("future", atom.args) not in listed
        if atom.predicate == "contains" and Atom("filled", atom.args) in listed:
            return True
        return atom in listed

    return holds


def find_impossible_goal(goal: Formula, objects: Mapping[str, str], reporter: Reporter) -> None:
    """Reports a goal that no state satisfies, and the fewest conjuncts that cannot hold together.

    The proof regards atoms as independent of each other: it takes nothing for granted about what a world allows. What
    ranges over a wildcard is left out of it, since nobody knows how many objects that is.
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
        clash = _clash(parts, objects)
    except SolverMissing:
        _report_unchecked(span, _SATISFIABLE, "z3 is not installed", "pip install z3-solver", reporter)
        return
    if clash is None:
        _report_unchecked(span, _SATISFIABLE, "z3 did not decide it in time", "the goal may be all right", reporter)
    elif clash:
        _report_impossible(span, clash, len(whole), reporter)


def _clash(parts: tuple[Formula, ...], objects: Mapping[str, str]) -> tuple[Formula, ...] | None:
    """Returns conjuncts that cannot hold together and of which none can be left out; none when all can hold.

    Returns:
        The conjuncts, empty when some state satisfies all of them, or None when the solver did not decide.

    Raises:
        SolverMissing: z3 is not installed.
    """
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
    """Yields states that satisfy most goals: what the goal affirms is true, or all is true, or nothing is."""
    wanted = frozenset(affirmed(goal))
    predicates = frozenset(atom.predicate for atom in wanted)
    yield lambda atom: atom in wanted
    yield lambda atom: atom.predicate in predicates
    yield lambda atom: False


def _report_impossible(span: Span, clash: tuple[Formula, ...], count: int, reporter: Reporter) -> None:
    if len(clash) == 1:
        own = clash[0].span or span
        message = "No state satisfies the goal." if count == 1 else "No state satisfies this conjunct of the goal."
        reporter.add("impossible-goal", own, message, hint=_way_out(clash))
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
        hint=_way_out(clash),
    )


def _way_out(clash: tuple[Formula, ...]) -> str:
    """Returns what to think of, by the forms that the conjuncts consist of."""
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
