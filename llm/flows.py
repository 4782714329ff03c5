"""Module 5, its symbolic part: the action flow of each kind of simple task, its numbers still open.

The executor's geometric planner writes the numbers (`null` in JSON) against the scene's geometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from llm.decompose import Step
from llm.intent import IntentKind
from oag import Action, ActionFlow, Primitive
from oag.flows import search

TEMPLATES: Mapping[str, tuple[Primitive, ...]] = MappingProxyType(
    {
        IntentKind.OPEN.value: search.OPEN,
        IntentKind.CLOSE.value: search.CLOSE,
        IntentKind.PICK.value: search.PICK,
        f"{IntentKind.PICK.value}, out of what it is inside": search.TAKE_OUT,
        IntentKind.PLACE.value: search.PLACE,
    }
)
"""The flows that simple tasks usually have, by what is done."""


def flow_for(step: Step) -> ActionFlow:
    """Returns the flow of a simple task; parameters are unfilled."""
    takes_out = step.kind is IntentKind.PICK and step.start is not None and step.start.relation == "inside"
    return tuple(Action(primitive) for primitive in (search.TAKE_OUT if takes_out else TEMPLATES[step.kind.value]))
