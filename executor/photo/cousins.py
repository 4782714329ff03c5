"""The same scene in the form of Digital Cousins, so that what reads their reconstructions reads ours, and is a witness.

`scene_0_info.json` has the camera and every object posed relative to it, `scene_0_graph.json` what stands on what;
scene_1 and scene_2 are its variations.
Quaternions are x y z w there, and a thing's front is at its own +x, where the library's models have it at -x.
"""

from __future__ import annotations

import math

import numpy as np

import bddl
from executor.assets.footprint import yaw_of
from executor.geometry import Array, inverse, quaternion_wxyz, rotation_z, transform
from executor.photo.space.observation import Observation
from oag import Scene, SceneObject

_NEITHER = ("wall", "floor")


def cousins_files(number: int) -> tuple[str, str]:
    """Returns the names of both files of a variation; 0 is the reconstruction itself."""
    return f"scene_{number}_info.json", f"scene_{number}_graph.json"


def cousins_json(scene: Scene, seen: Observation) -> tuple[dict[str, object], dict[str, object]]:
    """Returns the contents of both files for a scene in the level frame of a picture; walls and floor are not in it."""
    T_world_camera = transform(seen.R_camera_level.T, seen.eye_m)
    w, x, y, z = (float(part) for part in quaternion_wxyz(T_world_camera))
    things = {key: obj for key, obj in scene.objects.items() if obj.category not in _NEITHER}
    objects = {
        key: {
            "category": obj.category,
            "model": obj.model,
            "bbox_extent": list(obj.extent_m),
            "tf_from_cam": (inverse(T_world_camera) @ _theirs(obj)).tolist(),
            "mount": {"floor": True, "wall": False},
        }
        for key, obj in things.items()
    }
    beneath = _beneath(scene)
    graph: dict[str, object] = {key: {"objBeneath": beneath.get(key, "floor")} for key in things}
    return {"cam_pose": [seen.eye_m.tolist(), [x, y, z, w]], "objects": objects}, graph


def _theirs(obj: SceneObject) -> Array:
    """(4, 4) pose of an upright object with its front at +x."""
    return transform(rotation_z(yaw_of(obj) + math.pi), np.asarray(obj.position))


def _beneath(scene: Scene) -> dict[str, str]:
    literals = (literal for fact in scene.facts for literal in bddl.literals(fact) or ())
    return {
        literal.atom.args[0]: literal.atom.args[1]
        for literal in literals
        if literal.value and literal.atom.predicate in ("ontop", "inside")
    }
