"""Self-evolution: criticise a failed subtask, revise its flow, restore its start, run it again.

Source: the paper's Algorithm 1. Its reset to the subtask's saved initial state is exact here: every attempt starts
from the same checkpoint, so that the flow which succeeds in the end does so again, to the last bit, when run by itself.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from bddl.terminal import pluralize
from executor.records import FailureKind, Listener, SubtaskRecord, ignore
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.evolution_record import AttemptFrames, Evolution, EvolutionInterrupted, SubtaskStory
from executor.rollouts.goals import StepWatch
from executor.rollouts.rollout import USUAL, Run, RunConditions, start_run
from llm.evolve import AttemptObservation, GiveUp, Inspector, MeasuredInspector, SearchSupervisor, Situation, Supervisor
from llm.evolve.diagnosis import diagnose
from oag import ObjectActionGraph, Scene, Task, compose
from oag.revision import Attempt, Hindsight, History, Revision, admissible

MOST_REVISIONS = 5
"""How many revisions a subtask may have, the paper's limit."""


def evolve(
    graph: ObjectActionGraph,
    scene: Scene | None = None,
    seed: int = 0,
    *,
    inspector: Inspector | None = None,
    supervisor: Supervisor | None = None,
    limit: int = MOST_REVISIONS,
    listen: Listener = ignore,
    vary: bool = True,
    frames: AttemptFrames | None = None,
    conditions: RunConditions = USUAL,
) -> Evolution:
    """Execute a task, revise the flows that fail, and return how it evolved.

    Equal scene, flows, seed, inspector and supervisor give an equal story, bit by bit; the two that come with the
    package need no model.

    Args:
        graph: A composed task; it is verified first.
        scene: The nominal scene; the graph's own by default.
        seed: Seeds the scene's variation and all planning.
        inspector: Judges steps; by default from measurements.
        supervisor: Revises flows; by default by a search that measurements guide.
        limit: How many revisions a subtask may have.
        listen: Called when subtasks and steps begin and end, and when a flow is revised.
        vary: Whether the scene is varied by the seed.
        frames: Draws failed attempts, for an inspector or supervisor that looks at pictures.
        conditions: How the episode is executed and recorded.

    Raises:
        TaskError, SceneError: `graph` is no graph, or `scene` no scene.
        SeedError: There are no starts of this seed.
        PlanRefused: `verify` does not prove the plan.
        MissingFlow: A subtask has no flow.
        ValueError: `limit` is negative.
        FaultUnfit, SceneError: The scene has nothing that a fault could be about.
        EvolutionInterrupted: Ctrl-C; carries what was done.
    """
    if limit < 0:
        raise ValueError(f"limit must not be negative, got {limit}")
    inspector, supervisor = inspector or MeasuredInspector(), supervisor or SearchSupervisor()
    run, nominal = start_run(graph, scene, seed, listen, conditions, vary=vary)
    try:
        return EvolutionLoop(run, nominal, inspector, supervisor, limit, frames).run()
    finally:
        run.close()


ROUNDS = 3
"""Requests for one revision before inadmissible answers count as giving up; few, since each may cost a model
reply."""


class EvolutionLoop:
    """One episode's evolution; the scene is the nominal one, in which revisions are judged."""

    def __init__(
        self,
        run: Run,
        scene: Scene,
        inspector: Inspector,
        supervisor: Supervisor,
        limit: int,
        frames: AttemptFrames | None,
    ) -> None:
        self._run, self._scene = run, scene
        self._inspector, self._supervisor, self._frames = inspector, supervisor, frames
        self._measured = MeasuredInspector()
        self._original = run.task
        self._visits = [_Visits(History(index, limit=limit)) for index in range(len(run.task.subtasks))]
        self._starts: list[Checkpoint] = []
        self._samples: list[int] = []

    def run(self) -> Evolution:
        """Return the finished evolution.

        Raises:
            EvolutionInterrupted: Ctrl-C; carries what was done.
        """
        try:
            self._starts, self._samples = [self._run.begin()], [self._run.recorder.samples]
            index: int | None = 0
            while index is not None and index < len(self._visits):
                index = self._attempt(index)
        except KeyboardInterrupt as interrupt:
            raise EvolutionInterrupted(self._result()) from interrupt
        return self._result()

    def _result(self) -> Evolution:
        stories = (
            SubtaskStory(visits.history, tuple(visits.records), visits.gave_up, tuple(visits.observations))
            for visits in self._visits
            if visits.records
        )
        return Evolution(self._original, self._run.finish(), tuple(stories), self._run.faults)

    def _attempt(self, index: int) -> int | None:
        """Run a subtask once, and return which subtask is next; None when there is nothing more to try."""
        run, visits, start = self._run, self._visits[index], self._starts[index]
        run.recorder.rewind(self._samples[index], start.state_hash)
        del run.subtasks[index:], self._starts[index + 1 :], self._samples[index + 1 :]
        watch = StepWatch(run.goals[index])
        record, after = run.subtask(index, start, watch)
        run.subtasks.append(record)
        observation = watch.observation(run.task, record)
        if self._frames is not None:
            observation = self._frames.attach(observation, record, run.recorder.trajectory(), run.scene)
        visits.records.append(record)
        visits.observations.append(observation)
        attempt = self._judged(record, observation, start)
        if attempt.succeeded:
            visits.history = visits.history.add(attempt)
            self._starts.append(after)
            self._samples.append(run.recorder.samples)
            return index + 1
        answer = self._ask(index, attempt, observation)
        if isinstance(answer, GiveUp):
            visits.history, visits.gave_up = visits.history.add(attempt), answer
            return None
        visits.history = visits.history.add(attempt, answer)
        return self._adopt(index, attempt, answer)

    def _judged(self, record: SubtaskRecord, observation: AttemptObservation, start: Checkpoint) -> Attempt:
        """Return the record of one execution.

        A success is judged by its measurements alone: a later failure may have its cause in it.
        """
        failure = record.failure
        inspector = self._measured if record.succeeded else self._inspector
        unfinished = failure is not None and failure.kind is not FailureKind.GOAL_NOT_REACHED
        attempt = Attempt(
            flow=observation.flow,
            outcome="succeeded" if record.succeeded else "failed",
            critiques=tuple(inspector.inspect(observation, step) for step in range(len(observation.steps))),
            filled=record.flow,
            seed=self._run.seed,
            state_hash=record.state_hash,
            start=start.state_hash,
        )
        if record.succeeded:
            return attempt
        return replace(
            attempt,
            failed_step=len(record.steps) - 1 if unfinished else None,
            failure=(failure.kind if failure else FailureKind.GOAL_NOT_REACHED).value,
            message=failure.message if failure else "the goal does not hold",
        )

    def _ask(self, index: int, attempt: Attempt, observation: AttemptObservation) -> Revision | GiveUp:
        """Return an admissible revision, or why there is none; nothing else is ever run."""
        history = self._visits[index].history
        if history.exhausted:
            cause = diagnose(attempt)
            return GiveUp(
                f"{history.limit_reached}; the last attempt: {attempt.message}",
                "" if cause is None else cause.kind.value,
            )
        earlier = tuple(visits.history for visits in self._visits[:index])
        objections: list[str] = []
        for _ in range(ROUNDS):
            situation = Situation(
                self._run.task,
                index,
                self._scene,
                attempt,
                history,
                tuple(objections),
                earlier,
                observation=observation,
            )
            answer = self._supervisor.revise(situation)
            objection = None if isinstance(answer, GiveUp) else self._objection(index, attempt, answer)
            if objection is None:
                return replace(answer, refused=(*objections, *answer.refused))
            objections.append(objection)
        reason = f"{ROUNDS} revisions were not admissible; the last one: {objections[-1]}"
        return GiveUp(reason, refused=tuple(objections))

    def _objection(self, index: int, attempt: Attempt, answer: Revision) -> str | None:
        """Return why an answer may not run, or None."""
        blamed = index if answer.subtask is None else answer.subtask
        if blamed > index:
            return f"T{blamed + 1} comes after T{index + 1}, which failed; only an earlier subtask can be to blame"
        history = self._visits[blamed].history
        if blamed < index:
            attempt, history = history.reopened(_hindsight(index, attempt))
        if history.exhausted:
            return f"T{blamed + 1} was revised {pluralize(history.limit, 'time')}, and that is the limit"
        admission = admissible(self._run.task, blamed, answer.flow, scene=self._scene, history=history.add(attempt))
        if not admission:
            return str(admission)
        return None if admission.report else str(admission.report)

    def _adopt(self, index: int, attempt: Attempt, answer: Revision) -> int:
        """Make a revised flow the next one to run, and return the index of its subtask."""
        blamed = index if answer.subtask is None else answer.subtask
        if blamed < index:
            for visits in self._visits[blamed + 1 : index]:
                visits.history = visits.history.superseded(answer)
            early, before = self._visits[blamed].history.reopened(_hindsight(index, attempt))
            self._visits[blamed].history = before.add(_blamed(early, answer), answer)
        self._run.change(compose(with_flow(self._run.task, blamed, answer), scene=self._scene))
        self._run.tell_revision(blamed, self._starts[blamed], answer.explanation)
        return blamed


@dataclass(slots=True)
class _Visits:
    """Everything that was tried for one subtask."""

    history: History
    records: list[SubtaskRecord] = field(default_factory=list)
    observations: list[AttemptObservation] = field(default_factory=list)
    gave_up: GiveUp | None = None


def with_flow(task: Task, index: int, revision: Revision) -> Task:
    """Return the task with a revision's flow in one subtask."""
    subtask = replace(task.subtasks[index], flow=revision.flow)
    return replace(task, subtasks=(*task.subtasks[:index], subtask, *task.subtasks[index + 1 :]))


def _hindsight(later: int, attempt: Attempt) -> Hindsight:
    return Hindsight(later, attempt.failure, attempt.message)


def _blamed(attempt: Attempt, revision: Revision) -> Attempt:
    """Return an attempt whose critique names the step that is to blame."""
    critiques = (
        replace(critique, state_reached=False, text=f"{critique.text} In hindsight: {revision.cause}.")
        if critique.step == revision.cause_step
        else critique
        for critique in attempt.critiques
    )
    return replace(attempt, critiques=tuple(critiques))
