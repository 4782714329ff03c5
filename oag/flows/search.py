"""The search for a subtask's action flow: the known templates first, then breadth first over what is known.

A state of the search is what is known of the robot and of the facts that matter (`Window`). Since those are few and
each has few values, the states that a subtask can reach are few as well, and the search is complete: when it ends
without a flow, the states it saw are closed under all primitives and none meets the goal. That set is the proof.

Source: docs/semantics.md, Flows that are searched.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

from oag.categories import Kind
from oag.compiled import CompiledSubtask
from oag.flows.templates import TEMPLATES
from oag.flows.window import State, Window
from oag.library import NAVIGATION
from oag.primitives import Primitive

# More states than any subtask of a real scene reaches; beyond it the search gives up without a claim.
MOST_STATES = 20_000
# Of flows equally long, the first in this order is taken: go there, reach, act, let go, move away.
ORDER = (17, 18, 1, 2, 3, 4, 19, 5, 7, 6, 8, 9, 10, 11, 12, 13, 14, 15, 16, 20, 21)
_ARTICULATE = (Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)

PrimitiveFlow = tuple[Primitive, ...]


class Found(NamedTuple):
    """A flow and what is known after it."""

    flow: PrimitiveFlow
    state: State


class TooManyStates(Exception):
    """A search gave up before it was complete."""


def legal_primitives(kind: Kind, support_goal: str | None) -> PrimitiveFlow:
    """Returns the primitives that a well-formed flow may use on a target of this kind, in the order of preference."""
    legal = []
    for number in ORDER:
        primitive = Primitive(number)
        if primitive is NAVIGATION[1] and support_goal is None:
            continue
        if primitive in _ARTICULATE and kind is not Kind.ARTICULATED:
            continue
        if primitive is Primitive.GRASP and kind is Kind.SUPPORT:
            continue
        legal.append(primitive)
    return tuple(legal)


def flows(
    window: Window, start: State, subtask: CompiledSubtask, legal: PrimitiveFlow, *, certain: bool = True
) -> Iterator[Found]:
    """Yields flows that take a subtask from a state to its goal, with what is known after each.

    Args:
        window: Which facts matter.
        start: What is known where the subtask starts.
        subtask: Its objects and its goal.
        legal: The primitives that a flow may use, from `legal_primitives`.
        certain: Ask that every precondition and the goal be known to hold; without it, unknown ones count as met.

    Yields:
        The empty flow when the goal holds already; then templates that work, in the order open, close, pick, place;
        then one shortest flow for every other state in which the goal holds, the shortest first.

    Raises:
        TooManyStates: The search reached `MOST_STATES` states.
    """
    seen: set[State] = set()
    for flow in ((), *TEMPLATES):
        end = _run(window, start, subtask, legal, flow, certain)
        if end is not None and end not in seen and _reached(window, end, subtask, certain):
            seen.add(end)
            yield Found(flow, end)
    for found in _breadth_first(window, start, subtask, legal, certain):
        if found.state not in seen and _reached(window, found.state, subtask, certain):
            yield found


def reachable(window: Window, start: State, subtask: CompiledSubtask, legal: PrimitiveFlow) -> tuple[State, ...]:
    """Returns every state that any flow of a subtask leads to, unknown preconditions counting as met.

    Raises:
        TooManyStates: There are more than `MOST_STATES`.
    """
    return tuple(found.state for found in _breadth_first(window, start, subtask, legal, certain=False))


def _breadth_first(
    window: Window, start: State, subtask: CompiledSubtask, legal: PrimitiveFlow, certain: bool
) -> Iterator[Found]:
    """Yields every reachable state once, with a shortest flow to it, in the order of length."""
    came: dict[State, tuple[State, Primitive] | None] = {start: None}
    waiting = deque([start])
    yield Found((), start)
    while waiting:
        state = waiting.popleft()
        for primitive in legal:
            truth, after = window.step(state, primitive, subtask)
            if truth is False or (certain and truth is None) or after in came:
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
    window: Window, start: State, subtask: CompiledSubtask, legal: PrimitiveFlow, flow: PrimitiveFlow, certain: bool
) -> State | None:
    """Returns what is known after a flow, or None when it cannot run."""
    state = start
    for primitive in flow:
        if primitive not in legal:
            return None
        truth, state = window.step(state, primitive, subtask)
        if truth is False or (certain and truth is None):
            return None
    return state


def _reached(window: Window, state: State, subtask: CompiledSubtask, certain: bool) -> bool:
    """Decides whether a state meets the goal, or may meet it."""
    truth = window.truth(state, subtask.goal)
    return truth is True or (truth is None and not certain)
