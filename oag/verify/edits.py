"""Edits of a task, each small enough for one sentence, and the fixes that are made of them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import bddl
from bddl.terminal import pluralize
from oag.model.actions import Action, ActionFlow
from oag.model.codec import Record, brief, fields_json
from oag.model.diagnostics import Diagnostic, FixError
from oag.model.scene import Scene
from oag.task_definition import SimpleTask, Task, default_goal

_Item = TypeVar("_Item")


@dataclass(frozen=True, slots=True)
class Edit(ABC):
    """One change to a task; `op` names it in JSON."""

    op = ""

    @abstractmethod
    def apply(self, task: Task) -> Task:
        """Return the changed task; raises FixError when the task has no such place."""

    def to_json(self) -> dict[str, object]:
        """Return the edit as JSON values, without what it leaves as it is; indices count from 0."""
        # Of strings only a support may be empty, which stands for none.
        written = {name: value for name, value in fields_json(self).items() if value is not None}
        return {"op": self.op} | {name: None if value == "" else value for name, value in written.items()}


@dataclass(frozen=True, slots=True)
class SetFlow(Edit):
    """Replace the flow of a subtask; `op` says how the new one was made, such as insert-step."""

    subtask: int
    flow: ActionFlow
    op: str = "set-flow"
    step: int | None = None

    def apply(self, task: Task) -> Task:
        """Return the task with the flow; mistakes that were made in reading the old one are gone."""
        old = item_at(task.subtasks, self.subtask, "subtask")
        kept = tuple(issue for issue in old.issues if not issue.code.startswith("flow/"))
        return _with_subtask(task, self.subtask, replace(old, flow=self.flow, issues=kept))


@dataclass(frozen=True, slots=True)
class ChangeSubtask(Edit):
    """Change roles or conditions of a subtask; None keeps a field, and "" stands for no support."""

    op = "change-subtask"
    subtask: int
    target: str | None = None
    support_init: str | None = None
    support_goal: str | None = None
    init: bddl.Formula | None = None
    goal: bddl.Formula | None = None

    def apply(self, task: Task) -> Task:
        """Return the task with the fields changed; mistakes that were made in reading those are gone."""
        old = item_at(task.subtasks, self.subtask, "subtask")
        changed = replace(
            old,
            target=old.target if self.target is None else self.target,
            support_init=_support(old.support_init, self.support_init),
            support_goal=_support(old.support_goal, self.support_goal),
            init=old.init if self.init is None else self.init,
            goal=old.goal if self.goal is None else self.goal,
            issues=tuple(issue for issue in old.issues if not self._settles(issue)),
        )
        return _with_subtask(task, self.subtask, changed)

    def _settles(self, issue: Diagnostic) -> bool:
        """Decide whether a mistake in reading is gone: one of a condition that is set, or of a role."""
        if issue.code == "task/role-scope":
            return self.target is not None
        return any(
            formula is not None and issue.field == field
            for field, formula in (("init", self.init), ("goal", self.goal))
        )


@dataclass(frozen=True, slots=True)
class InsertSubtask(Edit):
    """Insert a subtask before the one of an index, or at the end."""

    op = "insert-subtask"
    subtask: int
    inserted: SimpleTask

    def apply(self, task: Task) -> Task:
        if not 0 <= self.subtask <= len(task.subtasks):
            raise FixError(f"there is no place {self.subtask} among {pluralize(len(task.subtasks), 'subtask')}")
        subtasks = list(task.subtasks)
        subtasks.insert(self.subtask, self.inserted)
        return _with_subtasks(task, subtasks)


@dataclass(frozen=True, slots=True)
class DeleteSubtask(Edit):
    """Remove a subtask."""

    op = "delete-subtask"
    subtask: int

    def apply(self, task: Task) -> Task:
        item_at(task.subtasks, self.subtask, "subtask")
        return _with_subtasks(task, (*task.subtasks[: self.subtask], *task.subtasks[self.subtask + 1 :]))


@dataclass(frozen=True, slots=True)
class MoveSubtask(Edit):
    """Move a subtask so that its index becomes `to`."""

    op = "move-subtask"
    subtask: int
    to: int

    def apply(self, task: Task) -> Task:
        for index in (self.subtask, self.to):
            item_at(task.subtasks, index, "subtask")
        return _with_subtasks(task, move_item(task.subtasks, self.subtask, self.to))


@dataclass(frozen=True, slots=True)
class SwapSubtasks(Edit):
    """Exchange two subtasks."""

    op = "swap-subtasks"
    subtask: int
    other: int

    def apply(self, task: Task) -> Task:
        subtasks = list(task.subtasks)
        first, second = (item_at(task.subtasks, index, "subtask") for index in (self.subtask, self.other))
        subtasks[self.subtask], subtasks[self.other] = second, first
        return _with_subtasks(task, subtasks)


@dataclass(frozen=True, slots=True)
class SetTaskGoal(Edit):
    """Replace the goal of the task."""

    op = "set-task-goal"
    goal: bddl.Formula

    def apply(self, task: Task) -> Task:
        """Return the task with the goal, which counts as given."""
        return replace(task, goal=self.goal, goal_given=True, issues=())


@dataclass(frozen=True, slots=True)
class SetScale(Edit):
    """Scale an object; a factor of None removes the entry."""

    op = "set-scale"
    name: str
    factor: float | None

    def apply(self, task: Task) -> Task:
        scales = {key: value for key, value in task.scales.items() if key != self.name}
        if self.factor is not None:
            scales[self.name] = self.factor
        return replace(task, scales=scales)

    def to_json(self) -> dict[str, object]:
        """Return the edit as JSON values, a factor of null for an entry that is taken out."""
        return {"op": self.op, "object": self.name, "factor": self.factor}


@dataclass(frozen=True, slots=True)
class AddFact(Edit):
    """State a fact in the scene; only the world itself shows whether it holds."""

    op = "add-fact"
    fact: bddl.Formula

    def apply(self, task: Task) -> Task:
        """Return the task with the fact in the scene that it carries, if it carries one."""
        return task if task.scene is None else replace(task, scene=self.apply_to_scene(task.scene))

    def apply_to_scene(self, scene: Scene) -> Scene:
        return replace(scene, facts=(*scene.facts, self.fact))


def condition_edit(index: int, field: str, formula: bddl.Formula) -> ChangeSubtask:
    """Return the edit that gives a subtask another `init` or `goal`."""
    return ChangeSubtask(index, init=formula) if field == "init" else ChangeSubtask(index, goal=formula)


def item_at(items: Sequence[_Item], index: int, what: str) -> _Item:
    """Return an item of a sequence; raises FixError when there is none of that index."""
    if not 0 <= index < len(items):
        raise FixError(f"there is no {what} {index}: the task has {len(items)}")
    return items[index]


def move_item(items: Sequence[_Item], index: int, to: int) -> tuple[_Item, ...]:
    """Return a sequence with one item moved so that its index becomes `to`."""
    rest = list(items)
    rest.insert(to, rest.pop(index))
    return tuple(rest)


def inserted(flow: ActionFlow, step: int, action: Action) -> ActionFlow:
    """Return a flow with an action put before a step."""
    return (*flow[:step], action, *flow[step:])


def _support(old: str | None, new: str | None) -> str | None:
    return old if new is None else new or None


def _with_subtask(task: Task, index: int, subtask: SimpleTask) -> Task:
    return _with_subtasks(task, (*task.subtasks[:index], subtask, *task.subtasks[index + 1 :]))


def _with_subtasks(task: Task, subtasks: Sequence[SimpleTask]) -> Task:
    """Return a task with other subtasks; a default goal is derived from the new ones."""
    goal = task.goal if task.goal_given else default_goal(subtasks)
    return replace(task, subtasks=tuple(subtasks), goal=goal, source=None)


@dataclass(frozen=True, slots=True)
class Fix(Record):
    """One verified repair of a plan.

    Attributes:
        kind: What it does: insert-step, delete-step, replace-step, move-step, set-flow, insert-subtask, delete-subtask,
            move-subtask, swap-subtasks, change-role, change-object, change-condition, change-task-goal, change-scale,
            add-fact, or several.
        summary: The same in words, with the places.
        subtask: Index of the subtask that it changes, or before which it inserts; None for the task as a whole.
        step: Index of the step that it changes, or before which it inserts; None where no step is meant.
        edits: The changes, in the order in which they are applied.
        cause: Which of `report.errors` it removes, as an index; None for one that removes them all together.
        proves: True when the repaired plan is PROVED. False when it only removes its cause and adds none. Then other
            causes remain, or the plan rests on unknown facts, as `remaining` and `remark` say.
        remaining: How many errors the repaired plan still has.
        remark: A further remark, such as why it would not work elsewhere.
        assumption: True when it states a fact of the world, which only an observation can confirm.
    """

    kind: str
    summary: str
    subtask: int | None
    step: int | None
    edits: tuple[Edit, ...]
    cause: int | None
    proves: bool
    remaining: int = 0
    remark: str = ""
    assumption: bool = False

    def __repr__(self) -> str:
        return brief(f"<Fix {self.kind}: {self.summary}>")

    def apply(self, task: Task) -> Task:
        """Return the repaired task; raises FixError for another task than the one whose report offered the fix.

        If the task carries its scene, a fact that the fix states is in the scene of the result.
        """
        for edit in self.edits:
            task = edit.apply(task)
        return replace(task, source=None)

    def apply_to_scene(self, scene: Scene) -> Scene:
        """Return the scene for the repaired task; it is another one only if the fix states a fact."""
        for edit in self.edits:
            if isinstance(edit, AddFact):
                scene = edit.apply_to_scene(scene)
        return scene

    def __str__(self) -> str:
        """Return the fix as diagnostics print it."""
        lines = [f"{self.summary}   [checked: {self._checked()}]"]
        if self.assumption:
            lines.append("(if it is so: this states a fact of the scene, look before you trust it)")
        if self.remark:
            lines.append(f"({self.remark})")
        return "\n".join(lines)

    def _checked(self) -> str:
        if self.proves:
            return "all obligations hold"
        if not self.remaining:
            return "nothing fails any more, some things stay unknown"
        noun = "1 other mistake remains" if self.remaining == 1 else f"{self.remaining} other mistakes remain"
        return f"this one is gone, {noun}"
