"""Looks at a subtask while it runs, and hands an inspector what was measured before and after every step."""

from __future__ import annotations

from collections.abc import Iterator

from bddl import Atom, Formula, conjuncts, format
from executor.primitives.session import Session
from executor.records.rollout import StepRecord, SubtaskRecord
from executor.rollouts.judge import judge, misses
from executor.world.detectors import GRIPPER, read, touching_bodies
from llm.evolution import AttemptSeen, GoalReading, Miss, StartSeen, StepSeen
from oag import Action, Task, flow_from_json

Moment = tuple[tuple[GoalReading, ...], tuple[Miss, ...]]


class StepWatch:
    """Reads the goal before and after every step; it moves nothing.

    Args:
        goal: The subtask's regressed goal.
    """

    def __init__(self, goal: Formula) -> None:
        self._goal = goal
        self._wanted = tuple(part for part in conjuncts(goal) if isinstance(part, Atom))
        self._start: StartSeen | None = None
        self._before: list[Moment] = []
        self._after: list[Moment] = []

    def before(self, session: Session) -> None:
        """Reads the goal when a step is about to run, and before the first one everything else."""
        if self._start is None:
            x_m, y_m, yaw_rad = (float(value) for value in session.control.q[:3])
            self._start = StartSeen(tuple(_facts(session)), (x_m, y_m, yaw_rad))
        self._before.append(self._look(session))

    def after(self, session: Session) -> None:
        """Reads the goal when a step has run."""
        self._after.append(self._look(session))

    def seen(self, task: Task, record: SubtaskRecord) -> AttemptSeen:
        """Returns the attempt, with what was read at its steps.

        Args:
            task: The task as it was run.
            record: What the subtask left behind.
        """
        flow = task.subtasks[record.index].flow or ()
        steps = tuple(
            _step(step, flow_from_json([step.action])[0], asked, before, after)
            for step, asked, before, after in zip(record.steps, flow, self._before, self._after, strict=False)
        )
        return AttemptSeen(task, record.index, flow, steps, record.readings, self._start)

    def _look(self, session: Session) -> Moment:
        readings = judge(self._goal, session.world)
        yaw_rad = float(session.control.q[2])
        return readings, misses(self._wanted, session.world, yaw_rad)


def _facts(session: Session) -> Iterator[str]:
    """Yields what is true of doors and of things that can be moved, as BDDL; what nobody knows of is not named."""
    world, known = session.world, session.believed.assets
    atoms = [Atom("open", (name,)) for name in world.articulated_ids]
    for name in world.dynamic_ids:
        containers = [other for other, asset in known.items() if asset.regions and other != name]
        atoms += [Atom("ontop", (name, other)) for other in touching_bodies(world, name) if other in known]
        atoms += [Atom("inside", (name, other)) for other in containers]
    yield from (format(atom) for atom in atoms if read(atom, world).value)
    if session.hand.held is not None:
        yield format(Atom("inside", (session.hand.held, GRIPPER)))


def _step(step: StepRecord, done: Action, asked: Action, before: Moment, after: Moment) -> StepSeen:
    failure = step.failure
    return StepSeen(
        step=step.step,
        asked=asked,
        done=done,
        measurements=step.measurements,
        failure=failure.kind.value if failure else "",
        message=failure.message if failure else "",
        failure_measurements=failure.measurements if failure else (),
        before=before[0],
        after=after[0],
        misses_before=before[1],
        misses_after=after[1],
    )
