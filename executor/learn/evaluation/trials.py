"""Run policies in the environment on the same unseen seeds, with optional pushes, planner's help and videos.

Where a policy gets no further, the planner may continue with a proved plan. Such successes are counted apart.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np

from executor.data.units import Pushed, Recording, View
from executor.data.views import Look, footage_path, render_views
from executor.envs import MOST_STEPS
from executor.envs.pushes import Pusher, draw_pushes
from executor.envs.scene_environment import SceneEnvironment
from executor.learn.acting import Policy
from executor.learn.demonstrations import EpisodeKind
from executor.learn.evaluation.outcomes import AFTER_S, HOLDS_S, EpisodeOutcome, MonitorWatch, OutcomeWatch
from executor.learn.evaluation.scores import drawn_numbers
from executor.learn.observations import plan_of
from executor.records import FailureKind, PlanRefused
from executor.rollouts.rollout import Conditions
from executor.rollouts.takeover import continue_plan
from executor.scenes.generators.families import Family
from executor.sim.render.cameras import cameras_for
from executor.sim.render.stage import SceneRenderer
from oag import Scene, Task, TaskError

STALL_S = 3.0
"""Rest that counts as a stall: the policy repeats itself; demonstrations rest for less."""

STILL_M, STILL_RAD = 0.01, 0.03
"""Maximum motion of base and joints in a stall: tremor in contact is below it, any work above it."""

ATTEMPTS = 2
"""Attempts of the planner: the second one with other draws, from the end of the first."""

_BASE, _MOVERS = 2, 10

Reason = Literal["stalled", "time"]


class StallWatch:
    """Detects that a robot has stopped for good.

    Args:
        rate_hz: Observations per second.
    """

    def __init__(self, rate_hz: float) -> None:
        self._postures: deque[np.ndarray] = deque(maxlen=max(round(STALL_S * rate_hz), 2))

    def look(self, qpos: np.ndarray) -> None:
        """Note the robot's (12,) joint positions; call it once per action."""
        self._postures.append(np.asarray(qpos, dtype=float)[:_MOVERS])

    @property
    def stalled(self) -> bool:
        """Whether it has not moved for `STALL_S`."""
        if len(self._postures) < (self._postures.maxlen or 0):
            return False
        moved = np.ptp(np.stack(self._postures), axis=0)
        return bool(moved[:_BASE].max() < STILL_M and moved[_BASE:].max() < STILL_RAD)


@dataclass(frozen=True, slots=True)
class PlannerHelp:
    """One help of the planner.

    Attributes:
        because: Reason: the policy had stalled, or its time was up.
        at_s: Simulated time since the world was built [s].
        subtask: Index of the subtask that it continued with.
        attempts: Number of attempts.
        succeeded: Whether the subtask's regressed goal was reached; with the time up, the task's goal.
        failure: Kind of the last attempt's failure; "plan-refused" where no plan was proved; empty for a success.
        took_s: Simulated time [s].
    """

    because: Reason
    at_s: float
    subtask: int
    attempts: int
    succeeded: bool
    failure: str
    took_s: float

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self)


def run_planner_help(
    env: SceneEnvironment,
    watch: OutcomeWatch,
    info: dict[str, Any],
    because: Reason,
    seed: int,
    rate_hz: float,
) -> tuple[PlannerHelp, dict[str, Any], dict[str, Any]]:
    """Let the planner do the subtask that a policy did not do, and return the episode to the policy.

    With the time up the policy acts no more, and the planner does all the rest.

    Args:
        env: The environment.
        watch: Tracks the outcome; it continues.
        info: The environment's last info.
        because: Reason of the help.
        seed: Seeds planning.
        rate_hz: Actions a second.

    Returns:
        Its record, and the environment's observation and info after it.
    """
    episode, begun_s = env.episode, env.world.time_s
    most = len(episode.task.subtasks) - 1
    first = min(int(info["stage"]), most)
    succeeded, failure, attempts = False, "", 0
    observation: dict[str, Any] = {}
    while attempts < ATTEMPTS and not succeeded:
        attempts += 1
        try:
            done = continue_plan(
                episode.graph,
                env.checkpoint(),
                min(int(info["stage"]), most),
                seed + attempts,
                Conditions(rate_hz, physics=episode.physics),
                only_one=because == "stalled",
            )
        except PlanRefused:
            failure = "plan-refused"
            break
        last = done.rollout.subtasks[-1]
        succeeded = last.succeeded if because == "stalled" else done.rollout.succeeded
        failure = FailureKind.GOAL_NOT_REACHED.value if last.failure is None else last.failure.kind.value
        observation, info = env.resume(done.after)
        watch.follow(env.world)
    record = PlannerHelp(
        because,
        round(begun_s, 3),
        first,
        attempts,
        succeeded,
        "" if succeeded else failure,
        round(env.world.time_s - begun_s, 3),
    )
    return record, observation, info


def hold_until_settled(env: SceneEnvironment, watch: OutcomeWatch, rate_hz: float) -> None:
    """Hold the robot still until it is known whether an episode's success stays."""
    for _ in range(round((HOLDS_S + AFTER_S) * rate_hz) + 1):
        watch.look(env.wait()[4])
        if watch.over:
            return


PUSHED_BETWEEN_S = (1.0, 6.0)
"""Time window of pushes: tasks take 7 to 10 s, with the drive first, and something has to be left to disturb."""

MOST_S = 40.0
"""Simulated time per subtask of a sentence: over twice the time of planned demonstrations."""

UNDONE_S = 2.0
"""Time for which a policy may continue past a subtask that the detectors report undone: released things have to come
to rest first."""


@dataclass(frozen=True, slots=True)
class EpisodeStates:
    """States of an episode, for rendering.

    Attributes:
        scene, task: Its scene and task.
        states: Packed physical states, one per action.
    """

    scene: Scene
    task: Task
    states: Sequence[bytes]


TrialCallback = Callable[[Policy, EpisodeOutcome, EpisodeStates], None]


@dataclass(frozen=True, slots=True)
class TrialConditions:
    """Conditions of trials.

    Attributes:
        pushes: What is pushed once in the middle of each episode.
        fallback: Whether the planner continues where a policy gets no further.
        keep_states: Whether states are kept for rendering.
    """

    pushes: tuple[Pushed, ...] = ()
    fallback: bool = False
    keep_states: bool = False


def evaluate(
    policies: Sequence[Policy],
    kind: EpisodeKind,
    seeds: Sequence[int],
    on_progress: TrialCallback,
    conditions: TrialConditions = TrialConditions(),
) -> dict[str, list[EpisodeOutcome]]:
    """Return policy -> outcome of each seed, in order; after Ctrl-C, of the seeds in which all of them had acted.

    Args:
        policies: The policies; each gets the same episodes.
        kind: Distribution of the episodes.
        seeds: Seeds of the episodes.
        on_progress: Called after each episode.
        conditions: Conditions of the trials.

    Raises:
        NotDrawn: No room could be drawn for a seed.
        TaskError: There is no item to push.
        KeyboardInterrupt: Before there was any result.
    """
    found: dict[str, list[EpisodeOutcome]] = {policy.name: [] for policy in policies}
    with ExitStack() as open_ones:
        envs = [open_ones.enter_context(closing(environment_for(policy, kind))) for policy in policies]
        # Seed by seed: drawing an episode takes as long as acting in it, and the last draws are cached.
        try:
            for seed in seeds:
                for policy, env in zip(policies, envs, strict=True):
                    outcome, footage = run_episode(env, policy, seed, conditions)
                    found[policy.name].append(outcome)
                    on_progress(policy, outcome, footage)
        except KeyboardInterrupt:
            whole = min(map(len, found.values()))
            if not whole:
                raise
            return {name: outcomes[:whole] for name, outcomes in found.items()}
    return found


def environment_for(policy: Policy, kind: EpisodeKind) -> SceneEnvironment:
    """Return an environment for a policy."""
    settings = policy.record.settings
    where: dict[str, Any] = (
        {"family": kind.origin.family}
        if kind.origin.family is not None
        else {"query": kind.origin.query, "scene": kind.origin.scene}
    )
    return SceneEnvironment(
        **where,
        observation_mode="state" if settings.sees.kind == "state" else "point_cloud",
        action_mode=settings.acts.kind,
        rate_hz=policy.record.rate_hz,
        variation=kind.variation,
        full_size=kind.full_size,
    )


def most_steps(family: Family | None, task: Task, rate_hz: float) -> int:
    """Return the maximum number of actions of an episode."""
    return round((MOST_S * len(task.subtasks) if family is None else MOST_STEPS[family] / 10.0) * rate_hz)


def run_episode(
    env: SceneEnvironment, policy: Policy, seed: int, conditions: TrialConditions = TrialConditions()
) -> tuple[EpisodeOutcome, EpisodeStates]:
    """Run a policy in an episode; return its outcome, and its states where they are kept.

    Raises:
        NotDrawn: No room could be drawn for the seed.
        TaskError: There is no item to push.
        NotAPolicy: The policy was not trained on the task.
    """
    observation, info = env.reset(seed=seed)
    episode = env.episode
    policy.begin(plan_of(episode.task), seed)
    watch, monitors = OutcomeWatch(episode, env.world), MonitorWatch(env.world, episode.task)
    pusher = pusher_of(env, seed, conditions.pushes)
    states: list[bytes] = []
    rate_hz = policy.record.rate_hz
    left = most_steps(env.family, episode.task, rate_hz)
    outcome: EpisodeOutcome | None = None
    helped: list[PlannerHelp] = []
    guide = PlanGuide(policy, episode.task)
    while True:
        env.disturb(pusher)
        stall = StallWatch(rate_hz)
        # A success at the end of the time is observed for as long afterwards as any other.
        while (left or watch.succeeded_s is not None) and not (
            watch.over or (conditions.fallback and stall.stalled and watch.succeeded_s is None)
        ):
            if conditions.keep_states and outcome is None:
                states.append(env.world.pack())
            observation, _, _, _, info = env.step(policy.act(observation))
            left = max(left - 1, 0)
            watch.look(info)
            stall.look(observation["agent_pos"])
            if outcome is None:
                monitors.look(env.target)
            guide.look(info)
        # The policy's own outcome is final before any help.
        outcome = outcome or watch.outcome(seed)
        count = len(episode.task.subtasks)
        if watch.succeeded_s is not None or not conditions.fallback or len(helped) > count:
            break
        because: Reason = "stalled" if left else "time"
        one, observation, info = run_planner_help(env, watch, info, because, seed, rate_hz)
        helped.append(one)
        if not one.succeeded or one.subtask + 1 == count or not left:
            break
        # The policy continues with the next subtask of the graph, by the detectors.
        policy.go_on(plan_of(episode.task, min(int(info["stage"]), count - 1)))
    if helped and helped[-1].succeeded:
        hold_until_settled(env, watch, rate_hz)
    return (
        replace(
            outcome,
            monitors=monitors.first_failures_s,
            drawn=drawn_numbers(episode),
            pushes=tuple(push.to_json() for push in pusher.applied),
            helped=tuple(one.to_json() for one in helped),
            success_with_help=watch.succeeded_s is not None if conditions.fallback else None,
        ),
        EpisodeStates(episode.scene, episode.task, states),
    )


class PlanGuide:
    """Guides a policy by the graph: the detectors decide from which subtask it continues.

    A policy that continues past an undone subtask is sent back. One that restarts a grasp whose subtask's goal already
    holds is sent on.

    Args:
        policy: The policy.
        task: Its task.
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


def pusher_of(env: SceneEnvironment, seed: int, kinds: tuple[Pushed, ...]) -> Pusher:
    """Return the pusher of an episode, with times and directions drawn by its seed.

    It pushes the base, or the first item that the task handles.

    Raises:
        TaskError: An item is to be pushed, and the task handles none.
    """
    targets = [subtask.target for subtask in env.episode.task.subtasks]
    item = next((target for target in targets if target in env.world.dynamic_ids), None)
    if item is None and "item" in kinds:
        message = f"no item can be pushed: the task is about {' and '.join(dict.fromkeys(targets))}"
        raise TaskError(message, source="--push item", hint="--push base pushes the robot")
    return Pusher(draw_pushes(kinds, seed, PUSHED_BETWEEN_S), item)


VIEW: View = "global"


def draw_video(
    scene_renderer: SceneRenderer, footage: EpisodeStates, folder: Path, size: tuple[int, int], rate_hz: float
) -> Path:
    """Render an episode from the global camera, and return the video's path.

    Args:
        scene_renderer: The renderer.
        footage: The episode with its states.
        folder: Folder of the video; it is created.
        size: Width and height [pixels].
        rate_hz: Pictures per second, one per action: the video is as long as the episode.

    Raises:
        VideoFailed: An encoder fails.
        OSError: The folder cannot be written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    cameras = cameras_for(footage.scene, (VIEW,), aspect=size[0] / size[1], task=footage.task)
    recording = Recording(views=(VIEW,), size=size, depth=False, segmentation=False)
    rate = Fraction(rate_hz).limit_denominator(1000)
    render_views(scene_renderer, folder, footage.scene, footage.states, Look(cameras), recording, rate)
    return footage_path(folder, VIEW)
