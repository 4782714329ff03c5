"""Simple tasks and tasks: what the planner proposes, read from JSON with its mistakes kept as data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

import bddl
from bddl.visible import counted
from oag.model.actions import ActionFlow, flow_to_json
from oag.model.diagnostic import TASK_GOAL, Diagnostic
from oag.model.errors import MissingScene, SceneError, TaskError
from oag.model.jsonfile import Document, Source, load, shown
from oag.model.scene import Scene
from oag.task.goals import default_goal
from oag.task.reading import (
    Roles,
    SubtaskForm,
    TaskForm,
    flow_of,
    formula_of,
    infer_roles,
    read_flow,
    read_formula,
    subtask_places,
)


@dataclass(frozen=True, slots=True)
class SimpleTask:
    """One subtask: the roles of its objects, where it starts, where it ends, and how.

    Attributes:
        name: Its activity, such as `open_refrigerator`.
        detail: What to do, for people and models.
        target: Id of the object it acts on (o_t).
        support_init: Id of the object that the initial state relates the target to (o_s1), or None.
        support_goal: Id of the object that the goal relates the target to (o_s2), or None.
        init: What must hold when it starts; its text is accepted and read.
        goal: What must hold when it ends, likewise.
        flow: Its actions; None when none has been planned yet. A list in the JSON form is accepted and read.
        issues: Mistakes found while it was read, such as an unbalanced parenthesis; `verify` reports them. Their place
            is within the subtask ("init", "step 3"), whichever place the subtask has in a task.

    Source: the paper's Definition of a simple task, T = <o_t, o_s1, o_s2, s_init, s_goal>.
    """

    name: str
    detail: str
    target: str
    support_init: str | None
    support_goal: str | None
    init: bddl.Formula
    goal: bddl.Formula
    flow: ActionFlow | None = None
    issues: tuple[Diagnostic, ...] = ()

    def __post_init__(self) -> None:
        """Reads what is given as a text or in the JSON form.

        Raises:
            TaskError: A condition is no formula and no text of one, or a role is no id.
            FlowError: The flow is no list of actions.
        """
        for role in ("target", "support_init", "support_goal"):
            name: object = getattr(self, role)
            if not isinstance(name, str) and (name is not None or role == "target"):
                raise TaskError(f"expected the id of an object, got {shown(name)}", source="(argument)", place=role)
        for field_name in ("init", "goal"):
            object.__setattr__(self, field_name, formula_of(getattr(self, field_name), field_name))
        if self.flow is not None:
            object.__setattr__(self, "flow", flow_of(self.flow))

    @property
    def roles(self) -> tuple[str, str | None, str | None]:
        """The target, and the supports of the initial state and of the goal."""
        return self.target, self.support_init, self.support_goal

    def to_json(self) -> dict[str, object]:
        """Returns the subtask as task files have it."""
        written: dict[str, object] = {
            "task_activity_name": self.name,
            "task_detail_message": self.detail,
            "target": self.target,
            "support_init": self.support_init,
            "support_goal": self.support_goal,
            "init": bddl.format(self.init),
            "goal": bddl.format(self.goal),
        }
        if self.flow is not None:
            written["flow"] = flow_to_json(self.flow)
        return written


@dataclass(frozen=True, slots=True)
class Task:
    """An ordered sequence of subtasks with the goal that the query asks for.

    Attributes:
        name: Its activity.
        detail: What to do, for people and models.
        goal: The task goal G, judged after the last subtask.
        goal_given: True when G was given apart from the decomposition; False when it was read off the subtasks,
            which cannot catch a dropped subtask.
        subtasks: In order.
        scales: Object id -> factor of the size adjustment.
        scene: The scene it was planned for, if known.
        issues: Mistakes found while it was read that belong to no subtask.
        source: The JSON it was read from when that has mistakes which the fields above cannot hold.

    Source: the paper's Definition of a complex long-horizon task; G is a departure (docs/proposition.md).
    """

    name: str
    detail: str
    goal: bddl.Formula
    goal_given: bool
    subtasks: tuple[SimpleTask, ...]
    scales: Mapping[str, float] = field(default_factory=dict)
    scene: Scene | None = None
    issues: tuple[Diagnostic, ...] = ()
    source: Mapping[str, object] | None = field(default=None, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Reads a goal that is given as a text.

        Raises:
            TaskError: The goal is no formula and no text of one, or something among the subtasks is no `SimpleTask`.
        """
        object.__setattr__(self, "goal", formula_of(self.goal, "goal"))
        object.__setattr__(self, "subtasks", tuple(self.subtasks))
        listed: tuple[object, ...] = self.subtasks
        for index, subtask in enumerate(listed):
            if not isinstance(subtask, SimpleTask):
                place = f"subtasks[{index}]"
                raise TaskError(f"expected a SimpleTask, got {shown(subtask)}", source="(argument)", place=place)

    def __repr__(self) -> str:
        return f"<Task {self.name!r}: {counted(len(self.subtasks), 'subtask')}, goal {bddl.format(self.goal)}>"

    @classmethod
    def from_json(cls, source: Source, scene: Scene | None = None) -> Self:
        """Returns the task that a JSON file, or a mapping of the same form, describes.

        Args:
            source: Path or mapping; subtasks under `sub_tasks` (a list) or `sub_task_1`, `sub_task_2`, ...
            scene: The scene it is for; its objects serve to suggest near names later.

        Raises:
            TaskError: Malformed JSON, a missing field or a wrong type. Mistakes of the plan itself (an unknown
                object or primitive, a wrong arity, an unbalanced parenthesis) are kept and reported by `verify`.
        """
        document = load(source, TaskError)
        form = document.read(TaskForm)
        places = subtask_places(document, form)
        subtasks = tuple(_read_subtask(index, document, place) for index, place in enumerate(places))
        issues: tuple[Diagnostic, ...] = ()
        if form.goal is None:
            goal = default_goal(subtasks)
        else:
            goal, issues = read_formula(form.goal, TASK_GOAL)
        broken = bool(issues) or any(subtask.issues for subtask in subtasks)
        return cls(
            name="task" if form.task_activity_name is None else form.task_activity_name,
            detail=form.task_detail_message or form.task_message_detail or "",
            goal=goal,
            goal_given=form.goal is not None,
            subtasks=subtasks,
            scales=form.scales or {},
            scene=scene,
            issues=issues,
            source=document.at() if broken else None,
        )

    def to_json(self) -> dict[str, object]:
        """Returns the mapping that `from_json` reads back into an equal task (its scene is not part of it).

        A goal that was read off other subtasks than these is written out, and counts as given when it is read again.
        """
        if self.source is not None:
            return dict(self.source)
        written: dict[str, object] = {"task_activity_name": self.name, "task_detail_message": self.detail}
        if self.goal_given or set(bddl.conjuncts(self.goal)) != set(bddl.conjuncts(default_goal(self.subtasks))):
            written["goal"] = bddl.format(self.goal)
        if self.scales:
            written["scales"] = dict(self.scales)
        written["sub_tasks"] = [subtask.to_json() for subtask in self.subtasks]
        return written


def _read_subtask(index: int, document: Document, place: Sequence[str | int]) -> SimpleTask:
    """Returns one subtask; `index` counts from 0 and gives it a name when it has none."""
    form = document.read(SubtaskForm, *place)
    said = document.at(*place)
    init, init_issues = read_formula(form.init, "init")
    goal, goal_issues = read_formula(form.goal, "goal")
    flow, flow_issues = read_flow(form.flow)
    roles = infer_roles(init, goal, form.target)
    role_issues = () if init_issues or goal_issues else _role_issue(roles)
    return SimpleTask(
        name=f"subtask_{index + 1}" if form.task_activity_name is None else form.task_activity_name,
        # The paper's outputs call it task_detail_message, its text task_message_detail.
        detail=form.task_detail_message or form.task_message_detail or "",
        target=roles.target,
        # What is written counts, null included.
        support_init=form.support_init if "support_init" in said else roles.support_init,
        support_goal=form.support_goal if "support_goal" in said else roles.support_goal,
        init=init,
        goal=goal,
        flow=flow,
        issues=(*init_issues, *goal_issues, *role_issues, *flow_issues),
    )


def _role_issue(roles: Roles) -> tuple[Diagnostic, ...]:
    if not roles.problem:
        return ()
    hint = "name it under target, or split the subtask so that each part changes one object"
    return (Diagnostic("task/role-scope", "error", roles.problem, hint=hint),)


_ARGUMENT, _READ = "(argument)", "oag.{}.from_json reads one from a file's path or a mapping"


def chosen_scene(task: Task, scene: Scene | None) -> Scene:
    """Returns the scene to judge a task in: the one given, else the one that the task carries.

    Raises:
        TaskError: The task is no `Task`.
        SceneError: The scene is no `Scene`.
        MissingScene: There is none.
    """
    if not isinstance(task, Task):
        raise TaskError(f"expected a Task, got {shown(task)}", source=_ARGUMENT, hint=_READ.format("Task"))
    chosen = scene if scene is not None else task.scene
    if chosen is None:
        raise MissingScene(task.name)
    return required_scene(chosen)


def required_scene(scene: object) -> Scene:
    """Returns a scene.

    Raises:
        SceneError: It is none, but the name of one, say.
    """
    if not isinstance(scene, Scene):
        raise SceneError(f"expected a Scene, got {shown(scene)}", source=_ARGUMENT, hint=_READ.format("Scene"))
    return scene


def label(subtask: int, step: int) -> str:
    """Returns the short name of a step, such as `T3.4`; both indices count from 0."""
    return f"T{subtask + 1}.{step + 1}"


def subtask_place(task: Task, subtask: int) -> str:
    """Returns the name of a subtask with its number."""
    return f"T{subtask + 1} {task.subtasks[subtask].name}"


def step_place(task: Task, subtask: int, step: int) -> str:
    """Returns the full name of a step."""
    flow = task.subtasks[subtask].flow or ()
    return f"{subtask_place(task, subtask)}, step {step + 1} {flow[step].primitive.name}"
