"""Turns an asset's data into bodies of a SAPIEN scene."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from executor.assets.draw import draw_link
from executor.assets.hulls import hull_file
from executor.assets.model import Asset, Joint, Link
from executor.assets.shapes import engine_orientation, x_axis_onto
from executor.geometry import Array, pose_vector
from executor.machine.simulator import load_sapien


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
    sapien_scene: Any, object_id: str, asset: Asset, T_world_root: Array, *, visual: bool, gravity: bool = True
) -> Built:
    """Adds an object to a scene and returns its bodies.

    Args:
        sapien_scene: A `sapien.Scene`, with a render system where `visual` is true.
        object_id: The object's name in the scene.
        asset: What to build.
        T_world_root: (4, 4) pose of the root link's frame.
        visual: Whether cameras shall see it; false touches no render class.
        gravity: Whether gravity acts on a dynamic body.
    """
    pose = _pose(T_world_root)
    if asset.motion == "articulated":
        built = _build_articulation(sapien_scene, object_id, asset, pose)
    else:
        built = _build_body(sapien_scene, object_id, asset, pose, gravity=gravity)
    if visual:
        for link in asset.links:
            draw_link(built.bodies[link.name].entity, link)
    return built


def _build_body(scene: Any, object_id: str, asset: Asset, pose: Any, *, gravity: bool) -> Built:
    builder = scene.create_actor_builder()
    _add_shapes(builder, asset.links[0])
    builder.set_physx_body_type(asset.motion)
    builder.set_initial_pose(pose)
    entity = builder.build(name=object_id)
    body = _body_of(entity)
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
    for joint in asset.joints:
        if joint.balanced:
            bodies[joint.child].set_disable_gravity(True)
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
        friction=joint.friction,
        damping=joint.damping,
    )


def _add_shapes(builder: Any, link: Link) -> None:
    sapien = load_sapien()

    for shape in link.shapes:
        if not shape.collides:
            continue
        pose = sapien.Pose(list(shape.position_m), list(engine_orientation(shape)))
        material = sapien.physx.PhysxMaterial(shape.friction, shape.friction, 0.0)
        if shape.kind == "box":
            builder.add_box_collision(pose, list(shape.size_m), material, shape.density_kg_m3)
        elif shape.kind == "cylinder":
            builder.add_cylinder_collision(pose, *shape.size_m, material, shape.density_kg_m3)
        elif shape.kind == "sphere":
            builder.add_sphere_collision(pose, shape.size_m[0], material, shape.density_kg_m3)
        elif shape.kind == "convex":
            file = hull_file(shape.vertices_m)
            builder.add_convex_collision_from_file(str(file), pose, [1.0, 1.0, 1.0], material, shape.density_kg_m3)
        else:
            raise ValueError(f"a {shape.kind} shape cannot collide; use boxes, cylinders, spheres and convex hulls")


def _pose(T: Array) -> Any:
    sapien = load_sapien()

    vector = pose_vector(T)
    return sapien.Pose(vector[:3], vector[3:])


def _body_of(entity: Any) -> Any:
    sapien = load_sapien()

    return entity.find_component_by_type(sapien.physx.PhysxRigidBaseComponent)
