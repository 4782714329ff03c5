"""Turns an asset's data into bodies of a SAPIEN scene, for physics and, where there is a renderer, for cameras."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from bddl.files import write_atomically
from executor.assets.model import IDENTITY, Asset, Joint, Link, Quaternion, Shape, Vector
from executor.geometry import Array, pose_vector
from executor.machine.extras import load_sapien
from executor.machine.files import cache_dir, content_key

BRAKE = 1e5
"""Nms/rad or Ns/m up to the friction: under a push that does not move it a joint creeps by 0.3 mm/s at the most."""

TEXTURE_M = 1.2
"""Side of the square that a texture covers before it repeats."""

_MIPMAPS = 7  # So that far faces do not glitter.
_ROUGHNESS, _SPECULAR = 0.55, 0.35  # Of every material: half matt, as most household things are.


Paint = Callable[[Shape], Any]
"""Makes what cameras see of a shape, at the origin: an engine's render shape."""


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
        paint: Makes what cameras see of a shape; by default `drawn_shape`.
    """
    vector = pose_vector(T_world_root)
    pose = load_sapien().Pose(vector[:3], vector[3:])
    if asset.motion == "articulated":
        built = _build_articulation(sapien_scene, object_id, asset, pose)
    else:
        built = _build_body(sapien_scene, object_id, asset, pose, gravity=gravity)
    if visual:
        for link in asset.links:
            _draw(built.bodies[link.name].entity, link, paint or drawn_shape)
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
    turn = _x_axis_onto(joint.axis)
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
        pose = sapien.Pose(list(shape.position_m), list(_engine_orientation(shape)))
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


def _draw(entity: Any, link: Link, paint: Paint) -> None:
    """Gives an entity the visible shapes of a link; the scene needs a render system."""
    sapien = load_sapien()
    component = sapien.render.RenderBodyComponent()
    for shape in link.shapes:
        if shape.visible:
            drawn = paint(shape)
            drawn.local_pose = sapien.Pose(list(shape.position_m), list(_engine_orientation(shape)))
            component.attach(drawn)
    entity.add_component(component)


def drawn_shape(shape: Shape, color: tuple[float, ...] = ()) -> Any:
    """Returns what cameras see of a shape, in its own colour or another, at the origin."""
    render = load_sapien().render
    red, green, blue, *alpha = color or shape.color
    base_color = [red, green, blue, alpha[0] if alpha else 1.0]
    material = render.RenderMaterial(base_color=base_color, roughness=_ROUGHNESS, specular=_SPECULAR)
    if shape.kind == "box":
        return render.RenderShapeBox(list(shape.size_m), material)
    if shape.kind == "cylinder":
        return render.RenderShapeCylinder(*shape.size_m, material)
    if shape.kind == "sphere":
        return render.RenderShapeSphere(shape.size_m[0], material)
    points, faces = np.asarray(shape.vertices_m, float), np.asarray(shape.triangles, np.int64)
    normals, no_picture = _vertex_normals(points, faces).astype(np.float32), np.zeros((len(points), 2), np.float32)
    return render.RenderShapeTriangleMesh(
        points.astype(np.float32), faces.astype(np.uint32), normals, no_picture, material
    )


def textured_material(colors: NDArray[Any], roughness: float, specular: float) -> Any:
    """Returns an engine's material with a texture that repeats.

    Args:
        colors: (H, W, 3) linear RGB in [0, 1]; the sides are powers of two.
        roughness, specular: Of all of it, 0 to 1.
    """
    render = load_sapien().render
    material = render.RenderMaterial(base_color=[1.0, 1.0, 1.0, 1.0], roughness=roughness, specular=specular)
    pixels = np.full((*colors.shape[:2], 4), 255, np.uint8)
    pixels[..., :3] = np.clip(colors * 255.0 + 0.5, 0.0, 255.0)
    material.set_base_color_texture(render.RenderTexture2D(pixels, "R8G8B8A8Unorm", _MIPMAPS, "linear", "repeat"))
    return material


def textured_box(half_m: tuple[float, ...], material: Any) -> Any:
    """Returns a box for cameras, its texture in metres, the grain along the longer side of each face."""
    points: list[NDArray[Any]] = []
    normals: list[NDArray[Any]] = []
    places: list[NDArray[Any]] = []
    faces: list[tuple[int, int, int]] = []
    half = np.asarray(half_m, float)
    for axis in range(3):
        along, across = sorted({0, 1, 2} - {axis}, key=lambda k: -half[k])
        for sign in (-1.0, 1.0):
            first = len(points)
            for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = np.zeros(3)
                corner[axis], corner[along], corner[across] = sign, u, v
                points.append(corner * half)
                normals.append(np.eye(3)[axis] * sign)
                places.append(((corner * half)[[along, across]]) / TEXTURE_M + 0.37 * axis)
            outwards = np.cross(np.eye(3)[along], np.eye(3)[across])[axis] * sign > 0
            corners = [first, first + 1, first + 2, first + 3]
            a, b, c, d = corners if outwards else corners[::-1]
            faces += [(a, b, c), (a, c, d)]
    return load_sapien().render.RenderShapeTriangleMesh(
        np.array(points, np.float32),
        np.array(faces, np.uint32),
        np.array(normals, np.float32),
        np.array(places, np.float32),
        material,
    )


def _vertex_normals(points: Array, faces: NDArray[np.int64]) -> Array:
    """(N, 3) unit normals, averaged over each vertex's triangles by area."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    weighted = np.cross(b - a, c - a)
    normals = np.zeros_like(points)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], weighted)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0, normals / np.maximum(length, 1e-30), [0.0, 0.0, 1.0])


def _x_axis_onto(axis: Vector) -> Quaternion:
    """The quaternion w x y z that turns +x, the engine's joint and cylinder axis, onto a unit vector."""
    x, y, z = axis
    if x < -1 + 1e-9:
        return (0.0, 0.0, 0.0, 1.0)
    if x > 1 - 1e-9:
        return IDENTITY
    quaternion = np.array([1.0 + x, 0.0, -z, y])
    w, i, j, k = quaternion / np.linalg.norm(quaternion)
    return (float(w), float(i), float(j), float(k))


def _engine_orientation(shape: Shape) -> Quaternion:
    """A shape's orientation w x y z for the engine, whose cylinders lie along x where ours stand along z."""
    if shape.kind != "cylinder":
        return shape.orientation
    ours, across = (Rotation.from_quat(turn, scalar_first=True) for turn in (shape.orientation, _X_ONTO_Z))
    w, x, y, z = (ours * across).as_quat(scalar_first=True)
    return (float(w), float(x), float(y), float(z))


_X_ONTO_Z = _x_axis_onto((0.0, 0.0, 1.0))
