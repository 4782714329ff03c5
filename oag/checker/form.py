"""What the parts of a certificate say: its conditions, actions, objects and start; and that they say something.

Part of the independent check: it knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bddl
from oag.checker.cases import Rejected, require
from oag.facts import ANY, EEF, EMPTY, HAND, HOME, NEAR, ROBOT_FACTS, Fact, Value, condition_on, gripping, holding
from oag.library import Clause, Needed, needed
from oag.primitives import Primitive

# A flow has primitives by number, or as the one key of a mapping.
PRIMITIVES: dict[Any, Primitive] = {key: p for p in Primitive for key in (int(p), str(int(p)))}


def primitive_of(item: Any) -> Primitive:
    """Returns the primitive of an action of a flow."""
    if type(item) is not int:
        (item,) = item.keys()
    return PRIMITIVES[item]


def needed_of(condition: Any) -> Needed:
    """Returns the clauses of a list of [atom, value], or the formula that a text says.

    Raises:
        Rejected: It speaks of a pattern, or of a variable of the robot as if it were an atom.
    """
    if isinstance(condition, str):
        formula = bddl.parse_formula(condition)
        require(all((atom.predicate, *atom.args) not in ROBOT_FACTS for atom in bddl.atoms(formula)), "no formula")
        return needed(formula)
    clauses: list[Clause] = []
    for names, value in condition:
        fact = tuple(names)
        if type(value) is not bool or fact in ROBOT_FACTS or ANY in "".join(fact):
            raise Rejected(f"{names} is no literal")
        clauses.append((condition_on(fact, value),))
    return tuple(clauses)


def start_of(data: Mapping[str, Any]) -> dict[Fact, Value]:
    """Returns what is known of the start: what the scene states, and what the reset is said to supply.

    Raises:
        Rejected: That is no start, or the reset supplies what it cannot.
    """
    scene, subtasks = data["scene"], data["plan"]["subtasks"]
    hands = (EMPTY, *map(holding, scene["items"]), *map(gripping, scene["articulated"]))
    start: dict[Fact, Value] = {}
    for names, value in scene["start"]:
        fact = tuple(names)
        fits = value in hands if fact == HAND else fact not in ROBOT_FACTS and type(value) is bool
        require(fits and not (value is True and ANY in fact), f"the start gives {fact} the value {value!r}")
        require(fact not in start, f"the start gives {fact} twice")
        start[fact] = value
    supplied = [(EEF, HOME), (HAND, EMPTY), *((NEAR, subtask["target"]) for subtask in subtasks[:1])]
    for fact, value in [(tuple(e["fact"]), e["value"]) for e in data["assumptions"] if e["kind"] == "reset"]:
        require(fact not in start and (fact, value) in supplied, f"the reset does not supply {fact}")
        start[fact] = value
    return start


def check_form(data: Mapping[str, Any]) -> None:
    """Checks that a plan can be read to its end, which following it to a failure does not, and what it acts on.

    Raises:
        Rejected: A subtask's objects are not the scene's, or the scene's cannot be told apart.
    """
    plan, scene = data["plan"], data["scene"]
    objects, items, articulated = scene["objects"], set(scene["items"]), set(scene["articulated"])
    require(isinstance(objects, Mapping) and ANY not in "".join(objects), "the objects have no names")
    require(items | articulated <= objects.keys() and not items & articulated, "an object is of two kinds, or of none")
    for index, subtask in enumerate(plan["subtasks"]):
        known = subtask["target"] in objects and (subtask["support_goal"] is None or subtask["support_goal"] in objects)
        require(known, f"subtask {index} is about something that the scene does not have")
    if data["failure"] is None:
        return
    needed_of(plan["goal"])
    for subtask in plan["subtasks"]:
        needed_of(subtask["init"]), needed_of(subtask["goal"])
        for item in subtask["flow"] or ():
            primitive_of(item)
