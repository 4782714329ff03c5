"""The check of refutations: one run comes to the place and fails there, and no run gets past it.

Part of the independent check: it knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from oag.checker.cases import Place, Reader, Rejected, require, truth_of, with_values
from oag.checker.plan import Given, Impossible, PlanRun
from oag.model.facts import HAND, ROBOT_FACTS, Fact, Value, generalisations
from oag.model.primitives import ARTICULATIONS, Primitive
from oag.table.invariants import with_consequences
from oag.table.library import Context, Effect, Needed, effect, requirements

# Where a plan whose flows are missing can be shown to end.
_NO_FLOW = "no-flow"
# Facts and places that are looked at for all cases together.
_MOST_LOOKED = 2_000_000


def failing_place(data: Mapping[str, Any], given: Sequence[Any], stop: Place | None) -> Place | None:
    """Returns the first place that one complete run does not meet; None when it meets all.

    Args:
        data: The certificate.
        given: The run: what is true or false of what is unknown; the rest is false.
        stop: The place that it should come to; where it is said that no flow exists, coming there is all.

    Raises:
        Rejected: That is no run, or it leaves a place open.
    """
    run = PlanRun(data, given, complete=True)
    for place, wanted in run.places():
        if place == stop and place[0] == _NO_FLOW:
            return place
        truth = truth_of(wanted, run.value, data["scene"]["objects"])
        require(truth is not None, f"the run leaves {place} open")
        if truth is False:
            return place
    return None


def check_refutation(data: Mapping[str, Any], stop: Place) -> None:
    """Checks that a run comes to a place and fails there, and that every run fails there or before.

    What is assumed on the way must be forced: without it the place where it is taken up would be false.

    Raises:
        Rejected: One of these is not so.
    """
    failing = failing_place(data, data["counterexample"], stop)
    require(failing == stop, f"from the counterexample's start, {failing} fails, and not {stop}")
    assumed = [(e["time"], tuple(e["fact"]), e["value"]) for e in data["assumptions"] if e["kind"] == "assumed"]
    cases, search = data["cases"], data["search"]
    if cases:
        require(not assumed and search is None and len(cases) == 1, "cases are distinguished of more than the failure")
        require(tuple(cases[0]["consumer"]) == stop, "the cases are of another place than the failure")
        _check_cases(data, cases[0]["tree"], stop)
    run = PlanRun(data)
    for place, wanted in run.places():
        _take_forced(run, wanted, assumed, data["scene"]["objects"])
        if place == stop:
            break
    _check_links(data, run, stop)
    if cases:
        return
    require(not assumed, f"nothing that the plan needs forces what is assumed: {assumed}")
    if stop[0] == _NO_FLOW:
        require(search["subtask"] == stop[1], "the search is of another subtask")
        check_search(search, run.context, wanted, run.value, data["scene"]["objects"])
        return
    shown = truth_of(wanted, run.value, data["scene"]["objects"])
    require(search is None and shown is False, f"{stop} is not shown to be false")


def forced_by(wanted: Needed, fact: Fact, value: bool, read: Reader, objects: Mapping[str, str]) -> bool:
    """True when clauses or a formula can only hold if a fact has a value, as far as is known otherwise."""
    otherwise = with_values(read, dict(with_consequences(fact, not value)))
    return truth_of(wanted, otherwise, objects) is False


def _take_forced(run: PlanRun, wanted: Needed, assumed: list[Given], objects: Mapping[str, str]) -> None:
    """Takes up what is assumed at a place, in order, and takes it off the list, as long as the place forces it."""
    while assumed and assumed[0][0] == run.time:
        time, fact, value = assumed[0]
        if not forced_by(wanted, fact, value, run.value, objects):
            return
        run.take(time, fact, value)
        del assumed[0]


def _check_cases(data: Mapping[str, Any], tree: list[Any], stop: Place) -> None:
    """Checks a distinction of cases in each of which some place is false, the failing one or one before it."""
    require(bool(tree), f"{stop} was decided by a solver alone: it has too many cases to list")
    pending: list[tuple[Given, ...]] = [()]
    looked = 0
    for split in tree:
        require(bool(pending), "a case distinction has too many cases")
        case = pending.pop()
        if split is None:
            looked += _check_case(data, case, stop)
            require(looked <= _MOST_LOOKED, "the cases take too long to look at")
        else:
            time, fact = split
            pending += [(*case, (time, tuple(fact), value)) for value in (False, True)]
    require(not pending, "a case of a distinction is missing")


def _check_case(data: Mapping[str, Any], case: tuple[Given, ...], stop: Place) -> int:
    """Checks that some place up to a failure is false in a case, or that no state is in it; returns what it took."""
    run, looked = PlanRun(data, case), 0

    def read(fact: Fact) -> Value:
        nonlocal looked
        looked += 1
        return run.value(fact)

    try:
        for place, wanted in run.places():
            looked += 1
            if place[0] != _NO_FLOW and truth_of(wanted, read, data["scene"]["objects"]) is False:
                return looked
            require(place != stop, f"in the case {list(case)}, nothing up to {stop} is false")
    except Impossible:
        return looked
    raise Rejected(f"the plan does not come to {stop}")


def _check_links(data: Mapping[str, Any], run: PlanRun, stop: Place) -> None:
    """Checks that every link is of the failing place, and names the last write of its fact and whether it does."""
    for kind, subtask, step, fact, value, positive, producer in data["links"]:
        written, known = run.last(tuple(fact))
        require((kind, subtask, step) == stop, f"a link is out of place: {(kind, subtask, step)}")
        require(producer == written, f"{stop}: {tuple(fact)} is written at {written}, not {producer}")
        require(known is not None and type(positive) is bool and value is not None, f"a link of {stop} says nothing")


_State = tuple[Value, ...]


def check_search(
    search: Mapping[str, Any], context: Context, goal: Needed, read: Reader, objects: Mapping[str, str]
) -> None:
    """Checks that no flow of a subtask reaches its goal.

    A state gives a value, or null for unknown, to every fact listed; it stands for all complete states that agree.

    Args:
        search: `facts`, the robot's three among them; `states`, each a list of values in the order of the facts; and
            `start`, the one of them that describes where the subtask starts.
        context: The subtask's objects.
        goal: Its goal.
        read: What is known where it starts.
        objects: Category of each object.

    Raises:
        Rejected: The start is not among the states, a primitive leads out of them, or the goal may hold in one.
    """
    facts = [tuple(fact) for fact in search["facts"]]
    states = {tuple(state) for state in search["states"]}
    require(set(ROBOT_FACTS) <= set(facts), "a search leaves out a variable of the robot")
    require(all(len(state) == len(facts) for state in states), "a state of a search has too few or too many values")
    start = tuple(map(read, facts))
    require(start == tuple(search["start"]) and start in states, "the start is not among the states of the search")
    legal = _legal(context, objects)
    for state in states:
        known = dict(zip(facts, state, strict=True))
        require(truth_of(goal, known.get, objects) is False, f"a state of the search may meet the goal: {known}")
        for primitive in legal:
            if truth_of(requirements(primitive, context, known[HAND]), known.get, objects) is not False:
                after = _after(known, effect(primitive, context, known[HAND]))
                require(after in states, f"{primitive.name} leads out of the states of the search")


def _legal(context: Context, objects: Mapping[str, str]) -> tuple[Primitive, ...]:
    """Returns the primitives that a well-formed flow may use in a context."""
    fixture = context.target in context.articulated
    illegal = set[Primitive]() if fixture else set(ARTICULATIONS)
    if not (fixture or context.target_is_item):
        illegal.add(Primitive.GRASP)
    if context.support_goal not in objects:
        illegal.add(Primitive.NAVIGATE_TO_SUPPORT)
    return tuple(primitive for primitive in Primitive if primitive not in illegal)


def _after(known: dict[Fact, Value], written: Effect) -> _State:
    """Returns the state after an effect, whose most specific write to a fact counts."""
    writes = dict(written)
    return tuple(
        next((writes[pattern] for pattern in generalisations(fact) if pattern in writes), value)
        for fact, value in known.items()
    )
