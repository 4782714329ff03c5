"""Replay stored demonstrations: exactly, from the command log, or by actions through the environment."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from executor.data import samples
from executor.data.episode import DEMONSTRATION, Episode
from executor.data.formats.export import open_set
from executor.data.formats.selection import EVERYTHING, Selection
from executor.data.formats.store_reader import traits_of
from executor.data.store import INDEX, EpisodeStore, NotADataset, StoredEpisode, start_of
from executor.data.units import DemoUnit
from executor.data.work import noise_of, physics_of
from executor.envs import TASK_ID
from executor.rollouts.checkpoint import Checkpoint
from executor.rollouts.recording import repeat
from executor.sim.engine import STANDARD, Physics
from executor.sim.robot.actions import OPENING, hand_actions, joint_limits
from executor.system.extras import require
from executor.system.workers import serve
from oag import Scene, Task

ReplayMode = Literal["exact", "joint_target", "paper"]

WORKER = "executor.envs.demonstration_replay"
"""Module of the worker process."""

WAITS_S = 5.0
"""Time after the last action, for a goal that has to hold at rest [s]."""


@dataclass(frozen=True, slots=True)
class ReplayOutcome:
    """Result of a replayed demonstration.

    Attributes:
        good: Whether it repeated its purpose: the same states, or success.
        problem: Reason why it could not be replayed at all: the end of its process.
    """

    name: str
    good: bool
    progress: float
    problem: str = ""


def count_demonstrations(path: Path, most: int | None = None, only: Selection = EVERYTHING) -> int:
    """Return the number of demonstrations that `iterate_replays` yields, up to `most`.

    Raises:
        NotADataset: It is no data set of this program.
    """
    if is_store(path):
        return sum(1 for _ in islice(_selected(path, only), most))
    found = open_set(path).found
    count = found.train + found.validation
    return count if most is None else min(count, most)


def is_store(path: Path) -> bool:
    """Decide whether a folder is read as a store of episodes, not as an export of one."""
    return (path / INDEX).exists() or not path.is_dir()


def _selected(path: Path, only: Selection) -> Iterator[StoredEpisode]:
    """Yield the selected demonstrations of a store."""
    for episode in EpisodeStore.open(path).demonstrations():
        if not only.chosen or only.takes(traits_of(episode, episode.meta.get("pictures"))):
            yield episode


def iterate_replays(
    path: Path, mode: ReplayMode, only: Selection = EVERYTHING
) -> Iterator[Callable[[], ReplayOutcome]]:
    """Yield a function per demonstration that replays it and returns the result.

    Args:
        path: A store, or an export of one.
        mode: As for `replay_episode`; an export has no command log.
        only: Selected demonstrations of a store.

    Raises:
        NotADataset: Something of it is unreadable.
    """
    if is_store(path):
        yield from (partial(replay_episode, episode, mode) for episode in _selected(path, only))
        return
    if mode == "exact":
        raise NotADataset(f"{path} has actions, and no commands: it can be done again through the environment only")
    stream = open_set(path)
    for episode in stream.episodes():
        if episode.about["kind"] == DEMONSTRATION:
            yield partial(replay_table, episode, stream.found.rate_hz, mode)


def replay_episode(episode: StoredEpisode, mode: ReplayMode) -> ReplayOutcome:
    """Replay a stored demonstration from its own scene.

    Args:
        episode: An episode with samples.
        mode: "exact": the command log, which has to give the same states bit by bit. Otherwise the kind of actions for
            the environment, at the rate of the samples; they have to succeed as the demonstration did.

    Raises:
        NotADataset: Its samples are unreadable.
    """
    unit, rate_hz = DemoUnit.from_json(episode.meta["unit"]), float(episode.meta["record_hz"])
    physics = physics_of(unit)
    if mode == "exact":
        commands = samples.commands(episode.arrays)
        begins, noise = episode.start, noise_of(unit)
        again = repeat(episode.task, episode.scene, commands, rate_hz, physics=physics, noise=noise, start=begins)
        same = again.state_hash == episode.meta["state_hash"]
        return ReplayOutcome(episode.name, same, 1.0 if all(r.satisfied for r in again.goal_readings) else 0.0)
    targets = episode.arrays["robot_target"]
    before = np.concatenate([start_target(episode.scene, episode.start)[None], targets[:-1]])
    actions = targets if mode == "joint_target" else hand_actions(episode.scene.robot.model, before, targets)
    return replay_actions(
        episode.name, episode.task, episode.scene, actions, rate_hz, mode, physics, start=episode.start
    )


def replay_table(episode: Episode, rate_hz: float, action_mode: Literal["joint_target", "paper"]) -> ReplayOutcome:
    """Replay the actions of a data set in the environment, at the data set's rate."""
    about = episode.about
    scene, start = Scene.from_json(about["scene"]), start_of(about.get("takeover"))
    varied = (about["drawn"] or {}).get("physics")
    # The first row's targets were held at its sample; actions start from there.
    first = np.asarray(about["first_target"], np.float64)[None]
    if action_mode == "joint_target":
        actions = np.concatenate([first, episode.columns["action.joint_target"][:-1]])
    else:
        actions = np.concatenate(
            [hand_actions(scene.robot.model, start_target(scene, start)[None], first), episode.columns["action"][:-1]]
        )
    return replay_actions(
        str(about["name"]),
        Task.from_json(about["task"], scene=scene),
        scene,
        actions,
        rate_hz,
        action_mode,
        STANDARD if varied is None else Physics(**varied),
        start=start,
    )


def replay_actions(
    name: str,
    task: Task,
    scene: Scene,
    actions: NDArray[Any],
    rate_hz: float,
    action_mode: Literal["joint_target", "paper"],
    physics: Physics = STANDARD,
    *,
    start: Checkpoint | None = None,
) -> ReplayOutcome:
    """Execute actions in the environment one after the other, open loop.

    Args:
        actions: (N, J) or (N, H), see `executor.sim.robot.actions`.
        physics: Physics of the world, where the demonstration varied it.
        start: Start of the episode; by default the scene at rest.
    """
    gymnasium = require("gymnasium", "gym")
    unlimited = {"max_episode_steps": -1, "disable_env_checker": True}
    arguments = {"scene": scene, "task": task, "rate_hz": rate_hz, "action_mode": action_mode, "physics": physics}
    arguments["start"] = start
    env = gymnasium.make(TASK_ID, **arguments, **unlimited)
    try:
        env.reset(seed=0)
        info: dict[str, Any] = {"success": False, "progress": 0.0}
        for action in _then_hold(np.asarray(actions), action_mode, round(WAITS_S * rate_hz)):
            _, _, done, _, info = env.step(action)
            if done:
                break
        return ReplayOutcome(name, bool(info["success"]), float(info["progress"]))
    finally:
        env.close()


def start_target(scene: Scene, start: Checkpoint | None = None) -> NDArray[np.float64]:
    """Return the (J,) joint targets at an episode's start.

    Args:
        start: Its start; by default the scene's place, arm at home, gripper open.
    """
    if start is not None:
        return np.array([*start.target, start.finger_target_m, start.finger_target_m])
    pose, opening_m = scene.robot, joint_limits(scene.robot.model)[-1, 1]
    start_q = pose.model.start(pose.position[0], pose.position[1], pose.yaw_rad)
    return np.array([*start_q, opening_m, opening_m])


def _then_hold(actions: NDArray[Any], action_mode: str, more: int) -> Iterator[NDArray[Any]]:
    """Yield actions, and then repeatedly the one that holds everything."""
    yield from actions
    still = np.array(actions[-1])
    if action_mode == "paper":
        still[np.arange(len(still)) != OPENING] = 0.0
    for _ in range(more):
        yield still


def main() -> None:
    """Replay the demonstrations of requests until standard input ends; those of a set come in order."""
    at: tuple[str, ReplayMode, str, int] | None = None
    rest: Iterator[Callable[[], ReplayOutcome]] = iter(())

    def handle(request: dict[str, Any]) -> dict[str, Any]:
        nonlocal at, rest
        path, mode, place = str(request["set"]), request["way"], int(request["place"])
        only = str(request["only"])
        before, at = at, None  # After an error the iteration cannot continue.
        if before is None or before[:3] != (path, mode, only) or before[3] > place:
            before, rest = (path, mode, only, 0), iterate_replays(Path(path), mode, Selection.parse(only))
        replay = next(islice(rest, place - before[3], None))
        at = (path, mode, only, place + 1)
        return asdict(replay())

    serve(handle)


if __name__ == "__main__":
    main()
