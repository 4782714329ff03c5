"""What a model is told beside its question: the scene, the primitives, the predicates, as compact tables.

All of it is generated from `oag` and `bddl`, so that a prompt cannot promise what the checks do not know.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import cache

import bddl
from oag import ParameterKind, Primitive, Scene, SceneObject, SimpleTask, parameter_kind
from oag.facts import EMPTY, Value, fact_text, gripping, holding
from oag.library import Clause, Context, Placement, effect, requirements

_LONGEST_NAME = 80
_UNITS = {
    ParameterKind.NONE: "-",
    ParameterKind.DISTANCE_M: "metres",
    ParameterKind.ANGLE_DEG: "degrees",
    ParameterKind.JOINT_LIMITS: "min, max (0 to 1)",
}


def scene_table(scene: Scene) -> str:
    """Returns a scene as text: its objects with category, type, size and place, and what is known of the start."""
    x, y, _ = scene.robot.position
    lines = [f"robot at ({x:.2f}, {y:.2f}), heading {scene.robot.yaw_rad:.2f} rad"]
    lines.append("id | category | type | kind | size x y z [m] | centre x y z [m]")
    lines.extend(_object_row(thing) for thing in scene.objects.values())
    facts = [bddl.format(fact) for fact in scene.facts]
    lines.append(f"at the start: {' '.join(facts) or 'nothing is stated'}")
    closed = ", ".join(sorted(scene.closed))
    known = f"of {closed} everything true is listed; what is not listed is false" if closed else "the rest is unknown"
    lines.append(known)
    return "\n".join(lines)


def _object_row(thing: SceneObject) -> str:
    size, place = (" ".join(f"{value:.3f}" for value in values) for values in (thing.extent_m, thing.position))
    return f"{thing.id} | {quoted(thing.category)} | {thing.role} | {thing.kind.value} | {size} | {place}"


def quoted(name: str) -> str:
    """Returns a name that somebody else wrote as a JSON string of bounded length, without signs that close a fence."""
    short = name if len(name) <= _LONGEST_NAME else f"{name[:_LONGEST_NAME]}..."
    return json.dumps(short).replace("<", "\\u003c").replace(">", "\\u003e")


@cache
def primitive_table() -> str:
    """Returns the library of primitives: ID, name, numbers, what each needs and what it brings about."""
    lines = ["ID | name | numbers | needs | then"]
    for primitive in Primitive:
        needs, then = _meaning(primitive)
        unit = _UNITS[parameter_kind(primitive)]
        lines.append(f"{int(primitive)} | {primitive.name} | {unit} | {needs or '-'} | {then or '-'}")
    return "\n".join(lines)


def _meaning(primitive: Primitive) -> tuple[str, str]:
    """Returns what a primitive needs and does, said of a target T and a support S that is a container."""
    texts = []
    for is_item in (True, False):
        context = Context("T", "S", Placement("inside", "S"), is_item, ("S",))
        hand: Value = holding("T") if is_item else gripping("T")
        hand = EMPTY if primitive is Primitive.GRASP else hand
        needs = "; ".join(_clause(clause) for clause in requirements(primitive, context, hand))
        writes = [fact_text(fact, value) for fact, value in effect(primitive, context, hand) if _told(fact, value)]
        texts.append((needs, "; ".join(writes)))
    (item_needs, item_then), (door_needs, door_then) = texts
    return _either(item_needs, door_needs), _either(item_then, door_then)


def _told(fact: tuple[str, ...], value: Value) -> bool:
    """True for what helps to plan: what becomes true, and that a carried item leaves its place."""
    return (
        value is not None and (value is not False or fact[0] in ("ontop", "inside", "open")) and fact[1:] != ("S", "T")
    )


def _clause(clause: Clause) -> str:
    return " or ".join(condition.text() for condition in clause)


def _either(item: str, fixture: str) -> str:
    """Returns one text where items and fixtures are alike, both where they are not."""
    if item == fixture:
        return item
    return " / ".join(f"{kind}: {text}" for kind, text in (("item", item), ("fixture", fixture)) if text)


@cache
def predicate_table() -> str:
    """Returns the predicates of BDDL with their arguments and meaning."""
    rows = [f"{spec.shape}  {spec.meaning}" for spec in bddl.PREDICATES.values()]
    return "\n".join([*rows, "(inside ITEM gripper)  the robot's hand holds the item"])


def subtask_table(subtasks: Sequence[SimpleTask], *, conditions: bool = True) -> str:
    """Returns the subtasks as far as they are known, a line each.

    Args:
        subtasks: In order.
        conditions: False to leave out the initial states and goals, which nobody has written yet.
    """
    return "\n".join(_subtask_rows(subtasks, conditions))


def _subtask_rows(subtasks: Sequence[SimpleTask], conditions: bool) -> Iterator[str]:
    for number, subtask in enumerate(subtasks, start=1):
        row = f"{number} | {subtask.name} | target {subtask.target}"
        row += f" | support_init {subtask.support_init or '-'} | support_goal {subtask.support_goal or '-'}"
        if conditions:
            row += f" | init {bddl.format(subtask.init)} | goal {bddl.format(subtask.goal)}"
        yield row
