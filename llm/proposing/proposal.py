"""Proposals: tasks with all texts that modules 1 to 5 wrote for them, and the interface of whatever proposes one."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import bddl
from llm.structured.conversation import Conversation
from oag import Scene, Task
from oag.model.codec import brief


@dataclass(frozen=True, slots=True)
class Expanded:
    """Texts of module 1.

    Attributes:
        task_name: The request with every object named by its id, such as "put glass_0 into refrigerator_0".
        task_message_detail: The scene-grounded description, step by step.
    """

    task_name: str
    task_message_detail: str


@dataclass(frozen=True, slots=True)
class Proposal:
    """A task proposed for a query, not yet verified.

    Attributes:
        query: The query as given.
        expanded: Module 1: the query in terms of the scene.
        task: Modules 2, 4 and 5: subtasks with roles, formulas and flows, the task goal G, the scales.
        problems: Module 3: one BDDL problem for each subtask.
        notes: Assumptions, omissions and scalings, for the user.
        proposer: Name of the proposer, such as "offline".
        conversation: Exchanges with a model; not part of the JSON, and ignored in comparisons.
    """

    query: str
    expanded: Expanded
    task: Task
    problems: tuple[bddl.Problem, ...]
    notes: tuple[str, ...] = ()
    proposer: str = "offline"
    conversation: Conversation | None = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        return brief(f"<Proposal by {self.proposer} for {self.query!r}: {self.task!r}>")

    def to_json(self) -> dict[str, object]:
        """Return the proposal under the paper's names; `oag.Task.from_json` reads it as a task file too.

        In addition to the task's own fields there are `query`, `task_name`, `task_message_detail`, `notes`,
        `proposer`. Each `sub_task_k` has its `bddl` text, its `scale`, and the `bddl_category` of each object it
        names.
        """
        task = self.task.to_json()
        subtasks = task.pop("sub_tasks")
        written: dict[str, object] = {
            "query": self.query,
            "proposer": self.proposer,
            "task_name": self.expanded.task_name,
            "task_message_detail": self.expanded.task_message_detail,
            **task,
            "notes": list(self.notes),
        }
        if not isinstance(subtasks, list):
            raise TypeError("a task's JSON has its subtasks in a list")
        for number, (subtask, problem) in enumerate(zip(subtasks, self.problems, strict=True), start=1):
            written[f"sub_task_{number}"] = {
                **subtask,
                "bddl_category": {thing.name: thing.category for thing in problem.objects},
                "scale": self.task.scales.get(subtask["target"], 1.0),
                "bddl": bddl.format(problem),
            }
        return written


@runtime_checkable
class Proposer(Protocol):
    """Interface of everything that turns a query into a proposal: the offline planner, or a model."""

    def propose(self, query: str, scene: Scene) -> Proposal:
        """Return the task for a query in a scene, or raise a QueryError."""
        ...
