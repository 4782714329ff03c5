"""What a model is told beside its question: the scene, the primitives, the predicates, as compact tables.

All of it is generated from `oag` and `bddl`, so that a prompt cannot promise what the checks do not know.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache

import bddl
from llm.answers.prompting import render
from oag import ParameterKind, Primitive, Scene, SceneObject, SimpleTask, parameter_kind
from oag.model.facts import ANY, EMPTY, Fact, Value, fact_text, gripping, holding
from oag.table.library import RESTING, Context, Placement, effect, requirements

CHANGEABLE = frozenset({*RESTING, "open"})
"""The predicates that primitives change; a goal about anything else is out of reach."""

_LONGEST_NAME = 80
_UNITS = {
    ParameterKind.NONE: "-",
    ParameterKind.DISTANCE_M: "metres",
    ParameterKind.ANGLE_DEG: "degrees",
    ParameterKind.JOINT_LIMITS: "from, to (0 to 1)",
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


def primitives_text(only: Primitive | None = None) -> str:
    """Returns the library of primitives, or one row of it, with what its words mean."""
    head, *rows = primitive_table().splitlines()
    shown = [row for row in rows if only is None or row.startswith(f"{int(only)} |")]
    return render("answers/primitives", table="\n".join((head, *shown))).rstrip()


def _meaning(primitive: Primitive) -> tuple[str, str]:
    """Returns what a primitive needs and does, said of a target T and a support S that is a container."""
    texts = []
    leaves: set[Fact] = set()
    for is_item in (True, False):
        context = Context("T", "S", Placement("inside", "S"), is_item, ("S",))
        hand: Value = holding("T") if is_item else gripping("T")
        hand = EMPTY if primitive is Primitive.GRASP else hand
        clauses = requirements(primitive, context, hand)
        needs = "; ".join(" or ".join(condition.text() for condition in clause) for clause in clauses)
        written = effect(primitive, context, hand)
        # What is so only of a held item would read as if it were so of every target.
        off_its_place = {
            (fact, value) for fact, value in written if fact[0] in RESTING and fact[1] == "T" and not value
        }
        off_its_place -= set(effect(primitive, context, EMPTY))
        leaves |= {fact for fact, _ in off_its_place}
        told = [entry for entry in written if _told(*entry) and entry not in off_its_place]
        texts.append((needs, "; ".join(fact_text(fact, value) for fact, value in told)))
    (item_needs, item_then), (door_needs, door_then) = texts
    # A motion by which a held target leaves places: out of all of them, or not.
    along = "" if not leaves else "; carries" if ("inside", "T", ANY) in leaves else "; moves"
    return _either(item_needs, door_needs), _either(item_then, door_then) + along


def _told(fact: tuple[str, ...], value: Value) -> bool:
    return value is not None and (value is not False or fact[0] in CHANGEABLE) and fact[1:] != ("S", "T")


def _either(item: str, fixture: str) -> str:
    if item == fixture:
        return item
    return " / ".join(f"{kind}: {text}" for kind, text in (("item", item), ("fixture", fixture)) if text)


@cache
def predicate_table() -> str:
    """Returns the predicates that primitives change, with their arguments and meaning, and the names of the others."""
    rows = [f"{spec.shape}  {spec.meaning}" for name, spec in bddl.PREDICATES.items() if name in CHANGEABLE]
    others = ", ".join(name for name in bddl.PREDICATES if name not in CHANGEABLE)
    held = "(inside ITEM gripper)  the robot's hand holds the item"
    return "\n".join([*rows, held, f"no primitive changes these, so no goal can ask for them: {others}"])


def subtask_table(subtasks: Sequence[SimpleTask], *, conditions: bool = True) -> str:
    """Returns the subtasks as far as they are known, a line each.

    Args:
        subtasks: In order.
        conditions: False to leave out the initial states and goals, which nobody has written yet.
    """
    rows = []
    for number, subtask in enumerate(subtasks, start=1):
        row = f"{number} | {subtask.name} | target {subtask.target}"
        row += f" | support_init {subtask.support_init or '-'} | support_goal {subtask.support_goal or '-'}"
        if conditions:
            row += f" | init {bddl.format(subtask.init)} | goal {bddl.format(subtask.goal)}"
        rows.append(row)
    return "\n".join(rows)
