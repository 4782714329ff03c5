"""Where a policy gets no further, the planner goes on with a proved plan; it is counted apart from what policies do."""

from __future__ import annotations

from collections import deque
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np

from executor.envs.environment import SceneEnvironment
from executor.policies.judging.outcomes import AFTER_S, HOLDS_S, OutcomeWatch
from executor.records.rollout import FailureKind, PlanRefused
from executor.rollouts.continuing import continue_plan

STALL_S = 3.0
"""A robot that has stood still for so long waits for nothing, its policy repeats itself; demonstrations rest less."""

STILL_M, STILL_RAD = 0.01, 0.03
"""How little base and joints move in that time: what trembles in contact moves by less, any work by more."""

ATTEMPTS = 2
"""How often the planner tries: a second time with other draws, from where the first one ended."""

_BASE, _MOVERS = 2, 10

Reason = Literal["stalled", "time"]


class StallWatch:
    """Tells when a robot has stopped for good.

    Args:
        rate_hz: Looks a second.
    """

    def __init__(self, rate_hz: float) -> None:
        self._postures: deque[np.ndarray] = deque(maxlen=max(round(STALL_S * rate_hz), 2))

    def look(self, qpos: np.ndarray) -> None:
        """Takes note of the robot's (12,) joint positions once an action."""
        self._postures.append(np.asarray(qpos, dtype=float)[:_MOVERS])

    @property
    def stalled(self) -> bool:
        """Whether it has stood still for `STALL_S`."""
        if len(self._postures) < (self._postures.maxlen or 0):
            return False
        moved = np.ptp(np.stack(self._postures), axis=0)
        return bool(moved[:_BASE].max() < STILL_M and moved[_BASE:].max() < STILL_RAD)


@dataclass(frozen=True, slots=True)
class PlannerHelp:
    """One time that the planner went on for a policy.

    Attributes:
        because: Why: the policy had stalled, or its time was up.
        at_s: When, in simulated time since the world was built.
        subtask: Index of the subtask that it went on with.
        attempts: How often it tried.
        succeeded: Whether the subtask's regressed goal was reached; with the time up, that of the task.
        failure: Kind of the last attempt's failure; "plan-refused" where no plan was proved; empty for a success.
        took_s: Simulated time.
    """

    because: Reason
    at_s: float
    subtask: int
    attempts: int
    succeeded: bool
    failure: str
    took_s: float

    def to_json(self) -> dict[str, Any]:
        """Returns it as plain data."""
        return asdict(self)


def help_on(
    env: SceneEnvironment,
    watch: OutcomeWatch,
    info: dict[str, Any],
    because: Reason,
    seed: int,
    rate_hz: float,
) -> tuple[PlannerHelp, dict[str, Any], dict[str, Any]]:
    """Has the planner do the subtask that a policy did not, and gives the episode back where that ends.

    A policy whose time is up does nothing more, and the planner does all the rest.

    Args:
        env: Where the policy acts.
        watch: What judges the episode; it goes on looking.
        info: What the environment said last.
        because: Why the planner is asked.
        seed: Seeds planning.
        rate_hz: Actions a second.

    Returns:
        What it came to, and the environment's observation and words after it.
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
                rate_hz,
                only_one=because == "stalled",
                physics=episode.physics,
            )
        except PlanRefused:
            failure = "plan-refused"
            break
        last = done.rollout.subtasks[-1]
        succeeded = last.succeeded if because == "stalled" else done.rollout.succeeded
        failure = FailureKind.GOAL_NOT_REACHED.value if last.failure is None else last.failure.kind.value
        observation, info = env.resume(done.after)
        watch.follow(env.world)
    told = PlannerHelp(
        because,
        round(begun_s, 3),
        first,
        attempts,
        succeeded,
        "" if succeeded else failure,
        round(env.world.time_s - begun_s, 3),
    )
    return told, observation, info


def hold_and_see(env: SceneEnvironment, watch: OutcomeWatch, rate_hz: float) -> None:
    """Holds the robot still until it is known whether an episode has come to a success that stays."""
    for _ in range(round((HOLDS_S + AFTER_S) * rate_hz) + 1):
        watch.look(env.wait()[4])
        if watch.over:
            return
