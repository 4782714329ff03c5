"""What cameras see of bodies: one mesh a body and texture, since drawing costs by the mesh and not by its size."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from executor.assets.model import Quaternion, Shape, Vector
from executor.assets.transforms import upright
from executor.geometry import Array
from executor.machine.extras import load_sapien

TEXTURE_M = 1.2
"""Side of the square that a texture covers before it repeats."""

_MIPMAPS = 7  # So that far faces do not glitter.
_ROUGHNESS, _SPECULAR = 0.55, 0.35  # Of every material: half matt, as most household things are.
_LEVELS = 4096  # Of red, green and blue: the number of a texture's place holds two of them without rounding.

Paint = Callable[[Shape], Any]
"""Says what a shape looks like: linear RGB with an optional alpha as a tuple, or, of a box, an engine's material."""


@dataclass(frozen=True, slots=True)
class _Mesh:
    """A surface.

    Attributes:
        points_m: (N, 3) vertices.
        normals: (N, 3) unit vectors.
        faces: (M, 3) vertices of each triangle, counter-clockwise from outside.
        places: (N, 2) where in a texture, or the vertex's colour (`_coloured`).
    """

    points_m: Array
    normals: Array
    faces: NDArray[Any]
    places: Array

    def moved(self, position_m: Sequence[float], orientation: Quaternion) -> _Mesh:
        turn = Rotation.from_quat(orientation, scalar_first=True)
        return replace(self, points_m=turn.apply(self.points_m) + position_m, normals=turn.apply(self.normals))


def own_color(shape: Shape) -> tuple[float, ...]:
    """Returns what a shape looks like where nothing else is said: the asset's colour."""
    return shape.color


def drawn_link(shapes: Iterable[Shape], paint: Paint = own_color) -> Any:
    """Returns what cameras see of a link, to be added to its entity; the scene needs a render system."""
    render = load_sapien().render
    component = render.RenderBodyComponent()
    plain: list[_Mesh] = []
    textured: dict[int, tuple[Any, list[_Mesh]]] = {}
    for shape in shapes:
        if not shape.visible:
            continue
        look = paint(shape)
        if not isinstance(look, tuple):
            textured.setdefault(id(look), (look, []))[1].append(_mesh_of(shape))
        elif len(look) == 3 and shape.kind in ("box", "mesh", "convex"):
            plain.append(_coloured(_mesh_of(shape), look))
        else:
            component.attach(_on_its_own(shape, look))
    if plain:
        component.attach(_shape(plain, _material([1.0, 1.0, 1.0, 1.0])))
    for material, meshes in textured.values():
        component.attach(_shape(meshes, material))
    return component


def draw_as_one(entity: Any) -> None:
    """Makes one mesh of all opaque meshes of an entity that came from files and have colours alone."""
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


def textured_box(half_m: Vector, material: Any) -> Any:
    """Returns a box for cameras, its texture in metres, the grain along the longer side of each face."""
    return _shape([_box(half_m)], material)


def _material(base_color: list[float]) -> Any:
    return load_sapien().render.RenderMaterial(base_color=base_color, roughness=_ROUGHNESS, specular=_SPECULAR)


def _on_its_own(shape: Shape, color: tuple[float, ...]) -> Any:
    """Returns an engine's shape for what is round, or can be seen through."""
    sapien = load_sapien()
    material = _material([*color[:3], color[3] if len(color) > 3 else 1.0])
    if shape.kind not in ("cylinder", "sphere"):
        return _shape([_mesh_of(shape)], material)
    if shape.kind == "cylinder":
        drawn, orientation = sapien.render.RenderShapeCylinder(*shape.size_m, material), upright(shape.orientation)
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
    """Gives all vertices a colour, in place of where in a texture they are; `shaders/seen.glsl` reads it.

    Red and green are the digits of one number to the base of `_LEVELS`, which is below -1: colours need no texture, and
    meshes of no colour of their own lie nowhere in theirs, at 0.
    """
    red, green, blue = np.round(np.clip(color, 0.0, 1.0) * (_LEVELS - 1.0))
    return replace(mesh, places=np.tile([-1.0 - (red * _LEVELS + green), blue], (len(mesh.points_m), 1)))


def _shape(meshes: Sequence[_Mesh], material: Any) -> Any:
    """Returns an engine's shape of several meshes."""
    first = np.cumsum([0, *(len(mesh.points_m) for mesh in meshes)])
    return load_sapien().render.RenderShapeTriangleMesh(
        np.concatenate([mesh.points_m for mesh in meshes]).astype(np.float32),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first[:-1], strict=True)]).astype(np.uint32),
        np.concatenate([mesh.normals for mesh in meshes]).astype(np.float32),
        np.concatenate([mesh.places for mesh in meshes]).astype(np.float32),
        material,
    )


def _box(half_m: Vector) -> _Mesh:
    """Returns a box at the origin, its texture in metres, the grain along the longer side of each face."""
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
    return _Mesh(np.array(points), np.array(normals), np.array(faces), np.array(places))


def _vertex_normals(points: Array, faces: NDArray[np.int64]) -> Array:
    """(N, 3) unit normals, averaged over each vertex's triangles by area."""
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    weighted = np.cross(b - a, c - a)
    normals = np.zeros_like(points)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], weighted)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(length > 0, normals / np.maximum(length, 1e-30), [0.0, 0.0, 1.0])
