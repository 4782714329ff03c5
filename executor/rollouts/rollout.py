"""Execute a task's plan by physics: subtask by subtask, each from an exact checkpoint.

A subtask that finds no place for a held item is preceded by another grasp (`executor.rollouts.repairs`). The graph
verifies the plan again before it runs.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from bddl import Formula
from executor.planning.choices import Choice
from executor.planning.collision import CollisionOracle
from executor.planning.planner import Planner
from executor.planning.whereabouts import read_where
from executor.records import (
    Detour,
    Event,
    Failure,
    Listener,
    PlanRefused,
    Rollout,
    RolloutInterrupted,
    SceneFix,
    StepRecord,
    SubtaskRecord,
    ignore,
    require_flows,
)
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.goals import StepWatch, as_failure, judge, judge_at_rest
from executor.rollouts.recording import TrajectoryRecorder, summarize_peaks
from executor.rollouts.repairs import MORE, Ways, found_no_place, regrasps
from executor.scenes.vary import check_seed
from executor.scenes.vary import vary as vary_scene
from executor.sim.belief import believed_scene, true_scene
from executor.sim.detectors import summarize_overlaps
from executor.sim.engine import STANDARD, Physics
from executor.sim.faults import Fault
from executor.sim.world import World
from executor.skills.control import Bystanders, Controller, settle_to_rest
from executor.skills.library import Runner, bounded, require_skills, skill_of
from executor.skills.session import Session
from executor.skills.trajectories import NO_NOISE, CommandNoise
from oag import ObjectActionGraph, Primitive, Scene, Task, TaskError, compose
from oag.measurements import GoalReading
from oag.model.actions import flow_from_json
from oag.model.codec import shown
from oag.task_definition import required_scene

BOUNDARY_SETTLE_S = 0.5  # Released items come to rest.
GOAL_HOLDS_S = 1.0  # A goal has to hold for this long.
RECORD_HZ = 10.0  # Usual in data sets of demonstrations.


@dataclass(frozen=True, slots=True)
class RunConditions:
    """How an episode is executed and recorded.

    Attributes:
        record_hz: Samples a second [Hz].
        faults: Deliberate faults, in experiments.
        physics: Settings that an experiment changes.
        noise: Noise in the drive commands.
        stances: How many are planned wherever one is chosen (`Session.stances`).
        avoided: Joints that are not to be opened, as a dry run found (`Feasibility.conditions`).
        detours: Insertions that the plan has already.
        kept: Of each subtask, what the dry run chose for its steps.
        scene_fixes: Changes of the scene, for the record.
    """

    record_hz: float = RECORD_HZ
    faults: tuple[Fault, ...] = ()
    physics: Physics = STANDARD
    noise: CommandNoise = NO_NOISE
    stances: int = 1
    avoided: Ways = frozenset()
    detours: tuple[Detour, ...] = ()
    kept: tuple[tuple[Choice, ...], ...] = ()
    scene_fixes: tuple[SceneFix, ...] = ()


USUAL = RunConditions()


class Run:
    """One episode in progress: its subtasks can be run one by one, and again, from their checkpoints.

    Args:
        graph: A composed task; it is verified first.
        listen: Called when subtasks and steps begin and end.

    Attributes:
        task: The task as it is run; `change` replaces it.
        goals: The subtasks' regressed goals.
        subtasks: Records of the finished subtasks.
        detours: Insertions into the plan so far.
        after: The checkpoint after the last finished subtask.
        skills: The function that runs each of the 21 primitives where it is not the robot's own.

    Raises:
        PlanRefused: `verify` does not prove the plan.
        MissingFlow: A subtask has no flow.
        MissingSkill: A primitive of an own domain has no skill.
    """

    skills: Mapping[Primitive, Runner] = MappingProxyType({})

    def __init__(
        self,
        graph: ObjectActionGraph,
        scene: Scene,
        seed: int,
        listen: Listener = ignore,
        conditions: RunConditions = USUAL,
    ) -> None:
        self.record_hz, self.faults = conditions.record_hz, conditions.faults
        self.physics, self.noise, self.stances = conditions.physics, conditions.noise, conditions.stances
        self.scene, self.seed, self.listen = scene, seed, listen
        self._graph: ObjectActionGraph
        self.task: Task
        self.goals: tuple[Formula, ...]
        self.change(graph)
        self.began = time.perf_counter()
        self.oracle_world = World(believed_scene(scene, self.faults), oracle=True)
        self.planner = Planner(CollisionOracle(self.oracle_world))
        self.recorder = TrajectoryRecorder(self.planner.kinematics, self.record_hz)
        self.subtasks: list[SubtaskRecord] = []
        self.avoided, self.detours, self.kept = conditions.avoided, conditions.detours, conditions.kept
        self._scene_fixes = conditions.scene_fixes
        self.goal_readings: tuple[GoalReading, ...] = ()
        self.planning_s = 0.0
        self.simulated_s = 0.0
        self.after: Checkpoint
        self.setup_s = time.perf_counter() - self.began

    def change(self, graph: ObjectActionGraph) -> None:
        """Go on with another task, such as one with a revised flow.

        Raises:
            PlanRefused: `verify` does not prove the plan; nothing is changed.
            MissingFlow: A subtask has no flow.
        """
        require_flows(graph.task)
        require_skills(graph.task)
        report = graph.verify()
        if not report:
            raise PlanRefused(report)
        self._graph, self.task, self.goals = graph, graph.task, report.regressed_goals

    def from_start(self) -> Rollout:
        """Return the rollout of all subtasks."""
        return self.from_checkpoint(self.begin(), 0)

    def begin(self) -> Checkpoint:
        """Return the checkpoint of the first subtask."""
        return Checkpoint.at_start(self.scene, self.faults, self.physics)

    def from_checkpoint(
        self, checkpoint: Checkpoint, first: int, *, first_step: int = 0, last: int | None = None
    ) -> Rollout:
        """Return the rollout from a subtask's checkpoint on.

        Args:
            checkpoint: Where the first subtask begins.
            first_step: Index of the step in its flow that it begins with.
            last: Index of the subtask before which it ends; by default it goes to the end.
        """
        self.recorder.state_hash = checkpoint.state_hash
        # Counted from the plan's end, since subtasks may be inserted on the way.
        not_run = 0 if last is None else len(self.task.subtasks) - last
        try:
            index = first
            while index < len(self.task.subtasks) - not_run:
                samples = self.recorder.samples
                record, after = self.subtask(index, checkpoint, first_step=first_step if index == first else 0)
                if found_no_place(record, self.task.subtasks[index], checkpoint.held):
                    done = self._regrasped(index, checkpoint, samples)
                    *before, (record, after) = done or [(record, after)]
                    self.subtasks += [earlier for earlier, _ in before]
                self.subtasks.append(record)
                index, checkpoint = len(self.subtasks), after
                self.after = after
                if not record.succeeded:
                    break
        except KeyboardInterrupt as interrupt:
            raise RolloutInterrupted(self.finish()) from interrupt
        finally:
            self.close()
        return self.finish()

    def _regrasped(self, index: int, start: Checkpoint, samples: int) -> list[tuple[SubtaskRecord, Checkpoint]] | None:
        """Set the held item down and take it again first; return what was done, or None with all as it was."""
        as_it_was, detours, simulated_s = self._graph, self.detours, self.simulated_s
        item, failed = self.task.subtasks[index].target, self.recorder.recorded()
        for support, task in regrasps(self.task, index, self.scene):
            try:
                self.change(compose(task, scene=as_it_was.scene))
            except PlanRefused:
                continue
            self.recorder.rewind(samples, start.state_hash)
            self.kept = ()  # Of another plan.
            reason = f"no place can be got to with this grasp: {item} is taken again from {support}"
            later = (replace(one, first=one.first + MORE) if one.first >= index else one for one in detours)
            self.detours = tuple(sorted((*later, Detour(index, MORE, reason)), key=lambda one: one.first))
            self.tell_revision(index + MORE, start, reason)
            done: list[tuple[SubtaskRecord, Checkpoint]] = []
            for added in range(MORE + 1):
                done.append(self.subtask(index + added, done[-1][1] if done else start))
                if not done[-1][0].succeeded:
                    break
            else:
                return done
        if self._graph is not as_it_was:
            self.change(as_it_was)
            self.detours, self.simulated_s = detours, simulated_s
            self.recorder.restore(failed)
            self.tell_revision(
                index, start, f"{item} was taken again in vain: the plan and its failure stay as they were"
            )
        return None

    def tell_revision(self, index: int, start: Checkpoint, reason: str) -> None:
        """Notify the listener that the plan was revised, and that the run goes back to a subtask's start.

        Args:
            index: Index of the subtask that was revised, or before which others were inserted.
            start: The checkpoint from which the run goes on.
            reason: Why, as a clause.
        """
        back_to_s = start.steps * self.physics.timestep_s
        count, name = len(self.task.subtasks), self.task.subtasks[index].name
        self.listen(Event("revision", index, count, -1, name, back_to_s, reason))

    def close(self) -> None:
        """Release the simulator's objects; subtasks cannot be run afterwards."""
        self.oracle_world.close()

    def subtask(
        self, index: int, start: Checkpoint, watch: StepWatch | None = None, *, first_step: int = 0
    ) -> tuple[SubtaskRecord, Checkpoint]:
        """Run one subtask from a checkpoint, and return its record and the checkpoint after it.

        The same checkpoint and the same flow give the same states, bit by bit, however often. Steps before
        `first_step` are skipped: the checkpoint is what they would have led to.
        """
        last = index + 1 == len(self.task.subtasks)
        subtask = self.task.subtasks[index]
        noise = self.noise.of_subtask(self.scene.robot.model, index, self.physics.timestep_s)
        world, control = start.restore(self.scene, self.recorder.after_step, self.faults, self.physics, noise)
        self.recorder.world, self.recorder.control, self.recorder.subtask = world, control, index
        # The engine finds contacts by stepping, and a restored world has none: one step, so that planning sees them.
        control.settle(world.timestep_s)
        session = self.session(index, start, world, control)
        self.planner.start_subtask(session.believed, self.seed, index)
        self._tell("subtask-start", index, -1, subtask.name, world)
        steps: list[StepRecord] = []
        bystanders = Bystanders(world, subtask.target)
        try:
            for number in range(first_step, len(session.flow)):
                session, record = self._step(replace(session, step=number), index, bystanders, watch)
                steps.append(record)
                if steps[-1].failure is not None:
                    break
            self.recorder.step = -1
            settle_to_rest(control, GOAL_HOLDS_S if last else BOUNDARY_SETTLE_S)
            readings = (judge_at_rest if last else judge)(self.goals[index], world) + read_where(subtask, world)
            failure = steps[-1].failure if steps else None
            if failure is None and (failure := as_failure(readings, subtask.name)) is not None and steps:
                steps[-1] = replace(steps[-1], failure=failure)
            if last and failure is None:
                self.goal_readings = judge_at_rest(self.task.goal, world)
            moved_m = bystanders.moved_m()
            after = Checkpoint.of(world, control, session.hand, self.recorder.state_hash)
            self._tell("subtask-end", index, -1, subtask.name, world, failure.message if failure else "")
        finally:
            self.simulated_s = world.time_s
            self.recorder.world = None
            world.close()
        done_now = flow_from_json([step.action for step in steps], self.scene.domain)
        filled = (*session.flow[:first_step], *done_now, *session.flow[first_step + len(steps) :])
        done = SubtaskRecord(
            index=index,
            name=subtask.name,
            flow=filled,
            steps=tuple(steps),
            readings=readings,
            state_hash=self.recorder.state_hash,
            checkpoint=start.to_bytes(),
            moved_m=moved_m,
            commands=tuple(control.command_log),
        )
        return done, after

    def session(self, index: int, start: Checkpoint, world: World, control: Controller) -> Session:
        """Return the execution state of a subtask at its start, in a world restored from its checkpoint."""
        subtask = self.task.subtasks[index]
        return Session(
            world,
            control,
            self.planner,
            subtask,
            flow=subtask.flow or (),
            later=self.task.subtasks[index + 1 :],
            faults=self.faults,
            hand=start.hand,
            handled=frozenset(earlier.target for earlier in self.task.subtasks[:index]),
            stances=self.stances,
            avoided=self.avoided,
            kept=self.kept[index] if index < len(self.kept) else (),
        )

    def _step(
        self, session: Session, index: int, bystanders: Bystanders, watch: StepWatch | None
    ) -> tuple[Session, StepRecord]:
        number = self.recorder.step = session.step
        action = session.flow[number]
        name = action.primitive.name
        self._tell("step-start", index, number, name, session.world)
        if watch is not None:
            watch.before(session)
        wall, simulated = time.perf_counter(), session.world.time_s
        moved_before = session.control.moving_wall_s
        session.control.start_primitive()
        outcome = bounded(self.skills.get(action.primitive) or skill_of(action.primitive), session, action)
        planning_s = time.perf_counter() - wall - (session.control.moving_wall_s - moved_before)
        self.planning_s += planning_s
        failure = outcome.failure or bystanders.check()
        message = failure.message if failure else ""
        self._tell("step-end", index, number, name, session.world, message)
        record = StepRecord(
            subtask=index,
            step=number,
            primitive=name,
            action=outcome.action.to_json(),
            start_s=simulated,
            end_s=session.world.time_s,
            planning_wall_s=planning_s,
            measurements=outcome.measurements,
            failure=failure,
        )
        if watch is not None:
            watch.after(outcome.session)
        return outcome.session, record

    def _tell(self, kind: str, subtask: int, step: int, name: str, world: World, message: str = "") -> None:
        count = len(self.task.subtasks)
        self.listen(Event(kind, subtask, count, step, name, world.time_s, message))  # type: ignore[arg-type]

    def finish(self) -> Rollout:
        """Return the rollout of what was done so far."""
        total_s = time.perf_counter() - self.began
        return Rollout(
            task=self.task,
            scene=self.scene,
            seed=self.seed,
            record_hz=self.record_hz,
            subtasks=tuple(self.subtasks),
            goal_readings=self.goal_readings,
            trajectory=self.recorder.trajectory(),
            state_hash=self.recorder.state_hash,
            simulated_s=self.simulated_s,
            planning_wall_s=self.planning_s + self.setup_s,
            simulation_wall_s=total_s - self.planning_s - self.setup_s,
            penetration=summarize_overlaps(self.recorder.overlaps),
            peaks=summarize_peaks(self.recorder.peaks),
            detours=self.detours,
            scene_fixes=self._scene_fixes,
        )


def require_graph(graph: object) -> ObjectActionGraph:
    """Return `graph` if it is an object-action graph.

    Raises:
        TaskError: It is none, but a task, for example.
    """
    if isinstance(graph, ObjectActionGraph):
        return graph
    hint = "oag.compose(task, scene) makes one of a task"
    raise TaskError(f"expected an object-action graph, got {shown(graph)}", source="(argument)", hint=hint)


def rollout(
    graph: ObjectActionGraph,
    scene: Scene | None = None,
    seed: int = 0,
    *,
    listen: Listener = ignore,
    vary: bool = True,
    conditions: RunConditions = USUAL,
) -> Rollout:
    """Execute a task's flows by physics and return the record.

    Equal scene, flow and seed give equal states, bit by bit, in any process.

    Args:
        graph: A composed task; it is verified first.
        scene: The nominal scene; the graph's own by default.
        seed: Seeds the scene's variation and all planning.
        listen: Called when subtasks and steps begin and end.
        vary: Whether the scene is varied by the seed.
        conditions: How the episode is executed and recorded.

    Raises:
        TaskError, SceneError: `graph` is no graph, or `scene` no scene.
        SeedError: There are no starts of this seed.
        PlanRefused: `verify` does not prove the plan.
        MissingFlow: A subtask has no flow.
        RolloutInterrupted: Ctrl-C; carries the finished part.
    """
    run, _ = start_run(graph, scene, seed, listen, conditions, vary=vary)
    return run.from_start()


def start_run(
    graph: ObjectActionGraph,
    scene: Scene | None,
    seed: int,
    listen: Listener,
    conditions: RunConditions,
    *,
    vary: bool,
) -> tuple[Run, Scene]:
    """Return an episode before its first subtask, and its nominal scene; for the arguments see `rollout`."""
    graph, seed = require_graph(graph), check_seed(seed)
    nominal = graph.scene if scene is None else required_scene(scene)
    concrete = nominal.with_scales(graph.task.scales)
    if vary:
        concrete = vary_scene(concrete, seed)
    concrete = true_scene(concrete, conditions.faults)
    return Run(graph, concrete, seed, listen, conditions), nominal


def resume(graph: ObjectActionGraph, earlier: Rollout, subtask: int, *, listen: Listener = ignore) -> Rollout:
    """Return the rollout that goes on from an earlier one's checkpoint; its last hash is equal to the earlier one's.

    The subtasks before are taken over unchanged; the trajectory has the resumed part alone.

    Args:
        earlier: The earlier rollout, made with the default settings of `rollout`.
        subtask: Index of the subtask to start with.
        listen: As for `rollout`.

    Raises:
        TaskError: `graph` is no graph.
        IndexError: The earlier rollout did not get to that subtask.
        CheckpointError: Its checkpoint cannot be read.
    """
    graph = require_graph(graph)
    if not 0 <= subtask < len(earlier.subtasks):
        raise IndexError(f"subtask {subtask} is not among the {len(earlier.subtasks)} recorded ones")
    checkpoint = Checkpoint.from_bytes(earlier.subtasks[subtask].checkpoint)
    run = Run(graph, earlier.scene, earlier.seed, listen, RunConditions(earlier.record_hz))
    run.subtasks = list(earlier.subtasks[:subtask])
    if [one.name for one in graph.task.subtasks] == [one.name for one in earlier.task.subtasks]:
        run.detours = earlier.detours
    return run.from_checkpoint(checkpoint, subtask)


def failure_of(rollout: Rollout) -> Failure | None:
    """Return what ended a rollout: a step's failure, or what the task goal still lacks."""
    return rollout.failure or as_failure(rollout.goal_readings, rollout.task.name)
