"""Module 2: from a request to the ordered simple tasks that fulfil it, with the roles of their objects.

Source: the paper's Subtask Decomposition, and its table of initial and goal states for T1 to T4.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from llm.doors import doors_in_the_way
from llm.intent import Intent, IntentKind
from llm.request import Request
from llm.surroundings import GRIPPER, Support, Surroundings


@dataclass(frozen=True, slots=True)
class Step:
    """A simple task before it has formulas: what is done to the target, from where, to where.

    Attributes:
        kind: One of the four kinds of simple tasks.
        target: Id of the object it acts on (o_t).
        start: For PICK, where the target stands (o_s1 and its relation).
        end: For PLACE, where the target shall stand (o_s2 and its relation).
    """

    kind: IntentKind
    target: str
    start: Support | None = None
    end: Support | None = None


def decompose(request: Request, around: Surroundings) -> tuple[Step, ...]:
    """Returns the simple tasks of a request, in order.

    Doors in the way are opened first, while the hand is free. They stay open as long as the next wish needs them, and
    are closed again in reverse order. What is open already is neither opened nor closed, what is so already is not done
    again, and a door that a wish opens is left to the wishes. After picking something up no door is closed: the hand
    is not free.

    Args:
        request: Wishes that were checked against the scene.
        around: The scene and its facts.
    """
    steps: list[Step] = []
    state = around
    # Doors that were opened on the way, not by a wish, and still are.
    opened: list[str] = []
    for index, intent in enumerate(request.intents):
        if intent.kind.is_about_a_door and intent.target in opened:
            opened.remove(intent.target)
        if state.fulfils(intent):
            continue
        if intent.kind.is_about_a_door:
            steps.append(Step(intent.kind, intent.target))
        else:
            doors = doors_in_the_way(intent, state)
            steps += [Step(IntentKind.OPEN, door) for door in doors]
            opened += doors
            steps += _moving(intent, state)
            state = state.with_doors(doors, True)
        state = state.after(intent)
        if state.held():
            continue
        needed = _needed(request.intents[index + 1 :], state, opened)
        done_with = [door for door in reversed(opened) if door not in needed]
        steps += [Step(IntentKind.CLOSE, door) for door in done_with]
        state = state.with_doors(done_with, False)
        opened = [door for door in opened if door in needed]
    return tuple(steps)


def _moving(intent: Intent, state: Surroundings) -> list[Step]:
    """Returns the picking up and the placing of a wish, without its doors."""
    steps = []
    start = state.support(intent.target)
    if start is not None and start.object_id != GRIPPER:
        steps.append(Step(IntentKind.PICK, intent.target, start=start))
    if intent.relation is not None and intent.destination is not None:
        steps.append(Step(IntentKind.PLACE, intent.target, end=Support(intent.relation, intent.destination)))
    return steps


def _needed(later: Sequence[Intent], state: Surroundings, opened: Sequence[str]) -> tuple[str, ...]:
    """Returns which of the doors that were opened on the way the next wish needs open, or speaks of itself."""
    closed = state.with_doors(opened, False)
    for intent in later:
        if intent.kind.is_about_a_door and intent.target in opened:
            return (intent.target,)
        if not state.fulfils(intent):
            return doors_in_the_way(intent, closed)
    return ()
