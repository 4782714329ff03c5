"""One run on which a refuted plan fails: a complete start state, and the states after it up to the failure.

Source: docs/semantics.md, Exact decisions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from oag.model.facts import ANY, EEF, HAND, NEAR, Fact, Value, fact_text, made_true
from oag.model.scene import Scene
from oag.progression.obligations import Assumption, Obligation
from oag.progression.progress import Step, Trace
from oag.table.invariants import with_consequences
from oag.table.start import scene_facts
from oag.table.state import START, State
from oag.task.task import Task, label

# Facts with their values.
Facts = tuple[tuple[Fact, Value], ...]


class Moment(NamedTuple):
    """What one step changed.

    Attributes:
        step: The step.
        changes: The facts that it gave another value, as far as the plan speaks of them.
    """

    step: Step
    changes: Facts

    def __str__(self) -> str:
        said = ", ".join(fact_text(fact, value) for fact, value in self.changes)
        return f"{label(self.step.subtask, self.step.position)} {self.step.primitive.name}: {said or 'no change'}"


@dataclass(frozen=True, slots=True)
class Counterexample:
    """A start state from which a plan fails, and how it gets there.

    Attributes:
        start: The value of every fact that the plan speaks of up to there, and of all that the scene states.
        moments: The steps that still run, in order.
        stops_at: The obligation that fails then.
    """

    start: Facts
    moments: tuple[Moment, ...]
    stops_at: Obligation

    def to_json(self) -> dict[str, object]:
        """Returns the run as JSON values."""
        return {
            "start": [[list(fact), value] for fact, value in self.start],
            "steps": [
                {
                    "step": label(step.subtask, step.position),
                    "primitive": step.primitive.name,
                    "changes": [[list(fact), value] for fact, value in changes],
                }
                for step, changes in self.moments
            ],
            "stops_at": [self.stops_at.kind, self.stops_at.subtask, self.stops_at.step],
        }

    def __str__(self) -> str:
        """Returns the start and what every step changes, a line each."""
        start = ", ".join(fact_text(fact, value) for fact, value in self.start)
        return "\n".join((f"start: {start}", *map(str, self.moments), f"fails: {self.stops_at.place}"))


def counterexample(task: Task, scene: Scene, trace: Trace) -> Counterexample | None:
    """Returns a run on which a plan fails at its first root cause; None when nothing fails.

    What the plan assumes on its way is so in this run; whatever else is unknown and plays a part is false.
    """
    if not trace.failures:
        return None
    number = trace.failures[0].obligation
    stops_at = trace.obligations[number]
    given = given_run(trace, number)
    spoken = dict.fromkeys((NEAR, EEF, HAND))
    spoken |= dict.fromkeys(fact for fact, _ in scene_facts(scene) if ANY not in fact)
    spoken |= dict.fromkeys(fact for _, fact, _ in given)
    for obligation in trace.obligations[: number + 1]:
        spoken |= dict.fromkeys(link.condition.fact for link in obligation.links)

    known = trace.start
    for time, fact, value in given:
        if time == START:
            known = known.after(with_consequences(fact, value))
    state = {fact: _settled(known, fact, False) for fact in spoken if known.value(fact) or len(fact) > 1}
    start = tuple(state.items())
    moments = []
    for count, step in enumerate(trace.steps[: stops_at.time // 2], start=1):
        known = known.after(step.effect, 2 * count)
        for time, fact, value in given:
            if time in (2 * count, 2 * count + 1):
                known = known.after(((fact, value),), time)
        after = {fact: _settled(known, fact, value) for fact, value in state.items()}
        moments.append(Moment(step, tuple(item for item in after.items() if item[1] != state[item[0]])))
        state = after
    return Counterexample(start, tuple(moments), stops_at)


def given_run(trace: Trace, number: int) -> tuple[tuple[int, Fact, Value], ...]:
    """Returns what an exact decision found, else what was assumed up to an obligation, as (time, fact, value).

    The time is that from which on the fact was unknown; 0 for the start.
    """
    if trace.counterexample is not None:
        return trace.counterexample
    return tuple(
        (unknown_since(trace, assumption), assumption.condition.fact, made_true(assumption.condition))
        for assumption in trace.assumptions
        if assumption.obligation <= number and assumption.condition is not None
    )


def unknown_since(trace: Trace, assumption: Assumption) -> int:
    """Returns the time of the step that left open what is assumed; 0 when it was unknown from the start."""
    if assumption.about_start or assumption.condition is None:
        return START
    written = trace.history(assumption.condition.fact)
    return max((entry.time for entry in written if entry.time < assumption.time), default=START)


def _settled(known: State, fact: Fact, otherwise: Value) -> Value:
    """Returns what a fact is known to be; where nothing says so, the other value."""
    value = known.value(fact)
    return otherwise if value is None else value
