"""Episodes as rows: what every format is written from, and what every format gives back when it is read.

Row i is what there is to see at sample i, and what was then commanded until sample i + 1; at the last sample the last
command stands. Columns, all at the rate of the recording:

    observation.state              (20) joints: base x, y (m), yaw (rad), seven of the arm (rad), two fingers (m); the
                                   point between the fingertips in the world: x y z (m), quaternion x y z w; how far
                                   the gripper is open (m)
    observation.velocity           (12) of the joints, m/s and rad/s
    observation.environment_state  (216) things and handles, as `executor.datasets.formats.observations` documents them
    observation.object_poses       (7 M) what can be moved, in the order of the episode's `object_ids`: x y z (m) in the
                                   world, quaternion x y z w; M is the most that an episode of the set has, and what
                                   is not used is 0
    observation.joint_positions    (J) joints of the articulated objects (rad or m), in the order of `joint_names`
    observation.camera_pose_VIEW   (7) the camera in the world, where there are pictures: x y z (m), quaternion x y z w;
                                   x right, y down, z ahead
    observation.point_cloud        (1024, 4) where it was asked for: x y z in the robot's base (m), 1 on the hand;
                                   `executor.datasets.formats.clouds`
    action                         (10) `executor.robot.actions.hand_actions`
    action.joint_target            (12) where the joints shall be at the next sample, m and rad
    subtask_index, primitive_index what was going on; a primitive's number is its number in flows, 0 between primitives
    next.reward                    1 / number of subtasks in the last row of each; of a demonstration they add up to 1
    next.done                      true in the last row

Quaternions are x y z w, as robosuite, robomimic and LeRobot have them; inside this program they are w x y z.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from bddl.files import opened
from bddl.visible import counted
from executor.datasets.footage import DEPTH, SEGMENTATION
from executor.datasets.formats.clouds import POINTS
from executor.datasets.formats.observations import HANDLES, THINGS
from executor.datasets.formats.videos import Clip
from executor.robot.description import JOINT_NAMES

SCHEMA = "scene2demo-export/2"
Extra = Literal["depth", "segmentation", "point_cloud", "corrections"]
"""What a data set has only where it was asked for."""

Repeats = tuple[tuple[str, str], ...]
"""Names of episodes that say again what others say, each with the one that counts."""

_MOST_NAMED = 3
CHANNELS = (DEPTH, SEGMENTATION)
"""Kinds of pictures beside colours, (H, W) uint16; the kind of colours is ""."""

DEMONSTRATION, CORRECTION, FAILURE = "demonstration", "correction", "failure"
"""Kinds of episodes: what reached its goal, what failed and was put right, and what failed in the end."""

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
CLOUD = "observation.point_cloud"
CLOUD_SHAPE = (POINTS, 4)
MOST_EPISODE_BYTES = 128_000_000
"""Of the numbers of an episode that is read back: more than an hour at 10 rows a second, without clouds."""
MOST_SIDE_PX = 1024
"""Of pictures, as `executor.datasets.units.Recording` has them."""
_LONGEST_LINE_BYTES = 8_000_000
_MOST_THINGS, _MOST_VIEWS = 1000, 32  # Of an episode.
SCALARS = {"subtask_index": "int64", "primitive_index": "int64", "next.reward": "float32", "next.done": "bool"}
"""Columns of one number -> its kind."""


@dataclass(frozen=True, slots=True)
class Survey:
    """What all episodes of a data set have in common.

    Attributes:
        train, validation, corrections: How many there are for what; in this order they come.
        rate_hz: Rows a second.
        views: Cameras of which every episode has pictures of one size -> width, height.
        channels: Kinds of pictures beside colours that each of these views has.
        objects, joints: Rows for objects and numbers for joints of articulated objects.
        point_cloud: Whether there are point clouds.
        robot: The robot's scale, and stiffness, damping and force limit of each joint's drive.
        repeats: Of a store, episodes that are left out, each with the one whose states, sentence and pictures it has.
    """

    train: int
    validation: int
    corrections: int
    rate_hz: float
    views: Mapping[str, tuple[int, int]]
    channels: tuple[str, ...]
    objects: int
    joints: int
    point_cloud: bool
    robot: Mapping[str, Any]
    repeats: Repeats = ()

    @property
    def count(self) -> int:
        """How many episodes there are."""
        return self.train + self.validation + self.corrections

    @property
    def splits(self) -> dict[str, range]:
        """Name of a part -> the numbers of its episodes."""
        learnt = self.train + self.validation
        return {
            "train": range(self.train),
            "validation": range(self.train, learnt),
            "corrections": range(learnt, self.count),
        }

    @property
    def vectors(self) -> dict[str, tuple[str, ...]]:
        """Columns of float32 numbers -> the numbers' names, in the order of the columns."""
        objects = (f"object{k}_{name}" for k in range(self.objects) for name in POSE_NAMES)
        found = {
            "observation.state": STATE_NAMES,
            "observation.velocity": JOINT_NAMES,
            "observation.environment_state": ENVIRONMENT_NAMES,
            "observation.object_poses": tuple(objects),
            "observation.joint_positions": tuple(f"joint{k}" for k in range(self.joints)),
            **{camera_column(view): POSE_NAMES for view in self.views},
            "action": HAND_ACTION_NAMES,
            "action.joint_target": JOINT_NAMES,
        }
        return {name: numbers for name, numbers in found.items() if numbers}

    def check_length(self, count: int) -> int:
        """Return how many rows an episode has, where that many can be read.

        Raises:
            ValueError: They would take too much memory.
        """
        numbers = sum(map(len, self.vectors.values())) + (math.prod(CLOUD_SHAPE) if self.point_cloud else 0)
        if not 0 < count <= (most := MOST_EPISODE_BYTES // (4 * numbers)):
            raise ValueError(f"an episode has {count} rows: expected 1 to {most}")
        return count

    @property
    def clips(self) -> tuple[tuple[str, str], ...]:
        """View and kind of all the pictures that each episode has."""
        return tuple((view, kind) for view in self.views for kind in ("", *self.channels))

    def to_json(self) -> dict[str, Any]:
        """Returns what a data set says of itself beside what its format has a place for."""
        return {
            "schema": SCHEMA,
            "rate_hz": self.rate_hz,
            "episodes": {name: len(numbers) for name, numbers in self.splits.items()},
            "between_rows": "joint targets go linearly from row to row",
            "quaternions": "x y z w",
            "frames": "poses in the world; hand actions as seen from the base; base actions in its own axes before",
            "columns": {name: list(numbers) for name, numbers in self.vectors.items()},
            "objects": self.objects,
            "joints": self.joints,
            "point_cloud": self.point_cloud,
            "views": {view: list(size) for view, size in self.views.items()},
            "channels": list(self.channels),
            "robot": self.robot,
        }

    @classmethod
    def from_json(cls, value: Mapping[str, Any]) -> Survey:
        """Returns the survey that `to_json` gave.

        Raises:
            ValueError, KeyError, TypeError: It did not give this.
        """
        if value["schema"] != SCHEMA:
            raise ValueError(f"it is of {value['schema']!r}, this program reads {SCHEMA!r}")
        episodes = value["episodes"]
        for name, number in {"objects": value["objects"], "joints": value["joints"]}.items():
            if not 0 <= int(number) <= _MOST_THINGS:
                raise ValueError(f"its episodes have {number} {name}: expected at most {_MOST_THINGS}")
        sides = [int(side) for size in value["views"].values() for side in size]
        if len(value["views"]) > _MOST_VIEWS or not all(0 < side <= MOST_SIDE_PX for side in sides):
            raise ValueError(f"it has pictures of more than {_MOST_VIEWS} views, or of more than {MOST_SIDE_PX} pixels")
        return cls(
            train=int(episodes["train"]),
            validation=int(episodes["validation"]),
            corrections=int(episodes["corrections"]),
            rate_hz=float(value["rate_hz"]),
            views={_file_name(view): (int(width), int(height)) for view, (width, height) in value["views"].items()},
            channels=tuple(kind for kind in CHANNELS if kind in value["channels"]),
            objects=int(value["objects"]),
            joints=int(value["joints"]),
            point_cloud=bool(value["point_cloud"]),
            robot=value["robot"],
        )


@dataclass(frozen=True, slots=True)
class FoldedEpisode:
    """One episode as rows.

    Attributes:
        index: Its place in the data set.
        columns: Name -> one row a sample; the module's text documents each.
        clips: View and kind -> its pictures, one a row. Those that are read of a file may be read until the next
            episode is asked for.
        about: What else there is to say of it, as plain data; `docs/datasets.md` documents it.
    """

    index: int
    columns: Mapping[str, NDArray[Any]]
    clips: Mapping[tuple[str, str], Clip]
    about: Mapping[str, Any]

    @property
    def length(self) -> int:
        """Number of rows."""
        return len(self.columns["action"])

    @property
    def task(self) -> str:
        """The sentence."""
        return str(self.about["query"])

    @property
    def subtasks(self) -> tuple[str, ...]:
        """A short sentence for each subtask; `subtask_index` counts them."""
        return tuple(entry["name"].replace("_", " ") for entry in self.about["subtasks"])


@dataclass(frozen=True)
class EpisodeStream:
    """A data set, whatever it is kept in.

    Attributes:
        found: What its episodes have in common.
        episodes: Begins to go through them; one at a time is in memory.
        page: The text of its card, without what stands before it for readers of formats.
    """

    found: Survey
    episodes: Callable[[], Iterator[FoldedEpisode]]
    page: str


def repeats_text(repeats: Repeats) -> str:
    """Return in words which episodes are left out since they repeat others."""
    named = "; ".join(f"{again} repeats {first}" for again, first in repeats[:_MOST_NAMED])
    more = len(repeats) - _MOST_NAMED
    return f"{counted(len(repeats), 'demonstration')} left out: {named}{f'; and {more} more' if more > 0 else ''}"


def camera_column(view: str) -> str:
    """Returns the name of the column that says where a camera was."""
    return f"observation.camera_pose_{view}"


def told_rows(about: Mapping[str, Any], count: int) -> dict[str, NDArray[Any]]:
    """Return the columns that follow from what is said of an episode: what was going on, reward, and the end.

    Args:
        about: Its `length`, `kind` and `subtasks` with their spans.
        count: How many rows it has.

    Raises:
        ValueError: It is said to have another length.
    """
    if about["length"] != count:
        raise ValueError(f"an episode is said to have {about['length']} rows, and has {count}")
    subtasks = about["subtasks"]
    found = {name: np.zeros(count, dtype) for name, dtype in SCALARS.items()}
    for number, entry in enumerate(subtasks):
        if entry["span"] is None:
            continue
        first, end = entry["span"]
        found["subtask_index"][first:end] = number
        if about["kind"] == DEMONSTRATION:
            found["next.reward"][end - 1] = 1.0 / len(subtasks)
        for step in entry["steps"]:
            if step["span"] is not None:
                action = step["action"]
                running = int(next(iter(action)) if isinstance(action, dict) else action)
                found["primitive_index"][slice(*step["span"])] = running
    found["next.done"][-1] = True
    return found


def about_text(about: Mapping[str, Any]) -> str:
    """Returns what is said of an episode as a line of JSON, without the end of the line."""
    return json.dumps(about, ensure_ascii=False, allow_nan=False)


def about_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yields what a file says of each episode, line by line.

    Raises:
        OSError: It cannot be read.
        ValueError: A line is no JSON, or too long.
    """
    with opened(path) as lines:
        while line := lines.readline(_LONGEST_LINE_BYTES + 1):
            if len(line) > _LONGEST_LINE_BYTES:
                raise ValueError(f"a line of {path.name} is longer than {_LONGEST_LINE_BYTES // 1_000_000} MB")
            try:
                yield json.loads(line)
            except RecursionError:
                raise ValueError(f"a line of {path.name} is nested too deeply") from None


def _file_name(name: str) -> str:
    """Returns a name that a file says and that becomes a part of paths.

    Raises:
        ValueError: It is none.
    """
    if not name.isidentifier():
        raise ValueError(f"{name!r} is no name of a view")
    return name
