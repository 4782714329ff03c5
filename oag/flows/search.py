"""The search for a subtask's action flow: the known templates first, then breadth first over what is known.

A state of the search is what is known of the robot and of the facts that matter (`View`). Since those are few and
each has few values, the states that a subtask can reach are few as well, and the search is complete: when it ends
without a flow, the states it saw are closed under all primitives and none meets the goal. That set is the proof.

Source: docs/semantics.md, Flows that are searched.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import NamedTuple

import bddl
from oag.model.actions import ActionFlow
from oag.model.categories import Kind, has_boards
from oag.model.facts import HAND, held_by
from oag.model.primitives import Parameter, Primitive, applicable
from oag.progression.compiled import CompiledSubtask
from oag.table.library import NAVIGATION, Needed
from oag.table.state import View, facts_of, granted, step, truth_of

# The flows that simple tasks have, their numbers open, by the paper's table of initial action flows. Departures: every
# flow begins with a navigation, every release ends with a retreat, the hand is moved down at the end of every placing,
# and it backs out of what it has taken a thing out of (docs/departures.md).
_REACH = (Primitive.NAVIGATE_TO_TARGET, Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP)
_RELEASE = (Primitive.UNGRASP, Primitive.RETREAT)

OPEN = (*_REACH, Primitive.ARTICULATE_OPEN, *_RELEASE)
CLOSE = (*_REACH, Primitive.ARTICULATE_CLOSE, *_RELEASE)
PICK = (*_REACH, Primitive.LIFT_EEF_UP)
# Within a compartment, or under a shelf's next board, a lift takes nothing out: the hand has to back out with it.
TAKE_OUT = (*PICK, Primitive.RETREAT)
PLACE = (Primitive.NAVIGATE_TO_SUPPORT, Primitive.MOVE_BASE_FORWARD, Primitive.LIFT_EEF_DOWN, *_RELEASE)
# Picking up and putting down in one subtask; shorter flows do without the lift, which only the symbols allow.
TRANSPORT = (*PICK, *PLACE)


TEMPLATES = (OPEN, CLOSE, PICK, TAKE_OUT, PLACE, TRANSPORT)

# More states than any subtask of a real scene reaches; beyond it the search gives up without a claim.
MOST_STATES = 20_000
# Of flows equally long, the first in this order is taken: go there, reach, act, let go, move away.
ORDER = (17, 18, 1, 2, 3, 4, 19, 5, 7, 6, 8, 9, 10, 11, 12, 13, 14, 15, 16, 20, 21)

PrimitiveFlow = tuple[Primitive, ...]
# Returns the state after a primitive, None when it may not run.
_Step = Callable[[View, CompiledSubtask, Primitive, Parameter], View | None]


def taking(relation: str, category: str) -> PrimitiveFlow:
    """Returns the flow that takes a thing from where it stands.

    Args:
        relation: How it stands there, "ontop" or "inside".
        category: Of what it stands on or in.
    """
    return TAKE_OUT if relation == "inside" or has_boards(category) else PICK


class Found(NamedTuple):
    """A flow and what is known after it."""

    flow: PrimitiveFlow
    state: View


class TooManyStates(Exception):
    """A search gave up before it was complete."""


class Leave(IntEnum):
    """How much a flow may leave open; what is open is assumed, a goal only where nothing else will do."""

    NOTHING = 0
    PRECONDITIONS = 1
    GOALS = 2


def legal_primitives(kind: Kind, support_goal: str | None) -> PrimitiveFlow:
    """Returns the primitives that a well-formed flow may use on a target of this kind, in the order of preference."""
    return tuple(
        primitive
        for primitive in map(Primitive, ORDER)
        if applicable(primitive, kind) and not (primitive is NAVIGATION[1] and support_goal is None)
    )


def flows(start: View, subtask: CompiledSubtask, legal: PrimitiveFlow, leave: Leave = Leave.NOTHING) -> Iterator[Found]:
    """Yields flows that take a subtask from a state to its goal, with what is known after each.

    Args:
        start: What is known where the subtask starts.
        subtask: Its objects and its goal.
        legal: The primitives that a flow may use, from `legal_primitives`.
        leave: How much may stay unknown: nothing, preconditions, or parts of the goal as well.

    Yields:
        One flow for each state that the goal may hold in, those that leave least open first, as `Leave` orders it, and
        of open goals those with the fewest open parts. Among equals comes the empty flow when the goal holds already;
        then templates that work, in the order of `TEMPLATES`; then the shortest.

    Raises:
        TooManyStates: The search reached `MOST_STATES` states; what was found before was yielded.
    """
    seen: set[View] = set()
    gave_up = False
    for level in Leave:
        if level > leave:
            break
        try:
            for found in _leaving(start, subtask, legal, level):
                if found.state not in seen:
                    seen.add(found.state)
                    yield found
        except TooManyStates:
            gave_up = True
    if gave_up:
        raise TooManyStates


def _leaving(start: View, subtask: CompiledSubtask, legal: PrimitiveFlow, level: Leave) -> Iterator[Found]:
    """Yields the flows that leave as much open as a level says, and perhaps less."""
    goal = subtask.goal
    if level is not Leave.GOALS:
        taken = _known_step if level is Leave.NOTHING else _assumed_step
        yield from (found for found in _tried(start, subtask, legal, taken) if found.state.truth(goal) is True)
        return
    opened = [
        found
        for taken in (_known_step, _assumed_step)
        for found in _tried(start, subtask, legal, taken)
        if found.state.truth(goal) is None
    ]
    # Sorting keeps the order among equals, so known preconditions, templates and short flows come first.
    yield from sorted(opened, key=lambda found: _open_parts(found.state, goal))
    # Of several unknown alternatives the first was assumed above; another may be the one that helps.
    yield from (
        found for found in _tried(start, subtask, legal, _possible_step) if found.state.truth(goal) is not False
    )


def _open_parts(state: View, wanted: Needed) -> int:
    """Returns how many clauses, or conjuncts of a formula, a state leaves open."""
    parts = [(clause,) for clause in wanted] if isinstance(wanted, tuple) else bddl.conjuncts(wanted)
    return sum(state.truth(part) is None for part in parts)


def _tried(start: View, subtask: CompiledSubtask, legal: PrimitiveFlow, taken: _Step) -> Iterator[Found]:
    """Yields the empty flow and the templates that can run, then a shortest flow to every reachable state."""
    if subtask.context.placement is None and HAND not in facts_of(subtask.goal, start.window.objects):
        taken = _holding_on(taken)
    for flow in ((), *TEMPLATES):
        end: View | None = start
        for primitive in flow:
            end = taken(end, subtask, primitive, None) if end is not None and primitive in legal else None
        if end is not None:
            yield Found(flow, end)
    yield from _breadth_first(start, subtask, legal, taken)


def _holding_on(taken: _Step) -> _Step:
    """Returns a step that does not let the target fall, for a goal that says neither where it is to be nor let go."""

    def held(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> View | None:
        falls = primitive is Primitive.UNGRASP and held_by(state.hand) == subtask.context.target
        return None if falls else taken(state, subtask, primitive, parameter)

    return held


def _may_run(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> bool | None:
    return truth_of(subtask.rows.row(primitive, state.hand, parameter)[0], state.value, {})


def _known_step(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> View | None:
    """Returns the state after a primitive whose precondition is known to hold, None after any other."""
    known = _may_run(state, subtask, primitive, parameter) is True
    return step(state, subtask.rows, primitive, parameter)[1] if known else None


def _possible_step(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> View | None:
    """Returns what is known after a primitive that may run, whatever made it run; None after any other."""
    impossible = _may_run(state, subtask, primitive, parameter) is False
    return None if impossible else step(state, subtask.rows, primitive, parameter)[1]


def _assumed_step(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> View | None:
    """Returns the state after a primitive that may run, with what it needed assumed; None after any other."""
    impossible = _may_run(state, subtask, primitive, parameter) is False
    return None if impossible else _forced_step(state, subtask, primitive, parameter)


def _forced_step(state: View, subtask: CompiledSubtask, primitive: Primitive, parameter: Parameter) -> View:
    """Returns what is known after a primitive, as if everything that it needs had held."""
    state = granted(state, subtask.rows.row(primitive, state.hand, parameter)[0])
    return step(state, subtask.rows, primitive, parameter)[1]


def run_through(state: View, subtask: CompiledSubtask, flow: ActionFlow | None = None) -> View | None:
    """Returns what is known after a flow, by default the subtask's own; None when it cannot run."""
    for action in subtask.flow or () if flow is None else flow:
        after = _possible_step(state, subtask, action.primitive, action.parameter)
        if after is None:
            return None
        state = after
    return state


def run_whatever(state: View, subtask: CompiledSubtask) -> View:
    """Returns what is known after a subtask's own flow, as if every precondition had held."""
    for action in subtask.flow or ():
        state = _forced_step(state, subtask, action.primitive, action.parameter)
    return state


def reachable(start: View, subtask: CompiledSubtask, legal: PrimitiveFlow) -> tuple[View, ...]:
    """Returns every state that any flow of a subtask leads to, unknown preconditions counting as met.

    Raises:
        TooManyStates: There are more than `MOST_STATES`.
    """
    return tuple(found.state for found in _breadth_first(start, subtask, legal, _possible_step))


def _breadth_first(start: View, subtask: CompiledSubtask, legal: PrimitiveFlow, taken: _Step) -> Iterator[Found]:
    """Yields every reachable state once, with a shortest flow to it, in the order of length."""
    seen = {start}
    waiting = deque([Found((), start)])
    yield waiting[0]
    while waiting:
        flow, state = waiting.popleft()
        for primitive in legal:
            after = taken(state, subtask, primitive, None)
            if after is None or after in seen:
                continue
            if len(seen) >= MOST_STATES:
                raise TooManyStates
            seen.add(after)
            waiting.append(Found((*flow, primitive), after))
            yield waiting[-1]
