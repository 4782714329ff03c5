"""Feasibility of a proved plan: all of it is gone through by geometry before anything moves.

The primitives run as they do in a rollout, on a world without dynamics (`executor.skills.dry_run`). So each subtask is
planned in the state that it will find: doors where they were moved to, things where they were put, the hand holding
what it took. What no stance, grasp, place or way is found for ends the dry run with the reason. Feasible is less than
succeeded: slips, stalls and whatever else takes forces are for the physics to decide.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from bddl import Atom, atoms
from executor.assets.asset_geometry import resting_top
from executor.geometry import Array, inverse, transform
from executor.planning.choices import Choice
from executor.planning.collision import CollisionOracle
from executor.planning.planner import Planner
from executor.planning.whereabouts import read_where
from executor.records import (
    Detour,
    Event,
    Failure,
    FailureKind,
    Listener,
    PlanRefused,
    StepRecord,
    SubtaskRecord,
    ignore,
    require_flows,
)
from executor.rollouts.capacity import first_misfit
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.goals import LEANS_DEG, as_failure, judge, judge_at_rest
from executor.rollouts.repairs import Failed, Ways, impossible, repairs
from executor.rollouts.rollout import USUAL, RunConditions, require_graph
from executor.scenes.vary import check_seed
from executor.scenes.vary import vary as vary_scene
from executor.sim.world import World
from executor.skills.control import Bystanders
from executor.skills.dry_run import DryController, DryState, DryWorld, at_rest_within
from executor.skills.library import MOST_EFFORT_S, bounded, require_skills, skill_of
from executor.skills.session import Hand, Session
from oag import ObjectActionGraph, Scene, SimpleTask, Task, compose
from oag.measurements import SupportDrive, TargetDrive, Unplanned, first_of
from oag.model.actions import flow_from_json
from oag.model.infeasible import Infeasible
from oag.planning import repair as plan_again
from oag.sizes import Sizing
from oag.task_definition import required_scene

MOST_PLANS = 3
"""How many other plans for the same goal are gone through, until they took as much effort as one primitive may."""

OFF_M = ((0.0, 0.0, 0.0), (0.004, 0.0, 0.0), (-0.002, 0.0035, 0.0), (-0.002, -0.0035, 0.0))
"""How far beside its place a thing is let go of: from all of these it has to stay in a bowl or box."""

SPARE_DEG, SPARE_M = 15.0, 0.002
"""How far from what a goal allows a thing has to end there: the opening fingers turn what they let go of."""

MOST_FORECAST_S = 15.0
"""Effort at which a forecast ends, its repairs and other plans included [s]; what has no answer by then has none."""

PATIENCE_S = 3.0
"""Effort after which what is in the way of a thing is first moved aside; all of the search comes after that [s]."""

MOST_REPAIRS = 4
"""How many repaired plans are gone through; together they may take as much effort as one primitive."""

Start = tuple[DryState, Hand]
"""What a subtask starts from."""


@dataclass(frozen=True, slots=True)
class FeasibleSubtask:
    """What was planned for a subtask.

    Attributes:
        record: The steps with their numbers and measurements, as of a rollout; no time passes in them.
        base: Where the base stood last to take or to put something: x, y [m] and heading [deg]; None where it stayed.
        margin_deg: The smallest distance of an arm joint to its limit in the stances and placements.
        region: Name of the region that the thing was put into or onto.
        cpu_s: CPU time of the dry run of the subtask.
        choices: Stances and places, for a rollout to keep.
    """

    record: SubtaskRecord
    base: tuple[float, float, float] | None
    margin_deg: float | None
    region: str | None
    cpu_s: float
    choices: tuple[Choice, ...] = ()

    def __str__(self) -> str:
        where = "" if self.base is None else "from ({:.2f}, {:.2f}) m at {:.0f} deg".format(*self.base)
        margin = "" if self.margin_deg is None else f"joints at least {self.margin_deg:.0f} deg off their limits"
        words = ", ".join(part for part in (where, f"into {self.region}" if self.region else "", margin) if part)
        return f"{self.record.name}: {words}" if words else self.record.name

    def to_json(self) -> dict[str, Any]:
        """Return the subtask's choices as plain data."""
        return {
            "name": self.record.name,
            "feasible": self.record.succeeded,
            "flow": [step.action for step in self.record.steps],
            "base": None if self.base is None else list(self.base),
            "margin_deg": self.margin_deg,
            "region": self.region,
            "cpu_s": round(self.cpu_s, 3),
        }


@dataclass(frozen=True, slots=True)
class Feasibility:
    """Whether a plan can be done, by geometry.

    Attributes:
        task: The plan that was gone through: the given one, or a repaired one; to be run with `conditions`.
        subtasks: Those that were gone through; the last one failed where the plan is not feasible.
        failure: Why the plan is not feasible, or None.
        primitive: Name of the step that failed; "" where a goal did not hold, or nothing failed.
        detours: Repairs of the plan.
        cpu_s: CPU time of the dry run.
        avoided: Joints that are not to be opened: behind them there is no place.
        known: What was found impossible, for `scene.knowing`, by which a revised plan is judged.
        effort_s: Effort of all plans that were gone through (`executor.system.effort`).
    """

    task: Task
    subtasks: tuple[FeasibleSubtask, ...]
    failure: Failure | None
    primitive: str
    detours: tuple[Detour, ...]
    cpu_s: float
    avoided: Ways = frozenset()
    known: tuple[Infeasible, ...] = ()
    effort_s: float = 0.0

    def conditions(self, usual: RunConditions = USUAL) -> RunConditions:
        """Return the conditions under which a rollout of the plan makes the same choices."""
        kept = tuple(subtask.choices for subtask in self.subtasks)
        return replace(usual, avoided=self.avoided, detours=self.detours, kept=kept)

    @property
    def feasible(self) -> bool:
        """Whether nothing speaks against the plan."""
        return self.failure is None

    @property
    def decided(self) -> bool:
        """Whether there is an answer: a search that ran out of its time says neither yes nor no."""
        return self.failure is None or self.failure.kind is not FailureKind.NO_ANSWER

    @property
    def in_the_way(self) -> tuple[str, ...]:
        """Bodies that are named as obstacles, the most frequent one first."""
        found = first_of(self.failure.measurements, Unplanned) if self.failure is not None else None
        return tuple(found.in_the_way or ()) if found is not None else ()

    @property
    def reason(self) -> str:
        """Why the plan is not feasible, or has no answer, in a sentence with the subtask's name; empty where it is."""
        if self.failure is None:
            return ""
        if not self.primitive:
            return self.failure.message
        return f"{self.subtasks[-1].record.name} ({self.primitive}): {self.failure.message}"

    def __bool__(self) -> bool:
        return self.feasible

    def to_json(self) -> dict[str, Any]:
        """Return the verdict with its numbers as plain data."""
        return {
            "feasible": self.feasible if self.decided else None,
            "cpu_s": round(self.cpu_s, 3),
            "failed": self.subtasks[-1].record.name if self.failure is not None else None,
            "primitive": self.primitive or None,
            "failure": None if self.failure is None else self.failure.to_json(),
            "in_the_way": list(self.in_the_way),
            "detours": [asdict(detour) for detour in self.detours],
            "plan": self.task.to_json() if self.detours else None,
            "avoided": sorted(map(list, self.avoided)),
            "known": [each.to_json() for each in self.known],
            "subtasks": [subtask.to_json() for subtask in self.subtasks],
        }


def feasible(
    graph: ObjectActionGraph,
    scene: Scene | None = None,
    seed: int = 0,
    *,
    listen: Listener = ignore,
    vary: bool = True,
    most_repairs: int = MOST_REPAIRS,
) -> Feasibility:
    """Return whether a proved plan can be done, each subtask in the state that it will find; nothing moves.

    What is found impossible is a fact for the planner: another plan for the same goal is gone through, if one is proved
    that does without. Nothing is resized for it.

    Args:
        graph: A composed task; it is verified first.
        scene: The nominal scene; the graph's own by default.
        seed: Seeds the scene's variation and all planning, as in `rollout`.
        listen: Called when subtasks and steps begin and end.
        vary: Whether the scene is varied by the seed.
        most_repairs: How many repaired plans are gone through.

    Raises:
        TaskError, SceneError: `graph` is no graph, or `scene` no scene.
        SeedError: There are no starts of this seed.
        PlanRefused: `verify` does not prove the plan.
        MissingFlow: A subtask has no flow.
        StartUnstable: Something falls before the robot moves.
    """
    graph, seed = require_graph(graph), check_seed(seed)
    nominal = graph.scene if scene is None else required_scene(scene)

    def verdict(graph: ObjectActionGraph, before_s: float = 0.0) -> Feasibility:
        concrete = nominal.with_scales(graph.task.scales)
        concrete = vary_scene(concrete, seed) if vary else concrete
        return DryRun(graph, concrete, seed, listen, most_repairs, before_s).verdict()

    first = found = verdict(graph)
    known, cpu_s, effort_s = first.known, first.cpu_s, first.effort_s
    # A goal names no part and no spot: another plan for it would not hold to them.
    by_goal = not any(subtask.where is not None for subtask in graph.task.subtasks)
    while most_repairs and by_goal and not found and found.known and len(known) <= MOST_PLANS:
        scene = graph.scene.knowing(known)
        planned = plan_again(graph.task, scene, sizing=Sizing(keep=True))
        if planned.task is None:
            break
        if effort_s - first.effort_s > MOST_EFFORT_S or effort_s > _most_forecast_s(nominal):
            first = _undecided(first)
            break
        found = verdict(compose(planned.task, scene=scene), effort_s)
        known, cpu_s, effort_s = (*known, *found.known), cpu_s + found.cpu_s, effort_s + found.effort_s
    if not found or found is first:
        return replace(first, known=known, cpu_s=cpu_s, effort_s=effort_s)
    detours = (Detour(0, 0, f"another plan is taken: {first.reason}"), *found.detours)
    return replace(found, known=known, cpu_s=cpu_s, effort_s=effort_s, detours=detours)


def _undecided(found: Feasibility) -> Feasibility:
    """Return the verdict of a plan that cannot be done as it is, while there was no time for what else could be."""
    failure = found.failure
    if failure is None or failure.kind is FailureKind.NO_ANSWER:
        return found
    message = f"no answer in the time: as it is, {failure.message}; not everything else was gone through"
    return replace(found, failure=Failure(FailureKind.NO_ANSWER, message, failure.measurements))


def _most_forecast_s(scene: Scene) -> float:
    # Stored results of the paper's robot were found by longer searches.
    return math.inf if scene.robot.model.keeps_order else MOST_FORECAST_S


class DryRun:
    """One dry run of a plan.

    Args:
        graph: A composed task; it is verified first.
        scene: A concrete scene.
        seed: Seeds all planning.
        listen: Called when subtasks and steps begin and end.
        most_repairs: How many repaired plans are gone through.
        before_s: Effort of the plans before this one, of the same forecast.

    Raises:
        PlanRefused: `verify` does not prove the plan.
        MissingFlow: A subtask has no flow.
    """

    def __init__(
        self,
        graph: ObjectActionGraph,
        scene: Scene,
        seed: int,
        listen: Listener = ignore,
        most_repairs: int = MOST_REPAIRS,
        before_s: float = 0.0,
    ) -> None:
        self._scene, self._seed, self._listen = scene, seed, listen
        self._most_s = _most_forecast_s(scene) - before_s
        self._ran_out = False
        self._detours: tuple[Detour, ...] = ()
        self._avoided: Ways = frozenset()
        self._repairs_left = most_repairs
        self._known: tuple[Infeasible, ...] = ()
        self._adopt(graph)

    def verdict(self) -> Feasibility:
        """Go through the whole plan, and return what came of it."""
        began = time.process_time()
        start = Checkpoint.at_start(self._scene)
        with World(self._scene, oracle=True) as oracle, DryWorld(self._scene, start.packed) as world:
            self._planner = Planner(CollisionOracle(oracle))
            self._world, self._hand = world, Hand()
            self._control = DryController(world, np.array(start.target), start.finger_target_m)
            with self._planner.effort.limited(self._most_s):
                done = tuple(self._subtasks())
        failed = done[-1].record if done and not done[-1].record.succeeded else None
        failure = as_failure(failed.readings, failed.name) if failed is not None and not failed.failure else None
        failure = failed.failure or failure if failed is not None else None
        primitive = next((step.primitive for step in failed.steps if step.failure), "") if failed is not None else ""
        found = Feasibility(
            self._task,
            done,
            failure,
            primitive,
            self._detours,
            time.process_time() - began,
            self._avoided,
            self._known,
            self._planner.effort.spent_s,
        )
        return _undecided(found) if self._ran_out else found

    def _refused(self, index: int, step: int, failure: Failure) -> FeasibleSubtask:
        """Return the record of a subtask of which sizes alone say that it cannot be done."""
        subtask = self._task.subtasks[index]
        flow = subtask.flow or ()
        primitive = flow[step].primitive.name
        record = StepRecord(index, step, primitive, flow[step].to_json(), 0.0, 0.0, 0.0, (), failure)
        return _summary(SubtaskRecord(index, subtask.name, flow, (record,), (), "", b"", {}), 0.0, ())

    def _adopt(self, graph: ObjectActionGraph) -> None:
        require_flows(graph.task)
        require_skills(graph.task)
        report = graph.verify()
        if not report:
            raise PlanRefused(report)
        self._graph, self._task, self._goals = graph, graph.task, report.regressed_goals

    def _subtasks(self) -> list[FeasibleSubtask]:
        starts, done = list[Start](), list[FeasibleSubtask]()
        while len(done) < len(self._task.subtasks):
            starts.append(self._state())
            refused = None if done else first_misfit(self._task, self._world)
            patience_s = PATIENCE_S if self._repairs_left and not self._planner.robot.keeps_order else math.inf
            done.append(self._subtask(len(done), patience_s) if refused is None else self._refused(*refused))
            if done[-1].record.succeeded:
                continue
            gave_up = self._planner.gave_up
            mended = refused is None and self._mended_in_time(done, starts)
            if not mended and not (gave_up and self._found_patiently(done, starts)):
                self._known = self._found_impossible(done, starts[-1][1].held)
                break
        return done

    def _found_patiently(self, done: list[FeasibleSubtask], starts: list[Start]) -> bool:
        """Go through the last subtask with all of its search; return whether it, or a repair of it, succeeds."""
        self._restore(starts[-1])
        again = self._subtask(len(done) - 1)
        failure = again.record.failure
        if failure is not None and failure.kind is FailureKind.NO_ANSWER:
            return False  # What was met before says more.
        done[-1] = again
        return again.record.succeeded or self._mended_in_time(done, starts)

    def _mended_in_time(self, done: list[FeasibleSubtask], starts: list[Start]) -> bool:
        """Go through repaired plans while there is time; return whether one gets past what failed."""
        effort, left = self._planner.effort, self._repairs_left
        ends_s = min(self._most_s, effort.spent_s + MOST_EFFORT_S)
        with effort.limited(ends_s - effort.spent_s):
            mended = self._mended(done, starts)
        self._ran_out = not mended and left > 0 and effort.spent_s >= ends_s
        return mended

    def _found_impossible(self, done: list[FeasibleSubtask], held: str | None) -> tuple[Infeasible, ...]:
        """Return what the last subtask shows to be impossible."""
        record = done[-1].record
        state = self._graph.verify().state_after(record.index)
        failed = Failed(self._task, record.index, record, self._scene, held)
        found = None if state is None else impossible(failed, state.facts)
        return () if found is None else (found,)

    def _mended(self, done: list[FeasibleSubtask], starts: list[Start]) -> bool:
        """Go through repaired plans until one gets past what failed; return whether one does, with both lists changed.

        Args:
            done: The subtasks so far; the last one failed.
            starts: The state at the start of each.
        """
        before, index = tuple(one.record for one in done[:-1]), len(done) - 1
        held = starts[index][1].held
        failed = Failed(self._task, index, done[index].record, self._scene, held, before, self._avoided)
        graph, avoided, detours = self._graph, self._avoided, self._detours
        in_vain = set[tuple[SimpleTask, Ways]]()
        for repair in repairs(failed):
            if self._repairs_left == 0:
                break
            begins = repair.task.subtasks[repair.first], repair.avoided
            if begins in in_vain:
                continue
            try:
                self._adopt(compose(repair.task, scene=graph.scene))
            except PlanRefused:
                continue
            self._repairs_left -= 1
            self._avoided, self._detours = repair.avoided, (*detours, repair.detour)
            self._restore(starts[repair.first])
            redone, again = done[: repair.first], starts[: repair.first]
            while len(redone) <= repair.last and (len(redone) == repair.first or redone[-1].record.succeeded):
                again.append(self._state())
                redone.append(self._subtask(len(redone)))
            got_there = len(redone) > repair.last
            if repair.first + 1 == len(redone) <= repair.last and not redone[-1].record.succeeded:
                in_vain.add(begins)  # What cannot be taken is set down nowhere.
            # Behind what was in the way there may be more.
            if got_there and (redone[-1].record.succeeded or (held is None and self._mended(redone, again))):
                done[:], starts[:] = redone, again
                return True
        self._adopt(graph)
        self._avoided, self._detours = avoided, detours
        return False

    def _state(self) -> Start:
        return self._world.state, self._hand

    def _restore(self, state: Start) -> None:
        dry, self._hand = state
        self._world.restore(dry)
        self._control = DryController(self._world, dry.q, float(dry.fingers_m.mean()))

    def _subtask(self, index: int, patience_s: float = math.inf) -> FeasibleSubtask:
        """Go through one subtask, from where the one before ended."""
        self._planner.patience_s = patience_s
        began = time.process_time()
        subtask, world, last = self._task.subtasks[index], self._world, index + 1 == len(self._task.subtasks)
        session = Session(
            world,
            self._control,
            self._planner,
            subtask,
            flow=subtask.flow or (),
            later=self._task.subtasks[index + 1 :],
            hand=self._hand,
            handled=frozenset(earlier.target for earlier in self._task.subtasks[:index]),
            avoided=self._avoided,
        )
        self._planner.start_subtask(world, self._seed, index)
        self._planner.lands = self._landing(subtask)
        self._tell("subtask-start", index, -1, subtask.name)
        steps: list[StepRecord] = []
        bystanders = Bystanders(world, subtask.target)
        for number in range(len(session.flow)):
            session, step = self._step(replace(session, step=number), index, bystanders)
            steps.append(step)
            if step.failure is not None:
                break
        self._hand = session.hand
        readings = (judge_at_rest if last else judge)(self._goals[index], world) + read_where(subtask, world)
        if last and not (steps and steps[-1].failure) and as_failure(readings, subtask.name) is None:
            readings = (*readings, *judge_at_rest(self._task.goal, world))
        flow = (*flow_from_json([step.action for step in steps], self._scene.domain), *session.flow[len(steps) :])
        record = SubtaskRecord(index, subtask.name, flow, tuple(steps), readings, "", b"", bystanders.moved_m())
        self._tell("subtask-end", index, -1, subtask.name, steps[-1].failure if steps else None)
        choices = () if self._planner.robot.keeps_order else tuple(self._planner.chosen)
        return _summary(record, time.process_time() - began, choices)

    def _landing(self, subtask: SimpleTask) -> Callable[[Array], bool] | None:
        """Return a test of where (4, 4) a thing is let go of over a bowl or box: whether all that belongs there stays.

        The same is asked of a thing on a rim, or on the top of a can. It is asked by the same detectors as the goal.
        None for a subtask that puts nothing into or onto such a thing.
        """
        world, item, vessel = self._world, subtask.target, subtask.support_goal
        if vessel is None or vessel not in world.dynamic_ids:
            return None
        crowned = resting_top(world.assets[vessel]) is not None
        relations = ("inside", "ontop") if crowned else ("inside",)
        goals = [Atom(relation, (item, vessel)) for relation in relations]
        goal = next((atom for atom in goals if atom in atoms(subtask.goal)), None)
        if goal is None:
            return None
        known = (Atom("inside", (name, vessel)) for name in world.dynamic_ids if name not in (item, vessel))
        wanted = (goal, *(atom for atom in known if judge(atom, world)[0].satisfied))

        def lands(T_world_item: Array) -> bool:
            return all(lands_from(transform(np.eye(3), np.array(off_m)) @ T_world_item) for off_m in OFF_M)

        def lands_from(T_world_item: Array) -> bool:
            moved = T_world_item @ inverse(world.T_world_link(item))
            released = {name: moved @ world.T_world_link(name) for name in world.along}
            with at_rest_within(world, released, vessel) as rested:
                first, *others = (judge(atom, rested)[0] for atom in wanted)
                measured = first.measurements
                within_m = -(measured.centre_beyond_edge_m or 0.0)
                leans_deg, depth_m = measured.tilted_deg or 0.0, measured.centre_depth_m or within_m
                surely = leans_deg <= LEANS_DEG - SPARE_DEG and depth_m >= SPARE_M
                return surely and all(reading.satisfied for reading in (first, *others))

        return lands

    def _step(self, session: Session, index: int, bystanders: Bystanders) -> tuple[Session, StepRecord]:
        action = session.flow[session.step]
        name = action.primitive.name
        self._tell("step-start", index, session.step, name)
        began = time.perf_counter()
        outcome = bounded(skill_of(action.primitive), session, action)
        failure = outcome.failure or bystanders.check()
        self._tell("step-end", index, session.step, name, failure)
        step = StepRecord(
            subtask=index,
            step=session.step,
            primitive=name,
            action=outcome.action.to_json(),
            start_s=0.0,
            end_s=0.0,
            planning_wall_s=time.perf_counter() - began,
            measurements=outcome.measurements,
            failure=failure,
        )
        return outcome.session, step

    def _tell(self, kind: str, subtask: int, step: int, name: str, failure: Failure | None = None) -> None:
        message = failure.message if failure is not None else ""
        self._listen(Event(kind, subtask, len(self._task.subtasks), step, name, 0.0, message))  # type: ignore[arg-type]


def _summary(record: SubtaskRecord, cpu_s: float, choices: tuple[Choice, ...]) -> FeasibleSubtask:
    base, region, margins_deg = None, None, list[float]()
    for step in record.steps:
        taken, put = first_of(step.measurements, TargetDrive), first_of(step.measurements, SupportDrive)
        if taken is not None:
            base = (taken.base_x_m, taken.base_y_m, taken.base_yaw_deg)
            margins_deg.append(taken.joint_margin_deg)
        if put is not None and put.joint_margin_deg is not None:
            region = put.region
            margins_deg.append(put.joint_margin_deg)
    return FeasibleSubtask(record, base, min(margins_deg, default=None), region, cpu_s, choices)
