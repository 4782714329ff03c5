"""Simple tasks made to order: open or close a fixture, pick up or place an item, with the template's flow.

Source: the paper's four kinds of simple task, its table of initial and goal states, and its initial action flows.
"""

from __future__ import annotations

import bddl
from oag.flows.search import CLOSE, OPEN, PICK, PLACE, TAKE_OUT, PrimitiveFlow
from oag.model.actions import Action, ActionFlow
from oag.model.facts import GRIPPER
from oag.table.library import Placement
from oag.task.task import SimpleTask


def opening(fixture: str) -> SimpleTask:
    """Returns the subtask that opens a fixture."""
    shut = bddl.Not(bddl.Atom("open", (fixture,)))
    return SimpleTask(f"open_{fixture}", f"Open {fixture}.", fixture, None, None, shut, shut.body, _flow(OPEN))


def closing(fixture: str) -> SimpleTask:
    """Returns the subtask that closes a fixture."""
    is_open = bddl.Atom("open", (fixture,))
    return SimpleTask(
        f"close_{fixture}", f"Close {fixture}.", fixture, None, None, is_open, bddl.Not(is_open), _flow(CLOSE)
    )


def picking(item: str, place: Placement | None) -> SimpleTask:
    """Returns the subtask that picks an item up from a place, or from wherever it is."""
    name, detail = f"pick_up_{item}", f"Pick up {item}."
    if place is None:
        held = bddl.Atom("inside", (item, GRIPPER))
        return SimpleTask(name, detail, item, None, None, bddl.Not(held), held, _flow(PICK))
    there = bddl.Atom(place.relation, (item, place.support))
    flow = _flow(TAKE_OUT if place.relation == "inside" else PICK)
    return SimpleTask(name, detail, item, place.support, None, there, bddl.Not(there), flow)


def placing(item: str, place: Placement) -> SimpleTask:
    """Returns the subtask that puts an item, which the hand holds, where it belongs."""
    held = bddl.Atom("inside", (item, GRIPPER))
    there = bddl.Atom(place.relation, (item, place.support))
    preposition = "on" if place.relation == "ontop" else "inside"
    return SimpleTask(
        f"put_{item}_{preposition}_{place.support}",
        f"Put {item} {preposition} {place.support}.",
        item,
        None,
        place.support,
        held,
        there,
        _flow(PLACE),
    )


def _flow(template: PrimitiveFlow) -> ActionFlow:
    """Returns a template as a flow with open numbers."""
    return tuple(Action(primitive) for primitive in template)
