"""Modules 1 to 5 as questions to a model: for each the prompt, the schema and check of its answer, and the result.

Module 1 (Semantic Expansion) gives the task goal G, which no later module can change; G is a departure
(docs/semantics.md). Module 2 (Subtask Decomposition) gives the simple tasks with the roles of their objects,
in order. Module 3 (BDDL Generation) gives initial state and goal of each as formulas; objects and categories are
added from the scene. See the paper's table of initial and goal states for T1 to T4. Module 4 (Object Size
Adjustment) gives scale factors of targets: aim about 0.05 m, type A always 1.0. The limit is the gripper's, and
so are the accepted widths. Of several factors for one object the first one counts. Where sizes are kept, the
model is not asked. Module 5 (Action Flow Planning) gives the action flow of each simple task, from the library
of 21 primitives.

Source: the paper's modules.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar

from pydantic import BeforeValidator, Field

import bddl
from llm.offline.subtasks import TEMPLATES
from llm.proposing.handling import bare_task, condition_forms, doors, handling_findings, has_place, role_forms
from llm.proposing.session import ModuleSession, check_numbering, named
from llm.proposing.understanding import Understood
from llm.structured.conversation import finding
from llm.structured.prompting import (
    fenced,
    predicate_table,
    primitives_text,
    render,
    subtask_table,
)
from llm.structured.schema import (
    MOST_ACTIONS,
    MOST_SUBTASKS,
    UNASKED,
    ActivityName,
    Answer,
    Formula,
    MaybeLine,
    MaybeObjectId,
    MaybeText,
    Number,
    ObjectId,
    SubtaskAnswer,
    WireStep,
)
from llm.structured.values import as_number
from oag import Diagnostic, Scene, SceneObject, SimpleTask, Task, Verdict, compose
from oag import flows as usual_flows
from oag.model.reading import UNREADABLE, syntax_issues
from oag.sizes import LEAST_SCALE, Gripper, scale_factor, too_small
from oag.task_definition import subtask_place
from oag.wellformed import check as check_form
from oag.wellformed import kind_problem


def _involved(subtasks: Iterable[SimpleTask]) -> set[str]:
    return {key for part in subtasks for key in (part.target, part.support_init, part.support_goal) if key}


def opens_its_target(found: Diagnostic, task: Task) -> bool:
    """Decide whether a finding of kind is about a subtask's own target, which module 2 has chosen."""
    if found.code != "bddl/kind" or found.subtask is None:
        return False
    subtask = task.subtasks[found.subtask]
    opened = bddl.Atom("open", (subtask.target,))
    return any(opened in bddl.atoms(formula) for formula in (subtask.init, subtask.goal))


class SubtaskRoles(SubtaskAnswer):
    """One simple task before it has formulas; the paper's o_t, o_s1 and o_s2 are target, support_init, support_goal."""

    sub_task: Number = Field(description="1, 2, 3 and so on")
    task_activity_name: ActivityName = Field(description="such as open_drawer, pick_up_glass or put_glass")
    task_detail_message: MaybeText = Field(default="", json_schema_extra=UNASKED)
    target: ObjectId = Field(description="id of the object that is acted on")
    support_init: MaybeObjectId = Field(
        default="", description="id of what the target stands in or on at first; empty if none"
    )
    support_goal: MaybeObjectId = Field(
        default="", description="id of what the target shall stand in or on; empty if none"
    )
    bddl_category: MaybeLine = Field(default="", json_schema_extra=UNASKED)

    @property
    def supports(self) -> tuple[str | None, str | None]:
        """What the target is taken from and put at; a thing that is named as its own support has none."""
        start, end = (None if key in ("", self.target) else key for key in (self.support_init, self.support_goal))
        return start, end

    @property
    def detail(self) -> str:
        """What the robot does, in the model's words or in those of the roles."""
        start, end = (
            f" {word} {key}" if key else "" for word, key in (("from", self.support_init), ("at", self.support_goal))
        )
        return self.task_detail_message or f"{self.task_activity_name.replace('_', ' ')}: {self.target}{start}{end}"


class Decomposition(Answer):
    """The simple tasks of a task, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskRoles] = Field(min_length=1, max_length=MOST_SUBTASKS)

    def resolved(self) -> Decomposition:
        """Return the decomposition in which an entry that picks up and puts down is two, or one for what is held."""
        entries: list[SubtaskRoles] = []
        held: tuple[str, str | None] = ("", "")
        for entry in self.sub_tasks:
            target, (start, end) = entry.target, entry.supports
            if start and end and start != end and (target, start) != held:
                taking = {"task_activity_name": f"pick_up_{target}", "support_goal": "", "task_detail_message": ""}
                entries.append(entry.model_copy(update=taking))
            if start and end and start != end:
                entry = entry.model_copy(update={"support_init": ""})
            entries.append(entry)
            held = (target, start) if start and not end else ("", "")
        if entries == self.sub_tasks or check_numbering(self.sub_tasks):
            return self
        numbered = [one.model_copy(update={"sub_task": n}) for n, one in enumerate(entries, start=1)]
        return self.model_copy(update={"sub_tasks": numbered})

    def subtasks(self) -> tuple[SimpleTask, ...]:
        """Return the simple tasks, without formulas and flows yet."""
        return tuple(
            SimpleTask(one.task_activity_name, one.detail, one.target, *one.supports, init=UNREADABLE, goal=UNREADABLE)
            for one in self.resolved().sub_tasks
        )


def decompose(session: ModuleSession, understood: Understood) -> tuple[SimpleTask, ...]:
    """Ask module 2 for the simple tasks of an understood task; raises as `ModuleSession.ask` does."""
    scene = session.scene
    # A small model does what the example does: one with a door makes it open one.
    example = "door" if doors(understood.goal, scene) else "bare"
    answer = session.ask(
        2,
        Decomposition,
        lambda given: _decomposition_findings(given, understood.goal, scene),
        {"task": understood.text(scene), "example": render(f"proposing/module_2_{example}").strip()},
        about=understood.about(scene),
        forms=lambda ids: role_forms(ids, understood.goal, scene, named(session.query, scene)),
    )
    return answer.subtasks()


def _decomposition_findings(answer: Decomposition, goal: bddl.Formula, scene: Scene) -> Iterator[Diagnostic]:
    yield from check_numbering(answer.sub_tasks)
    yield from check_form(bare_task(scene, answer.subtasks()), scene)
    yield from handling_findings(answer.subtasks(), goal, scene)
    # Numbered as they are understood and shown.
    entries = answer.resolved().sub_tasks
    for index, entry in enumerate(entries):
        thing = scene.objects.get(entry.target)
        if thing is not None and thing.role == "A" and any(entry.supports):
            message = (
                f"{thing.id} is of type A and is not carried: the target is the item that is picked up or put down"
            )
            hint = "name the item as the target; supports are for what is carried"
            place = f"T{index + 1} {entry.task_activity_name}, target"
            yield finding("answer/target", message, place, subtask=index, hint=hint)
        elif thing is not None and not any(entry.supports) and _has_no_door(thing, scene):
            message = f"without a support it would be opened or closed, and {thing.id} has no door"
            hint = "leave it out, or name what the item is taken from or put at"
            place = f"T{index + 1} {entry.task_activity_name}, target"
            yield finding("answer/target", message, place, subtask=index, hint=hint)
        stated = entry.bddl_category
        earlier = [n for n, other in enumerate(entries[:index]) if other.target == entry.target]
        if earlier and _same_again(entries[earlier[-1]], entry):
            message = f"it has the name and the roles of T{earlier[-1] + 1}, so that nothing tells the two apart"
            hint = "name each subtask for what it does, such as open_... and close_..., or leave one out"
            place = f"T{index + 1} {entry.task_activity_name}"
            yield finding("answer/same-again", message, place, subtask=index, hint=hint)
        if stated and thing is not None and stated.lower() != " ".join(thing.category.lower().split()):
            message = f"the scene calls {thing.id} a {thing.category[:80]!r}, not a {stated[:80]!r}"
            place = f"T{index + 1} {entry.task_activity_name}, bddl_category"
            yield finding("answer/category", message, place, subtask=index)


def _has_no_door(thing: SceneObject, scene: Scene) -> bool:
    """Decide whether a thing is neither opened nor, in a scene that does not tell its place, picked up."""
    if thing.role == "B" and not has_place(thing.id, scene):
        return False
    return kind_problem(bddl.Atom("open", (thing.id,)), scene) is not None


def _same_again(one: SubtaskRoles, other: SubtaskRoles) -> bool:
    return (one.task_activity_name, one.supports) == (other.task_activity_name, other.supports)


class SubtaskConditions(SubtaskAnswer):
    """Initial state and goal of one simple task."""

    init: Formula = Field(description="BDDL formula that holds when the subtask starts")
    goal: Formula = Field(description="BDDL formula that holds when the subtask has succeeded")


class Conditions(Answer):
    """The conditions of all simple tasks, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskConditions] = Field(min_length=1, max_length=MOST_SUBTASKS)

    def added_to(self, subtasks: Sequence[SimpleTask]) -> tuple[SimpleTask, ...]:
        """Return simple tasks with these conditions."""
        return tuple(
            replace(subtask, init=bddl.parse_formula(entry.init), goal=bddl.parse_formula(entry.goal))
            for subtask, entry in zip(subtasks, self.sub_tasks, strict=True)
        )


def instantiate(
    session: ModuleSession, understood: Understood, subtasks: Sequence[SimpleTask]
) -> tuple[SimpleTask, ...]:
    """Ask module 3 for initial states and goals of the simple tasks; raises as `ModuleSession.ask` does."""
    example = "bare" if all(part.support_init or part.support_goal for part in subtasks) else "door"
    places = {
        "example": render(f"proposing/module_3_{example}").strip(),
        "task": understood.text(session.scene),
        "subtasks": fenced("subtasks", subtask_table(subtasks, conditions=False)),
        "predicates": predicate_table(),
    }
    return session.ask(
        3,
        Conditions,
        lambda given: _condition_findings(given, subtasks, session.scene),
        places,
        about=understood.about(session.scene) | _involved(subtasks),
        entries=len(subtasks),
        forms=lambda ids: condition_forms(subtasks, ids, session.scene),
    ).added_to(subtasks)


def _condition_findings(answer: Conditions, subtasks: Sequence[SimpleTask], scene: Scene) -> Iterator[Diagnostic]:
    task = bare_task(scene, subtasks)
    unreadable = False
    for index, entry in enumerate(answer.sub_tasks):
        for which, text in (("init", entry.init), ("goal", entry.goal)):
            try:
                bddl.parse_formula(text)
            except bddl.BDDLError as error:
                unreadable = True
                issues = syntax_issues(error, f"{subtask_place(task, index)}, {which}")
                yield from (replace(issue, subtask=index) for issue in issues)
    if unreadable:
        return
    written = answer.added_to(subtasks)
    plan = bare_task(scene, written)
    # Errors of the roles are module 2's, and the verdict on the plan assigns them to it: a goal that puts the target
    # elsewhere than on its support_goal, or a target to be opened that has no door.
    of_form = (found for found in check_form(plan, scene) if found.code != "task/role-scope")
    yield from (found for found in of_form if not opens_its_target(found, plan))
    for index, subtask in enumerate(written):
        for which, formula in (("init", subtask.init), ("goal", subtask.goal)):
            names = {name for atom in bddl.atoms(formula) for name in atom.args}
            # A quantified formula is about objects that it does not name.
            if subtask.target not in names and not any(name.startswith("?") for name in names):
                message = f"the {which} {bddl.format(formula)[:200]} does not speak of the target {subtask.target}"
                place = f"{subtask_place(task, index)}, {which}"
                yield finding("answer/off-target", message, place, subtask=index)


_EXAMPLE_M = 0.08  # Width of the item in the prompt's example.
_ROUNDING_M = 0.0005  # Half a hundredth of the factor, times the width of the widest scaled object.


class SubtaskSize(SubtaskAnswer):
    """The factor of one simple task's target."""

    target: MaybeObjectId = Field(default="", json_schema_extra=UNASKED)
    scale: Annotated[float, BeforeValidator(as_number)] = Field(
        gt=0.0, le=100.0, description="factor; 1.0 leaves the object as it is"
    )


class Sizes(Answer):
    """The factors of all simple tasks' targets, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskSize] = Field(min_length=1, max_length=MOST_SUBTASKS)


def resize(session: ModuleSession, subtasks: Sequence[SimpleTask]) -> dict[str, float]:
    """Ask module 4 for the scale factors of the targets; raises as `ModuleSession.ask` does."""
    if session.sizing.keep:
        return {subtask.target: 1.0 for subtask in subtasks}
    gripper = Gripper.of(session.scene.robot)
    things = [session.scene[part.target] for part in subtasks]
    if all(scale_factor(thing, gripper) == 1.0 for thing in things):
        # The rule leaves one answer.
        return {thing.id: 1.0 for thing in things}
    rows = (
        f"{n} | {part.name} | target {thing.id} | type {thing.role} | d {min(thing.extent_m[:2]):.3f}"
        for n, (part, thing) in enumerate(zip(subtasks, things, strict=True), start=1)
    )
    places = {
        "subtasks": fenced("subtasks", "\n".join(rows)),
        "limit": f"{gripper.widest_m:g}",
        "aim": f"{gripper.aim_m:.2f}",
        "narrow": f"{gripper.least_m:g}",
        "wide": f"{gripper.most_m:g}",
        "least": f"{LEAST_SCALE:g}",
        "example": f"{gripper.aim_m / _EXAMPLE_M:.2f}",
    }
    answer = session.ask(
        4,
        Sizes,
        lambda given: _size_findings(given, subtasks, session.scene),
        places,
        about=(),
        entries=len(subtasks),
    )
    factors: dict[str, float] = {}
    for entry, thing in zip(answer.sub_tasks, things, strict=True):
        factors.setdefault(thing.id, entry.scale)
    return factors


def _size_findings(answer: Sizes, subtasks: Sequence[SimpleTask], scene: Scene) -> Iterator[Diagnostic]:
    gripper = Gripper.of(scene.robot)
    for index, (entry, subtask) in enumerate(zip(answer.sub_tasks, subtasks, strict=True)):
        place = f"T{index + 1} {subtask.name}, scale"
        if entry.target not in ("", subtask.target):
            message = f"its target is {subtask.target}, not {entry.target[:80]}"
            yield finding("answer/target", message, place, subtask=index)
            continue
        problem = _problem(entry.scale, scene[subtask.target], gripper)
        if problem is not None:
            hint = f"write {scale_factor(scene[subtask.target], gripper)}"
            yield finding("answer/scale", problem, place, subtask=index, hint=hint)


def _problem(factor: float, thing: SceneObject, gripper: Gripper) -> str | None:
    d_min_m = min(thing.extent_m[:2])
    if scale_factor(thing, gripper) == 1.0:
        if factor == 1.0:
            return None
        why = "it is of type A" if thing.role == "A" else f"it is {d_min_m:.3f} m wide and is taken as it is"
        return f"{thing.id} is scaled by {factor:g}, and it is not to be scaled: {why}"
    unfit = too_small(factor)
    if unfit is not None:
        return f"{thing.id} {unfit}"
    low, high = gripper.least_m, gripper.most_m
    if low - _ROUNDING_M <= factor * d_min_m <= high + _ROUNDING_M:
        return None
    scaled = f"scaled by {factor:g} it is {factor * d_min_m:.3f} m"
    return f"{thing.id} is {d_min_m:.3f} m wide; {scaled}, not from {low:g} to {high:g} m"


class SubtaskFlow(SubtaskAnswer):
    """The flow of one simple task."""

    flow: list[WireStep] = Field(min_length=1, max_length=MOST_ACTIONS)


class Flows(Answer):
    """The flows of all simple tasks, in their order."""

    list_name: ClassVar[str] = "sub_tasks"
    sub_tasks: list[SubtaskFlow] = Field(min_length=1, max_length=MOST_SUBTASKS)

    def added_to(self, subtasks: Sequence[SimpleTask]) -> tuple[SimpleTask, ...]:
        """Return simple tasks with these flows."""
        return tuple(
            replace(subtask, flow=tuple(step.action() for step in entry.flow))
            for subtask, entry in zip(subtasks, self.sub_tasks, strict=True)
        )


def _with_flows_that_work(found: Sequence[Diagnostic], task: Task) -> tuple[Diagnostic, ...]:
    """Return findings about flows with one that a search finds in its place, where the subtasks then succeed."""
    wrong = {one.subtask for one in found}
    if not wrong or None in wrong or task.scene is None:
        return tuple(found)
    parts = (replace(part, flow=None) if n in wrong else part for n, part in enumerate(task.subtasks))
    graph = compose(replace(task, subtasks=tuple(parts), goal=task.subtasks[-1].goal), scene=task.scene)
    if graph.verify().verdict is not Verdict.PROVED:
        return tuple(found)
    flows = {n: json.dumps([*map(str, part.flow or ())]) for n, part in enumerate(graph.task.subtasks)}
    return tuple(replace(one, fixes=(f"T{n + 1}: the flow {flows[n]}",)) for one in found for n in [one.subtask or 0])


# A small model copies the flow of an example for everything: it has one of each kind.
_EXAMPLE_FLOWS = [
    {"sub_task": number, "flow": [step.name for step in flow]}
    for number, flow in enumerate((usual_flows.OPEN, usual_flows.PICK, usual_flows.PLACE, usual_flows.CLOSE), start=1)
]


def plan(session: ModuleSession, subtasks: Sequence[SimpleTask], scales: Mapping[str, float]) -> tuple[SimpleTask, ...]:
    """Ask module 5 for the action flows of the simple tasks; raises as `ModuleSession.ask` does."""
    templates = (f"- {kind}: {', '.join(primitive.name for primitive in flow)}" for kind, flow in TEMPLATES.items())
    places = {
        "subtasks": fenced("subtasks", subtask_table(subtasks)),
        "primitives": primitives_text(),
        "templates": "\n".join(templates),
        "longest": str(MOST_ACTIONS),
        "example": json.dumps({"sub_tasks": _EXAMPLE_FLOWS}),
    }

    def check(answer: Flows) -> Iterable[Diagnostic]:
        task = replace(bare_task(session.scene, answer.added_to(subtasks)), scales=dict(scales))
        return _with_flows_that_work(check_form(task, session.scene), task)

    return session.ask(5, Flows, check, places, about=_involved(subtasks), entries=len(subtasks)).added_to(subtasks)
