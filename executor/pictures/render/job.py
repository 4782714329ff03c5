"""A rendering job on disk: the scene, the cameras and the packed states that a worker process draws.

Workers get paths and numbers as JSON lines; nothing is pickled, and a worker that dies takes no state with it.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from executor.pictures.pinhole import Camera
from executor.pictures.render.frames import create_frames, view_size
from oag import Scene

_SCENE, _STATES, _CAMERAS = "scene.json", "states.npy", "cameras.json"


@dataclass(frozen=True, slots=True)
class Job:
    """What a worker reads from a job's folder.

    Attributes:
        scene: The concrete scene.
        cameras: What to draw with.
        sizes: Camera name -> width and height.
        states: (N, L) uint8, one packed physical state a row.
        shadows: Whether to draw shadows.
    """

    scene: Scene
    cameras: tuple[Camera, ...]
    sizes: dict[str, tuple[int, int]]
    states: np.ndarray
    shadows: bool


def write_job(
    folder: Path,
    scene: Scene,
    cameras: Iterable[Camera],
    states: Sequence[bytes],
    size: tuple[int, int],
    *,
    shadows: bool,
) -> None:
    """Writes a job, and empty arrays for its pictures, into a folder.

    Raises:
        ValueError: When there are no states, or they differ in length.
    """
    lengths = {len(state) for state in states}
    if len(lengths) != 1:
        raise ValueError(f"expected packed states of one length, got {sorted(lengths) or 'none'}")
    cameras = tuple(cameras)
    rows = np.frombuffer(b"".join(states), dtype=np.uint8).reshape(len(states), -1)
    np.save(folder / _STATES, rows)
    (folder / _SCENE).write_text(json.dumps(scene.to_json()), encoding="utf-8")
    described = {
        "shadows": shadows,
        "cameras": [
            {
                "name": camera.name,
                "mount": camera.mount,
                "pose": camera.T_mount_camera.tolist(),
                "fov_y_rad": camera.fov_y_rad,
                "near_m": camera.near_m,
                "far_m": camera.far_m,
                "size": view_size(camera.name, size),
            }
            for camera in cameras
        ],
    }
    (folder / _CAMERAS).write_text(json.dumps(described), encoding="utf-8")
    create_frames(folder, (camera.name for camera in cameras), len(states), size)


def read_job(folder: Path) -> Job:
    """Returns the job that `write_job` left in a folder."""
    described = json.loads((folder / _CAMERAS).read_text(encoding="utf-8"))
    cameras = tuple(
        Camera(
            entry["name"],
            entry["mount"],
            np.array(entry["pose"], dtype=float),
            entry["fov_y_rad"],
            entry["near_m"],
            entry["far_m"],
        )
        for entry in described["cameras"]
    )
    return Job(
        scene=Scene.from_json(folder / _SCENE),
        cameras=cameras,
        sizes={entry["name"]: tuple(entry["size"]) for entry in described["cameras"]},
        states=np.load(folder / _STATES),
        shadows=described["shadows"],
    )
