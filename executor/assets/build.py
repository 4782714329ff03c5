"""Turns an asset's data into bodies of a SAPIEN scene, for physics and, where there is a renderer, for cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from bddl.files import write_atomically
from executor.assets.model import Asset, Joint, Link, Vector
from executor.assets.transforms import upright, x_axis_onto
from executor.assets.visuals import Paint, drawn_link, own_color
from executor.geometry import Array, pose_vector
from executor.machine.extras import load_sapien
from executor.machine.files import cache_dir, content_key

BRAKE = 1e5
"""Nms/rad or Ns/m up to the friction: under a push that does not move it a joint creeps by 0.3 mm/s at the most."""


@dataclass(frozen=True, slots=True)
class Built:
    """The bodies of one object.

    Attributes:
        root: The entity whose pose is the object's pose.
        bodies: Link name -> physics component.
        articulation: The articulation, or None for a single body.
    """

    root: Any
    bodies: Mapping[str, Any]
    articulation: Any | None


def build_asset(
    sapien_scene: Any,
    object_id: str,
    asset: Asset,
    T_world_root: Array,
    *,
    visual: bool,
    gravity: bool = True,
    paint: Paint | None = None,
) -> Built:
    """Adds an object to a scene and returns its bodies.

    Args:
        sapien_scene: A `sapien.Scene`, with a render system where `visual` is true.
        object_id: The object's name in the scene.
        asset: What to build.
        T_world_root: (4, 4) pose of the root link's frame.
        visual: Whether cameras shall see it; false touches no render class.
        gravity: Whether gravity acts on a dynamic body.
        paint: Says what a shape looks like; by default the asset's colours.
    """
    vector = pose_vector(T_world_root)
    pose = load_sapien().Pose(vector[:3], vector[3:])
    if asset.motion == "articulated":
        built = _build_articulation(sapien_scene, object_id, asset, pose)
    else:
        built = _build_body(sapien_scene, object_id, asset, pose, gravity=gravity)
    if visual:
        for link in asset.links:
            built.bodies[link.name].entity.add_component(drawn_link(link.shapes, paint or own_color))
    return built


def _build_body(scene: Any, object_id: str, asset: Asset, pose: Any, *, gravity: bool) -> Built:
    builder = scene.create_actor_builder()
    _add_shapes(builder, asset.links[0])
    builder.set_physx_body_type(asset.motion)
    builder.set_initial_pose(pose)
    entity = builder.build(name=object_id)
    body = entity.find_component_by_type(load_sapien().physx.PhysxRigidBaseComponent)
    if asset.motion == "dynamic":
        body.set_angular_damping(asset.angular_damping)
        body.set_linear_damping(asset.linear_damping)
        body.set_disable_gravity(not gravity)
    return Built(root=entity, bodies={asset.links[0].name: body}, articulation=None)


def _build_articulation(scene: Any, object_id: str, asset: Asset, pose: Any) -> Built:
    builder = scene.create_articulation_builder()
    builder.set_initial_pose(pose)
    links = {asset.links[0].name: builder.create_link_builder()}
    joint_of = {joint.child: joint for joint in asset.joints}
    for link in asset.links:
        if link.name not in links:
            links[link.name] = builder.create_link_builder(links[joint_of[link.name].parent])
            _add_joint(links[link.name], joint_of[link.name])
        links[link.name].set_name(link.name)
        _add_shapes(links[link.name], link)
    articulation = builder.build(fix_root_link=True)
    articulation.name = object_id
    bodies = {link.name: link for link in articulation.links}
    engine_joints = {joint.name: joint for joint in articulation.active_joints}
    for joint in asset.joints:
        if joint.balanced:
            bodies[joint.child].set_disable_gravity(True)
        _resist(engine_joints[joint.name], joint)
    return Built(root=articulation.links[0].entity, bodies=bodies, articulation=articulation)


def _add_joint(builder: Any, joint: Joint) -> None:
    sapien = load_sapien()
    builder.set_joint_name(joint.name)
    turn = x_axis_onto(joint.axis)
    builder.set_joint_properties(
        joint.kind,
        [list(joint.limits)],
        sapien.Pose(list(joint.position_m), list(turn)),
        sapien.Pose([0.0, 0.0, 0.0], list(turn)),
    )


def _resist(engine_joint: Any, joint: Joint) -> None:
    """Gives a joint its dry friction: a brake that holds it still with no more than that.

    It is a drive to no speed, whose force limit is the friction. The engine's own coefficient would multiply the load
    in the joint; the builder's argument for it, besides, reaches no joint in SAPIEN 3.0.3, which so ran at 0.05.
    """
    engine_joint.set_friction(0.0)
    engine_joint.set_drive_properties(0.0, BRAKE, joint.friction, "force")
    engine_joint.set_drive_velocity_target(0.0)


def _add_shapes(builder: Any, link: Link) -> None:
    sapien = load_sapien()
    for shape in link.shapes:
        if not shape.collides:
            continue
        orientation = upright(shape.orientation) if shape.kind == "cylinder" else shape.orientation
        pose = sapien.Pose(list(shape.position_m), list(orientation))
        material = sapien.physx.PhysxMaterial(shape.friction, shape.friction, 0.0)
        if shape.kind == "box":
            builder.add_box_collision(pose, list(shape.size_m), material, shape.density_kg_m3)
        elif shape.kind == "cylinder":
            builder.add_cylinder_collision(pose, *shape.size_m, material, shape.density_kg_m3)
        elif shape.kind == "sphere":
            builder.add_sphere_collision(pose, shape.size_m[0], material, shape.density_kg_m3)
        elif shape.kind == "convex":
            file = str(_hull_file(shape.vertices_m))
            builder.add_convex_collision_from_file(file, pose, [1.0, 1.0, 1.0], material, shape.density_kg_m3)
        else:
            raise ValueError(f"a {shape.kind} shape cannot collide; use boxes, cylinders, spheres and convex hulls")


@lru_cache(maxsize=4096)
def _hull_file(points_m: Sequence[Vector]) -> Path:
    """An OBJ file of the convex hull of points, named by its content: the engine's builder takes hulls as files only.

    It is written where it is not there yet.

    Raises:
        scipy.spatial.QhullError: The points lie in a plane.
        OSError: The cache cannot be written.
    """
    points = np.asarray(points_m)
    path = cache_dir() / "hulls" / f"{content_key(points.tobytes())}.obj"
    if path.is_file():
        return path
    hull = ConvexHull(points)
    order = {int(old): new for new, old in enumerate(hull.vertices, start=1)}
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points[hull.vertices]]
    for face, plane in zip(hull.simplices, hull.equations, strict=True):
        a, b, c = (points[i] for i in face)
        outwards = float(np.cross(b - a, c - a) @ plane[:3]) > 0.0
        corners = face if outwards else face[::-1]
        lines.append("f " + " ".join(str(order[int(i)]) for i in corners))
    return write_atomically(path, ("\n".join(lines) + "\n").encode())
