"""Groceries, fruit and vegetables, cutlery, pans and a hob, by the data of `pantry.toml` where they are alike.

Physics has cylinders, balls and boxes that fill the object's box; visual shapes stay inside it.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from executor.assets.families.furniture import cabinet
from executor.assets.families.shapes import (
    UP,
    Color,
    box,
    box_item,
    cylinder,
    edged,
    fixture,
    revolved,
    round_item,
    shell,
    surface,
)
from executor.assets.model import Asset, Link, Region, Shape, Vector
from executor.assets.parameters import SAME_AS_WIDTH, AssetError, ChoiceParameter, ModelEntry, Range, require_size
from oag import SceneObject

_DATA: Mapping[str, Mapping[str, Any]] = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
_FRICTION, _LEAST_M = 0.9, (0.01, 0.01, 0.01)
_STEEL, _BLACK, _WOOD = (0.58, 0.59, 0.61), (0.05, 0.05, 0.055), (0.36, 0.20, 0.10)
_SMOOTH_FROM = 5  # Points of a profile's part; shorter ones are caps and labels with edges.
_GLASS_M, _PLATE = 0.006, (0.30, 0.07, 0.05)
_CUTLERY_KG_M3, _PAN_KG_M3, _PAN_WALL_M, _PAN_PIECES = 2500.0, 2000.0, 0.004, 16


def _color(obj: SceneObject, data: Mapping[str, Any]) -> Color:
    return tuple(data["colors"][ChoiceParameter("color", tuple(data["colors"])).read(obj)])


def _turned_look(data: Mapping[str, Any], main: Color, radius: float, length: float) -> Iterator[Shape]:
    """Yield the visual meshes of a profile; each part is smooth, with an edge wherever it turns sharply."""
    for part in data["profile"]:
        points = np.array(part["points"])
        if data.get("solid") == "ball" and len(points) >= _SMOOTH_FROM:
            curve = CubicSpline(np.arange(len(points)), points)
            points = np.clip(curve(np.linspace(0, len(points) - 1, 4 * len(points))), 0.0, 1.0)
        outline = [(float(r) * radius, (float(z) - 0.5) * length) for r, z in points]
        yield revolved(edged(*outline) if len(outline) < _SMOOTH_FROM else [outline], tuple(part.get("color", main)))


def turned(obj: SceneObject, data: Mapping[str, Any]) -> Asset:
    """Return an item that is round about z; its diameter is the smaller horizontal extent."""
    length, width, height = require_size(obj, _LEAST_M)
    main, solid = _color(obj, data), data["solid"]
    # A ball is as wide as it is high.
    radius = height / 2 if solid == "ball" else min(length, width) / 2
    made: dict[str, Any] = {"friction": _FRICTION, "density_kg_m3": float(data["density"]), "visible": False}
    if solid == "ball":
        solids = [Shape("sphere", (radius,), color=main, **made)]
    else:
        levels = [(share * radius, (low - 0.5) * height, (high - 0.5) * height) for share, low, high in solid]
        solids = [cylinder(*level, color=main, **made) for level in levels]
    shapes = (*solids, *_turned_look(data, main, radius, height))
    return round_item(obj, obj.category, shapes, radius, height, data["synset"])


def packet(obj: SceneObject, data: Mapping[str, Any]) -> Asset:
    """Return a closed packet with a label on its sides and front, and a cap where it has one."""
    extent = require_size(obj, _LEAST_M)
    x, y, z = (length / 2 for length in extent)
    main, label, thin = _color(obj, data), tuple(data["label"]), 0.0006
    radius, cap_m = data.get("cap", (0.0, 0.0))
    top = z - cap_m
    body = partial(box, friction=_FRICTION, density_kg_m3=float(data["density"]))
    lengths = (-x, -y, -z), (x, y, top)
    shapes = [body(*lengths, main, visible=False)]
    shapes += [box([v + thin for v in lengths[0]], [v - thin for v in lengths[1]], main, collides=False)]
    if extent[2] < min(extent[:2]):
        shapes.append(box((-0.6 * x, -0.6 * y, 0.0), (0.6 * x, 0.6 * y, top), label, collides=False))
    else:
        low, high = -z + 0.34 * (top + z), -z + 0.80 * (top + z)
        shapes.append(box((-0.72 * x, -y, low), (0.72 * x, y, high), label, collides=False))
        shapes.append(box((-x, -0.72 * y, -z + 0.08 * z), (x, 0.72 * y, -z + 0.3 * z), label, collides=False))
    if cap_m:
        shapes.append(cylinder(radius, top, z, color=label, friction=_FRICTION, density_kg_m3=300.0))
    tops = () if cap_m else (surface(obj.category, x, y, z),)
    return box_item(obj, obj.category, shapes, extent, data["synset"], *tops)


def lying(obj: SceneObject, data: Mapping[str, Any]) -> Asset:
    """Return a round item that lies along x; physics sees a box, on which it does not roll away."""
    extent = require_size(obj, _LEAST_M)
    x, y, z = (length / 2 for length in extent)
    main, radius = _color(obj, data), min(y, z)
    solid = box((-x, -y, -z), (x, y, z), main, friction=_FRICTION, density_kg_m3=float(data["density"]), visible=False)
    along_x = (0.5**0.5, 0.0, 0.5**0.5, 0.0)
    look = (
        Shape(
            kind="mesh",
            color=shape.color,
            collides=False,
            orientation=along_x,
            vertices_m=shape.vertices_m,
            triangles=shape.triangles,
        )
        for shape in _turned_look(data, main, radius, extent[0])
    )
    return box_item(obj, obj.category, (solid, *look), extent, data["synset"])


def cutlery(obj: SceneObject) -> Asset:
    """Return a knife, fork, spoon or spatula that lies along x, its handle at -x."""
    extent = require_size(obj, (0.05, 0.008, 0.004))
    x, y, z = (length / 2 for length in extent)
    kind = obj.category.rsplit("_", 1)[-1]
    handle = _WOOD if kind == "spatula" else _BLACK if kind == "knife" else _STEEL
    part = partial(box, friction=_FRICTION, density_kg_m3=_CUTLERY_KG_M3)
    shapes = [part((-x, -0.45 * y, -z), (0.1 * x, 0.45 * y, z), handle)]
    if kind == "fork":
        shapes.append(part((0.1 * x, -y, -z), (0.55 * x, y, 0.4 * z), _STEEL))
        for side in (-1.0, -1 / 3, 1 / 3, 1.0):
            middle = side * 0.85 * y
            shapes.append(part((0.55 * x, middle - 0.15 * y, -z), (x, middle + 0.15 * y, 0.4 * z), _STEEL))
    elif kind == "knife":
        shapes.append(part((0.1 * x, -y, -z), (x, y, -0.2 * z), _STEEL))
    else:
        shapes.append(part((0.1 * x, -0.35 * y, -z), (0.4 * x, 0.35 * y, 0.4 * z), _STEEL))
        shapes.append(part((0.4 * x, -y, -z), (x, y, 0.4 * z), _STEEL if kind == "spoon" else _BLACK))
    return box_item(obj, obj.category, shapes, extent, f"{kind}.n.01")


def pan(obj: SceneObject) -> Asset:
    """Return a pan or a pot: its width (y) is its diameter, and what is left of its length (x) a handle at +x.

    A pot has two short handles, one at each end.
    """
    length, width, height = require_size(obj, (0.08, 0.06, 0.02))
    radius, low, high, wall = width / 2, -height / 2, height / 2, _PAN_WALL_M
    left = length - width
    if left < 0.02:
        raise AssetError(obj, f"its x extent is {length:.3f} m", f"its handles need at least {width + 0.02:.3f} m")
    two = obj.category.endswith("pot")
    centre = 0.0 if two else -left / 2
    inner = radius - wall
    solid = shell(
        foot_m=inner,
        low_m=low,
        thick_m=wall,
        pieces=_PAN_PIECES,
        piece_m=(wall, height),
        middle_m=(radius - wall / 2, 0.0),
        reach_m=radius,
        pitch_rad=0.0,
        friction=0.8,
        density_kg_m3=_PAN_KG_M3,
    )
    outer, lining = _STEEL if two else _BLACK, (0.42, 0.43, 0.45) if two else (0.10, 0.10, 0.11)
    out = [[(0.0, low), (0.94 * radius, low)], [(0.94 * radius, low), (radius, low + 0.06 * height), (radius, high)]]
    top = [[(radius, high), (inner, high)]]
    within = [[(inner, high), (inner, low + wall)], [(inner, low + wall), (0.0, low + wall)]]
    body = [*solid, revolved([*out, *top], outer), revolved(within, lining)]
    moved = [_shifted(one, (centre, 0.0, 0.0)) for one in body]
    ends = ((1.0, left / 2), (-1.0, left / 2)) if two else ((1.0, left),)
    half_y, thick = (0.22 * radius, 0.012) if two else (0.011, 0.016)
    for sign, reach in ends:
        near, far = sorted((centre + sign * (radius - 0.002), centre + sign * (radius + reach)))
        handle = (near, -half_y, high - thick), (far, half_y, high)
        moved.append(box(*handle, _BLACK, friction=0.9, density_kg_m3=800.0))
    side = inner / 2**0.5 - 0.001
    room = (side, side, (height - wall) / 2)
    hollow = Region("hollow", "interior", obj.category, (centre, 0.0, wall / 2), room, UP)
    return Asset(
        category=obj.category,
        motion="dynamic",
        links=(Link(obj.category, tuple(moved)),),
        extent_m=(length, width, height),
        regions=(hollow,),
        graspable_width_m=None,
        synset="pot.n.01" if two else "frying_pan.n.01",
    )


def hob(obj: SceneObject) -> Asset:
    """Return a hob: four plates in a glass on a base cabinet."""
    length, width, height = require_size(obj, (0.45, 0.45, 0.50))
    x, y, z = length / 2, width / 2, height / 2
    below = cabinet(replace(obj, bbox_extent=(length, width, height - _GLASS_M), scale=(1.0, 1.0, 1.0)))
    shapes = [_shifted(one, (0.0, 0.0, -_GLASS_M / 2)) for one in below.links[0].shapes]
    glass = z - _GLASS_M, z - 0.001
    shapes.append(box((-x, -y, glass[0]), (x, y, z), _BLACK, visible=False))
    shapes.append(box((-0.8 * x, -0.9 * y, glass[0]), (0.8 * x, 0.9 * y, glass[1]), _BLACK, collides=False))
    for dx, dy, radius in ((-0.4, -0.45, 0.075), (-0.4, 0.45, 0.10), (0.4, -0.45, 0.10), (0.4, 0.45, 0.075)):
        ring = edged((radius, glass[1]), (0.98 * radius, z), (0.88 * radius, z), (0.86 * radius, glass[1]))
        shapes.append(_shifted(revolved(ring, _PLATE), (dx * x, dy * y, 0.0)))
    return fixture(obj, "hob", shapes, obj.extent_m, "burner.n.02", surface("hob", x, y, z))


def _shifted(shape: Shape, by_m: Vector) -> Shape:
    x, y, z = (at + by for at, by in zip(shape.position_m, by_m, strict=True))
    return replace(shape, position_m=(x, y, z))


_BUILDERS = {"turned": turned, "packet": packet, "lying": lying}


def _ranges(shape: str, data: Mapping[str, Any]) -> tuple[Range, Range, Range]:
    across = Range(*data["across"])
    long = Range(*data["long"]) if "long" in data else SAME_AS_WIDTH
    return long, across, Range(*data["high"]) if "high" in data else SAME_AS_WIDTH


def _entries() -> Iterator[ModelEntry]:
    for shape, models in _DATA.items():
        for model, data in models.items():
            color = ChoiceParameter("color", tuple(data["colors"]))
            build = partial(_BUILDERS[shape], data=data)
            yield ModelEntry(model, model, data["synset"], build, *_ranges(shape, data), (color,))


def _entry(
    model: str, category: str, synset: str, build: Callable[[SceneObject], Asset], *sides: tuple[float, float]
) -> ModelEntry:
    x, y, z = (Range(*side) for side in sides)
    return ModelEntry(model, category, synset, build, x, y, z)


MODELS = (
    *_entries(),
    _entry("table_knife", "knife", "knife.n.01", cutlery, (0.18, 0.23), (0.016, 0.022), (0.008, 0.012)),
    _entry("table_fork", "fork", "fork.n.01", cutlery, (0.16, 0.20), (0.022, 0.028), (0.009, 0.013)),
    _entry("table_spoon", "spoon", "spoon.n.01", cutlery, (0.15, 0.20), (0.030, 0.042), (0.009, 0.013)),
    _entry("cooking_spatula", "spatula", "spatula.n.01", cutlery, (0.26, 0.32), (0.050, 0.065), (0.012, 0.016)),
    _entry("frying_pan", "frying_pan", "frying_pan.n.01", pan, (0.38, 0.46), (0.20, 0.28), (0.04, 0.06)),
    _entry("sauce_pan", "sauce_pan", "frying_pan.n.01", pan, (0.30, 0.36), (0.15, 0.20), (0.08, 0.11)),
    _entry("cooking_pot", "cooking_pot", "pot.n.01", pan, (0.28, 0.34), (0.20, 0.25), (0.12, 0.17)),
    _entry("hob_unit", "hob", "burner.n.02", hob, (0.55, 0.65), (0.55, 0.75), (0.80, 0.92)),
)
FAMILIES = {"hob": hob, "pan": pan, "knife": cutlery, "fork": cutlery, "spoon": cutlery, "spatula": cutlery}
