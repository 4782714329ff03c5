"""The texts of modules 1 and 2: names and descriptions of a task and its subtasks, grounded in the scene."""

from __future__ import annotations

from collections.abc import Sequence

from llm.decompose import Step
from llm.intent import PREPOSITION, Intent, IntentKind
from llm.request import Request
from llm.surroundings import Support, Surroundings

_ORDINALS = ("First", "Second", "Third", "Fourth", "Fifth", "Sixth", "Seventh", "Eighth", "Ninth", "Tenth")
_NAME_PREPOSITION = {"inside": "into", "ontop": "on"}


def noun(object_id: str, around: Surroundings) -> str:
    """Returns the id without its number where that names one object only: "glass" for `glass_0`."""
    stem = _stem(object_id)
    alike = [key for key in around.scene.objects if _stem(key) == stem]
    return stem if stem and len(alike) == 1 else object_id


def subtask_name(step: Step, around: Surroundings) -> str:
    """Returns the activity name of a simple task, such as `put_glass_into_refrigerator`."""
    target = noun(step.target, around)
    if step.end is None:
        return f"{step.kind.value.replace(' ', '_')}_{target}"
    return f"put_{target}_{_NAME_PREPOSITION[step.end.relation]}_{noun(step.end.object_id, around)}"


def task_name(request: Request, steps: Sequence[Step], around: Surroundings) -> str:
    """Returns the activity name of the whole task; opening is named, closing on the way is left to the description.

    Source: the form of the paper's own, such as `open_the_refrigerator_and_put_the_glass_into_the_refrigerator`.
    """
    wished = {intent.target for intent in request.intents if intent.kind is IntentKind.OPEN}
    on_the_way = dict.fromkeys(step.target for step in steps if step.kind is IntentKind.OPEN)
    parts = [f"open_the_{noun(door, around)}" for door in on_the_way if door not in wished]
    return "_and_".join((*parts, *(_wish_name(group, around) for group in request.groups())))


def _wish_name(group: Sequence[Intent], around: Surroundings) -> str:
    """Returns one wish as a part of an activity name."""
    first = group[0]
    targets = "_and_".join(f"the_{noun(intent.target, around)}" for intent in group)
    name = f"{first.kind.value.replace(' ', '_')}_{targets}"
    if first.relation is None or first.destination is None:
        return name
    return f"{name}_{_NAME_PREPOSITION[first.relation]}_the_{noun(first.destination, around)}"


def subtask_detail(step: Step) -> str:
    """Returns what the robot does in a simple task, as an imperative sentence."""
    target = step.target
    if step.kind is IntentKind.OPEN:
        return (
            f"Open {target}: drive to it, take hold of its handle and pull the door open, "
            "then let go and withdraw the hand."
        )
    if step.kind is IntentKind.CLOSE:
        return (
            f"Close {target}: drive to it, take hold of its handle and push the door shut, "
            "then let go and withdraw the hand."
        )
    if step.end is None:
        place = "" if step.start is None else f" {_from(step.start)}"
        out = step.start is not None and step.start.relation == "inside"
        clear = "lift it and back out with it" if out else "lift it clear"
        return f"Pick up {target}{place}: drive to it, reach for it, grasp it and {clear}."
    where = "inside" if step.end.relation == "inside" else "on top of"
    return (
        f"Put {target} {PREPOSITION[step.end.relation]} {step.end.object_id}: carry it there, move forward, "
        f"lower it until it stands {where} {step.end.object_id}, then let go and withdraw the hand."
    )


def narrative(request: Request, steps: Sequence[Step], around: Surroundings) -> str:
    """Returns the description of the whole task: where things stand, what is wanted, and the steps in order."""
    sentences = [f"The scene is {around.scene.name}.", *(_setting(key, around) for key in _involved(steps, around))]
    sentences.append(f"The task is to {request}.")
    for index, step in enumerate(steps):
        ordinal = "" if len(steps) == 1 else f"{_ordinal(index, len(steps))}, "
        sentence = f"{ordinal}the robot {_action(step)}."
        sentences.append(sentence[0].upper() + sentence[1:])
    return " ".join(sentences)


def _stem(object_id: str) -> str:
    return object_id.rstrip("0123456789").rstrip("_")


def _ordinal(index: int, count: int) -> str:
    """Returns "First", "Second" and so on, and "Finally" for the last."""
    if index == count - 1:
        return "Finally"
    return _ORDINALS[index] if index < len(_ORDINALS) else "Then"


def _involved(steps: Sequence[Step], around: Surroundings) -> tuple[str, ...]:
    """Returns the objects that the steps are about, in the order of the steps."""
    ids: list[str] = []
    for step in steps:
        ids.append(step.target)
        ids += [place.object_id for place in (step.start, step.end) if place is not None]
    return tuple(key for key in dict.fromkeys(ids) if key in around.scene.objects)


def _setting(object_id: str, around: Surroundings) -> str:
    """Returns a sentence on where an object is and in which state."""
    thing = around.scene.objects[object_id]
    name = object_id if _stem(object_id) == thing.category else f"{object_id} ({thing.category})"
    support = around.support(object_id)
    place = around.bearing(object_id) if support is None else _at(support)
    state = around.is_open(object_id) if around.affordances[object_id].door else None
    said = "" if state is None else f", and it is {'open' if state else 'closed'}"
    return f"{name} is {place}{said}."


def _at(support: Support) -> str:
    return f"{'in' if support.relation == 'inside' else 'on'} {support.object_id}"


def _from(support: Support) -> str:
    return f"{'out of' if support.relation == 'inside' else 'from'} {support.object_id}"


def _action(step: Step) -> str:
    """Returns what the robot does, as the rest of a sentence about it."""
    if step.kind is IntentKind.OPEN:
        return f"opens {step.target} by its handle"
    if step.kind is IntentKind.CLOSE:
        return f"closes {step.target} by its handle"
    if step.end is None:
        return f"picks up {step.target}" + ("" if step.start is None else f" {_from(step.start)}")
    return f"puts {step.target} {PREPOSITION[step.end.relation]} {step.end.object_id} and lets go of it"
