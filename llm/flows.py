"""Module 5, its symbolic part: the action flow of each kind of simple task, its numbers still open.

The executor's geometric planner writes the numbers (`null` in JSON) against the scene's geometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from llm.intent import IntentKind
from oag import Action, ActionFlow, Primitive
from oag.flows import templates

TEMPLATES: Mapping[IntentKind, tuple[Primitive, ...]] = MappingProxyType(
    {
        IntentKind.OPEN: templates.OPEN,
        IntentKind.CLOSE: templates.CLOSE,
        IntentKind.PICK: templates.PICK,
        IntentKind.PLACE: templates.PLACE,
    }
)


def flow_for(kind: IntentKind) -> ActionFlow:
    """Returns the flow of a kind of simple task; parameters are unfilled."""
    return tuple(Action(primitive) for primitive in TEMPLATES[kind])
