"""The obligations of a plan, in order, and how each was decided.

Per subtask k: its initial condition where it starts (B_0 for the first, C(k-1) after that), the precondition of every
step P(k,i), its goal at the flow's end G(k); last of all the task goal F. Well-formedness (W) comes before all of
them and is decided by `wellformed`; locality (L) is reported beside them.

Source: docs/semantics.md, Verdicts.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Literal, NamedTuple

import bddl
from oag.model.facts import Condition, Fact, Value
from oag.table.state import Entry
from oag.task.task import label

ObligationKind = Literal["init", "precondition", "goal", "task-goal"]


class Grade(Enum):
    """How an obligation stands in the states that are consistent with what is known."""

    HOLDS = "HOLDS"
    POSSIBLE = "POSSIBLE"
    FAILS = "FAILS"


class CausalLink(NamedTuple):
    """One causal link: a condition, and the write that decides it.

    Attributes:
        condition: What is needed.
        producer: Time of the write that gave the fact its value; 0 for the start state.
        value: The value it wrote.
    """

    condition: Condition
    producer: int
    value: Value


class Obligation(NamedTuple):
    """One thing that must hold at one place.

    Attributes:
        kind: Which kind.
        subtask: Index of the subtask; for the task goal, the number of subtasks.
        step: Index of the step for a precondition, else -1.
        time: When it must hold: writes before this time count.
        grade: How it was decided.
        links: What decided it.
        cases: The distinction of cases that decided it, in preorder, where links alone do not: an unknown fact stands
            before its case true and its case false, None ends a case. None when there is no such distinction.
    """

    kind: ObligationKind
    subtask: int
    step: int
    time: int
    grade: Grade
    links: tuple[CausalLink, ...]
    cases: tuple[Fact | None, ...] | None = None

    @property
    def place(self) -> str:
        """Where it must hold, in short: `T3.4`, `T3's goal`, or `the task goal`."""
        if self.kind == "task-goal":
            return "the task goal"
        return label(self.subtask, self.step) if self.kind == "precondition" else f"T{self.subtask + 1}'s {self.kind}"


class Assumption(NamedTuple):
    """Something unknown that a plan needs.

    Attributes:
        time: When it is assumed.
        condition: The literal; None when a formula beyond literals is unknown as a whole.
        formula: That formula, or None.
        obligation: Index of the obligation that needs it.
        about_start: True when nothing before wrote the fact, so that the assumption speaks of S_0.
    """

    time: int
    condition: Condition | None
    formula: bddl.Formula | None
    obligation: int
    about_start: bool


class RootCause(NamedTuple):
    """A root cause: an obligation that fails, not as a consequence of an earlier failure.

    Attributes:
        obligation: Index of the obligation.
        condition: The literal that is false; None when a formula beyond literals is.
        formula: That formula, or None.
        entry: The write that made the literal false.
        missing: Every literal of the obligation that fails independently, this one included.
    """

    obligation: int
    condition: Condition | None
    formula: bddl.Formula | None
    entry: Entry
    missing: tuple[Condition, ...]


@dataclass(frozen=True, slots=True)
class Decision:
    """What was decided of the obligations that progression had left open.

    Attributes:
        fails: Index of the first obligation that no run meets; None when some run meets all.
        grades: Grades of the open obligations before that one, each over the runs that meet all earlier ones.
        given: What to assume where the plan needs it, by the index of the obligation that first speaks of it. With
            it every obligation up to `fails` holds, or all; none of it can be left out.
        run: A run that gets to the obligation that fails, as (time, fact, value) for everything unknown that the plan
            speaks of; at time 0 the start. None when nothing fails.
        miss: When something has to be assumed, a run that misses an obligation, in the same form; else None.
    """

    fails: int | None = None
    grades: Mapping[int, Grade] = field(default_factory=dict)
    given: Mapping[int, tuple[Condition, ...]] = field(default_factory=dict)
    run: tuple[tuple[int, Fact, Value], ...] | None = None
    miss: tuple[tuple[int, Fact, Value], ...] | None = None


NOTHING_DECIDED = Decision()
