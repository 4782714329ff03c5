"""The search for a subtask's action flow: the known templates first, then breadth first over what is known.

A state of the search is what is known of the robot and of the facts that matter (`Window`). Since those are few and
each has few values, the states that a subtask can reach are few as well, and the search is complete: when it ends
without a flow, the states it saw are closed under all primitives and none meets the goal. That set is the proof.

Source: docs/semantics.md, Flows that are searched.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import NamedTuple

from oag.flows.window import State, Window, facts_of
from oag.model.categories import Kind
from oag.model.facts import HAND, held_by
from oag.model.primitives import Primitive
from oag.progression.compiled import CompiledSubtask
from oag.table.feasible import applicable
from oag.table.library import NAVIGATION

# The flows that simple tasks have, their numbers open, by the paper's table of initial action flows. Departures: every
# flow begins with a navigation, every release ends with a retreat, the hand is moved down at the end of every placing,
# and it backs out of what it has taken a thing out of (docs/departures.md).
_REACH = (Primitive.NAVIGATE_TO_TARGET, Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP)
_RELEASE = (Primitive.UNGRASP, Primitive.RETREAT)

OPEN = (*_REACH, Primitive.ARTICULATE_OPEN, *_RELEASE)
CLOSE = (*_REACH, Primitive.ARTICULATE_CLOSE, *_RELEASE)
PICK = (*_REACH, Primitive.LIFT_EEF_UP)
# Within a compartment a lift takes nothing out of it: a thing is out when the hand has backed out with it.
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
_Step = Callable[[Window, State, Primitive, CompiledSubtask], State | None]


class Found(NamedTuple):
    """A flow and what is known after it."""

    flow: PrimitiveFlow
    state: State


class TooManyStates(Exception):
    """A search gave up before it was complete."""


class Leave(IntEnum):
    """How much a flow may leave open; what is open is assumed, a goal only where nothing else will do."""

    NOTHING = 0
    PRECONDITIONS = 1
    GOALS = 2


def legal_primitives(kind: Kind, support_goal: str | None) -> PrimitiveFlow:
    """Returns the primitives that a well-formed flow may use on a target of this kind, in the order of preference."""
    legal = []
    for number in ORDER:
        primitive = Primitive(number)
        if primitive is NAVIGATION[1] and support_goal is None:
            continue
        if applicable(primitive, kind):
            legal.append(primitive)
    return tuple(legal)


def flows(
    window: Window, start: State, subtask: CompiledSubtask, legal: PrimitiveFlow, leave: Leave = Leave.NOTHING
) -> Iterator[Found]:
    """Yields flows that take a subtask from a state to its goal, with what is known after each.

    Args:
        window: Which facts matter.
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
    seen: set[State] = set()
    gave_up = False
    for level in Leave:
        if level > leave:
            break
        try:
            for found in _leaving(window, start, subtask, legal, level):
                if found.state not in seen:
                    seen.add(found.state)
                    yield found
        except TooManyStates:
            gave_up = True
    if gave_up:
        raise TooManyStates


def _leaving(
    window: Window, start: State, subtask: CompiledSubtask, legal: PrimitiveFlow, level: Leave
) -> Iterator[Found]:
    """Yields the flows that leave as much open as a level says, and perhaps less."""
    if level is not Leave.GOALS:
        step = _known_step if level is Leave.NOTHING else _assumed_step
        for found in _tried(window, start, subtask, legal, step):
            if window.truth(found.state, subtask.goal) is True:
                yield found
        return
    opened: list[tuple[int, Found]] = []
    for step in (_known_step, _assumed_step):
        for found in _tried(window, start, subtask, legal, step):
            if window.truth(found.state, subtask.goal) is None:
                opened.append((window.open_parts(found.state, subtask.goal), found))
    # Sorting keeps the order among equals, so known preconditions, templates and short flows come first.
    yield from (found for _, found in sorted(opened, key=lambda option: option[0]))
    # Of several unknown alternatives the first was assumed above; another may be the one that helps.
    for found in _tried(window, start, subtask, legal, _possible_step):
        if window.truth(found.state, subtask.goal) is not False:
            yield found


def _tried(
    window: Window, start: State, subtask: CompiledSubtask, legal: PrimitiveFlow, step: _Step
) -> Iterator[Found]:
    """Yields the empty flow and the templates that can run, then a shortest flow to every reachable state."""
    if subtask.context.placement is None and HAND not in facts_of(subtask.goal, window.objects):
        step = _holding_on(step)
    for flow in ((), *TEMPLATES):
        end = _run(window, start, subtask, legal, flow, step)
        if end is not None:
            yield Found(flow, end)
    yield from _breadth_first(window, start, subtask, legal, step)


def _holding_on(step: _Step) -> _Step:
    """Returns a step that does not let the target fall, for a goal that says neither where it is to be nor let go."""

    def held(window: Window, state: State, primitive: Primitive, subtask: CompiledSubtask) -> State | None:
        falls = primitive is Primitive.UNGRASP and held_by(window.value(state, HAND)) == subtask.context.target
        return None if falls else step(window, state, primitive, subtask)

    return held


def _known_step(window: Window, state: State, primitive: Primitive, subtask: CompiledSubtask) -> State | None:
    """Returns the state after a primitive whose precondition is known to hold, None after any other."""
    truth, after = window.step(state, primitive, subtask)
    return after if truth is True else None


def _possible_step(window: Window, state: State, primitive: Primitive, subtask: CompiledSubtask) -> State | None:
    """Returns what is known after a primitive that may run, whatever made it run; None after any other."""
    truth, after = window.step(state, primitive, subtask)
    return None if truth is False else after


def _assumed_step(window: Window, state: State, primitive: Primitive, subtask: CompiledSubtask) -> State | None:
    """Returns the state after a primitive that may run, with what it needed assumed; None after any other."""
    truth, after = window.step(state, primitive, subtask)
    return window.forced(state, primitive, subtask) if truth is None else after if truth else None


def reachable(window: Window, start: State, subtask: CompiledSubtask, legal: PrimitiveFlow) -> tuple[State, ...]:
    """Returns every state that any flow of a subtask leads to, unknown preconditions counting as met.

    Raises:
        TooManyStates: There are more than `MOST_STATES`.
    """
    return tuple(found.state for found in _breadth_first(window, start, subtask, legal, _possible_step))


def _breadth_first(
    window: Window, start: State, subtask: CompiledSubtask, legal: PrimitiveFlow, step: _Step
) -> Iterator[Found]:
    """Yields every reachable state once, with a shortest flow to it, in the order of length."""
    came: dict[State, tuple[State, Primitive] | None] = {start: None}
    waiting = deque([start])
    yield Found((), start)
    while waiting:
        state = waiting.popleft()
        for primitive in legal:
            after = step(window, state, primitive, subtask)
            if after is None or after in came:
                continue
            if len(came) >= MOST_STATES:
                raise TooManyStates
            came[after] = (state, primitive)
            waiting.append(after)
            yield Found(_way(came, after), after)


def _way(came: dict[State, tuple[State, Primitive] | None], state: State) -> PrimitiveFlow:
    """Returns the flow that led to a state."""
    steps: list[Primitive] = []
    while (before := came[state]) is not None:
        state, primitive = before
        steps.append(primitive)
    return tuple(reversed(steps))


def _run(
    window: Window, start: State, subtask: CompiledSubtask, legal: PrimitiveFlow, flow: PrimitiveFlow, step: _Step
) -> State | None:
    """Returns what is known after a flow, or None when it cannot run."""
    state: State | None = start
    for primitive in flow:
        if state is None or primitive not in legal:
            return None
        state = step(window, state, primitive, subtask)
    return state
