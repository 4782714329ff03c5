"""Policies in the environment: the same unseen seeds for all of them, and what came of each episode."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from typing import Any

from executor.bench.units import Family
from executor.envs import MOST_STEPS
from executor.envs.environment import SceneEnvironment
from executor.policies.acting import Actor
from executor.policies.judging.outcomes import EpisodeOutcome, OutcomeWatch
from executor.policies.windows import EpisodeKind
from oag import Scene, Task

MOST_S = 40.0
"""Simulated time of an episode of a sentence of one's own: over twice what planned demonstrations of one deed take."""


@dataclass(frozen=True, slots=True)
class Footage:
    """An episode, as it can be drawn.

    Attributes:
        scene, task: What it is of.
        states: Packed physical states, one an action.
    """

    scene: Scene
    task: Task
    states: Sequence[bytes]


Seen = Callable[[Actor, EpisodeOutcome, Footage], None]


def evaluate(
    actors: Sequence[Actor], kind: EpisodeKind, seeds: Sequence[int], told: Seen, *, keep_states: bool = False
) -> dict[str, list[EpisodeOutcome]]:
    """Returns policy -> what came of each seed, in order.

    Args:
        actors: The policies; each gets the same episodes.
        kind: What episodes are drawn from.
        seeds: Of the episodes.
        told: Called after each episode.
        keep_states: Whether states are kept for drawing.

    Raises:
        NotDrawn: No room could be made of a seed.
    """
    found: dict[str, list[EpisodeOutcome]] = {actor.name: [] for actor in actors}
    with ExitStack() as open_ones:
        envs = [open_ones.enter_context(closing(environment_for(actor, kind))) for actor in actors]
        # Seed by seed: to draw an episode takes as long as to act in it, and what was drawn last is remembered.
        for seed in seeds:
            for actor, env in zip(actors, envs, strict=True):
                outcome, footage = run_episode(env, actor, seed, keep_states=keep_states)
                found[actor.name].append(outcome)
                told(actor, outcome, footage)
    return found


def environment_for(actor: Actor, kind: EpisodeKind) -> SceneEnvironment:
    """Returns an environment that a policy acts in."""
    settings = actor.record.settings
    where: dict[str, Any] = (
        {"family": kind.origin.family}
        if kind.origin.family is not None
        else {"query": kind.origin.query, "scene": kind.origin.scene}
    )
    return SceneEnvironment(
        **where,
        observation_mode="state" if settings.sees.kind == "state" else "point_cloud",
        action_mode=settings.acts.kind,
        rate_hz=actor.record.rate_hz,
        variation=kind.variation,
    )


def most_steps(family: Family | None, rate_hz: float) -> int:
    """Returns after how many actions an episode is over."""
    return round(MOST_S * rate_hz) if family is None else round(MOST_STEPS[family] * rate_hz / 10.0)


def run_episode(
    env: SceneEnvironment, actor: Actor, seed: int, *, keep_states: bool = False
) -> tuple[EpisodeOutcome, Footage]:
    """Returns what came of an episode, and its states where they are to be kept.

    Raises:
        NotDrawn: No room could be made of the seed.
    """
    observation, info = env.reset(seed=seed)
    episode = env.episode
    actor.begin(list(_plan(episode.task)), seed)
    watch, states = OutcomeWatch(episode, env.world), []
    for _ in range(most_steps(env.family, actor.record.rate_hz)):
        if keep_states:
            states.append(env.world.pack())
        observation, _, _, _, info = env.step(actor.act(observation))
        watch.look(info)
        if watch.over:
            break
    return watch.outcome(seed), Footage(episode.scene, episode.task, states)


def _plan(task: Task) -> Iterator[int]:
    """Yields the numbers of the primitives of a task's flows, subtask after subtask."""
    for subtask in task.subtasks:
        yield from (action.primitive.value for action in subtask.flow or ())
