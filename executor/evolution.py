"""Self-evolution: a failed subtask is criticised, its flow revised, its start restored, and run again.

Source: the paper's Algorithm 1. Its reset to the subtask's saved initial state is exact here: every attempt starts
from the same checkpoint, so that the flow which succeeds in the end does so again, to the last bit, when run by itself.
"""

from __future__ import annotations

from dataclasses import replace

from executor.checkpoint import Checkpoint
from executor.events import Event, Listener, ignore
from executor.evolution_record import Evolution, SubtaskStory
from executor.execution import RECORD_HZ, Run
from executor.faults import Fault
from executor.observe import StepWatch
from executor.records import SubtaskRecord
from executor.scenes.vary import vary as vary_scene
from llm.evolution import GiveUp, Inspector, MeasuredInspector, SearchSupervisor, Situation, Supervisor
from oag import Attempt, History, ObjectActionGraph, Revision, Scene, admissible, compose

MOST_REVISIONS = 5
ROUNDS = 3
"""How often a supervisor is asked for one revision before its inadmissible answers count as giving up."""


def evolve(
    graph: ObjectActionGraph,
    scene: Scene | None = None,
    seed: int = 0,
    *,
    inspector: Inspector | None = None,
    supervisor: Supervisor | None = None,
    limit: int = MOST_REVISIONS,
    listen: Listener = ignore,
    record_hz: float = RECORD_HZ,
    vary: bool = True,
    faults: tuple[Fault, ...] = (),
) -> Evolution:
    """Returns what became of a task whose failing flows were revised.

    Equal scene, flows, seed, inspector and supervisor give an equal story, bit by bit; the two that come with the
    package need no model.

    Args:
        graph: A composed task; it is verified first.
        scene: The nominal scene; the graph's own by default.
        seed: Seeds the scene's variation and all planning.
        inspector: Judges steps; by default from measurements.
        supervisor: Revises flows; by default by a search that measurements guide.
        limit: How many revisions a subtask may have.
        listen: Told when subtasks and steps begin and end, and when a flow is revised.
        record_hz: Samples a second.
        vary: Whether the scene is varied by the seed.
        faults: What is wrong on purpose, in experiments.

    Raises:
        PlanRefused: `verify` does not prove the plan.
        MissingFlow: A subtask has no flow.
        ValueError: `limit` is negative.
    """
    if limit < 0:
        raise ValueError(f"limit must not be negative, got {limit}")
    nominal = scene or graph.scene
    concrete = nominal.with_scales(graph.task.scales)
    if vary:
        concrete = vary_scene(concrete, seed)
    run = Run(graph, concrete, seed, listen, record_hz, faults)
    loop = _Loop(run, nominal, inspector or MeasuredInspector(), supervisor or SearchSupervisor(), limit)
    try:
        return loop.run()
    finally:
        run.close()


class _Loop:
    def __init__(self, run: Run, scene: Scene, inspector: Inspector, supervisor: Supervisor, limit: int) -> None:
        self._run, self._scene, self._limit = run, scene, limit
        self._inspector, self._supervisor = inspector, supervisor
        self._original = run.task

    def run(self) -> Evolution:
        stories: list[SubtaskStory] = []
        checkpoint = self._run.begin()
        for index in range(len(self._original.subtasks)):
            story, checkpoint = self._evolve(index, checkpoint)
            stories.append(story)
            self._run.subtasks.append(story.records[-1])
            if not story.solved:
                break
        return Evolution(self._original, self._run.finish(), tuple(stories))

    def _evolve(self, index: int, start: Checkpoint) -> tuple[SubtaskStory, Checkpoint]:
        run = self._run
        samples = run.recorder.samples
        history = History(index, limit=self._limit)
        records: list[SubtaskRecord] = []
        while True:
            run.recorder.rewind(samples, start.state_hash)
            watch = StepWatch(run.goals[index])
            record, after = run.subtask(index, start, watch)
            records.append(record)
            attempt = self._attempt(record, watch)
            answer = None if attempt.succeeded else self._ask(index, attempt, history)
            if not isinstance(answer, Revision):
                return SubtaskStory(history.add(attempt), tuple(records), answer), after
            history = history.add(attempt, answer)
            self._adopt(index, answer)

    def _attempt(self, record: SubtaskRecord, watch: StepWatch) -> Attempt:
        """Returns the record of one execution, criticised when it failed."""
        flow = self._run.task.subtasks[record.index].flow or ()
        failure = record.failure
        if record.succeeded:
            return Attempt(flow, "succeeded", filled=record.flow, seed=self._run.seed, state_hash=record.state_hash)
        seen = watch.seen(self._run.task, record)
        critiques = tuple(self._inspector.inspect(seen, step) for step in range(len(seen.steps)))
        unfinished = failure is not None and failure.kind.value != "goal-not-reached"
        return Attempt(
            flow=flow,
            outcome="failed",
            failed_step=len(record.steps) - 1 if unfinished else None,
            failure=failure.kind.value if failure else "goal-not-reached",
            message=failure.message if failure else "the goal does not hold",
            critiques=critiques,
            filled=record.flow,
            seed=self._run.seed,
            state_hash=record.state_hash,
        )

    def _ask(self, index: int, attempt: Attempt, history: History) -> Revision | GiveUp:
        """Returns an admissible revision, or why there is none; nothing else is ever run."""
        if history.exhausted:
            return GiveUp(
                f"{history.limit} revisions were tried, and that is the limit; the last attempt: {attempt.message}"
            )
        objections: list[str] = []
        for _ in range(ROUNDS):
            situation = Situation(self._run.task, index, self._scene, attempt, history, tuple(objections))
            answer = self._supervisor.revise(situation)
            if isinstance(answer, GiveUp):
                return answer
            admission = admissible(self._run.task, index, answer.flow, scene=self._scene, history=history.add(attempt))
            if admission and admission.report:
                return answer
            objections.append(str(admission) if not admission else str(admission.report))
        return GiveUp(f"{ROUNDS} revisions were not admissible; the last one: {objections[-1]}")

    def _adopt(self, index: int, revision: Revision) -> None:
        task = self._run.task
        subtask = replace(task.subtasks[index], flow=revision.flow)
        revised = replace(task, subtasks=(*task.subtasks[:index], subtask, *task.subtasks[index + 1 :]))
        self._run.change(compose(revised, scene=self._scene))
        count = len(task.subtasks)
        self._run.listen(Event("revision", index, count, -1, subtask.name, self._run.simulated_s, revision.explanation))
