"""Why a task is not executed, or not to its end: it is not proved, a flow is missing, or somebody pressed Ctrl-C."""

from __future__ import annotations

from executor.records.rollout import Rollout
from oag import Report, Task


class PlanRefused(ValueError):
    """A plan that `verify` does not prove is not executed; `report` says why."""

    def __init__(self, report: Report) -> None:
        super().__init__(f"the plan is not proved, nothing was moved:\n{report}")
        self.report = report


class MissingFlow(ValueError):
    """A subtask without an action flow cannot be executed."""


def require_flows(task: Task) -> None:
    """Returns when every subtask has an action flow.

    Raises:
        MissingFlow: One has none; the message names it.
    """
    missing = [subtask.name for subtask in task.subtasks if subtask.flow is None]
    if missing:
        raise MissingFlow(f"no action flow for {', '.join(missing)}; a flow is a list such as [17, 1, 2, 3]")


class RolloutInterrupted(KeyboardInterrupt):
    """Ctrl-C during a rollout; `partial` is what had been done."""

    def __init__(self, partial: Rollout) -> None:
        super().__init__("the rollout was interrupted")
        self.partial = partial
