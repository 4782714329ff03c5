"""Run policies in the environment on the same unseen seeds, judge their episodes, and draw videos of them.

Opening succeeds when a door or drawer of the target is at least 0.45 of its range open for a second. Picking up
succeeds when the item is between the fingers, at least 5 cm higher than at first, for a second. Anything else succeeds
when the environment reports it: the goal judged as for demonstrations, at rest for a second. The paper gives no
thresholds; these are ours. `success_once`: it succeeded at some time. `success_at_end`: also 3 s later, with the policy
still acting.

The monitors end a planned motion; here they only record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bddl import Atom
from executor.data.units import Recording, View
from executor.data.views import Look, footage_path, render_views
from executor.envs import MOST_STEPS
from executor.envs.episodes import DrawnEpisode, hand_distance_m
from executor.envs.scene_environment import SceneEnvironment
from executor.learn.acting import Policy
from executor.learn.demonstrations import EpisodeKind
from executor.learn.observations import plan_of
from executor.planning.articulation import handle_contacts
from executor.planning.cargo import cargo_of, carried_by, touching_any
from executor.planning.collision import NOTHING, Allowed, fingers_may_touch, held_may_touch
from executor.records import Failure
from executor.rollouts.goals import tilt_deg
from executor.scenes.generators.families import Family
from executor.sim.detectors import GRIPPER, fingers_touching, read
from executor.sim.engine import ROBOT
from executor.sim.render.cameras import cameras_for
from executor.sim.render.home import home_of
from executor.sim.render.stage import SceneRenderer
from executor.sim.robot.kinematics import Kinematics
from executor.sim.world import World
from executor.skills.control import DISPLACED_M, TIPPED_DEG, Bystanders, Monitor, stall
from oag import Scene, Task
from oag.model.symbols import Primitive
from oag.primitives.table import OPEN_FRACTION

LEAST_OPEN, LEAST_LIFT_M = 0.45, 0.05
HOLDS_S, AFTER_S = 1.0, 3.0
NEAR_M = 0.05
"""Distance within which a hand has reached its target, a handle's bar or the thing."""

TaskKind = Literal["open", "pick", "other"]
FAILURES = (
    "not-reached",
    "not-grasped",
    "not-far-enough",
    "lost",
    "displaced",
    "tipped",
    "incomplete",
)
"""The hand never came near; it came near and never held; it held and moved too little; it held and lost the thing; the
item was pushed away; it fell over; a task of another kind was not finished."""


@dataclass(frozen=True, slots=True)
class EpisodeOutcome:
    """Outcome of one episode.

    Attributes:
        success_once, success_at_end: See the module's docstring.
        failure: Kind of failure, one of `FAILURES`; empty for a success.
        simulated_s: Simulated time up to the success or to the end [s].
        measured: The underlying measurements.
        monitors: Failure kinds of the executor's monitors -> time of the first [s].
    """

    seed: int
    success_once: bool
    success_at_end: bool
    failure: str
    simulated_s: float
    measured: Mapping[str, float]
    monitors: Mapping[str, float] = field(default_factory=dict)

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


class OutcomeWatch:
    """Tracks the outcome of one episode.

    Attributes:
        succeeded_s: Time of the first success [s]; None so far.
    """

    def __init__(self, episode: DrawnEpisode, world: World) -> None:
        self._world = world
        self._target = episode.task.subtasks[-1].target
        self._kind = task_kind(episode)
        self._start = self._pose()
        self._began_s = self._looked_s = world.time_s
        self._held_s = 0.0
        self._holds = False
        self._nearest_m, self._most, self._gripped = hand_distance_m(world, self._target), 0.0, False
        self.succeeded_s: float | None = None

    @property
    def elapsed_s(self) -> float:
        """Simulated time since the episode began."""
        return self._world.time_s - self._began_s

    @property
    def over(self) -> bool:
        """Whether the outcome is final: it succeeded, and the time after that is over."""
        return self.succeeded_s is not None and self.elapsed_s >= self.succeeded_s + AFTER_S - 1e-9

    def look(self, info: Mapping[str, Any]) -> None:
        """Observe the world; call it once per action."""
        since_s, self._looked_s = self._world.time_s - self._looked_s, self._world.time_s
        self._nearest_m = min(self._nearest_m, hand_distance_m(self._world, self._target))
        self._gripped = self._gripped or fingers_touching(self._world, self._target) == 2
        if self._kind == "other":
            self._most, self._holds = max(self._most, float(info["progress"])), bool(info["success"])
        else:
            amount, least = (self._open(), LEAST_OPEN) if self._kind == "open" else (self._lift_m(), LEAST_LIFT_M)
            self._most = max(self._most, amount)
            self._held_s = self._held_s + since_s if amount >= least and self._in_hand() else 0.0
            self._holds = self._held_s >= HOLDS_S - 1e-9
        if self._holds and self.succeeded_s is None:
            self.succeeded_s = self.elapsed_s

    def outcome(self, seed: int) -> EpisodeOutcome:
        """Return whether the episode of a seed succeeded, when, and otherwise why not, from all states so far."""
        once = self.succeeded_s is not None
        measured = {"nearest_m": round(float(self._nearest_m), 4), "most": round(self._most, 4)}
        failure = "" if once else self._failure()
        return EpisodeOutcome(
            seed, once, once and self._holds, failure, round(self.succeeded_s or self.elapsed_s, 3), measured
        )

    def _failure(self) -> str:
        if self._kind == "other":
            return "incomplete"
        if self._kind == "pick" and not self._in_hand() and tilt_deg(self._world, self._target) > TIPPED_DEG:
            return "tipped"
        if self._most > OPEN_FRACTION if self._kind == "open" else self._gripped:
            held = self._gripped and fingers_touching(self._world, self._target) == 2
            return "not-far-enough" if held else "lost"
        if self._nearest_m > NEAR_M:
            return "not-reached"
        if self._kind == "pick" and np.linalg.norm(self._pose()[:3, 3] - self._start[:3, 3]) > DISPLACED_M:
            return "displaced"
        return "not-grasped"

    def _pose(self) -> np.ndarray:
        return self._world.T_world_link(self._target)

    def _lift_m(self) -> float:
        return float(self._pose()[2, 3] - self._start[2, 3])

    def _in_hand(self) -> bool:
        """Decide whether an item is between the fingers; an opened door stays open by itself."""
        return self._kind == "open" or bool(read(Atom("inside", (self._target, GRIPPER)), self._world).value)

    def _open(self) -> float:
        joints = self._world.assets[self._target].doors
        return max(joint.fraction(self._world.joint_position(self._target, joint.name)) for joint in joints)


def task_kind(episode: DrawnEpisode) -> TaskKind:
    """Return the kind of an episode's task, from the flow of its only subtask."""
    subtasks = episode.task.subtasks
    flow = {action.primitive for action in subtasks[-1].flow or ()}
    if len(subtasks) > 1 or Primitive.ARTICULATE_CLOSE in flow:
        return "other"
    if Primitive.ARTICULATE_OPEN in flow:
        return "open"
    return "pick" if Primitive.GRASP in flow and Primitive.UNGRASP not in flow else "other"


STALLED_LOOKS = 5
"""Consecutive observations, half a second at 10 Hz: a robot in fast motion lags behind for less."""


class MonitorWatch:
    """Runs the executor's monitors on one episode.

    Args:
        task: Its subtasks' objects may be touched.

    Attributes:
        first_failures_s: Kind of a failure (`executor.records.FailureKind`) -> simulated time of the first,
            since the world was built [s].
    """

    def __init__(self, world: World, task: Task) -> None:
        self._world = world
        self._targets = tuple(dict.fromkeys(part.target for part in task.subtasks))
        kinematics = Kinematics(world.robot, world.model)
        self._monitor = Monitor(world, kinematics, allowed=_allowed_contacts(world, self._targets))
        # Tasks of several subtasks move several things on purpose.
        self._bystanders = Bystanders(world, self._targets[0]) if len(self._targets) == 1 else None
        self._kinematics = kinematics
        self._behind = 0
        self.first_failures_s: dict[str, float] = {}

    def look(self, target: np.ndarray) -> None:
        """Observe the world; call it once per action.

        Args:
            target: (J,) present joint targets of the drives.
        """
        world, q = self._world, np.asarray(self._world.robot.get_qpos(), dtype=float)
        self._note(self._monitor.check())
        self._note(self._bystanders.check() if self._bystanders is not None else None)
        behind = stall(world.model, q, target[: world.model.movers])
        self._behind = 0 if behind is None else self._behind + 1
        if self._behind >= STALLED_LOOKS:
            self._note(behind)
        item = self._targets[-1]
        if self._monitor.carried is None and item in world.dynamic_ids and fingers_touching(world, item) == 2:
            carried = carried_by(world, item, self._kinematics.forward(q), cargo_of(world, item))
            supports = [body for body in touching_any(world, carried.ids) if body != ROBOT]
            allowed = self._monitor.allowed | held_may_touch(supports)
            self._monitor = replace(self._monitor, carried=carried, allowed=allowed)

    def _note(self, failure: Failure | None) -> None:
        if failure is not None:
            self.first_failures_s.setdefault(failure.kind.value, round(self._world.time_s, 2))


def _allowed_contacts(world: World, targets: tuple[str, ...]) -> Allowed:
    """Return the contacts that handling some things allows."""
    allowed = NOTHING
    for name in targets:
        allowed |= fingers_may_touch(world.model, name, hand=True) if name in world.dynamic_ids else NOTHING
        for handle in world.assets[name].handles:
            allowed |= handle_contacts(world.model, name, handle)
    return allowed


MOST_S = 40.0
"""Simulated time per subtask of a sentence: over twice the time of planned demonstrations."""

UNDONE_S = 2.0
"""Time for which a policy may continue past a subtask that the detectors report undone: released things have to come
to rest first."""


@dataclass(frozen=True, slots=True)
class EpisodeStates:
    """States of an episode, for rendering."""

    scene: Scene
    task: Task
    states: Sequence[bytes]


TrialCallback = Callable[[Policy, EpisodeOutcome, EpisodeStates], None]


def evaluate(
    policies: Sequence[Policy],
    kind: EpisodeKind,
    seeds: Sequence[int],
    on_progress: TrialCallback,
    *,
    keep_states: bool = False,
    enough: Callable[[Mapping[str, Sequence[EpisodeOutcome]]], bool] = lambda found: False,
) -> dict[str, list[EpisodeOutcome]]:
    """Return policy -> outcome of each seed, in order; after Ctrl-C, of the seeds in which all of them had acted.

    Args:
        enough: Asked after every seed; no further one is begun when it agrees.

    Raises:
        KeyboardInterrupt: Before there was any result.
    """
    found: dict[str, list[EpisodeOutcome]] = {policy.name: [] for policy in policies}
    with ExitStack() as open_ones:
        envs = [open_ones.enter_context(closing(environment_for(policy, kind))) for policy in policies]
        # Seed by seed: drawing an episode takes as long as acting in it, and the last draws are cached.
        try:
            for seed in seeds:
                for policy, env in zip(policies, envs, strict=True):
                    outcome, footage = run_episode(env, policy, seed, keep_states=keep_states)
                    found[policy.name].append(outcome)
                    on_progress(policy, outcome, footage)
                if enough(found):
                    break
        except KeyboardInterrupt:
            whole = min(map(len, found.values()))
            if not whole:
                raise
            return {name: outcomes[:whole] for name, outcomes in found.items()}
    return found


def environment_for(policy: Policy, kind: EpisodeKind) -> SceneEnvironment:
    """Return an environment for a policy."""
    settings, pictures = policy.record.settings, policy.picture_size
    where: dict[str, Any] = (
        {"family": kind.origin.family}
        if kind.origin.family is not None
        else {"query": kind.origin.query, "scene": kind.origin.scene}
    )
    if pictures is not None:
        where["size"] = pictures
    return SceneEnvironment(
        **where,
        observation_mode="pixels" if pictures else "state" if settings.sees.kind == "state" else "point_cloud",
        action_mode=settings.acts.kind,
        rate_hz=policy.record.rate_hz,
        variation=kind.variation,
        robot=kind.robot_name,
        plain=not policy.home,
    )


def most_steps(family: Family | None, task: Task, rate_hz: float) -> int:
    """Return the maximum number of actions of an episode."""
    return round((MOST_S * len(task.subtasks) if family is None else MOST_STEPS[family] / 10.0) * rate_hz)


def run_episode(
    env: SceneEnvironment, policy: Policy, seed: int, *, keep_states: bool = False
) -> tuple[EpisodeOutcome, EpisodeStates]:
    """Run a policy in an episode; return its outcome, and its states where they are kept.

    Raises:
        NotAPolicy: The policy was not trained on the task.
    """
    observation, _ = env.reset(seed=seed)
    episode = env.episode
    policy.begin(plan_of(episode.task), seed)
    watch, monitors = OutcomeWatch(episode, env.world), MonitorWatch(env.world, episode.task)
    guide = PlanGuide(policy, episode.task)
    states: list[bytes] = []
    left = most_steps(env.family, episode.task, policy.record.rate_hz)
    # A success at the end of the time is observed for as long afterwards as any other.
    while (left > 0 or watch.succeeded_s is not None) and not watch.over:
        if keep_states:
            states.append(env.world.pack())
        observation, _, _, _, info = env.step(policy.act(observation))
        left -= 1
        watch.look(info)
        monitors.look(env.target)
        guide.look(info)
    outcome = replace(watch.outcome(seed), monitors=monitors.first_failures_s)
    return outcome, EpisodeStates(episode.scene, episode.task, states)


class PlanGuide:
    """Guides a policy by the graph: the detectors decide from which subtask it continues.

    A policy that continues past an undone subtask is sent back. One that restarts a grasp whose subtask's goal already
    holds is sent on.
    """

    def __init__(self, policy: Policy, task: Task) -> None:
        self._policy, self._task = policy, task
        self._undone, self._restarts = 0, policy.restarts

    def look(self, info: Mapping[str, Any]) -> None:
        """Observe the environment's info; call it once per action."""
        stage, restarts = int(info["stage"]), self._policy.restarts
        restarted, self._restarts = restarts > self._restarts, restarts
        self._undone = self._undone + 1 if self._policy.subtask > stage else 0
        needless = restarted and self._policy.subtask < stage < len(self._task.subtasks)
        if needless or self._undone > UNDONE_S * self._policy.record.rate_hz:
            self._policy.go_on(plan_of(self._task, stage))
            self._undone, self._restarts = 0, self._policy.restarts


VIEW: View = "global"


def draw_video(
    scene_renderer: SceneRenderer, footage: EpisodeStates, folder: Path, size: tuple[int, int], rate_hz: float
) -> Path:
    """Render an episode from the global camera, and return the video's path.

    Args:
        rate_hz: Pictures per second, one per action: the video is as long as the episode.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cameras = cameras_for(footage.scene, (VIEW,), aspect=size[0] / size[1], task=footage.task, height_px=size[1])
    home = home_of(footage.scene)
    look = Look(cameras, home.lights, home.surfaces)
    recording = Recording(views=(VIEW,), size=size, depth=False, segmentation=False)
    rate = Fraction(rate_hz).limit_denominator(1000)
    render_views(scene_renderer, folder, footage.scene, footage.states, look, recording, rate)
    return footage_path(folder, VIEW)
