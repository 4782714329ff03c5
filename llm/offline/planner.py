"""The offline planner: modules 1 to 5 in their order, by lexicon, grammar and templates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from llm.errors import QueryError
from llm.offline.lexicon import Lexicon, built_in
from llm.offline.steps import PlainTask, check_sizes, decompose, problem, scale_factors
from llm.offline.surroundings import Support, Surroundings
from llm.offline.understand import understand
from llm.offline.wish import PREPOSITION, Intent, IntentKind, Request
from llm.proposal import Expanded, Proposal
from oag import Scene, SimpleTask, Task, Verdict, compose
from oag.task.sizes import TO_THE_AIM, Sizing, resizings

_ORDINALS = ("First", "Second", "Third", "Fourth", "Fifth", "Sixth", "Seventh", "Eighth", "Ninth", "Tenth")
_NAME_PREPOSITION = {"inside": "into", "ontop": "on"}


@dataclass(frozen=True, slots=True)
class OfflinePlanner:
    """Proposes tasks without a model; equal queries and scenes give equal proposals.

    Attributes:
        lexicon: The words and categories it knows; `llm.offline.lexicon.load` reads another one from a file.
        sizing: What becomes of the sizes of what is handled.
    """

    lexicon: Lexicon = field(default_factory=built_in)
    sizing: Sizing = TO_THE_AIM

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
        understood = understand(query, scene, self.lexicon, self.sizing)
        around, request = understood.around, understood.request
        wanted = str(request)
        steps = decompose(request, around)
        check_sizes((step.target for step in steps), scene, self.sizing, query, wanted)
        subtasks = tuple(_subtask(step, around) for step in steps)
        detail = _narrative(request, steps, around)
        task = Task(
            name=_task_name(request, steps, around),
            detail=detail,
            goal=understood.goal,
            goal_given=True,
            subtasks=subtasks,
            scales=scale_factors((step.target for step in steps), scene, self.sizing),
            scene=scene,
        )
        # What the scene leaves open is not held against a plan.
        report = compose(task).verify()
        if report.verdict is Verdict.REFUTED:
            reason = f"no plan was found for it that goes through: {report.errors[0].message}"
            raise QueryError("unproved", query, reason, understood=wanted)
        return Proposal(
            query=query,
            expanded=Expanded(wanted, detail),
            task=task,
            problems=tuple(problem(subtask.name, subtask.init, subtask.goal, scene) for subtask in subtasks),
            notes=(*understood.notes, *map(str, resizings(task.scales, scene))),
        )


def _subtask(step: PlainTask, around: Surroundings) -> SimpleTask:
    init, goal = step.states()
    name = f"{step.kind.value.replace(' ', '_')}_{_noun(step.target, around)}"
    if step.end is not None:
        name += f"_{_NAME_PREPOSITION[step.end.relation]}_{_noun(step.end.object_id, around)}"
    return SimpleTask(
        name=name,
        detail=_subtask_detail(step, around),
        target=step.target,
        support_init=None if step.start is None else step.start.object_id,
        support_goal=None if step.end is None else step.end.object_id,
        init=init,
        goal=goal,
        flow=step.flow(around.scene),
    )


def _stem(object_id: str) -> str:
    return object_id.rstrip("0123456789").rstrip("_")


def _noun(object_id: str, around: Surroundings) -> str:
    """Returns the id without its number where that names one object only: "glass" for `glass_0`."""
    stem = _stem(object_id)
    alike = [key for key in around.scene.objects if _stem(key) == stem]
    return stem if stem and len(alike) == 1 else object_id


def _task_name(request: Request, steps: Sequence[PlainTask], around: Surroundings) -> str:
    """Returns the activity name of the whole task; opening is named, closing on the way is left to the description.

    Source: the form of the paper's own, such as `open_the_refrigerator_and_put_the_glass_into_the_refrigerator`.
    """
    wished = {intent.target for intent in request.intents if intent.kind is IntentKind.OPEN}
    on_the_way = dict.fromkeys(step.target for step in steps if step.kind is IntentKind.OPEN)
    parts = [f"open_the_{_noun(door, around)}" for door in on_the_way if door not in wished]
    return "_and_".join((*parts, *(_wish_name(group, around) for group in request.groups())))


def _wish_name(group: Sequence[Intent], around: Surroundings) -> str:
    first = group[0]
    targets = "_and_".join(f"the_{_noun(intent.target, around)}" for intent in group)
    name = f"{first.kind.value.replace(' ', '_')}_{targets}"
    if first.relation is None or first.destination is None:
        return name
    return f"{name}_{_NAME_PREPOSITION[first.relation]}_the_{_noun(first.destination, around)}"


def _subtask_detail(step: PlainTask, around: Surroundings) -> str:
    """Return what the robot does in a simple task, as an imperative sentence."""
    target, start, end = step.target, step.start, step.end
    if step.kind.is_about_a_door:
        front = "drawer" if around.affordances[target].opens_by("drawer") else "door"
        does, moves = (
            ("Open", f"pull the {front} open") if step.kind is IntentKind.OPEN else ("Close", f"push the {front} shut")
        )
        way = f"drive to it, take hold of its handle and {moves}, then let go and withdraw the hand."
        return f"{does} {target}: {way}"
    if end is None:
        clear = "lift it and back out with it" if start is not None and start.relation == "inside" else "lift it clear"
        place = "" if start is None else f" {_from(start)}"
        return f"Pick up {target}{place}: drive to it, reach for it, grasp it and {clear}."
    where = "inside" if end.relation == "inside" else "on top of"
    return (
        f"Put {target} {PREPOSITION[end.relation]} {end.object_id}: carry it there, move forward, "
        f"lower it until it stands {where} {end.object_id}, then let go and withdraw the hand."
    )


def _narrative(request: Request, steps: Sequence[PlainTask], around: Surroundings) -> str:
    """Returns the description of the whole task: where things stand, what is wanted, and the steps in order."""
    places = [(step.target, *(s.object_id for s in (step.start, step.end) if s is not None)) for step in steps]
    involved = dict.fromkeys(key for ids in places for key in ids if key in around.scene.objects)
    sentences = [f"The scene is {around.scene.name}.", *(_setting(key, around) for key in involved)]
    sentences.append(f"The task is to {request}.")
    for index, step in enumerate(steps):
        ordinal = _ORDINALS[index] if index < len(_ORDINALS) else "Then"
        ordinal = "Finally" if index == len(steps) - 1 else ordinal
        sentences.append(f"{'The' if len(steps) == 1 else f'{ordinal}, the'} robot {_action(step)}.")
    return " ".join(sentences)


def _setting(object_id: str, around: Surroundings) -> str:
    thing = around.scene.objects[object_id]
    name = object_id if _stem(object_id) == thing.category else f"{object_id} ({thing.category})"
    place = around.support(object_id) or around.bearing(object_id)
    state = around.is_open(object_id) if around.affordances[object_id].door else None
    said = "" if state is None else f", and it is {'open' if state else 'closed'}"
    return f"{name} is {place}{said}."


def _from(support: Support) -> str:
    return f"{'out of' if support.relation == 'inside' else 'from'} {support.object_id}"


def _action(step: PlainTask) -> str:
    if step.kind.is_about_a_door:
        return f"{step.kind.value}s {step.target} by its handle"
    if step.end is None:
        return f"picks up {step.target}" + ("" if step.start is None else f" {_from(step.start)}")
    return f"puts {step.target} {PREPOSITION[step.end.relation]} {step.end.object_id} and lets go of it"
