"""Policies in the environment: the same unseen seeds for all of them, and what came of each episode."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from typing import Any

from executor.bench.units import Family
from executor.datasets.units import Pushed
from executor.envs import MOST_STEPS
from executor.envs.environment import SceneEnvironment
from executor.envs.pushes import Pusher, drawn_pushes
from executor.policies.acting import Acting
from executor.policies.judging.axes import drawn_numbers
from executor.policies.judging.helping import PlannerHelp, Reason, StallWatch, help_on, hold_and_see
from executor.policies.judging.monitors import MonitorWatch
from executor.policies.judging.outcomes import EpisodeOutcome, OutcomeWatch
from executor.policies.steps import plan_of
from executor.policies.windows import EpisodeKind
from oag import Scene, Task, TaskError

PUSHED_BETWEEN_S = (1.0, 6.0)
"""When pushes come: of what is done in 7 to 10 s, driving first, while there is something left to be disturbed."""

MOST_S = 40.0
"""Simulated time of each subtask of a sentence of one's own: over twice what planned demonstrations of it take."""

UNDONE_S = 2.0
"""For how long a policy may go on from a subtask that the detectors say is not done: what is let go of has to come to
rest first."""


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


Seen = Callable[[Acting, EpisodeOutcome, Footage], None]


@dataclass(frozen=True, slots=True)
class TrialConditions:
    """Under what episodes are held.

    Attributes:
        pushes: What is pushed once in the middle of each episode.
        fallback: Whether the planner goes on where a policy gets no further.
        keep_states: Whether states are kept for drawing.
    """

    pushes: tuple[Pushed, ...] = ()
    fallback: bool = False
    keep_states: bool = False


def evaluate(
    actors: Sequence[Acting],
    kind: EpisodeKind,
    seeds: Sequence[int],
    told: Seen,
    conditions: TrialConditions = TrialConditions(),
) -> dict[str, list[EpisodeOutcome]]:
    """Returns policy -> what came of each seed, in order; after Ctrl-C, of the seeds in which all of them had acted.

    Args:
        actors: The policies; each gets the same episodes.
        kind: What episodes are drawn from.
        seeds: Of the episodes.
        told: Called after each episode.
        conditions: Under what they are held.

    Raises:
        NotDrawn: No room could be made of a seed.
        TaskError: There is no item to push.
        KeyboardInterrupt: Before there was anything to return.
    """
    found: dict[str, list[EpisodeOutcome]] = {actor.name: [] for actor in actors}
    with ExitStack() as open_ones:
        envs = [open_ones.enter_context(closing(environment_for(actor, kind))) for actor in actors]
        # Seed by seed: to draw an episode takes as long as to act in it, and what was drawn last is remembered.
        try:
            for seed in seeds:
                for actor, env in zip(actors, envs, strict=True):
                    outcome, footage = run_episode(env, actor, seed, conditions)
                    found[actor.name].append(outcome)
                    told(actor, outcome, footage)
        except KeyboardInterrupt:
            whole = min(map(len, found.values()))
            if not whole:
                raise
            return {name: outcomes[:whole] for name, outcomes in found.items()}
    return found


def environment_for(actor: Acting, kind: EpisodeKind) -> SceneEnvironment:
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
        full_size=kind.full_size,
    )


def most_steps(family: Family | None, task: Task, rate_hz: float) -> int:
    """Returns after how many actions an episode is over."""
    return round((MOST_S * len(task.subtasks) if family is None else MOST_STEPS[family] / 10.0) * rate_hz)


def run_episode(
    env: SceneEnvironment, actor: Acting, seed: int, conditions: TrialConditions = TrialConditions()
) -> tuple[EpisodeOutcome, Footage]:
    """Returns what came of an episode, and its states where they are to be kept.

    Raises:
        NotDrawn: No room could be made of the seed.
        TaskError: There is no item to push.
        NotAPolicy: The policy has learned nothing of the task.
    """
    observation, info = env.reset(seed=seed)
    episode = env.episode
    actor.begin(plan_of(episode.task), seed)
    watch, monitors = OutcomeWatch(episode, env.world), MonitorWatch(env.world, episode.task)
    pusher = pusher_of(env, seed, conditions.pushes)
    states: list[bytes] = []
    rate_hz = actor.record.rate_hz
    left = most_steps(env.family, episode.task, rate_hz)
    outcome: EpisodeOutcome | None = None
    helped: list[PlannerHelp] = []
    guide = PlanGuide(actor, episode.task)
    while True:
        env.disturb(pusher)
        stall = StallWatch(rate_hz)
        # Who succeeds as the time runs out is looked at for as long afterwards as anybody else.
        while (left or watch.succeeded_s is not None) and not (
            watch.over or (conditions.fallback and stall.stalled and watch.succeeded_s is None)
        ):
            if conditions.keep_states and outcome is None:
                states.append(env.world.pack())
            observation, _, _, _, info = env.step(actor.act(observation))
            left = max(left - 1, 0)
            watch.look(info)
            stall.look(observation["agent_pos"])
            if outcome is None:
                monitors.look(env.target)
            guide.look(info)
        # What the policy came to by itself is settled before anybody helps it.
        outcome = outcome or watch.outcome(seed)
        count = len(episode.task.subtasks)
        if watch.succeeded_s is not None or not conditions.fallback or len(helped) > count:
            break
        because: Reason = "stalled" if left else "time"
        one, observation, info = help_on(env, watch, info, because, seed, rate_hz)
        helped.append(one)
        if not one.succeeded or one.subtask + 1 == count or not left:
            break
        # The graph says what comes next, by the detectors; the policy goes on with that.
        actor.go_on(plan_of(episode.task, min(int(info["stage"]), count - 1)))
    if helped and helped[-1].succeeded:
        hold_and_see(env, watch, rate_hz)
    return (
        replace(
            outcome,
            monitors=monitors.seen,
            drawn=drawn_numbers(episode),
            pushes=tuple(push.to_json() for push in pusher.applied),
            helped=tuple(one.to_json() for one in helped),
            success_with_help=watch.succeeded_s is not None if conditions.fallback else None,
        ),
        Footage(episode.scene, episode.task, states),
    )


class PlanGuide:
    """What the graph says to a policy that acts: by the detectors, from which subtask it has to go on.

    One that goes on from what is not done is sent back, and one that begins a grasp anew of which nothing is needed any
    more, as that subtask's goal holds already, is sent on.

    Args:
        actor: The policy.
        task: What it does.
    """

    def __init__(self, actor: Acting, task: Task) -> None:
        self._actor, self._task = actor, task
        self._undone, self._anew = 0, actor.anew

    def look(self, info: Mapping[str, Any]) -> None:
        """Looks at what the environment says once an action."""
        stage, anew = int(info["stage"]), self._actor.anew
        began_anew, self._anew = anew > self._anew, anew
        self._undone = self._undone + 1 if self._actor.subtask > stage else 0
        needless = began_anew and self._actor.subtask < stage < len(self._task.subtasks)
        if needless or self._undone > UNDONE_S * self._actor.record.rate_hz:
            self._actor.go_on(plan_of(self._task, stage))
            self._undone, self._anew = 0, self._actor.anew


def pusher_of(env: SceneEnvironment, seed: int, kinds: tuple[Pushed, ...]) -> Pusher:
    """Returns what pushes in an episode, at times and in directions that its seed draws: the base, and the first item
    that the task handles.

    Raises:
        TaskError: An item is to be pushed, and the task handles none.
    """
    targets = [subtask.target for subtask in env.episode.task.subtasks]
    item = next((target for target in targets if target in env.world.dynamic_ids), None)
    if item is None and "item" in kinds:
        told = f"no item can be pushed: the task is about {' and '.join(dict.fromkeys(targets))}"
        raise TaskError(told, source="--push item", hint="--push base pushes the robot")
    return Pusher(drawn_pushes(kinds, seed, PUSHED_BETWEEN_S), item)
