"""From root causes and assumptions to diagnostics: what is needed, what is the case instead, and who made it so.

Source: docs/codes/.
"""

from __future__ import annotations

from collections.abc import Iterator
from operator import itemgetter

import bddl
from oag.explain.words import needed_text, state_text, verb, why_false
from oag.model.categories import Kind
from oag.model.diagnostic import TASK_GOAL, WRONG_ORDER, Diagnostic
from oag.model.facts import (
    EEF,
    HAND,
    NEAR,
    ROBOT_FACTS,
    Condition,
    Fact,
    conjunction,
    fact_text,
    held_by,
    holding,
)
from oag.model.scene import Scene
from oag.progression.compiled import compile_subtask
from oag.progression.obligations import Assumption, Obligation, RootCause
from oag.progression.progress import Trace, producer_place
from oag.table.library import RESTING, needed
from oag.task.task import Task, step_place, subtask_place

# Of a formula over many objects, so many facts of the start are named.
_SHOWN_FACTS = 8


class Explainer:
    """Turns the findings of one trace into diagnostics."""

    def __init__(self, task: Task, scene: Scene, trace: Trace) -> None:
        self.task = task
        self.scene = scene
        self.trace = trace

    def failures(self) -> Iterator[Diagnostic]:
        """Yields one error for each root cause, in order."""
        for failure, dependent in zip(self.trace.failures, self.trace.dependents, strict=True):
            yield self._failure(failure, dependent)

    def assumptions(self) -> Iterator[Diagnostic]:
        """Yields one warning for each thing that is needed and unknown, in order."""
        for assumption in self.trace.assumptions:
            obligation = self.trace.obligations[assumption.obligation]
            why = "it held, but carrying something made it unknown"
            if assumption.condition is None:
                why = "what is known does not decide it"
            elif assumption.about_start:
                why = "nothing states it, and no step before decides it"
            yield Diagnostic(
                "context/open",
                "warning",
                why + self._otherwise(assumption.condition, obligation, possible=True),
                self._place(obligation),
                *self._indices(obligation),
                literal=needed_text(assumption.condition, assumption.formula),
                hint=self._closing_hint(assumption),
            )

    def goal_gaps(self) -> Iterator[Diagnostic]:
        """Yields one note for each subtask whose goal omits what the rest of the plan needs of its flow.

        Source: docs/codes/context/goal-gap.md: a boundary that holds by the flow, but not by the goal, is thin.
        """
        gaps: dict[int, dict[Condition, Obligation]] = {}
        steps = self.trace.steps
        for obligation in self.trace.obligations:
            subtask = obligation.subtask
            for condition, producer, _ in obligation.links:
                if producer <= 0 or producer % 2:
                    continue
                made_by = steps[producer // 2 - 1].subtask
                if made_by < subtask and condition.sayable:
                    goal = needed(self.task.subtasks[made_by].goal)
                    if not (isinstance(goal, tuple) and (condition,) in goal):
                        gaps.setdefault(made_by, {}).setdefault(condition, obligation)
        for index, gap in sorted(gaps.items(), key=itemgetter(0)):
            needs = "; ".join(f"{c.text()} for {o.place}" for c, o in gap.items())
            said = self.task.subtasks[index].goal
            message = f"the goal {bddl.format(said)} can hold without what the rest of the plan needs: {needs}"
            hint = f"accept the subtask on {bddl.format(conjunction(said, gap))}"
            yield Diagnostic("context/goal-gap", "note", message, subtask_place(self.task, index), index, hint=hint)

    def _failure(self, failure: RootCause, dependent: int) -> Diagnostic:
        obligation = self.trace.obligations[failure.obligation]
        code, label_text = self._code(obligation, failure)
        since = None
        if failure.condition is not None:
            value = False if failure.entry.value is None else failure.entry.value
            began = self.trace.since(failure.condition.fact, value, failure.entry.time)
            since = producer_place(self.trace, began.time)
            message = self._why(failure, failure.condition, obligation, began.time, since)
        else:
            message = why_false(self.trace, obligation, failure.formula, self.scene.categories)
        return Diagnostic(
            code,
            "error",
            message,
            self._place(obligation),
            *self._indices(obligation),
            literal=needed_text(failure.condition, failure.formula),
            since=since,
            start=self._start(failure),
            stops_at=obligation.place,
            eai_label=label_text,
            dependent=dependent,
        )

    def _code(self, obligation: Obligation, failure: RootCause) -> tuple[str, str | None]:
        if obligation.kind == "init":
            code = "context/start" if obligation.subtask == 0 else "context/refuted"
        elif obligation.kind == "goal":
            code = "flow/goal-not-reached"
        elif obligation.kind == "precondition":
            code = "flow/precondition"
        else:
            code = "goal/undone" if self._reached_before(failure) else "goal/not-reached"
        if code in ("flow/precondition", "context/refuted") and self._held_before(failure):
            return code, WRONG_ORDER
        return code, None

    def _reached_before(self, failure: RootCause) -> bool:
        return any(
            link.condition == failure.condition
            for obligation in self.trace.obligations[: failure.obligation]
            if obligation.kind == "goal"
            for link in obligation.links
        )

    def _held_before(self, failure: RootCause) -> bool:
        condition = failure.condition
        if condition is None or condition.fact in (NEAR, EEF):
            return False
        history = self.trace.history(condition.fact)
        return any(condition.grade(entry.value) for entry in history if entry.time < failure.entry.time)

    def _why(self, failure: RootCause, condition: Condition, obligation: Obligation, began: int, since: str) -> str:
        """Returns what is the case instead, since when, and that nothing changed it."""
        instead = state_text(condition, failure.entry.value)
        lines = [f"{instead} since {since}; {self._nothing(condition, obligation, began)}"]
        if condition.fact[0] in RESTING and not condition.positive and obligation.kind == "goal":
            lines.append(self._why_resting(condition.fact, obligation.subtask))
        later = self._made_later(condition, obligation)
        if later is not None:
            lines.append(f"{later} would, but comes later")
        otherwise = self._otherwise(condition, obligation, possible=False).strip()
        if otherwise:
            lines.append(f"{otherwise}, which is not so either")
        if len(failure.missing) > 1:
            others = ", ".join(other.text() for other in failure.missing if other != condition)
            lines.append(f"the same place also lacks {others}")
        return "\n".join(lines)

    def _nothing(self, condition: Condition, obligation: Obligation, began: int) -> str:
        """Returns the clause that says no step in between brought the literal about."""
        does = verb(condition)
        if began > 0 and began % 2 == 0:
            return f"no step after that {does}"
        reached = min(obligation.subtask, len(self.task.subtasks) - 1) + 1
        if obligation.kind == "init":
            reached = obligation.subtask
        if reached == 0:
            return "no step comes before"
        return f"no step of {'T1' if reached == 1 else f'T1-T{reached}'} {does}"

    def _why_resting(self, fact: Fact, subtask: int) -> str:
        """Returns why an item that a subtask should have taken away still rests where it was."""
        _, item, place = fact
        steps = [step for step in self.trace.steps if step.subtask == subtask]
        grasped = any((HAND, holding(item)) in step.effect or held_by(step.hand) == item for step in steps)
        if not grasped:
            return f"nothing in T{subtask + 1} grasps {item}"
        within = fact[0] == "inside" and place in self.scene.objects and self.scene[place].kind is not Kind.ITEM
        motion = "RETREAT or driving" if within else "a motion"
        example = "" if within else ", such as LIFT_EEF_UP"
        return f"T{subtask + 1} grasps {item}, but {motion} has to follow while it is held{example}"

    def _made_later(self, condition: Condition, obligation: Obligation) -> str | None:
        """Returns the first step of a later subtask that brings about what an earlier place lacks."""
        if obligation.kind in ("goal", "task-goal") or condition.fact in (NEAR, EEF):
            return None
        wanted = (condition.fact, condition.value if condition.positive else False)
        for step in self.trace.steps:
            if step.subtask > obligation.subtask and wanted in step.effect:
                return f"T{step.subtask + 1} step {step.position + 1} {step.primitive.name}"
        return None

    def _otherwise(self, condition: Condition | None, obligation: Obligation, *, possible: bool) -> str:
        """Returns a line with what else a step would run on, for a need that has an alternative.

        Args:
            condition: What is needed.
            obligation: Where.
            possible: Name what may be so there, and of alternatives that cannot be so that they are out.
        """
        others = self.alternatives(condition, obligation)
        out = [other for other, may_be in others.items() if possible and not may_be]
        lines = [f"{other.text()} would do, and is known not to be so" for other in out]
        left = " or ".join(other.text() for other in others if other not in out)
        if left:
            lines.insert(0, f"{self.trace.steps[obligation.time // 2].primitive.name} would also run with {left}")
        return "".join(f"\n{line}" for line in lines)

    def alternatives(self, condition: Condition | None, obligation: Obligation) -> dict[Condition, bool]:
        """Returns what else than a condition a step would run on, each with whether that may be so there."""
        if condition is None or obligation.kind != "precondition":
            return {}
        rows = compile_subtask(self.task.subtasks[obligation.subtask], self.scene).rows
        step = self.trace.steps[obligation.time // 2]
        clauses = rows.row(step.primitive, step.hand)[0]
        others = next((clause for clause in clauses if condition in clause), ())
        return {other: not self._known_false(other, obligation) for other in others if other != condition}

    def _known_false(self, condition: Condition, obligation: Obligation) -> bool:
        written = (e.value for e in self.trace.history(condition.fact) if e.time <= obligation.time)
        return condition.grade([None, *written][-1]) is False

    def _closing_hint(self, assumption: Assumption) -> str | None:
        """Returns how the scene could settle an unknown literal."""
        condition = assumption.condition
        literal = None if condition is None else condition.literal()
        if condition is None or literal is None or not assumption.about_start:
            return None
        closed = f', or list "{condition.fact[0]}" under "closed"' if not condition.positive else ""
        return f'state {bddl.format(literal)} in the scene\'s "facts"{closed} if it holds'

    def _start(self, failure: RootCause) -> tuple[str, ...]:
        """Returns literals of a start state from which the plan fails here, the ones about the task's objects."""
        names = {name for subtask in self.task.subtasks for name in subtask.roles}
        said: dict[str, None] = {}
        for fact in self.scene.facts:
            for literal in bddl.literals(fact) or ():
                if names.issuperset(literal.atom.args[:1]):
                    text = f"{literal.atom.predicate}({', '.join(literal.atom.args)})"
                    said[text if literal.value else f"not {text}"] = None
        condition = failure.condition
        if condition is None:
            # What of the start makes a formula false, as far as it can be told in few words.
            links = self.trace.obligations[failure.obligation].links
            start = [link for link in links if link.producer <= 0 and link.condition.fact not in ROBOT_FACTS]
            said |= dict.fromkeys(link.condition.text() for link in start[:_SHOWN_FACTS])
        elif failure.entry.time == 0 and condition.fact not in (NEAR, EEF, HAND):
            said[fact_text(condition.fact, failure.entry.value)] = None
        for assumption in self.trace.assumptions:
            if assumption.obligation < failure.obligation and assumption.condition is not None:
                said[assumption.condition.text()] = None
        said[fact_text(HAND, self.trace.start.hand)] = None
        return tuple(said)

    def _indices(self, obligation: Obligation) -> tuple[int | None, int | None]:
        subtask = None if obligation.kind == "task-goal" else obligation.subtask
        return subtask, obligation.step if obligation.kind == "precondition" else None

    def _place(self, obligation: Obligation) -> str:
        if obligation.kind == "task-goal":
            return TASK_GOAL
        if obligation.kind == "precondition":
            return step_place(self.task, obligation.subtask, obligation.step)
        return f"{subtask_place(self.task, obligation.subtask)}, {obligation.kind}"
