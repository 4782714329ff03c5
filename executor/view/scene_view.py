"""A scene as a page in which it can be turned, by the viewer that trimesh brings."""

from __future__ import annotations

from typing import Any

import numpy as np

from executor.assets.asset_geometry import shape_mesh
from executor.assets.library import asset_for
from executor.geometry import Array, rotation_z, transform, transform_from_quaternion
from executor.sim.render.cameras import joints_at_start, link_frames
from executor.system.extras import require
from oag import Scene

_AROUND_M, _THICK_M = 0.5, 0.01  # How far the floor goes beyond what stands on it, and how thick it is drawn.
_ROBOT_M = (0.45, 0.35, 0.5)  # A box for the robot's base; the arm would hide what is in front of it.
_FLOOR, _ROBOT = (0.35, 0.34, 0.32), (0.04, 0.22, 0.55)
_SHINE = 0.12
_UPRIGHT = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])  # The viewer has y up.
_VIEW_FROM = (-0.55, -0.35, 1.0)  # Direction to the camera: from behind the robot, high enough to look over walls.


def scene_page(scene: Scene) -> str:
    """Return a scene as a self-contained HTML page; it asks no network.

    Raises:
        MissingExtra: trimesh is not installed.
        AssetError: An object cannot be built.
    """
    drawn = scene_meshes(scene)
    middle = np.array([*drawn.bounds.mean(axis=0)[:2], -_THICK_M / 2.0])
    drawn.apply_transform(_UPRIGHT)
    drawn.camera_transform = _UPRIGHT @ _looking_at(middle, float(np.linalg.norm(drawn.extents)))
    viewer = require("trimesh.viewer.notebook", "sim")
    return str(viewer.scene_to_html(drawn))


def scene_meshes(scene: Scene) -> Any:
    """Return the things of a scene, a floor, and a box for the robot's base as a scene of trimesh, z up.

    Raises:
        MissingExtra: trimesh is not installed.
        AssetError: An object cannot be built.
    """
    trimesh = require("trimesh", "sim")
    drawn = trimesh.Scene()
    for name, thing in scene.objects.items():
        asset = asset_for(thing)
        T_world_root = transform_from_quaternion(thing.position, thing.orientation)
        frames = link_frames(asset, joints_at_start(thing, asset))
        for link in asset.links:
            for number, shape in enumerate(link.shapes):
                if shape.visible and shape.kind != "convex":
                    mesh = shape_mesh(shape).apply_transform(T_world_root @ frames[link.name])
                    drawn.add_geometry(_colored(mesh, shape.color), node_name=f"{name}/{link.name}/{number}")
    low, high = drawn.bounds if not drawn.is_empty else np.zeros((2, 3))
    size = (*(high - low)[:2] + 2.0 * _AROUND_M, _THICK_M)
    middle = np.array([*(low + high)[:2] / 2.0, -_THICK_M / 2.0])
    box = trimesh.creation.box
    drawn.add_geometry(_colored(box(size).apply_translation(middle), _FLOOR), node_name="floor")
    base = transform(rotation_z(scene.robot.yaw_rad), (*scene.robot.position[:2], _ROBOT_M[2] / 2.0))
    drawn.add_geometry(_colored(box(_ROBOT_M).apply_transform(base), _ROBOT), node_name="robot")
    return drawn


def _looking_at(middle: Array, distance_m: float) -> Array:
    """Return the (4, 4) pose of a camera, x right, y up, z back, that looks at a point with the world's z up."""
    back = np.asarray(_VIEW_FROM) / np.linalg.norm(_VIEW_FROM)
    right = np.cross((0.0, 0.0, 1.0), back)
    right /= np.linalg.norm(right)
    return transform(np.stack([right, np.cross(back, right), back], axis=1), middle + distance_m * back)


def _colored(mesh: Any, linear_rgb: tuple[float, ...]) -> Any:
    """Paint a mesh, partly as if it shone: the viewer has a single lamp."""
    visual = require("trimesh.visual", "sim")
    rgb = np.clip(np.asarray(linear_rgb[:3]), 0.0, 1.0)
    alpha = linear_rgb[3] if len(linear_rgb) > 3 else 1.0
    material = visual.material.PBRMaterial(
        baseColorFactor=[*rgb, alpha],
        emissiveFactor=_SHINE * rgb,
        metallicFactor=0.0,
        roughnessFactor=1.0,
        alphaMode="OPAQUE" if alpha == 1.0 else "BLEND",
        doubleSided=True,
    )
    mesh.visual = visual.TextureVisuals(material=material)
    return mesh
