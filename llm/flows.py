"""Module 5, its symbolic part: the action flow of each kind of simple task, its numbers still open.

The executor's geometric planner writes the numbers (`null` in JSON) against the scene's geometry.

Source: the paper's table of initial action flows. Departures: every flow begins with a navigation, every release ends
with a retreat, and the hand is moved down at the end of every placing (docs/departures.md).
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from llm.intent import IntentKind
from oag import Action, ActionFlow, Primitive

_REACH = (Primitive.NAVIGATE_TO_TARGET, Primitive.APPROACH, Primitive.CONVERGE, Primitive.GRASP)
_RELEASE = (Primitive.UNGRASP, Primitive.RETREAT)

TEMPLATES: Mapping[IntentKind, tuple[Primitive, ...]] = MappingProxyType(
    {
        IntentKind.OPEN: (*_REACH, Primitive.ARTICULATE_OPEN, *_RELEASE),
        IntentKind.CLOSE: (*_REACH, Primitive.ARTICULATE_CLOSE, *_RELEASE),
        IntentKind.PICK: (*_REACH, Primitive.LIFT_EEF_UP),
        IntentKind.PLACE: (
            Primitive.NAVIGATE_TO_SUPPORT,
            Primitive.MOVE_BASE_FORWARD,
            Primitive.LIFT_EEF_DOWN,
            *_RELEASE,
        ),
    }
)


def flow_for(kind: IntentKind) -> ActionFlow:
    """Returns the flow of a kind of simple task; parameters are unfilled."""
    return tuple(Action(primitive) for primitive in TEMPLATES[kind])
