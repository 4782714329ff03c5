"""What every kind of fix is made of: the mistake to mend, the candidate that may mend it, and its cost."""

from __future__ import annotations

from dataclasses import dataclass

import bddl
from oag.model.diagnostics import Diagnostic
from oag.model.scene import Scene
from oag.model.symbols import (
    Condition,
)
from oag.primitives.state import Entry
from oag.progression import Obligation, Trace
from oag.rewriting import Variant
from oag.task import SimpleTask, Task
from oag.verify.edits import (
    Edit,
    Fix,
    InsertSubtask,
    condition_edit,
)


class Cost:
    """How much a candidate changes; the smallest is tried and offered first."""

    STEP = FORM = 1
    ROLE = MOVE = 2
    CONDITION = SUBTASK = 3
    FLOW = 4
    DELETION = 5
    TWO_SUBTASKS = 6
    FACT = 7
    TASK_GOAL = 8


@dataclass(frozen=True, slots=True)
class Candidate:
    """A change that may repair a plan; the fields are those of a `Fix`.

    Attributes:
        cost: How much it changes, from `Cost`.
        subtask: Index of the subtask that it changes, or before which it inserts.
        step: Index of the step that it changes.
        rank: Among candidates of one cost, the smaller is tried first.
    """

    cost: int
    kind: str
    summary: str
    edits: tuple[Edit, ...]
    subtask: int | None = None
    step: int | None = None
    rank: int = 0
    assumption: bool = False

    @property
    def inserted(self) -> SimpleTask | None:
        """The one subtask that it puts in, if that is all it does."""
        edit = self.edits[0]
        return edit.inserted if len(self.edits) == 1 and isinstance(edit, InsertSubtask) else None

    def as_fix(self, cause: int) -> Fix:
        """Return the candidate as a fix of an error, not yet verified."""
        at = (self.subtask, self.step)
        return Fix(self.kind, self.summary, *at, self.edits, cause, proves=False, assumption=self.assumption)


@dataclass(frozen=True, slots=True)
class Mistake:
    """One mistake of a plan, with its context in the report.

    Attributes:
        number: Its index in `report.errors`.
        trace: The plan as it was followed; None when it is not well formed.
        obligation: What fails; None when the plan is not well formed, or a flow does not exist.
        condition: The literal that fails, where it is one.
        formula: The formula that fails, where it is no literal.
        entry: The write that made the literal false.
    """

    number: int
    finding: Diagnostic
    task: Task
    scene: Scene
    trace: Trace | None = None
    obligation: Obligation | None = None
    condition: Condition | None = None
    formula: bddl.Formula | None = None
    entry: Entry | None = None

    @property
    def subtask(self) -> int:
        """Index of the subtask where it shows; the number of subtasks when that is the task goal."""
        if self.obligation is not None:
            return self.obligation.subtask
        return len(self.task.subtasks) if self.finding.subtask is None else self.finding.subtask

    @property
    def writer(self) -> int | None:
        """Index of the subtask that made the literal false; None for the start, and where no step did."""
        if self.trace is None or self.entry is None or self.entry.time <= 0 or self.entry.time % 2:
            return None
        return self.trace.steps[self.entry.time // 2 - 1].subtask


def numbered(index: int) -> str:
    """Return the short name of a subtask."""
    return f"T{index + 1}"


def changed_condition(
    index: int, field: str, variant: Variant, rank: int, cost: int = Cost.CONDITION, kind: str = "change-condition"
) -> Candidate:
    """Return the candidate that gives a subtask's `init` or `goal` another form."""
    whose = f"{numbered(index)}'s {field}"
    left_out = variant.new is None
    words = f"leave {variant.words} out of {whose}" if left_out else f"change {whose} from {variant.words}"
    return Candidate(cost, kind, words, (condition_edit(index, field, variant.formula),), index, rank=rank)
