"""Decision of a plan: obligations in order, their grades, and the report with verdict, diagnostics and certificate.

Diagnostics and fixes are made when a report is first asked for them.

Source: docs/semantics.md, Verdicts and Proposition 1'.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cache, cached_property, partial
from typing import NamedTuple, cast

import bddl
from bddl.terminal import pluralize
from oag.certificate.write import Certificate, certify
from oag.compilation import CompiledSubtask, compile_plan
from oag.exact import Counterexample, Undecided, counterexample, decide, needs_exact_decision, unroll
from oag.flows import NoFlow, prove_no_flow
from oag.model.codec import brief, shown
from oag.model.diagnostics import Diagnostic, NoSuchSubtask
from oag.model.scene import Scene
from oag.model.symbols import Condition, conjunction
from oag.picture import drawing, html
from oag.primitives.state import State, reset_reason, scene_facts, start_state
from oag.primitives.table import Needed, needed
from oag.progression import (
    NOTHING_DECIDED,
    CausalLink,
    Decision,
    Grade,
    Obligation,
    Trace,
    holds_throughout,
)
from oag.task_definition import Task
from oag.verify.edits import Fix
from oag.verify.outcome import Missing, PlanState
from oag.wellformed import check

# Classes of the picture's steps.
_TINTS = {Grade.HOLDS: "done", Grade.POSSIBLE: "open", Grade.FAILS: "failed"}
_SEVERITIES = ("error", "warning", "note")
# Fixes that remove a whole place with all its mistakes.
_WIPING = ("set-flow", "delete-subtask")


Repair = Callable[["Report"], tuple[Fix, ...]]


class Verdict(Enum):
    """What `verify` decided of a plan."""

    PROVED = "PROVED"
    CONDITIONAL = "CONDITIONAL"
    REFUTED = "REFUTED"


@dataclass(frozen=True)
class Report:
    """What was decided of one plan; true exactly when it is PROVED.

    Attributes:
        verdict: PROVED, CONDITIONAL (holds if what the warnings list holds) or REFUTED.
        explain: What makes the diagnostics; they are made when they are first read.
        no_flow: The proof that a subtask has no flow, where that was shown.
        repair: How fixes are searched; None for a report that offers none.
        searched: Indices of the subtasks whose flow was searched: other conditions may need another one.
    """

    task: Task
    scene: Scene
    verdict: Verdict
    explain: Callable[[], tuple[Diagnostic, ...]] = field(repr=False, compare=False)
    _follow: Callable[[], Trace] | None = field(repr=False, compare=False)
    no_flow: NoFlow | None = field(default=None, repr=False, compare=False)
    repair: Repair | None = field(default=None, repr=False, compare=False)
    searched: tuple[int, ...] = field(default=(), repr=False, compare=False)

    def __repr__(self) -> str:
        return brief(f"<Report {self.verdict.value} of {self.task!r}>")

    def _repr_html_(self) -> str:
        """Return the verdict, the plan's picture and the findings for a notebook."""
        states: dict[tuple[int, int], str] = {}
        for obligation in self.obligations:
            if obligation.kind == "precondition":
                states[obligation.subtask, obligation.step] = _TINTS[obligation.grade]
            if obligation.grade is Grade.FAILS:
                break
        drawn = drawing(self.task, states, {place for place, state in states.items() if state == "failed"})
        blocks = [str(finding) for finding in self.findings if finding.severity != "note"]
        return html(self.verdict.value, self._head(), drawn, "\n\n".join(blocks))

    def __bool__(self) -> bool:
        return self.verdict is Verdict.PROVED

    @property
    def sure_fix(self) -> Fix | None:
        """The first fix that proves the plan and states no fact of the scene; None where there is none."""
        return next((fix for fix in self.fixes if fix.proves and not fix.assumption), None)

    @cached_property
    def trace(self) -> Trace | None:
        """How each obligation was decided, and by which writes; None when the plan is not well formed."""
        return None if self._follow is None else self._follow()

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

    def state_after(self, subtasks: int) -> PlanState | None:
        """Return what is known once so many subtasks of the plan are done; None where the plan does not get there.

        0 is the start. In a plan that rests on assumptions, these count as known from where they are needed.

        Raises:
            NoSuchSubtask: The plan has fewer subtasks.
        """
        count, number = len(self.task.subtasks), cast("object", subtasks)
        if not isinstance(number, int) or not 0 <= number <= count:
            raise NoSuchSubtask(f"expected a number of subtasks from 0 to {count}, got {shown(subtasks)}")
        trace = self.trace
        if trace is None or (trace.undecided_from is not None and trace.undecided_from < subtasks):
            return None
        if any(trace.obligations[failure.obligation].subtask < subtasks for failure in trace.failures):
            return None
        end, state = 2 * sum(step.subtask < subtasks for step in trace.steps) + 1, trace.start
        for time, effect in trace.writes:
            if time < end:
                state = state.after(effect, time)
        return PlanState(state, self.scene.categories, subtasks)

    @cached_property
    def missing(self) -> tuple[Missing, ...]:
        """Return what the plan needs and does not have, in order: what is false where it fails, else what is unknown.

        None for a plan that is proved, or that is not well formed.
        """
        from oag.verify.diagnose import needed_text

        trace = self.trace
        if trace is None:
            return ()
        found: list[Missing] = []
        for failure in trace.failures:
            place = trace.obligations[failure.obligation].place
            wanted = [c.text() for c in failure.missing] or [str(needed_text(failure.condition, failure.formula))]
            found += [Missing(place, text, known_false=True) for text in wanted]
        if self.no_flow is not None:
            goal = bddl.format(self.task.subtasks[self.no_flow.subtask].goal)
            found.append(Missing(f"T{self.no_flow.subtask + 1}'s goal", goal, known_false=True))
        if not found:
            found += [
                Missing(trace.obligations[a.obligation].place, str(needed_text(a.condition, a.formula)), False)
                for a in trace.assumptions
            ]
        return tuple(found)

    @property
    def undecided(self) -> bool:
        """True when it is open whether the plan works, however the start may be: something was too large, or absent."""
        if self.verdict is not Verdict.CONDITIONAL:
            return False
        trace = self.trace
        return trace is None or trace.undecided_from is not None or trace.unsettled is not None

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
        return self.text()

    def text(self, without: Collection[str] = ()) -> str:
        """Return the report for a person, without the findings of some codes."""
        lines = [
            f"{self.verdict.value}  {self._head()}",
            f"  goal    {bddl.format(self.task.goal)} ({self.goal_source})",
        ]
        lines.extend(f"  {'rests' if index == 0 else '':7} {text}" for index, text in enumerate(self.assumptions))
        blocks = ["\n".join(lines), *(str(finding) for finding in self.findings if finding.code not in without)]
        whole = ((index, fix) for index, fix in enumerate(self.fixes) if fix.cause is None)
        blocks.extend(f"all of it together\n  fix     {self._number(index)}{fix}" for index, fix in whole)
        return "\n\n".join(blocks)

    def _head(self) -> str:
        """Return the plan with the number of obligations that hold, or what kept them from being decided."""
        flows = [subtask.flow for subtask in self.task.subtasks]
        steps = sum(len(flow) for flow in flows if flow is not None)
        head = f"{self.task.name}: {pluralize(len(flows), 'subtask')}, {pluralize(steps, 'step')}"
        trace = self.trace
        if trace is None:
            return f"{head}, undecided" if self.undecided else head
        held = sum(obligation.grade is Grade.HOLDS for obligation in trace.obligations)
        counted = f"{held} of {pluralize(len(trace.obligations), 'obligation')}"
        if trace.undecided_from is None:
            return f"{head}, {counted} hold{', undecided' if self.undecided else ''}"
        stop = f"T{trace.undecided_from + 1}"
        why = "no flow reaches its goal" if self.no_flow is not None else "it has no flow"
        return f"{head}, {counted} hold up to {stop}, and {why}"


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


def verify(
    task: Task, scene: Scene, searched: tuple[int, ...] = (), *, exact: bool = False, repair: Repair | None = None
) -> Report:
    """Decide whether a plan reaches its goal from every start state that is consistent with what is known.

    It is REFUTED when the plan is not well formed or an obligation fails; CONDITIONAL when an obligation needs an
    unknown fact, or the plan is too large to be decided; PROVED when all obligations hold.

    Args:
        task: The plan.
        scene: Its objects and what is known of the start.
        searched: Indices of the subtasks whose flow was searched; each gets a note.
        exact: Decide everything by a solver, even what progression decides; the verdict is the same.
        repair: How the report searches for fixes, such as `find_fixes`; by default it offers none.
    """
    malformed = check(task, scene)
    if malformed:
        # A plan that is too large to be decided is no mistake.
        wrong = any(finding.severity == "error" for finding in malformed)
        ordered = sorted(malformed, key=lambda finding: finding.severity != "error")
        verdict = Verdict.REFUTED if wrong else Verdict.CONDITIONAL
        return Report(task, scene, verdict, partial(tuple, ordered), None, repair=repair)
    plan = _compiled(task, scene)
    verdict, proof = Verdict.PROVED, None
    # Most plans hold by what is known, and not every caller reads the evidence.
    evidence = cache(partial(_followed, plan, exact=exact))
    if exact or not holds_throughout(*plan):
        trace = evidence()
        # A choice among unknown alternatives may be wrong, and then proves nothing about reachability.
        proof = None if trace.chose else prove_no_flow(task, scene, trace)
        if trace.failures or proof is not None:
            verdict = Verdict.REFUTED
        elif trace.assumptions or trace.undecided_from is not None:
            verdict = Verdict.CONDITIONAL

    def explain() -> tuple[Diagnostic, ...]:
        from oag.verify.diagnose import all_findings

        return all_findings(task, scene, evidence(), proof, searched)

    return Report(task, scene, verdict, explain, evidence, proof, repair, searched)


class _Compiled(NamedTuple):
    """A well-formed plan ready for progression; `objects` has the category of each object."""

    start: State
    subtasks: tuple[CompiledSubtask, ...]
    goal: Needed
    objects: dict[str, str]


def _compiled(task: Task, scene: Scene) -> _Compiled:
    stated = scene_facts(scene)
    start = start_state(scene, task.subtasks[0].target if task.subtasks else None, stated)
    return _Compiled(start, compile_plan(task.subtasks, scene, stated), needed(task.goal), scene.categories)


def follow(task: Task, scene: Scene) -> Trace:
    """Return the progression of a well-formed plan, exact where three-valued progression alone would not be."""
    return _followed(_compiled(task, scene))


def _followed(plan: _Compiled, *, exact: bool = False) -> Trace:
    """Return the progression of a plan; `exact` also decides exactly what progression alone decides."""
    start, subtasks, goal, objects = plan

    def progressed(decision: Decision, *, chose: bool = False) -> Trace:
        trace = Trace(start, objects, decision, chose=chose)
        trace.run(subtasks, goal)
        return trace

    trace = progressed(NOTHING_DECIDED)
    if not exact and not needs_exact_decision(trace):
        return trace
    unrolled = unroll(trace, subtasks, goal, objects, every=exact)
    try:
        decision = decide(unrolled)
    except Undecided as problem:
        if needs_exact_decision(trace):
            trace.leave_open(str(problem))
        return trace
    if decision.fails is None and not (decision.given or trace.assumptions or trace.failures):
        return trace
    # The given values are sufficient, not necessary: other runs may succeed without them.
    return progressed(decision, chose=trace.chose or bool(decision.given))
