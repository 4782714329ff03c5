"""Data sets: the common properties of their episodes, and a stream of them."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from bddl.files import open_input
from bddl.terminal import pluralize
from executor.data.episode import Episode, camera_column
from executor.data.state_readers import HANDLES, POINTS, THINGS
from executor.data.views import DEPTH, SEGMENTATION
from oag.model.robots import Robot, robot_of_record

SCHEMA = "scene2demo-export/2"
Extra = Literal["depth", "segmentation", "point_cloud", "corrections"]
"""Optional contents of a data set."""

Repeats = tuple[tuple[str, str], ...]
"""Names of duplicate episodes, each with the name of the kept one."""

_MOST_NAMED = 3
CHANNELS = (DEPTH, SEGMENTATION)
"""Kinds of pictures besides colours, (H, W) uint16; the kind of colours is ""."""

_HAND_ACTION_NAMES = (
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
CLOUD_SHAPE = (POINTS, 4)
MOST_EPISODE_BYTES = 128_000_000
"""Limit for the numbers of an episode that is read back: over an hour at 10 rows per second, without clouds."""
_LONGEST_LINE_BYTES = 8_000_000
_MOST_THINGS = 1000  # Limit of an episode.


@dataclass(frozen=True, slots=True)
class DatasetSpec:
    """Common properties of all episodes of a data set.

    Attributes:
        train, validation, corrections: Number of episodes for each; they come in this order.
        rate_hz: Rows per second.
        views: Cameras of which every episode has pictures of one size -> width, height.
        channels: Kinds of pictures besides colours in each of these views.
        objects, joints: Rows for objects and numbers for joints of articulated objects.
        point_cloud: Whether there are point clouds.
        robot: Which one it is (`oag.model.robots.record_of_robot`), and stiffness, damping and force limit of each
            joint's drive.
        repeats: Omitted episodes of a store, each with the one whose states, sentence and pictures it duplicates.
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
        """Number of episodes."""
        return self.train + self.validation + self.corrections

    @property
    def splits(self) -> dict[str, range]:
        """Name of a split -> numbers of its episodes."""
        learnt = self.train + self.validation
        return {
            "train": range(self.train),
            "validation": range(self.train, learnt),
            "corrections": range(learnt, self.count),
        }

    @property
    def robot_record(self) -> Robot:
        """The robot's record."""
        return robot_of_record(self.robot)

    @property
    def vectors(self) -> dict[str, tuple[str, ...]]:
        """Columns of float32 numbers -> names of the numbers, in the order of the columns."""
        joints = self.robot_record.joint_names
        objects = (f"object{k}_{name}" for k in range(self.objects) for name in POSE_NAMES)
        found = {
            "observation.state": (*joints, *(f"hand_{name}" for name in POSE_NAMES), "gripper_opening"),
            "observation.velocity": joints,
            "observation.environment_state": ENVIRONMENT_NAMES,
            "observation.object_poses": tuple(objects),
            "observation.joint_positions": tuple(f"joint{k}" for k in range(self.joints)),
            **{camera_column(view): POSE_NAMES for view in self.views},
            "action": (*_HAND_ACTION_NAMES, *(["lift"] if self.robot_record.lift_m else [])),
            "action.joint_target": joints,
        }
        return {name: numbers for name, numbers in found.items() if numbers}

    def check_length(self, count: int) -> int:
        """Return the number of rows of an episode, if that many can be read.

        Raises:
            ValueError: They would take too much memory.
        """
        numbers = sum(map(len, self.vectors.values())) + (math.prod(CLOUD_SHAPE) if self.point_cloud else 0)
        if not 0 < count <= (most := MOST_EPISODE_BYTES // (4 * numbers)):
            raise ValueError(f"an episode has {count} rows: expected 1 to {most}")
        return count

    @property
    def clips(self) -> tuple[tuple[str, str], ...]:
        """View and kind of all pictures of each episode."""
        return tuple((view, kind) for view in self.views for kind in ("", *self.channels))

    def to_json(self) -> dict[str, Any]:
        """Return the metadata of a data set that its format has no place for."""
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
    def from_json(cls, value: Mapping[str, Any]) -> DatasetSpec:
        """Parse the data that `to_json` returned.

        Raises:
            ValueError, KeyError, TypeError: It is no such data.
        """
        if value["schema"] != SCHEMA:
            raise ValueError(f"it is of {value['schema']!r}, this program reads {SCHEMA!r}")
        episodes = value["episodes"]
        for name, number in {"objects": value["objects"], "joints": value["joints"]}.items():
            if not 0 <= int(number) <= _MOST_THINGS:
                raise ValueError(f"its episodes have {number} {name}: expected at most {_MOST_THINGS}")
        return cls(
            train=int(episodes["train"]),
            validation=int(episodes["validation"]),
            corrections=int(episodes["corrections"]),
            rate_hz=float(value["rate_hz"]),
            views={view: (int(width), int(height)) for view, (width, height) in value["views"].items()},
            channels=tuple(kind for kind in CHANNELS if kind in value["channels"]),
            objects=int(value["objects"]),
            joints=int(value["joints"]),
            point_cloud=bool(value["point_cloud"]),
            robot=value["robot"],
        )


@dataclass(frozen=True)
class EpisodeStream:
    """A data set, whatever its format.

    Attributes:
        found: Common properties of its episodes.
        episodes: Starts an iteration over them; one at a time is in memory.
        page: Text of its card, without the header for readers of formats; empty for an export that is read.
    """

    found: DatasetSpec
    episodes: Callable[[], Iterator[Episode]]
    page: str = ""


def repeats_text(repeats: Repeats) -> str:
    """Describe which episodes are omitted as duplicates."""
    named = "; ".join(f"{again} repeats {first}" for again, first in repeats[:_MOST_NAMED])
    more = len(repeats) - _MOST_NAMED
    return f"{pluralize(len(repeats), 'demonstration')} left out: {named}{f'; and {more} more' if more > 0 else ''}"


def read_metadata_lines(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the metadata of each episode of a file, line by line.

    Raises:
        OSError: It is unreadable.
        ValueError: A line is no JSON, or too long.
    """
    with open_input(path) as lines:
        while line := lines.readline(_LONGEST_LINE_BYTES + 1):
            if len(line) > _LONGEST_LINE_BYTES:
                raise ValueError(f"a line of {path.name} is longer than {_LONGEST_LINE_BYTES // 1_000_000} MB")
            try:
                yield json.loads(line)
            except RecursionError:
                raise ValueError(f"a line of {path.name} is nested too deeply") from None
