"""A fix: a change to a plan that was verified before it is offered."""

from __future__ import annotations

from dataclasses import dataclass, replace

from oag.model.scene import Scene
from oag.task.edits import AddFact, Edit
from oag.task.task import Task


@dataclass(frozen=True, slots=True)
class Fix:
    """One verified repair of a plan.

    Attributes:
        kind: What it does: insert-step, delete-step, replace-step, move-step, set-flow, insert-subtask,
            delete-subtask, move-subtask, swap-subtasks, change-role, change-object, change-condition,
            change-task-goal, change-scale, add-fact, or several.
        summary: The same in words, with the places.
        subtask: Index of the subtask that it changes, or before which it inserts; None for the task as a whole.
        step: Index of the step that it changes, or before which it inserts; None where no step is meant.
        edits: The changes, in the order in which they are applied.
        cause: Which of `report.errors` it removes, as an index; None for one that removes them all together.
        proves: True when the repaired plan is PROVED. False when it removes its cause and adds none, and either other
            causes remain or the plan still rests on something unknown: `remaining` and `remark` say which.
        remaining: How many errors the repaired plan still has.
        remark: What else to know, such as why it would not work elsewhere.
        assumption: True when it states a fact of the world, which only a look at the world can confirm.
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

    def apply(self, task: Task) -> Task:
        """Returns the repaired task.

        Args:
            task: The one whose report offered the fix. If it carries its scene, a fact that the fix states is in the
                scene of the result.

        Raises:
            FixError: It is another task, without the places that the fix changes.
        """
        for edit in self.edits:
            task = edit.apply(task)
        return replace(task, source=None)

    def apply_to_scene(self, scene: Scene) -> Scene:
        """Returns the scene for the repaired task; it is another one only if the fix states a fact."""
        for edit in self.edits:
            if isinstance(edit, AddFact):
                scene = edit.apply_to_scene(scene)
        return scene

    def __str__(self) -> str:
        """Returns the fix as diagnostics print it."""
        lines = [f"{self.summary}   [checked: {self._checked()}]"]
        if self.assumption:
            lines.append("(if it is so: this states a fact of the scene, look before you trust it)")
        if self.remark:
            lines.append(f"({self.remark})")
        return "\n".join(lines)

    def _checked(self) -> str:
        """Returns what the verification of the repaired plan found."""
        if self.proves:
            return "all obligations hold"
        if not self.remaining:
            return "nothing fails any more, some things stay unknown"
        noun = "1 other mistake remains" if self.remaining == 1 else f"{self.remaining} other mistakes remain"
        return f"this one is gone, {noun}"

    def to_json(self) -> dict[str, object]:
        """Returns the fix as JSON values."""
        return {
            "kind": self.kind,
            "summary": self.summary,
            "subtask": self.subtask,
            "step": self.step,
            "edits": [edit.to_json() for edit in self.edits],
            "cause": self.cause,
            "proves": self.proves,
            "remaining": self.remaining,
            "remark": self.remark,
            "assumption": self.assumption,
        }
