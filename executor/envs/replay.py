"""Does stored demonstrations again: exactly, by what the robot was told, and through the environment, by actions."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from executor.datasets import samples
from executor.datasets.formats.export import open_set
from executor.datasets.formats.stream import DEMONSTRATION, FoldedEpisode
from executor.datasets.store import INDEX, EpisodeStore, NotADataset, StoredEpisode, start_of
from executor.datasets.units import DemoUnit
from executor.datasets.work import noise_of, physics_of
from executor.envs import TASK_ID
from executor.machine.extras import require
from executor.machine.workers.process import serve
from executor.robot.actions import hand_actions, joint_limits
from executor.robot.description import ARM_HOME
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.repeat import repeat
from executor.world.physics import STANDARD, Physics
from oag import Scene, Task

Way = Literal["exact", "joint_target", "paper"]

WORKER = "executor.envs.replay"
"""The module whose processes do again what they are told the place of."""

WAITS_S = 5.0
"""After the last action, for a goal that has to hold at rest."""


@dataclass(frozen=True, slots=True)
class Redone:
    """What came of a demonstration that was done again.

    Attributes:
        name: The demonstration's.
        good: Whether it did again what it is there for: the same states, or success.
        progress: How far the task came, 0 to 1.
        problem: Why it could not be done at all: what its process ended with.
    """

    name: str
    good: bool
    progress: float
    problem: str = ""


def count_of(path: Path) -> int:
    """Returns how many demonstrations `redoings` yields.

    Raises:
        NotADataset: It is no data set of ours.
    """
    if is_store(path):
        return sum(1 for _ in EpisodeStore.open(path).demonstrations())
    found = open_set(path).found
    return found.train + found.validation


def is_store(path: Path) -> bool:
    """Decides whether a folder is to be read as a store of episodes, rather than as what was exported of one."""
    return (path / INDEX).exists() or not path.is_dir()


def redoings(path: Path, way: Way) -> Iterator[Callable[[], Redone]]:
    """Yields, demonstration by demonstration, what does it again and returns what comes of it.

    Args:
        path: A store, or a data set that was exported of one.
        way: As for `replayed`; what was exported has no command log.

    Raises:
        NotADataset: Something of it cannot be read.
    """
    if is_store(path):
        yield from (partial(replayed, episode, way) for episode in EpisodeStore.open(path).demonstrations())
        return
    if way == "exact":
        raise NotADataset(f"{path} has actions, and no commands: it can be done again through the environment only")
    stream = open_set(path)
    for episode in stream.episodes():
        if episode.about["kind"] == DEMONSTRATION:
            yield partial(replayed_rows, episode, stream.found.rate_hz, way)


def replayed(episode: StoredEpisode, way: Way) -> Redone:
    """Returns what comes of a stored demonstration when it is done again from its own scene.

    Args:
        episode: One with samples.
        way: "exact": the command log, which has to give the same states bit by bit. Else what the actions are that the
            environment is given, at the rate of the samples; they have to succeed as the demonstration did.

    Raises:
        NotADataset: Its samples cannot be read.
        MissingExtra: Gymnasium is not installed, and the environment is wanted.
    """
    unit, rate_hz = DemoUnit.from_json(episode.meta["unit"]), float(episode.meta["record_hz"])
    physics = physics_of(unit)
    if way == "exact":
        told = samples.commands(episode.arrays)
        begins, noise = episode.start, noise_of(unit)
        again = repeat(episode.task, episode.scene, told, rate_hz, physics=physics, noise=noise, start=begins)
        same = again.state_hash == episode.meta["state_hash"]
        return Redone(episode.name, same, 1.0 if all(r.satisfied for r in again.goal_readings) else 0.0)
    targets = episode.arrays["robot_target"]
    before = np.concatenate([start_target(episode.scene, episode.start)[None], targets[:-1]])
    actions = targets if way == "joint_target" else hand_actions(episode.scene.robot.scale, before, targets)
    return through_environment(
        episode.name, episode.task, episode.scene, actions, rate_hz, way, physics, start=episode.start
    )


def replayed_rows(episode: FoldedEpisode, rate_hz: float, action_mode: Literal["joint_target", "paper"]) -> Redone:
    """Returns what comes of the actions of a data set when the environment is given them, at the data set's rate.

    Args:
        episode: A demonstration, whatever format it was read of.
        rate_hz: Rows a second.
        action_mode: Which of its actions.

    Raises:
        MissingExtra: Gymnasium is not installed.
    """
    about = episode.about
    scene, start = Scene.from_json(about["scene"]), start_of(about.get("takeover"))
    varied = (about["drawn"] or {}).get("physics")
    # The first row's targets are those that were held when it was taken; actions lead on from there.
    first = np.asarray(about["first_target"], np.float64)[None]
    if action_mode == "joint_target":
        actions = np.concatenate([first, episode.columns["action.joint_target"][:-1]])
    else:
        actions = np.concatenate(
            [hand_actions(scene.robot.scale, start_target(scene, start)[None], first), episode.columns["action"][:-1]]
        )
    return through_environment(
        str(about["name"]),
        Task.from_json(about["task"], scene=scene),
        scene,
        actions,
        rate_hz,
        action_mode,
        STANDARD if varied is None else Physics(**varied),
        start=start,
    )


def through_environment(
    name: str,
    task: Task,
    scene: Scene,
    actions: NDArray[Any],
    rate_hz: float,
    action_mode: Literal["joint_target", "paper"],
    physics: Physics = STANDARD,
    *,
    start: Checkpoint | None = None,
) -> Redone:
    """Returns what comes of actions that the environment is given one after the other, without looking.

    Args:
        name: What it is called.
        task: What is to be done.
        scene: The concrete scene.
        actions: (N, 12) or (N, 10), as `executor.robot.actions` defines them.
        rate_hz: Actions a second.
        action_mode: What they are.
        physics: Of the world, where the demonstration varied it.
        start: Where it begins; by default where the scene has everything, at rest.

    Raises:
        MissingExtra: Gymnasium is not installed.
    """
    gymnasium = require("gymnasium", "gym")
    unlimited = {"max_episode_steps": -1, "disable_env_checker": True}
    told = {"scene": scene, "task": task, "rate_hz": rate_hz, "action_mode": action_mode, "physics": physics}
    told["start"] = start
    env = gymnasium.make(TASK_ID, **told, **unlimited)
    try:
        env.reset(seed=0)
        info: dict[str, Any] = {"success": False, "progress": 0.0}
        for action in _then_still(np.asarray(actions), action_mode, round(WAITS_S * rate_hz)):
            _, _, done, _, info = env.step(action)
            if done:
                break
        return Redone(name, bool(info["success"]), float(info["progress"]))
    finally:
        env.close()


def start_target(scene: Scene, start: Checkpoint | None = None) -> NDArray[np.float64]:
    """Returns the (12,) joint targets with which an episode begins.

    Args:
        scene: Its concrete scene.
        start: Where it begins; by default at the scene's place, arm at home, gripper open.
    """
    if start is not None:
        return np.array([*start.target, start.finger_target_m, start.finger_target_m])
    pose, opening_m = scene.robot, joint_limits(scene.robot.scale)[-1, 1]
    return np.array([*pose.position[:2], pose.yaw_rad, *ARM_HOME, opening_m, opening_m])


def _then_still(actions: NDArray[Any], action_mode: str, more: int) -> Iterator[NDArray[Any]]:
    """Yields actions, and then so often the one that keeps everything where it is."""
    yield from actions
    still = np.array(actions[-1])
    if action_mode == "paper":
        still[[0, 1, 2, 3, 4, 5, 7, 8, 9]] = 0.0
    for _ in range(more):
        yield still


def main() -> None:
    """Does again what requests give the places of, until standard input ends; places of a set come in order."""
    at: tuple[str, Way, int] | None = None
    rest: Iterator[Callable[[], Redone]] = iter(())

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        nonlocal at, rest
        path, way, place = str(request["set"]), request["way"], int(request["place"])
        before, at = at, None  # After an error there is nothing to go on from.
        if before is None or before[:2] != (path, way) or before[2] > place:
            before, rest = (path, way, 0), redoings(Path(path), way)
        redo = next(islice(rest, place - before[2], None))
        at = (path, way, place + 1)
        return asdict(redo())

    serve(handle)


if __name__ == "__main__":
    main()
