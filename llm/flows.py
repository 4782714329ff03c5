"""Module 5, its symbolic part: the action flow of each kind of simple task, its numbers still open.

The executor's geometric planner writes the numbers (`null` in JSON) against the scene's geometry.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from llm.decompose import Step
from llm.intent import IntentKind
from oag import Action, ActionFlow, Primitive
from oag.flows import templates

TEMPLATES: Mapping[str, tuple[Primitive, ...]] = MappingProxyType(
    {
        IntentKind.OPEN.value: templates.OPEN,
        IntentKind.CLOSE.value: templates.CLOSE,
        IntentKind.PICK.value: templates.PICK,
        f"{IntentKind.PICK.value}, out of what it is inside": templates.TAKE_OUT,
        IntentKind.PLACE.value: templates.PLACE,
    }
)
"""The flows that simple tasks usually have, by what is done."""


def flow_for(step: Step) -> ActionFlow:
    """Returns the flow of a simple task; parameters are unfilled."""
    takes_out = step.kind is IntentKind.PICK and step.start is not None and step.start.relation == "inside"
    return tuple(Action(primitive) for primitive in (templates.TAKE_OUT if takes_out else TEMPLATES[step.kind.value]))
