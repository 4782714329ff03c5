"""Build an asset's bodies in a SAPIEN scene, for physics and, with a renderer, for cameras.

Cameras get one mesh per body and texture, since rendering cost grows with the number of meshes and not with their size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from bddl.files import write_atomically
from executor.assets.asset_geometry import cylinder_orientation, quaternion_x_to_axis
from executor.assets.model import Asset, Control, Joint, Link, Quaternion, Shape, Vector
from executor.geometry import Array, pose_vector
from executor.system.extras import load_sapien
from executor.system.files import cache_dir, content_key

TEXTURE_M = 1.2
"""Side of the square that a texture covers before it repeats."""

_MIPMAPS = 7  # So that far faces do not glitter.
_ROUGHNESS, _SPECULAR = 0.55, 0.35  # Of every material: half matt, as most household things are.
_LEVELS = 4096  # Levels of a colour channel: one texture coordinate encodes two of them without rounding.

_WALL_TURNS = 64.0  # Whole repeats of a texture by which the coordinates of a wall are marked.

Paint = Callable[[Shape], Any]
"""Returns a shape's appearance: linear RGB with optional alpha as a tuple, or, for a box, a SAPIEN material; None hides
the shape."""


@dataclass(frozen=True, slots=True)
class _Mesh:
    """A surface.

    Attributes:
        points_m: (N, 3) vertices.
        normals: (N, 3) unit vectors.
        faces: (M, 3) vertices of each triangle, counter-clockwise from outside.
        uv: (N, 2) texture coordinates, or the encoded vertex colour (`_coloured`).
    """

    points_m: Array
    normals: Array
    faces: NDArray[Any]
    uv: Array

    def moved(self, position_m: Sequence[float], orientation: Quaternion) -> _Mesh:
        turn = Rotation.from_quat(orientation, scalar_first=True)
        return replace(self, points_m=turn.apply(self.points_m) + position_m, normals=turn.apply(self.normals))


def build_render_component(shapes: Iterable[Shape], paint: Paint | None = None, *, wall: bool = False) -> Any:
    """Build the render component of a link, to be added to its entity; the scene needs a render system.

    Args:
        shapes: Its shapes.
        paint: Returns the appearance of a shape; by default its own colour.
        wall: Whether it is a wall of a room, all boxes: cameras behind it (at negative x) do not see it, and it throws
            no shadow.
    """
    render = load_sapien().render
    component = render.RenderBodyComponent()
    plain: list[_Mesh] = []
    textured: dict[int, tuple[Any, list[_Mesh]]] = {}
    for shape in shapes:
        if not shape.visible:
            continue
        look = shape.color if paint is None else paint(shape)
        if look is None:
            continue
        if not isinstance(look, tuple):
            mesh = _mesh_of(shape)
            mark = [_WALL_TURNS, 0.0] if wall else [0.0, 0.0]
            textured.setdefault(id(look), (look, []))[1].append(replace(mesh, uv=mesh.uv + mark))
        elif len(look) == 3 and shape.kind in ("box", "mesh", "convex"):
            mesh = _coloured(_mesh_of(shape), look)
            plain.append(replace(mesh, uv=mesh.uv + ([0.0, _LEVELS] if wall else [0.0, 0.0])))
        else:
            component.attach(_on_its_own(shape, look))
    if plain:
        component.attach(_shape(plain, _material([1.0, 1.0, 1.0, 1.0])))
    for material, meshes in textured.values():
        component.attach(_shape(meshes, material))
    return component


def merge_opaque_meshes(entity: Any) -> None:
    """Merge all opaque, untextured meshes of an entity loaded from files into one mesh."""
    render = load_sapien().render
    before = entity.find_component_by_type(render.RenderBodyComponent)
    if before is None:
        return
    plain: list[_Mesh] = []
    component = render.RenderBodyComponent()
    for shape in before.render_shapes:
        parts = shape.parts if isinstance(shape, render.RenderShapeTriangleMesh) else ()
        if not parts or any(part.material.base_color_texture or part.material.base_color[3] < 1.0 for part in parts):
            component.attach(shape.clone())
            continue
        pose = shape.local_pose
        for part in parts:
            points, faces = part.vertices * shape.scale, part.triangles.reshape(-1, 3)
            mesh = _Mesh(points, part.get_vertex_normal(), faces, np.zeros((len(points), 2)))
            plain.append(_coloured(mesh, part.material.base_color[:3]).moved(pose.p, tuple(pose.q)))
    if plain:
        component.attach(_shape(plain, _material([1.0, 1.0, 1.0, 1.0])))
        entity.remove_component(before)
        entity.add_component(component)


def textured_material(colors: NDArray[Any], roughness: float, specular: float, glow: float = 0.0) -> Any:
    """Return a SAPIEN material with a repeating texture.

    Args:
        colors: (H, W, 3) linear RGB in [0, 1]; the sides are powers of two.
        glow: Share of its own colour that it shows without any light.
    """
    render = load_sapien().render
    material = render.RenderMaterial(base_color=[1.0, 1.0, 1.0, 1.0], roughness=roughness, specular=specular)
    material.set_emission([glow, glow, glow, 1.0])
    pixels = np.full((*colors.shape[:2], 4), 255, np.uint8)
    pixels[..., :3] = np.clip(colors * 255.0 + 0.5, 0.0, 255.0)
    material.set_base_color_texture(render.RenderTexture2D(pixels, "R8G8B8A8Unorm", _MIPMAPS, "linear", "repeat"))
    return material


def textured_box(half_m: Vector, material: Any) -> Any:
    """Return a render shape of a box, its texture scaled in metres, the grain along the longer side of each face."""
    return _shape([_box(half_m)], material)


def _material(base_color: list[float]) -> Any:
    return load_sapien().render.RenderMaterial(base_color=base_color, roughness=_ROUGHNESS, specular=_SPECULAR)


def _on_its_own(shape: Shape, color: tuple[float, ...]) -> Any:
    """Return the render shape of a round or transparent shape."""
    sapien = load_sapien()
    material = _material([*color[:3], color[3] if len(color) > 3 else 1.0])
    if shape.kind not in ("cylinder", "sphere"):
        return _shape([_mesh_of(shape)], material)
    if shape.kind == "cylinder":
        drawn, orientation = (
            sapien.render.RenderShapeCylinder(*shape.size_m, material),
            cylinder_orientation(shape.orientation),
        )
    else:
        drawn, orientation = sapien.render.RenderShapeSphere(shape.size_m[0], material), shape.orientation
    drawn.local_pose = sapien.Pose(list(shape.position_m), list(orientation))
    return drawn


def _mesh_of(shape: Shape) -> _Mesh:
    if shape.kind == "box":
        half_m = (shape.size_m[0], shape.size_m[1], shape.size_m[2])
        return _box(half_m).moved(shape.position_m, shape.orientation)
    points, faces = np.asarray(shape.vertices_m, float), np.asarray(shape.triangles, np.int64)
    mesh = _Mesh(points, _vertex_normals(points, faces), faces, np.zeros((len(points), 2)))
    return mesh.moved(shape.position_m, shape.orientation)


def _coloured(mesh: _Mesh, color: Sequence[float]) -> _Mesh:
    """Encode one colour in the texture coordinates of all vertices; `shaders/seen.glsl` decodes it.

    Red and green are the digits of one number to the base of `_LEVELS`, which is below -1. Colours therefore need no
    texture, and meshes without a colour of their own keep texture coordinates at 0.
    """
    red, green, blue = np.round(np.clip(color, 0.0, 1.0) * (_LEVELS - 1.0))
    return replace(mesh, uv=np.tile([-1.0 - (red * _LEVELS + green), blue], (len(mesh.points_m), 1)))


def _shape(meshes: Sequence[_Mesh], material: Any) -> Any:
    first = np.cumsum([0, *(len(mesh.points_m) for mesh in meshes)])
    return load_sapien().render.RenderShapeTriangleMesh(
        np.concatenate([mesh.points_m for mesh in meshes]).astype(np.float32),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first[:-1], strict=True)]).astype(np.uint32),
        np.concatenate([mesh.normals for mesh in meshes]).astype(np.float32),
        np.concatenate([mesh.uv for mesh in meshes]).astype(np.float32),
        material,
    )


def _box(half_m: Vector) -> _Mesh:
    """Return a box at the origin, its texture scaled in metres, the grain along the longer side of each face."""
    points: list[NDArray[Any]] = []
    normals: list[NDArray[Any]] = []
    uv: list[NDArray[Any]] = []
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
                uv.append(((corner * half)[[along, across]]) / TEXTURE_M + 0.37 * axis)
            outwards = np.cross(np.eye(3)[along], np.eye(3)[across])[axis] * sign > 0
            corners = [first, first + 1, first + 2, first + 3]
            a, b, c, d = corners if outwards else corners[::-1]
            faces += [(a, b, c), (a, c, d)]
    return _Mesh(np.array(points), np.array(normals), np.array(faces), np.array(uv))


def _vertex_normals(points: Array, faces: NDArray[np.int64]) -> Array:
    """(N, 3) unit normals, averaged over each vertex's triangles by area."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    weighted = np.cross(b - a, c - a)
    normals = np.zeros_like(points)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], weighted)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0, normals / np.maximum(length, 1e-30), [0.0, 0.0, 1.0])


BRAKE = 1e5
"""Nms/rad or Ns/m up to the friction: under a push that does not move it a joint creeps by 0.3 mm/s at the most."""

BUTTON_DAMPING = 8.0  # Ns/m: a button of 20 g on a spring of 400 N/m comes back without swinging.
BUTTON_FORCE_N = 20.0  # At most, of a button's spring.


@dataclass(frozen=True, slots=True)
class BuiltAsset:
    """The bodies of one object.

    Attributes:
        root: The entity whose pose is the object's pose.
        bodies: Link name -> physics component.
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
) -> BuiltAsset:
    """Build an object in a scene and return its bodies.

    Args:
        sapien_scene: A `sapien.Scene`, with a render system where `visual` is true.
        T_world_root: (4, 4) pose of the root link's frame.
        visual: Whether to add render shapes; False touches no render class.
        paint: Returns the appearance of a shape; by default the asset's colours.
    """
    vector = pose_vector(T_world_root)
    pose = load_sapien().Pose(vector[:3], vector[3:])
    if asset.motion == "articulated":
        built = _build_articulation(sapien_scene, object_id, asset, pose)
    else:
        built = _build_body(sapien_scene, object_id, asset, pose, gravity=gravity)
    if visual:
        for link in asset.links:
            built.bodies[link.name].entity.add_component(build_render_component(link.shapes, paint))
    return built


def _build_body(scene: Any, object_id: str, asset: Asset, pose: Any, *, gravity: bool) -> BuiltAsset:
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
    return BuiltAsset(root=entity, bodies={asset.links[0].name: body}, articulation=None)


def _build_articulation(scene: Any, object_id: str, asset: Asset, pose: Any) -> BuiltAsset:
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
    return BuiltAsset(root=articulation.links[0].entity, bodies=bodies, articulation=articulation)


def _add_joint(builder: Any, joint: Joint) -> None:
    sapien = load_sapien()
    builder.set_joint_name(joint.name)
    turn = quaternion_x_to_axis(joint.axis)
    builder.set_joint_properties(
        joint.kind,
        [list(joint.limits)],
        sapien.Pose(list(joint.position_m), list(turn)),
        sapien.Pose([0.0, 0.0, 0.0], list(turn)),
    )


def _resist(engine_joint: Any, joint: Joint) -> None:
    """Apply dry friction to a joint: a brake that holds it still with at most that force; a button has a spring.

    The brake is a drive to zero velocity whose force limit is the friction. The engine's own coefficient would multiply
    the load in the joint. The builder's argument for it reaches no joint in SAPIEN 3.0.3, which then ran at 0.05.
    """
    engine_joint.set_friction(0.0)
    if isinstance(joint, Control) and joint.is_button:
        engine_joint.set_drive_properties(joint.spring_n_m, BUTTON_DAMPING, BUTTON_FORCE_N, "force")
        return
    engine_joint.set_drive_properties(0.0, BRAKE, joint.friction, "force")
    engine_joint.set_drive_velocity_target(0.0)


def _add_shapes(builder: Any, link: Link) -> None:
    sapien = load_sapien()
    for shape in link.shapes:
        if not shape.collides:
            continue
        orientation = cylinder_orientation(shape.orientation) if shape.kind == "cylinder" else shape.orientation
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
    """Return an OBJ file of the convex hull of points, cached by content.

    The engine's builder reads hulls from files only.

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
