"""The result of `verify`: verdict, diagnostics, certificate, regressed goals; as text and as JSON."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

import bddl
from oag.certificate import Certificate, certify
from oag.diagnostic import Diagnostic
from oag.obligations import Grade, Obligation
from oag.progress import Trace
from oag.regress import regressed_goals
from oag.scene import Scene
from oag.task import Task


class Verdict(Enum):
    """What `verify` decided of a plan."""

    PROVED = "PROVED"
    CONDITIONAL = "CONDITIONAL"
    REFUTED = "REFUTED"


@dataclass(frozen=True)
class Report:
    """What was decided of one plan; true exactly when it is PROVED.

    Attributes:
        task: The plan.
        scene: The scene it was judged in.
        verdict: PROVED, CONDITIONAL (holds if what the warnings list holds) or REFUTED.
        diagnostics: Errors first, then warnings and notes, each group in the order of the plan.
        trace: How the obligations were decided; None when the plan is not well formed.
    """

    task: Task
    scene: Scene
    verdict: Verdict
    diagnostics: tuple[Diagnostic, ...]
    trace: Trace | None = field(repr=False, compare=False)

    def __bool__(self) -> bool:
        return self.verdict is Verdict.PROVED

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """The diagnostics that refute the plan."""
        return tuple(finding for finding in self.diagnostics if finding.severity == "error")

    @property
    def obligations(self) -> tuple[Obligation, ...]:
        """Every obligation with its grade and links, in order; none when the plan is not well formed."""
        return () if self.trace is None else tuple(self.trace.obligations)

    @cached_property
    def certificate(self) -> Certificate | None:
        """The evidence for the verdict, for `recheck`.

        None when the plan is not well formed, or has a subtask without a flow: there is then nothing to re-check.
        """
        if self.trace is None or self.trace.undecided_from is not None:
            return None
        return certify(self.task, self.scene, self.verdict.value, self.trace)

    @cached_property
    def regressed_goals(self) -> tuple[bddl.Formula, ...]:
        """For each subtask, its goal together with what the rest of the plan needs of it.

        The executor accepts a subtask on this. When the plan is not well formed these are the plain goals.
        """
        if self.trace is None:
            return tuple(subtask.goal for subtask in self.task.subtasks)
        return regressed_goals(self.task, self.trace)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """What the verdict rests on beside the scene's facts, in words: the reset, then what is unknown."""
        if self.certificate is None:
            return ()
        lines = []
        for entry in self.certificate.assumptions:
            if entry["kind"] == "reset":
                lines.append(f"{entry['text']}: {entry['reason']}")
            else:
                lines.append(f"{entry.get('text') or entry.get('formula')}: unknown, and needed")
        return tuple(lines)

    @property
    def goal_source(self) -> str:
        """Where the task goal came from, in words."""
        if self.task.goal_given:
            return "given with the task"
        return "read off the subtask goals, so a dropped subtask cannot be seen"

    def to_json(self) -> dict[str, object]:
        """Returns the report as JSON values."""
        return {
            "verdict": self.verdict.value,
            "task": self.task.name,
            "scene": self.scene.name,
            "goal": bddl.format(self.task.goal),
            "goal_source": self.goal_source,
            "assumptions": list(self.assumptions),
            "regressed_goals": [bddl.format(goal) for goal in self.regressed_goals],
            "diagnostics": [finding.to_json() for finding in self.diagnostics],
            "certificate": None if self.certificate is None else self.certificate.to_json(),
        }

    def __str__(self) -> str:
        """Returns the report for a person."""
        flows = [subtask.flow for subtask in self.task.subtasks]
        steps = sum(len(flow) for flow in flows if flow is not None)
        head = f"{self.verdict.value}  {self.task.name}: {_count(len(flows), 'subtask')}, {_count(steps, 'step')}"
        if self.trace is not None:
            held = sum(obligation.grade is Grade.HOLDS for obligation in self.trace.obligations)
            head += f", {held} of {_count(len(self.trace.obligations), 'obligation')} hold"
        lines = [head, f"  goal    {bddl.format(self.task.goal)} ({self.goal_source})"]
        lines.extend(f"  {'rests' if index == 0 else '':7} {text}" for index, text in enumerate(self.assumptions))
        blocks = ["\n".join(lines), *(str(finding) for finding in self.diagnostics)]
        return "\n\n".join(blocks)


def _count(number: int, noun: str) -> str:
    """Returns a number with its noun."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
