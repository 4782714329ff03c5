"""Module 2: from a wish to the ordered simple tasks that fulfil it, with the roles of their objects.

Source: the paper's Subtask Decomposition, and its table of initial and goal states for T1 to T4.
"""

from __future__ import annotations

from dataclasses import dataclass

from llm.doors import doors_in_the_way
from llm.intent import Intent, IntentKind
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


def decompose(intent: Intent, around: Surroundings) -> tuple[Step, ...]:
    """Returns the simple tasks of a wish, in order.

    Doors in the way are opened first, while the hand is free, and closed again in reverse order once it is. What is
    open already is neither opened nor closed. After picking something up no door is closed: the hand is not free.

    Args:
        intent: A wish that was checked against the scene.
        around: The scene and its facts.
    """
    if intent.kind.is_about_a_door:
        return (Step(intent.kind, intent.target),)
    doors = doors_in_the_way(intent, around)
    steps = [Step(IntentKind.OPEN, door) for door in doors]
    start = around.support(intent.target)
    if start is not None and start.object_id != GRIPPER:
        steps.append(Step(IntentKind.PICK, intent.target, start=start))
    if intent.relation is not None and intent.destination is not None:
        steps.append(Step(IntentKind.PLACE, intent.target, end=Support(intent.relation, intent.destination)))
        steps.extend(Step(IntentKind.CLOSE, door) for door in reversed(doors))
    return tuple(steps)
