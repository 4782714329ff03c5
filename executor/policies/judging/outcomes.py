"""What came of an episode: whether it succeeded, as is written down here, and if not, what went wrong.

Opening succeeds when a door or drawer of the target is at least 0.45 of its range open for a second; picking up when
the item is between the fingers, at least 5 cm higher than at first, for a second; anything else when the environment
says so (the goal judged as a demonstration's is, at rest for a second). The paper gives no thresholds; these are ours.
`success_once`: it succeeded at some time. `success_at_end`: also 3 s later, the policy going on all the while.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

import numpy as np

from bddl import Atom
from executor.envs.episodes import DrawnEpisode
from executor.envs.progress import hand_off_m
from executor.primitives.monitors import DISPLACED_M, TIPPED_DEG
from executor.rollouts.handling import tilt_deg
from executor.world.detectors import GRIPPER, fingers_touching, read
from executor.world.world import World
from oag.model.primitives import Primitive
from oag.table.library import OPEN_FRACTION

LEAST_OPEN, LEAST_LIFT_M = 0.45, 0.05
HOLDS_S, AFTER_S = 1.0, 3.0
NEAR_M = 0.05
"""A hand that was never as near to what it can take, a handle's bar or the thing, did not get there."""

Deed = Literal["open", "pick", "other"]
FAILURES = (
    "not-reached",
    "not-grasped",
    "not-far-enough",
    "lost",
    "displaced",
    "tipped",
    "incomplete",
)
"""The hand never came near; it came, and never held; it held, and moved too little; it held, and let go; the item was
pushed away; it fell; a task of another kind did not get to its end."""


@dataclass(frozen=True, slots=True)
class EpisodeOutcome:
    """What came of one episode.

    Attributes:
        seed: Its seed.
        success_once, success_at_end: As the module's text says.
        failure: What went wrong, one of `FAILURES`; empty for a success.
        simulated_s: How long it took, up to the success or to the end.
        measured: The numbers behind it.
        monitors: Kinds of failures that the executor's monitors saw -> when first [s].
        drawn: Numbers that were drawn for the episode, by name.
        pushes: What pushed, as it was.
        helped: What the planner did where the policy got no further; the successes above are without that.
        success_with_help: Whether it succeeded after all, with help or without; None where no help was to be had.
    """

    seed: int
    success_once: bool
    success_at_end: bool
    failure: str
    simulated_s: float
    measured: Mapping[str, float]
    monitors: Mapping[str, float] = field(default_factory=dict)
    drawn: Mapping[str, float] = field(default_factory=dict)
    pushes: tuple[Mapping[str, Any], ...] = ()
    helped: tuple[Mapping[str, Any], ...] = ()
    success_with_help: bool | None = None

    def to_json(self) -> dict[str, Any]:
        """Returns it as plain data."""
        return asdict(self)


class OutcomeWatch:
    """Follows one episode.

    Args:
        episode: What it is about.
        world: Where things are.

    Attributes:
        succeeded_s: When it succeeded first [s]; None so far.
    """

    def __init__(self, episode: DrawnEpisode, world: World) -> None:
        self._world = world
        self._target = episode.task.subtasks[-1].target
        self._deed = deed_of(episode)
        self._start = self._pose()
        self._began_s = self._seen_s = world.time_s
        self._held_s = 0.0
        self._holds = False
        self._nearest_m, self._most, self._gripped = hand_off_m(world, self._target), 0.0, False
        self.succeeded_s: float | None = None

    @property
    def elapsed_s(self) -> float:
        """Simulated time since the episode began."""
        return self._world.time_s - self._began_s

    @property
    def over(self) -> bool:
        """Whether there is nothing more to see: it succeeded, and the time after that is over."""
        return self.succeeded_s is not None and self.elapsed_s >= self.succeeded_s + AFTER_S - 1e-9

    def follow(self, world: World) -> None:
        """Goes on with another world that has taken on the state of this one, as after a planner's help."""
        self._world = world
        self._seen_s = world.time_s

    def look(self, info: Mapping[str, Any]) -> None:
        """Looks at the world once an action.

        Args:
            info: What the environment said beside the observation.
        """
        since_s, self._seen_s = self._world.time_s - self._seen_s, self._world.time_s
        self._nearest_m = min(self._nearest_m, hand_off_m(self._world, self._target))
        self._gripped = self._gripped or fingers_touching(self._world, self._target) == 2
        if self._deed == "other":
            self._most, self._holds = max(self._most, float(info["progress"])), bool(info["success"])
        else:
            amount, least = (self._open(), LEAST_OPEN) if self._deed == "open" else (self._lift_m(), LEAST_LIFT_M)
            self._most = max(self._most, amount)
            self._held_s = self._held_s + since_s if amount >= least and self._in_hand() else 0.0
            self._holds = self._held_s >= HOLDS_S - 1e-9
        if self._holds and self.succeeded_s is None:
            self.succeeded_s = self.elapsed_s

    def outcome(self, seed: int) -> EpisodeOutcome:
        """Returns what came of it."""
        once = self.succeeded_s is not None
        measured = {"nearest_m": round(float(self._nearest_m), 4), "most": round(self._most, 4)}
        failure = "" if once else self._failure()
        return EpisodeOutcome(
            seed, once, once and self._holds, failure, round(self.succeeded_s or self.elapsed_s, 3), measured
        )

    def _failure(self) -> str:
        if self._deed == "other":
            return "incomplete"
        if self._deed == "pick" and not self._in_hand() and tilt_deg(self._world, self._target) > TIPPED_DEG:
            return "tipped"
        if self._most > OPEN_FRACTION if self._deed == "open" else self._gripped:
            held = self._gripped and fingers_touching(self._world, self._target) == 2
            return "not-far-enough" if held else "lost"
        if self._nearest_m > NEAR_M:
            return "not-reached"
        if self._deed == "pick" and np.linalg.norm(self._pose()[:3, 3] - self._start[:3, 3]) > DISPLACED_M:
            return "displaced"
        return "not-grasped"

    def _pose(self) -> np.ndarray:
        return self._world.T_world_link(self._target)

    def _lift_m(self) -> float:
        return float(self._pose()[2, 3] - self._start[2, 3])

    def _in_hand(self) -> bool:
        """Decides whether an item is between the fingers; what is opened stays open by itself."""
        return self._deed == "open" or bool(read(Atom("inside", (self._target, GRIPPER)), self._world).value)

    def _open(self) -> float:
        joints = self._world.assets[self._target].joints
        return max(joint.fraction(self._world.joint_position(self._target, joint.name)) for joint in joints)


def deed_of(episode: DrawnEpisode) -> Deed:
    """Returns what an episode is for, as the flow of its only subtask says."""
    subtasks = episode.task.subtasks
    flow = {action.primitive for action in subtasks[-1].flow or ()}
    if len(subtasks) > 1 or Primitive.ARTICULATE_CLOSE in flow:
        return "other"
    if Primitive.ARTICULATE_OPEN in flow:
        return "open"
    return "pick" if Primitive.GRASP in flow and Primitive.UNGRASP not in flow else "other"
