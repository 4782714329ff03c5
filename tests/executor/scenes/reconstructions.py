"""Files in the form that Digital Cousins writes: a camera, and objects posed relative to it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

Thing = dict[str, object]
CAMERA_M = (2.6, -0.3, 1.5)


def camera() -> np.ndarray:
    """Its pose: it looks towards -x, a little down; its own axes are right, up and backwards."""
    backwards = np.array([1.0, 0.0, 0.35]) / np.hypot(1.0, 0.35)
    right = np.array([0.0, 1.0, 0.0])
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(backwards, right), backwards], axis=1)
    T[:3, 3] = CAMERA_M
    return T


def thing(
    category: str,
    extent_m: tuple[float, float, float],
    position_m: tuple[float, float, float],
    euler_rad: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    floor: bool = True,
) -> Thing:
    """One object at a pose of the world, as the file has it."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", euler_rad).as_matrix()
    T[:3, 3] = position_m
    return {
        "category": category,
        "model": "abcdef",
        "scale": [1.02, 0.97, 1.1],
        "bbox_extent": list(extent_m),
        "tf_from_cam": (np.linalg.inv(camera()) @ T).tolist(),
        "mount": {"floor": floor, "wall": None if floor else ["walls/wall_0.png"]},
    }


def kitchen() -> dict[str, Thing]:
    """A refrigerator, a cabinet with a microwave oven on it, and a table with a glass and an apple."""
    return {
        "fridge_0": thing("fridge", (0.70, 0.64, 1.42), (0.0, -0.9, 0.73), (0.0, 0.0, 0.03)),
        "cabinet_0": thing("bottom_cabinet", (0.60, 0.88, 0.82), (0.0, 0.4, 0.43)),
        "microwave_0": thing("microwave", (0.43, 0.50, 0.29), (0.02, 0.45, 0.98)),
        "table_0": thing("breakfast_table", (0.7, 1.0, 0.68), (0.2, 2.0, 0.34)),
        "glass_0": thing("water_glass", (0.072, 0.069, 0.125), (0.45, 1.85, 0.75), (0.0, 0.0, 1.1)),
        "apple_0": thing("apple", (0.077, 0.075, 0.08), (0.42, 2.2, 0.73)),
        "picture_0": thing("picture", (0.02, 0.5, 0.4), (-0.4, 2.0, 1.5), floor=False),
    }


def write(folder: Path, objects: Mapping[str, Thing]) -> Path:
    """Write `scene_0_info.json`, and return its path."""
    T = camera()
    info = {
        "resolution": [720, 1280],
        "scene_graph": "/somewhere/else/scene_0/scene_0_graph.json",
        "cam_pose": [list(CAMERA_M), Rotation.from_matrix(T[:3, :3]).as_quat().tolist()],
        "objects": objects,
    }
    path = folder / "scene_0_info.json"
    path.write_text(json.dumps(info, indent=4))
    return path
