"""What the parts of a certificate say: its conditions, objects and start; and that they say something.

Part of the independent check: it knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bddl
from bddl.semantics.members import spelled_out
from oag.checker.actions import check_flow
from oag.checker.cases import Rejected, require
from oag.model.facts import ANY, EEF, EMPTY, HAND, HOME, NEAR, ROBOT_FACTS, Fact, Value, condition_on, gripping, holding
from oag.table.invariants import impossible
from oag.table.library import Clause, Needed, needed

# What something unknown has for a value: a time, a fact, and the value.
Given = tuple[int, Fact, bool]
# Parts that the formulas of a plan may have, with every quantifier spelled out over the objects.
MOST_PARTS = 20_000


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
        # The robot's variables alone are about nothing.
        if type(value) is not bool or len(fact) < 2 or ANY in "".join(fact):
            raise Rejected(f"{names} is no literal")
        clauses.append((condition_on(fact, value),))
    return tuple(clauses)


def start_of(data: Mapping[str, Any]) -> dict[Fact, Value]:
    """Returns what is known of the start: by the kinds of things, by the scene, and by the reset as it is said.

    Raises:
        Rejected: That is no start, or the reset supplies what it cannot.
    """
    scene, subtasks = data["scene"], data["plan"]["subtasks"]
    start: dict[Fact, Value] = {}
    for names, value in scene["start"]:
        fact = tuple(names)
        if fact in ROBOT_FACTS:
            hands = (EMPTY, *map(holding, scene["items"]), *map(gripping, scene["articulated"]))
            fits = fact == HAND and value in hands
        else:
            fits = type(value) is bool and not (value and ANY in fact)
        if not fits or fact in start:
            raise Rejected(f"the start gives {fact} the value {value!r}, or gives it twice")
        start[fact] = value
    supplied: dict[Fact, Value] = {EEF: HOME, HAND: EMPTY, NEAR: subtasks[0]["target"] if subtasks else None}
    for entry in data["assumptions"]:
        if entry["kind"] == "reset":
            fact, value = tuple(entry["fact"]), entry["value"]
            if fact in start or value is None or supplied.get(fact) != value:
                raise Rejected(f"the reset does not supply {fact}")
            start[fact] = value
    never: dict[Fact, Value] = dict.fromkeys(impossible(scene["objects"], set(scene["articulated"])), False)
    for fact, value in start.items():
        if value is True and (fact in never or (fact[0], ANY, fact[-1]) in never):
            raise Rejected(f"the start says {fact}, which cannot be for the kinds of things")
    return never | start


def check_form(data: Mapping[str, Any]) -> None:
    """Checks that a plan can be read to its end, which following it to a failure does not, and what it acts on.

    Raises:
        Rejected: A subtask's objects are not the scene's, or the scene's cannot be told apart.
    """
    plan, scene = data["plan"], data["scene"]
    objects, items, articulated = scene["objects"], set(scene["items"]), set(scene["articulated"])
    require(ANY not in "".join(objects.keys()), "the objects have no names")
    require(items | articulated <= objects.keys() and not items & articulated, "an object is of two kinds, or of none")
    for index, subtask in enumerate(plan["subtasks"]):
        support = subtask["support_goal"]
        if subtask["target"] not in objects or (support is not None and support not in objects):
            raise Rejected(f"subtask {index} is about something that the scene does not have")
        check_flow(index, subtask, items, articulated)
    _check_size(plan, objects)
    if data["failure"] is None:
        return
    needed_of(plan["goal"])
    for subtask in plan["subtasks"]:
        needed_of(subtask["init"]), needed_of(subtask["goal"])


def _check_size(plan: Mapping[str, Any], objects: Mapping[str, str]) -> None:
    """Checks that what the plan's formulas say of the objects, all together, is not too much to be evaluated."""
    left = MOST_PARTS
    for condition in (plan["goal"], *(s[field] for s in plan["subtasks"] for field in ("init", "goal"))):
        # Without a variable there is no quantifier.
        if isinstance(condition, str) and "?" in condition:
            left -= spelled_out(bddl.parse_formula(condition), objects, left)
            require(left >= 0, f"its quantifiers say more than {MOST_PARTS} things of the objects")


def given_of(entry: Any) -> Given:
    """Returns one thing that is taken for given, if it is a fact about the scene's objects."""
    time, fact, value = entry[0], tuple(entry[1]), entry[2]
    require(type(time) is int and time >= 0 and type(value) is bool, f"{fact} cannot be given as {value!r} at {time!r}")
    require(fact not in ROBOT_FACTS and "*" not in "".join(fact), f"{fact} is the robot's, or a pattern: not to assume")
    return time, fact, value
