"""A trained policy at work: observations in, the environment's actions out, a chunk at a time."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from executor.policies.chunks import targets_in_the_room
from executor.policies.networks import PolicyNetwork
from executor.policies.phases import PlanFollower
from executor.policies.seen.features import Numbers, own_numbers, robot_numbers, shown_numbers, state_numbers
from executor.policies.steps import primitive_of, subtask_of
from executor.policies.trained import NotAPolicy, PolicyRecord, load_network, normalised, read_record
from executor.policies.ways import MOST_WAYS
from executor.policies.windows import chosen_points


class Acting(Protocol):
    """Somebody who acts in one episode after the other: a policy of ours, or of somebody else's (`stock.py`)."""

    name: str
    folder: str
    record: PolicyRecord
    execute: int
    step: int

    def begin(self, plan: Sequence[int], seed: int) -> None:
        """Begins an episode with the numbers of its plan's steps and its seed."""

    def go_on(self, plan: Sequence[int]) -> None:
        """Goes on in the middle of an episode with what is left of its plan."""

    @property
    def subtask(self) -> int:
        """Index of the subtask that it takes to be going on; 0 where it is told nothing of that."""

    @property
    def anew(self) -> int:
        """How often it has begun a grasp or its plan anew since it began."""

    def act(self, observation: Mapping[str, Any]) -> NDArray:
        """Returns the next action."""


class Actor:
    """A policy that acts in one episode after the other.

    Args:
        name: What it is called in results.
        record: What it is.
        network: Its network.
        execute: How many actions of a chunk it does before it looks again; by default what its settings say.
        step: After how many steps of training it is as it is; by default after all.
        folder: Where it was read from; by default what it is called.

    Attributes:
        name, record, step, folder: As given.
        execute: How many actions it does.
    """

    def __init__(
        self,
        name: str,
        record: PolicyRecord,
        network: PolicyNetwork,
        execute: int | None = None,
        step: int | None = None,
        folder: str = "",
    ) -> None:
        self.name, self.record = name, record
        self.folder = folder or name
        self.step = record.settings.training.steps if step is None else step
        self._network, self._settings = network.eval(), record.settings
        self.execute = execute or record.settings.acts.execute
        self._frames: deque[tuple[Numbers, int, NDArray | None]] = deque(maxlen=record.settings.sees.frames)
        self._waiting: list[NDArray] = []
        self._ways: dict[int, int] = {}
        self._began: NDArray | None = None
        self._follower = PlanFollower(record, self.execute)
        mean, deviation = record.numbers
        self._scales = torch.from_numpy(mean), torch.from_numpy(deviation)
        self._points: NDArray[np.int64] | None = None

    @classmethod
    def load(cls, folder: Path, step: int | None = None, execute: int | None = None) -> Actor:
        """Returns the policy of a folder.

        Args:
            folder: Where it is.
            step: After how many steps of training; by default the last.
            execute: As for the class.

        Raises:
            NotAPolicy: There is none.
        """
        record = read_record(folder)
        name = str(folder) if step is None else f"{folder}@{step}"
        return cls(name, record, load_network(folder, record, step), execute, step, str(folder))

    @property
    def phase(self) -> int:
        """Number of the step that it takes to be going on."""
        return self.record.steps[self._follower.phase]

    @property
    def anew(self) -> int:
        """How often it has begun a grasp or its plan anew since it began."""
        return self._follower.anew

    @property
    def subtask(self) -> int:
        """Index of the subtask that it takes to be going on; 0 where it is told nothing of that."""
        return subtask_of(self.phase) if self._settings.sees.phase else 0

    def begin(self, plan: Sequence[int], seed: int) -> None:
        """Begins an episode.

        Args:
            plan: Numbers of the steps of the episode's plan (`steps.py`), in order; which of them goes on is told the
                policy, if it was trained so (`phases.py`).
            seed: Of the episode; it chooses among points as it did for demonstrations.

        Raises:
            NotAPolicy: It has learned nothing of a step of the plan, as of a task of another kind.
        """
        if self._settings.sees.phase and (foreign := [step for step in plan if step not in self.record.steps]):
            learned = ", ".join(dict.fromkeys(kind.origin.label for kind in self.record.kinds))
            step = f"{primitive_of(foreign[0]).name} in subtask {subtask_of(foreign[0])}"
            raise NotAPolicy(
                f"{self.name} has learned nothing of {step}, which this task's plan has; it was trained on {learned}"
            )
        self._began = None
        if self._settings.sees.kind == "cloud":
            self._points = chosen_points(self._settings.sees.points, seed)
        self.go_on(plan)

    def go_on(self, plan: Sequence[int]) -> None:
        """Goes on in the middle of an episode, as at its beginning but for what it saw then."""
        self._follower.begin(plan)
        self._frames.clear()
        self._waiting.clear()
        self._ways.clear()

    def act(self, observation: Mapping[str, Any]) -> NDArray:
        """Returns the next action: (12,) joint targets or (10,) a hand action.

        Raises:
            NotAPolicy: It is not finite.
        """
        self._see(observation)
        if not self._waiting:
            chunk = self._foretell(np.asarray(observation["agent_pos"], float)[:12])
            self._waiting = list(finite(chunk, self.folder))
        return self._waiting.pop(0)

    def _see(self, observation: Mapping[str, Any]) -> None:
        agent, sees = np.asarray(observation["agent_pos"])[None], self._settings.sees
        cloud: NDArray | None = None
        if self._points is None:
            environment = np.asarray(observation["environment_state"])[None]
            if self._began is None:
                self._began = environment[0]
            numbers = state_numbers(agent, environment, sees, self._began)
        else:
            cloud = np.asarray(observation["point_cloud"], np.float32)[self._points]
            numbers = own_numbers(agent)
            if sees.locates:
                numbers, cloud = self._network.located(robot_numbers(agent), cloud[None]), None
        frame = (numbers[0], self._follower.phase if sees.phase else 0, cloud)
        self._frames.extend([frame] * (1 if self._frames else sees.frames))

    def _way(self, numbers: Tensor, phase: Tensor) -> int:
        """Returns the way of grasping of the subtask that goes on, which it keeps to.

        Where it does not choose, it is the one that most demonstrations have.
        """
        if not self._settings.sees.chooses:
            return 0
        if self.subtask not in self._ways:
            ways = self._network(numbers[None], phase[None], None, torch.zeros_like(phase)[None]).ways
            assert ways is not None
            self._ways[self.subtask] = int(ways[0, : MOST_WAYS - 1].argmax())
        return self._ways[self.subtask]

    def _foretell(self, qpos: NDArray) -> NDArray:
        """Returns (execute, 12 or 10) the next actions.

        Where another step of the plan turns out to go on by now, they are those of that one: one that is asked what it
        does where it is done already has never been shown that.
        """
        found, logits = self._asked()
        if logits is not None:
            before, sees, (numbers, _, cloud) = self._follower.phase, self._settings.sees, self._frames[-1]
            self._follower.go_on(logits[0], shown_numbers(numbers[None], sees.places, sees.things, sees.handles)[0])
            if self._follower.phase != before:
                self._frames[-1] = (numbers, self._follower.phase, cloud)
                found, logits = self._asked()
                assert logits is not None
            self._follower.foretell(logits[self.execute - 1])
        mean, deviation = (part[self._frames[-1][1]] for part in self.record.actions)
        chunk = (found * deviation + mean)[: self.execute]
        if self._settings.acts.kind == "joint_target":
            chunk = targets_in_the_room(qpos, chunk, self.record.scale)
        return chunk

    def _asked(self) -> tuple[NDArray, NDArray | None]:
        """Returns what the network foretells: (chunk, A) actions, normalised, and (chunk, P) what goes on after each of
        them; None where it is told nothing of steps."""
        phase = torch.tensor([frame[1] for frame in self._frames])
        seen = torch.from_numpy(np.stack([frame[0] for frame in self._frames]))
        numbers = normalised(seen, phase, self._scales)
        clouds = [frame[2] for frame in self._frames if frame[2] is not None]
        cloud = torch.from_numpy(np.stack(clouds))[None] if clouds else None
        with torch.inference_mode():
            told = phase[None] if self._settings.sees.phase else None
            way = torch.full_like(phase, self._way(numbers, phase))[None]
            found, logits, _ = self._network(numbers[None], told, cloud, way)
        return found[0, -1].numpy(), None if logits is None else logits[0, -1].numpy()


def finite(actions: NDArray, policy: str) -> NDArray:
    """Returns what a policy gives, where it can be done.

    Raises:
        NotAPolicy: A number is not finite.
    """
    if not np.isfinite(actions).all():
        raise NotAPolicy(f"{policy} gives actions that are not finite: its weights are not, or what it sees is not")
    return actions
