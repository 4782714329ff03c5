"""What a LeRobotDataset calls its files and columns, in versions 3.0 and 2.1.

Source: lerobot 0.6.1, `src/lerobot/datasets/`, for v3.0; lerobot 0.3.3 for v2.1; Isaac-GR00T's guide to data that it
reads, for `modality.json`.
"""

from __future__ import annotations

from typing import Any, Literal

from executor.datasets.footage import DEPTH
from executor.datasets.formats.stream import CLOUD, CLOUD_SHAPE, SCALARS, Survey

Version = Literal["v3.0", "v2.1"]

IN_A_CHUNK = 1000
ABOUT, LINES = "meta/scene2demo.json", "meta/scene2demo_episodes.jsonl"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
VIDEO_PATHS = {
    "v3.0": "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4",
    "v2.1": "videos/chunk-{episode_chunk:03d}/{video_key}/episode_{episode_index:06d}.mp4",
}
DATA_PATHS = {
    "v3.0": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "v2.1": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet",
}
_COUNTERS = ("timestamp", "frame_index", "episode_index", "index", "task_index")
_STATE_PARTS = {
    "base": (0, 3),
    "arm": (3, 10),
    "fingers": (10, 12),
    "hand_position": (12, 15),
    "hand_quaternion": (15, 19),
}
_ACTION_PARTS = {"hand_position": (0, 3), "hand_turn": (3, 6), "gripper": (6, 7), "base": (7, 10)}
_TARGET_PARTS = {"base_target": (0, 3), "arm_target": (3, 10), "fingers_target": (10, 12)}


def features_of(found: Survey, version: Version) -> dict[str, dict[str, Any]]:
    """Returns the features of `info.json`, in the order of the columns."""
    counters = {name: "float32" if name == "timestamp" else "int64" for name in _COUNTERS}
    features: dict[str, dict[str, Any]] = {
        name: {"dtype": "float32", "shape": [len(names)], "names": list(names)} for name, names in found.vectors.items()
    }
    if found.point_cloud:
        features[CLOUD] = {"dtype": "float32", "shape": list(CLOUD_SHAPE), "names": ["point", "x_y_z_hand"]}
    features |= {name: {"dtype": kind, "shape": [1], "names": None} for name, kind in {**SCALARS, **counters}.items()}
    channels = "channels" if version == "v3.0" else "channel"
    for view, kind in found.clips:
        width, height = found.views[view]
        told = {
            "video.height": height,
            "video.width": width,
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": whole_fps(found),
            "video.channels": 3,
            "has_audio": False,
        }
        if kind:
            told = {"is_depth_map": kind == DEPTH, **({"depth_unit": "mm"} if kind == DEPTH else {})}
        features[picture_key(view, kind)] = {
            "dtype": "image" if kind else "video",
            "shape": [height, width, 1 if kind else 3],
            "names": ["height", "width", channels],
            "info": told,
        }
    return features


def picture_key(view: str, kind: str) -> str:
    """Returns the name of the feature of a view's pictures of a kind."""
    # No policy shall take numbers of bodies for colours because of a name.
    return f"observation.{kind}.{view}" if kind else f"observation.images.{view}"


def modalities_of(found: Survey) -> dict[str, Any]:
    """Returns `modality.json`, which tells GR00T's loader what the numbers of state and actions are."""

    def parts(named: dict[str, tuple[int, int]], column: str) -> dict[str, Any]:
        return {name: {"start": first, "end": end, "original_key": column} for name, (first, end) in named.items()}

    return {
        "state": parts(_STATE_PARTS, "observation.state"),
        "action": parts(_ACTION_PARTS, "action") | parts(_TARGET_PARTS, "action.joint_target"),
        "video": {view: {"original_key": picture_key(view, "")} for view in found.views},
        "annotation": {"human.task_description": {"original_key": "task_index"}},
    }


def whole_fps(found: Survey) -> float | int:
    """Returns rows a second, as a whole number where it is one."""
    return int(found.rate_hz) if found.rate_hz.is_integer() else found.rate_hz
