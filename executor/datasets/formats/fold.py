"""One episode of a store as the rows that every format is made of, and what all episodes of a data set have in common.

Row i is what there is to see at sample i, and what was then commanded until sample i + 1; at the last sample the last
command stands. Columns, all at the rate of the recording:

    observation.state              (20) joints: base x, y (m), yaw (rad), seven of the arm (rad), two fingers (m); the
                                   point between the fingertips in the world: x y z (m), quaternion x y z w; how far
                                   the gripper is open (m)
    observation.velocity           (12) of the joints, m/s and rad/s
    observation.environment_state  (216) things and handles, as `executor.datasets.formats.observations` documents them
    observation.camera_pose_VIEW   (7) the camera in the world, where there are pictures: x y z (m), quaternion x y z w;
                                   x right, y down, z ahead
    action                         (10) `executor.robot.actions.hand_actions`
    action.joint_target            (12) where the joints shall be at the next sample, m and rad
    subtask_index, primitive_index what was going on; a primitive's number is its number in flows, 0 between primitives
    next.reward                    1 / number of subtasks in the last row of each; they add up to 1
    next.done                      true in the last row

Quaternions are x y z w, as robosuite, robomimic and LeRobot have them; inside this program they are w x y z.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.assets.library import asset_for
from executor.datasets.footage import POSES, footage_path
from executor.datasets.formats.observations import ENVIRONMENT, HANDLES, THINGS, StateReader
from executor.datasets.store import EpisodeStore, StoredEpisode
from executor.geometry import quaternions_last
from executor.robot.actions import hand_actions
from executor.robot.description import JOINT_NAMES
from executor.world.engine import TIMESTEP_S
from executor.world.world import World
from oag import Scene

HAND_ACTION_NAMES = (
    *("hand_x", "hand_y", "hand_z", "hand_turn_x", "hand_turn_y", "hand_turn_z"),
    "gripper",
    *("base_forward", "base_left", "base_turn"),
)
POSE_NAMES = ("x", "y", "z", "qx", "qy", "qz", "qw")
_THING_NAMES = (
    *("there", *POSE_NAMES, "extent_x", "extent_y", "extent_z"),
    *("grasp_x", "grasp_y", "grasp_z"),
)
_HANDLE_NAMES = ("there", "position", "share", "x", "y", "z")
ENVIRONMENT_NAMES = (
    *(f"thing{k}_{name}" for k in range(THINGS) for name in _THING_NAMES),
    *(f"handle{k}_{name}" for k in range(HANDLES) for name in _HANDLE_NAMES),
)
STATE_NAMES = (*JOINT_NAMES, *(f"hand_{name}" for name in POSE_NAMES), "gripper_opening")
_VALIDATION_OF = 10
"""One episode in so many is for validation."""


class NothingToExport(ValueError):
    """A store has no demonstrations that make one data set."""


@dataclass(frozen=True, slots=True)
class Survey:
    """What the demonstrations of a store have in common, from their `unit.json` alone.

    Attributes:
        train, validation: Names of the episodes' folders; a data set has the first, then the second.
        rate_hz: Rows a second.
        views: Cameras of which every episode has pictures of one size -> width, height.
        robot: The robot's scale, and stiffness, damping, force limit of its drives.
    """

    train: tuple[str, ...]
    validation: tuple[str, ...]
    rate_hz: float
    views: Mapping[str, tuple[int, int]]
    robot: Mapping[str, Any]

    @property
    def names(self) -> tuple[str, ...]:
        """All episodes in the order of the data set."""
        return (*self.train, *self.validation)

    def to_json(self) -> dict[str, Any]:
        """Returns what a data set says of itself beside what its format has a place for."""
        return {
            "schema": "scene2demo-export/1",
            "rate_hz": self.rate_hz,
            "episodes": {"train": len(self.train), "validation": len(self.validation)},
            "between_rows": "joint targets go linearly from row to row",
            "quaternions": "x y z w",
            "frames": "poses in the world; hand actions as seen from the base; base actions in its own axes before",
            "columns": {"action": HAND_ACTION_NAMES, "action.joint_target": JOINT_NAMES},
            "robot": self.robot,
        }


@dataclass(frozen=True, slots=True)
class FoldedEpisode:
    """One demonstration as rows.

    Attributes:
        source: The episode in the store.
        index: Its place in the data set.
        columns: Name -> one row a sample; the module's text documents each.
        task: The sentence.
        subtasks: A short sentence for each subtask; `subtask_index` counts them.
        about: What else there is to say of it, as plain data.
    """

    source: StoredEpisode
    index: int
    columns: Mapping[str, NDArray]
    task: str
    subtasks: tuple[str, ...]
    about: Mapping[str, Any]

    @property
    def length(self) -> int:
        """Number of rows."""
        return len(self.columns["action"])


def survey(store: EpisodeStore) -> Survey:
    """Returns what the demonstrations of a store have in common.

    Raises:
        NothingToExport: There are none, or they are of different rates.
        NotADataset: One of them cannot be read.
    """
    parts: tuple[list[str], list[str]] = ([], [])
    rates: set[float] = set()
    sizes: Counter[tuple[str, int, int]] = Counter()
    robot: Mapping[str, Any] = {}
    for episode in store.demonstrations():
        parts[is_for_validation(str(episode.meta["id"]))].append(episode.name)
        rates.add(_rate_hz(float(episode.meta["record_hz"])))
        sizes.update((view, *size) for view, size in _pictured(episode).items())
        robot = episode.meta["robot"]
    count = len(parts[0]) + len(parts[1])
    if not count:
        raise NothingToExport(f"{store.path} has no success with samples, and only these are exported")
    if len(rates) > 1:
        found = ", ".join(f"{rate:g}" for rate in sorted(rates))
        raise NothingToExport(
            f"{store.path} has episodes of {found} samples a second, and a data set has one rate; generate them into a "
            "store each"
        )
    views = {view: (width, height) for (view, width, height), seen in sorted(sizes.items()) if seen == count}
    return Survey(tuple(parts[0]), tuple(parts[1]), rates.pop(), views, robot)


def is_for_validation(episode_id: str) -> bool:
    """Decides which part of a data set an episode is in: it follows from its id, whatever else there is."""
    return int(episode_id[:8], 16) % _VALIDATION_OF == 0


def folded(store: EpisodeStore, found: Survey) -> Iterator[FoldedEpisode]:
    """Yields the episodes of a data set in order; one at a time is in memory.

    Raises:
        NotADataset: One of them cannot be read.
    """
    for index, name in enumerate(found.names):
        yield fold(store.episode(name), index, found)


def fold(episode: StoredEpisode, index: int, found: Survey) -> FoldedEpisode:
    """Returns an episode as rows.

    Args:
        episode: A success with samples.
        index: Its place in the data set.
        found: What all episodes of the set have in common.

    Raises:
        NotADataset: Its samples cannot be read.
    """
    arrays, meta = episode.arrays, episode.meta
    qpos, targets = arrays["robot_qpos"], arrays["robot_target"]
    count = len(qpos)
    after = np.concatenate([targets[1:], targets[-1:]])
    rewards = np.zeros(count, np.float32)
    for span in (entry["span"] for entry in meta["subtasks"]):
        rewards[span[1] - 1] = 1.0 / len(meta["subtasks"])
    done = np.zeros(count, np.bool_)
    done[-1] = True
    environment, rows = _environment(episode)
    opening = qpos[:, 10:12].sum(axis=1, keepdims=True)
    state = np.concatenate([qpos, quaternions_last(arrays["eef_pose"]), opening], axis=1, dtype=np.float32)
    return FoldedEpisode(
        source=episode,
        index=index,
        columns={
            "observation.state": state,
            "observation.velocity": arrays["robot_qvel"].astype(np.float32),
            "observation.environment_state": environment,
            **{camera_column(view): quaternions_last(arrays[f"{POSES}{view}"]) for view in found.views},
            "action": hand_actions(targets, after).astype(np.float32),
            "action.joint_target": after.astype(np.float32),
            "subtask_index": arrays["subtask"].astype(np.int64),
            "primitive_index": _primitives(meta, count),
            "next.reward": rewards,
            "next.done": done,
        },
        task=str(meta["query"]),
        subtasks=tuple(entry["name"].replace("_", " ") for entry in meta["subtasks"]),
        about={**_about(episode, index, count), **rows},
    )


def camera_column(view: str) -> str:
    """Returns the name of the column that says where a camera was."""
    return f"observation.camera_pose_{view}"


def object_poses(episode: StoredEpisode) -> dict[str, NDArray[np.float32]]:
    """Returns id -> (N, 7) position and quaternion w x y z of what can be moved, in the recording's order."""
    poses = episode.arrays["object_poses"]
    return {name: poses[:, k] for k, name in enumerate(episode.meta["object_ids"])}


def joint_positions(episode: StoredEpisode) -> dict[str, NDArray[np.float32]]:
    """Returns id -> (N, J) joints of everything that has some, in the recording's order."""
    ends = np.cumsum(list(_joint_counts(episode).values()), dtype=int)
    parts = np.split(episode.arrays["joint_positions"], ends[:-1], axis=1) if len(ends) else []
    return dict(zip(episode.meta["joint_ids"], parts, strict=True))


def _joint_counts(episode: StoredEpisode) -> dict[str, int]:
    objects = Scene.from_json(episode.meta["scene"]).objects
    return {name: len(asset_for(objects[name]).joints) for name in episode.meta["joint_ids"]}


def _pictured(episode: StoredEpisode) -> dict[str, tuple[int, int]]:
    """Returns the views of which there are pictures, and their size."""
    drawn = (episode.meta.get("pictures") or {}).get("views", {})
    return {
        view: (int(told["size"][0]), int(told["size"][1]))
        for view, told in drawn.items()
        if footage_path(episode.path, view).is_file()
    }


def _rate_hz(asked_hz: float) -> float:
    """Returns the rate of samples: they are whole physics steps apart, which is not always what was asked for."""
    return round(1.0 / (max(round(1.0 / (asked_hz * TIMESTEP_S)), 1) * TIMESTEP_S), 6)


def _environment(episode: StoredEpisode) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Returns (N, ENVIRONMENT) what is around the robot at each sample, and what its rows are of."""
    states = episode.arrays["packed_states"]
    found = np.empty((len(states), ENVIRONMENT), np.float32)
    with World(episode.scene) as world:
        reader = StateReader(world, episode.task)
        for row, state in enumerate(states):
            world.unpack(state.tobytes())
            found[row] = reader.environment()
    return found, {"things": reader.things, "handles": reader.handles}


def _primitives(meta: Mapping[str, Any], count: int) -> NDArray[np.int64]:
    """Returns (N,) the number of the primitive that was running; 0 where none was."""
    numbers = np.zeros(count, np.int64)
    for subtask in meta["subtasks"]:
        for step in subtask["steps"]:
            action = step["action"]
            if step["span"] is not None:
                numbers[slice(*step["span"])] = int(next(iter(action)) if isinstance(action, dict) else action)
    return numbers


def _about(episode: StoredEpisode, index: int, count: int) -> dict[str, Any]:
    meta = episode.meta
    told = ("id", "name", "query", "state_hash", "certificate", "verdict", "scaled", "simulated_s")
    return {
        "episode_index": index,
        "length": count,
        **{name: meta[name] for name in told},
        "unit": meta["unit"],
        "validation": is_for_validation(str(meta["id"])),
        "task_detail": meta["task"]["task_detail_message"],
        "drawn": meta.get("drawn"),
        "pictures": meta.get("pictures"),
        "subtasks": [
            {
                **{name: entry[name] for name in ("name", "detail", "init", "goal", "span")},
                "steps": [{name: step[name] for name in ("primitive", "text", "span")} for step in entry["steps"]],
            }
            for entry in meta["subtasks"]
        ],
    }
