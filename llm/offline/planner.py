"""The offline planner: modules 1 to 5 in their order, by lexicon, grammar and templates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from llm.errors import QueryError
from llm.offline.lexicon import Lexicon, built_in
from llm.offline.steps import Step, check_sizes, decompose, flow_for, problem, scale_factors, states
from llm.offline.surroundings import Support, Surroundings
from llm.offline.understand import understand
from llm.offline.wish import PREPOSITION, Intent, IntentKind, Request
from llm.proposal import Expanded, Proposal
from oag import Scene, SimpleTask, Task, Verdict, compose
from oag.task.sizes import resizings


@dataclass(frozen=True, slots=True)
class OfflinePlanner:
    """Proposes tasks without a model; equal queries and scenes give equal proposals.

    Attributes:
        lexicon: The words and categories it knows; `llm.offline.lexicon.load` reads another one from a file.
    """

    lexicon: Lexicon = field(default_factory=built_in)

    def propose(self, query: str, scene: Scene) -> Proposal:
        """Returns the task for a query in a scene.

        Args:
            query: English, one wish or several in order.
            scene: Where it is to be done.

        Raises:
            QueryError: The query is not understood, can mean several things, or cannot be done in the scene; code
                "too-large" where something would have to be scaled by too much, "unproved" where a plan was found that
                cannot succeed.
        """
        understood = understand(query, scene, self.lexicon)
        around, request = understood.around, understood.request
        steps = decompose(request, around)
        check_sizes((step.target for step in steps), scene, query, str(request))
        subtasks = tuple(_subtask(step, around) for step in steps)
        detail = narrative(request, steps, around)
        task = Task(
            name=task_name(request, steps, around),
            detail=detail,
            goal=understood.goal,
            goal_given=True,
            subtasks=subtasks,
            scales=scale_factors((step.target for step in steps), scene),
            scene=scene,
        )
        _check_proof(query, task, str(request))
        return Proposal(
            query=query,
            expanded=Expanded(str(request), detail),
            task=task,
            problems=tuple(problem(subtask.name, subtask.init, subtask.goal, scene) for subtask in subtasks),
            notes=(*understood.notes, *map(str, resizings(task.scales, scene))),
        )


def _check_proof(query: str, task: Task, understood: str) -> None:
    """Raises a QueryError for a plan that cannot succeed; what the scene leaves open is not held against it."""
    report = compose(task).verify()
    if report.verdict is Verdict.REFUTED:
        reason = report.errors[0].message
        problem = f"no plan was found for it that goes through: {reason}"
        raise QueryError("unproved", query, problem, understood=understood)


def _subtask(step: Step, around: Surroundings) -> SimpleTask:
    """Returns a simple task with its formulas, texts and flow."""
    init, goal = states(step)
    return SimpleTask(
        name=subtask_name(step, around),
        detail=subtask_detail(step),
        target=step.target,
        support_init=None if step.start is None else step.start.object_id,
        support_goal=None if step.end is None else step.end.object_id,
        init=init,
        goal=goal,
        flow=flow_for(step),
    )


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
