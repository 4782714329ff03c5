"""Report of `verify`: verdict, diagnostics, certificate and regressed goals, as text and as JSON."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property

import bddl
from bddl.terminal import pluralize
from oag.certificate.write import Certificate, certify
from oag.exact import Counterexample, counterexample
from oag.flows import NoFlow
from oag.model.diagnostics import Diagnostic
from oag.model.scene import Scene
from oag.model.symbols import Condition, conjunction
from oag.primitives.state import reset_reason
from oag.progression import CausalLink, Grade, Obligation, Trace
from oag.task import Task
from oag.verify.edits import Fix

_SEVERITIES = ("error", "warning", "note")
# Fixes that remove a whole place with all its mistakes.
_WIPING = ("set-flow", "delete-subtask")


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
        explain: What makes the diagnostics; they are made when they are first read.
        trace: How the obligations were decided; None when the plan is not well formed.
        no_flow: The proof that a subtask has no flow, where that was shown.
        repair: How fixes are searched; None for a report that offers none.
    """

    task: Task
    scene: Scene
    verdict: Verdict
    explain: Callable[[], tuple[Diagnostic, ...]] = field(repr=False, compare=False)
    trace: Trace | None = field(repr=False, compare=False)
    no_flow: NoFlow | None = field(default=None, repr=False, compare=False)
    repair: Callable[[Report], tuple[Fix, ...]] | None = field(default=None, repr=False, compare=False)

    def __repr__(self) -> str:
        return f"<Report {self.verdict.value} of {self.task!r}>"

    def __bool__(self) -> bool:
        return self.verdict is Verdict.PROVED

    @property
    def sure_fix(self) -> Fix | None:
        """The first fix that proves the plan and states no fact of the scene; None where there is none."""
        return next((fix for fix in self.fixes if fix.proves and not fix.assumption), None)

    @cached_property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """All diagnostics of the plan: errors, then warnings and notes, each in the order of the plan."""
        return self.explain()

    def with_findings(self, more: tuple[Diagnostic, ...]) -> Report:
        """Return the report with further warnings and notes, from callers that know more than plan and scene."""

        def explain() -> tuple[Diagnostic, ...]:
            return tuple(sorted((*self.diagnostics, *more), key=lambda found: _SEVERITIES.index(found.severity)))

        return replace(self, explain=explain)

    @property
    def errors(self) -> tuple[Diagnostic, ...]:
        """The diagnostics that refute the plan: one for each cause that progression distinguishes."""
        return tuple(finding for finding in self.diagnostics if finding.severity == "error")

    @cached_property
    def fixes(self) -> tuple[Fix, ...]:
        """Repairs of a refuted plan, each verified: those that prove it first, the smallest change first.

        They are searched when this is first read; a plan that is not refuted has none and pays nothing.
        """
        return self.repair(self) if self.repair is not None and self.verdict is Verdict.REFUTED else ()

    @cached_property
    def findings(self) -> tuple[Diagnostic, ...]:
        """The diagnostics with the fixes of each, which are searched when this is first read.

        Where one change at one place removes all errors, they are shown as one mistake. The first error stands for it,
        and its `also` names the others. A change that replaces a whole flow, or leaves a subtask out, removes any
        mistake there, so it does not show that errors belong together. `errors` has all of them.
        """
        errors = list(self.errors)
        numbered_fixes = [(fix, f"{self._number(index)}{fix}") for index, fix in enumerate(self.fixes)]
        fixes = [tuple(text for fix, text in numbered_fixes if fix.cause == number) for number in range(len(errors))]
        if len(errors) > 1 and any(
            fix.proves and fix.cause is not None and fix.kind not in _WIPING for fix, _ in numbered_fixes
        ):
            also = tuple(error.brief for error in errors[1:])
            dependent = sum(error.dependent for error in errors)
            errors = [replace(errors[0], dependent=dependent, also=also)]
            fixes = [tuple(text for fix, text in numbered_fixes if fix.proves and fix.cause is not None)]
        written = [replace(error, fixes=texts) for error, texts in zip(errors, fixes, strict=True)]
        return (*written, *(finding for finding in self.diagnostics if finding.severity != "error"))

    def _number(self, index: int) -> str:
        """Return the number that a fix is chosen by, where there is a choice."""
        return f"({index + 1}) " if len(self.fixes) > 1 else ""

    @property
    def obligations(self) -> tuple[Obligation, ...]:
        """Every obligation with its grade and links, in order; none when the plan is not well formed."""
        return () if self.trace is None else tuple(self.trace.obligations)

    @cached_property
    def certificate(self) -> Certificate | None:
        """The evidence for the verdict, for `recheck`.

        None when the plan is not well formed, or has a subtask without a flow that may have one: there is then nothing
        to recheck. None too when a solver decided it by more cases than can be listed, or did not finish.
        """
        if self.trace is None or not self.trace.checkable:
            return None
        if self.trace.undecided_from is not None and self.verdict is not Verdict.REFUTED:
            return None
        return certify(self.task, self.scene, self.verdict.value, self.trace, self.no_flow)

    @cached_property
    def counterexample(self) -> Counterexample | None:
        """A complete start state from which a refuted plan fails, and the states up to there.

        None when no obligation failed: the plan is not refuted, not well formed, or lacks a flow.
        """
        return None if self.trace is None else counterexample(self.task, self.scene, self.trace)

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
        """Premises of the verdict in addition to the scene's facts, in words: the reset, then what is unknown."""
        if self.certificate is None:
            return ()
        return tuple(
            f"{entry['text']}: {reset_reason(entry['fact']) if entry['kind'] == 'reset' else 'unknown, and needed'}"
            for entry in self.certificate.assumptions
        )

    @property
    def goal_source(self) -> str:
        """Where the task goal came from, in words."""
        if self.task.goal_given:
            return "given with the task"
        return "read off the subtask goals, so a dropped subtask cannot be seen"

    def to_json(self) -> dict[str, object]:
        """Return the report as JSON values."""
        return {
            "verdict": self.verdict.value,
            "task": self.task.name,
            "scene": self.scene.name,
            "goal": bddl.format(self.task.goal),
            "goal_source": self.goal_source,
            "assumptions": list(self.assumptions),
            "regressed_goals": [bddl.format(goal) for goal in self.regressed_goals],
            "diagnostics": [finding.to_json() for finding in self.findings],
            "fixes": [fix.to_json() for fix in self.fixes],
            "counterexample": None if self.counterexample is None else self.counterexample.to_json(),
            "certificate": None if self.certificate is None else self.certificate.to_json(),
        }

    def __str__(self) -> str:
        """Return the report for a person."""
        flows = [subtask.flow for subtask in self.task.subtasks]
        steps = sum(len(flow) for flow in flows if flow is not None)
        head = f"{self.verdict.value}  {self.task.name}: {pluralize(len(flows), 'subtask')}, {pluralize(steps, 'step')}"
        if self.trace is not None:
            held = sum(obligation.grade is Grade.HOLDS for obligation in self.trace.obligations)
            head += f", {held} of {pluralize(len(self.trace.obligations), 'obligation')} hold"
        lines = [head, f"  goal    {bddl.format(self.task.goal)} ({self.goal_source})"]
        lines.extend(f"  {'rests' if index == 0 else '':7} {text}" for index, text in enumerate(self.assumptions))
        blocks = ["\n".join(lines), *(str(finding) for finding in self.findings)]
        whole = ((index, fix) for index, fix in enumerate(self.fixes) if fix.cause is None)
        blocks.extend(f"all of it together\n  fix     {self._number(index)}{fix}" for index, fix in whole)
        return "\n\n".join(blocks)


def crossing(trace: Trace, count: int) -> tuple[tuple[Condition, ...], ...]:
    """Return, for the boundary after each of `count` subtasks, the conditions that cross it, robot ones included."""
    sets: list[dict[Condition, None]] = [{} for _ in range(count)]
    for obligation in trace.obligations:
        for link in obligation.links:
            if not link.condition.grade(link.value):
                continue
            for boundary in range(_born(link, obligation, trace), min(obligation.subtask, count)):
                sets[boundary].setdefault(link.condition)
    return tuple(tuple(conditions) for conditions in sets)


def regressed_goals(task: Task, trace: Trace) -> tuple[bddl.Formula, ...]:
    """Return for each subtask its own goal together with R_k, what the rest of the plan needs of it.

    R_k is the regression of the task goal and of all later preconditions back to the boundary after subtask k. It
    follows from the causal links: it is the set of conditions whose link crosses that boundary. A state that satisfies
    them lets the rest of the plan run to the task goal, since no step in between writes their facts. In a refuted plan,
    literals that fail are left out. So are conditions about the robot alone, which have no BDDL form.

    Source: docs/semantics.md, Regressed goals.
    """
    crossings = crossing(trace, len(task.subtasks))
    return tuple(conjunction(s.goal, c) for s, c in zip(task.subtasks, crossings, strict=True))


def _born(link: CausalLink, obligation: Obligation, trace: Trace) -> int:
    """Return the index of the subtask in which a link's fact got its value; the start counts as subtask 0."""
    if link.producer <= 0:
        return 0
    if link.producer % 2 == 0:
        return trace.steps[link.producer // 2 - 1].subtask
    assumed = (a for a in trace.assumptions if a.time == link.producer and a.condition == link.condition)
    return 0 if any(a.about_start for a in assumed) else obligation.subtask
