"""Visual meshes of robots: Collada files, simplified for the renderer and cached as GLB files.

The Panda's have 135 thousand triangles together. Rendering time goes into vertices, so they are simplified part by part
to a twentieth, every material with its colour.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bddl.files import write_atomically
from executor.system.files import cache_dir, content_key

KEPT_FRACTION = 0.05  # No difference shows at 224 pixels; pictures of 128 take a quarter less time than with 0.10.
_FEWEST_TRIANGLES = 24
_OUTLINE_TOLERANCE_M = 0.0015
_AGGRESSION = 3.0  # The library's default of 7 merges across thin parts before it has looked at all edges.
# Raised when the simplification changes, so that old cached files are not taken for new ones.
_RECIPE = "3"
_NAMESPACE = {"c": "http://www.collada.org/2005/11/COLLADASchema"}


@dataclass(frozen=True, slots=True)
class ColoredPart:
    """One piece of a mesh with one colour.

    Attributes:
        vertices_m: (N, 3) positions in the link frame.
        triangles: (M, 3) vertex indices.
        color: RGBA in [0, 1].
    """

    vertices_m: NDArray[np.float64]
    triangles: NDArray[np.int64]
    color: tuple[float, ...]


def decimated_mesh(source: Path) -> Path:
    """Return the cached GLB of a Collada mesh at about a twentieth of its triangles, made where it is missing.

    Args:
        source: A `.dae` file of flat nodes that hold triangles with one material each.
    """
    path = cache_dir() / "meshes" / f"{source.stem}_{content_key(source.read_bytes(), _RECIPE)}.glb"
    return path if path.is_file() else write_atomically(path, _to_glb(simplified(read_collada(source))))


def read_collada(source: Path) -> list[ColoredPart]:
    """Return the coloured parts of a Collada file, placed by their nodes.

    Args:
        source: File with a flat visual scene of triangle meshes, as Blender exports it.
    """
    root = ET.parse(source).getroot()
    colors = {
        effect.attrib["id"]: _element_floats(effect.find(".//c:diffuse/c:color", _NAMESPACE))
        for effect in root.iterfind(".//c:library_effects/c:effect", _NAMESPACE)
    }
    effects = {
        material.attrib["id"]: next(material.iterfind("c:instance_effect", _NAMESPACE)).attrib["url"][1:]
        for material in root.iterfind(".//c:library_materials/c:material", _NAMESPACE)
    }
    geometries = {g.attrib["id"]: g for g in root.iterfind(".//c:library_geometries/c:geometry", _NAMESPACE)}
    parts: list[ColoredPart] = []
    for node in root.iterfind(".//c:visual_scene/c:node", _NAMESPACE):
        T_link_node = _element_floats(node.find("c:matrix", _NAMESPACE)).reshape(4, 4)
        for instance in node.iterfind("c:instance_geometry", _NAMESPACE):
            geometry = geometries[instance.attrib["url"][1:]]
            targets = {
                bound.attrib["symbol"]: bound.attrib["target"][1:]
                for bound in instance.iterfind(".//c:instance_material", _NAMESPACE)
            }
            for triangles in geometry.iterfind(".//c:triangles", _NAMESPACE):
                color = colors[effects[targets[triangles.attrib["material"]]]]
                points, faces = _triangles(geometry, triangles)
                placed = points @ T_link_node[:3, :3].T + T_link_node[:3, 3]
                parts.append(ColoredPart(placed, faces, tuple(float(value) for value in color)))
    return parts


def simplified(parts: list[ColoredPart]) -> list[ColoredPart]:
    """Return the parts with about a twentieth of their triangles; a part that would lose its outline keeps more."""
    import fast_simplification

    result = []
    for part in parts:
        points, triangles = _merged(part.vertices_m, part.triangles)
        outline = _outline(points, triangles)
        wanted = max(_FEWEST_TRIANGLES, int(KEPT_FRACTION * len(triangles)))
        while wanted < len(triangles):
            fewer = fast_simplification.simplify(
                points.astype(np.float32), triangles.astype(np.int32), target_count=wanted, agg=_AGGRESSION
            )
            if np.abs(_outline(*fewer) - outline).max() <= _OUTLINE_TOLERANCE_M:
                points, triangles = np.asarray(fewer[0], float), np.asarray(fewer[1], np.int64)
                break
            wanted *= 2
        result.append(ColoredPart(points, triangles, part.color))
    return result


def _outline(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the corners (2, 3) of the box around the vertices that triangles use."""
    used = points[triangles.reshape(-1)]
    return np.stack([used.min(axis=0), used.max(axis=0)])


def _merged(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Join vertices that lie within 10 micrometres: simplification opens cracks along unjoined seams."""
    _, first, inverse = np.unique(np.round(points, 5), axis=0, return_index=True, return_inverse=True)
    joined = inverse.reshape(-1)[triangles]
    a, b, c = joined.T
    return points[first], joined[(a != b) & (b != c) & (c != a)]


def _triangles(geometry: ET.Element, triangles: ET.Element) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertex positions (N, 3) and indices (M, 3) of one `<triangles>` element."""
    inputs = triangles.findall("c:input", _NAMESPACE)
    stride = 1 + max(int(entry.attrib["offset"]) for entry in inputs)
    vertex = next(entry for entry in inputs if entry.attrib["semantic"] == "VERTEX")
    by_id = {element.attrib["id"]: element for element in geometry.iter() if "id" in element.attrib}
    vertices = by_id[vertex.attrib["source"][1:]]
    position = next(
        entry for entry in vertices.iterfind("c:input", _NAMESPACE) if entry.attrib["semantic"] == "POSITION"
    )
    source = by_id[position.attrib["source"][1:]]
    points = _element_floats(source.find("c:float_array", _NAMESPACE)).reshape(-1, 3)
    indices = _element_floats(triangles.find("c:p", _NAMESPACE)).astype(np.int64).reshape(-1, 3, stride)
    return points, indices[:, :, int(vertex.attrib["offset"])]


def _element_floats(element: ET.Element | None) -> NDArray[np.float64]:
    text = "" if element is None else element.text or ""
    return np.array(text.split(), dtype=np.float64)


def _to_glb(parts: list[ColoredPart]) -> bytes:
    import trimesh

    scene = trimesh.Scene()
    for part in parts:
        material = trimesh.visual.material.PBRMaterial(
            baseColorFactor=np.array(part.color), metallicFactor=0.0, roughnessFactor=0.5
        )
        mesh = trimesh.Trimesh(part.vertices_m, part.triangles, process=False)
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(mesh)
    return bytes(scene.export(file_type="glb"))
