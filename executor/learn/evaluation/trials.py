"""Run policies in the environment on the same unseen seeds, and draw videos of episodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from executor.data.units import Recording, View
from executor.data.views import Look, footage_path, render_views
from executor.envs import MOST_STEPS
from executor.envs.scene_environment import SceneEnvironment
from executor.learn.acting import Policy
from executor.learn.demonstrations import EpisodeKind
from executor.learn.evaluation.outcomes import EpisodeOutcome, MonitorWatch, OutcomeWatch
from executor.learn.observations import plan_of
from executor.scenes.generators.families import Family
from executor.sim.render.cameras import cameras_for
from executor.sim.render.stage import SceneRenderer
from oag import Scene, Task

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


def evaluate(
    policies: Sequence[Policy],
    kind: EpisodeKind,
    seeds: Sequence[int],
    on_progress: TrialCallback,
    *,
    keep_states: bool = False,
) -> dict[str, list[EpisodeOutcome]]:
    """Return policy -> outcome of each seed, in order; after Ctrl-C, of the seeds in which all of them had acted.

    Args:
        policies: The policies; each gets the same episodes.
        kind: Distribution of the episodes.
        seeds: Seeds of the episodes.
        on_progress: Called after each episode.
        keep_states: Whether states are kept for rendering.

    Raises:
        NotDrawn: No room could be drawn for a seed.
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
    env: SceneEnvironment, policy: Policy, seed: int, *, keep_states: bool = False
) -> tuple[EpisodeOutcome, EpisodeStates]:
    """Run a policy in an episode; return its outcome, and its states where they are kept.

    Raises:
        NotDrawn: No room could be drawn for the seed.
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
