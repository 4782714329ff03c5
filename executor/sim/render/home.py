"""Homes: one style for all surfaces of a scene, and a visual room around it with windows and daylight.

A style (`styles.toml`) gives each role of a surface its material and colour, so that all fronts of a kitchen match. The
room is drawn only: bodies would change the physics that packed states belong to. Its walls replace those of the scene.
A wall vanishes for a camera behind it (`shaders/seen.glsl`), so that outside cameras see into the room.
"""

from __future__ import annotations

import math
import tomllib
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from executor.assets.footprint import Footprint, yaw_of
from executor.assets.library import asset_for
from executor.geometry import Array, rotation_z
from executor.sim.render.appearance import Finish, Surfaces, Wall, WallPart, surface_key
from executor.sim.render.cameras import WALL
from executor.sim.render.stage import Lights
from oag import Scene, SceneObject
from oag.model.scene import FLOOR
from oag.model.symbols import Kind

HEIGHT_M = 2.6
_BACK_GAP_M, _WALL_GAP_M = 0.02, 0.12  # From a back to its wall; as deep as a wall of a scene may be hidden by it.
_FREE_M = 1.3  # From furniture, or the robot, to a wall that nothing is put against: room to pass.
_LEAST_SIDE_M = 3.2
_SHADE = 0.06  # How far a colour of a home is from its style's.
_PATTERNS = 4
_KITCHEN = ("refrigerator", "bottom_cabinet", "countertop", "counter", "oven", "dishwasher", "microwave", "sink", "hob")
_SPLASH_M, _TALLEST_TOP_M = 0.6, 1.1
_SILL_M, _WINDOW_M, _FRAME_M, _SKIRTING_M = 0.95, (1.16, 1.12), 0.05, 0.09
_PICTURE_M = (0.55, 0.42)
_CORNER_M = 0.35


@dataclass(frozen=True, slots=True)
class Home:
    """The surfaces and lights of a home."""

    surfaces: Surfaces
    lights: Lights


@cache
def _data() -> Mapping[str, Any]:
    return tomllib.loads(Path(__file__).with_name("styles.toml").read_text("utf-8"))


def styles() -> tuple[str, ...]:
    """Return the names of the styles."""
    return tuple(_data()["style"])


def home_of(scene: Scene, rng: np.random.Generator | None = None, style: str | None = None) -> Home:
    """Return the home of a scene.

    Args:
        scene: The concrete scene.
        rng: What style, shades and windows are drawn from; by default the scene's name.
        style: One of `styles`; by default it is drawn.
    """
    rng = np.random.default_rng(zlib.crc32(scene.name.encode())) if rng is None else rng
    base, drawn = int(rng.integers(2**62)), styles()[int(rng.integers(len(styles())))]
    columns = dict(zip(_data()["columns"], _data()["style"][style or drawn], strict=True))
    finishes = {
        role: _shaded(np.random.default_rng((base, zlib.crc32(role.encode()))), *made.split())
        for role, made in (_data()["usual"] | columns).items()
    }
    r, g, b = finishes["front"].color
    finishes["carcass"] = replace(finishes["front"], color=(0.88 * r, 0.88 * g, 0.88 * b))
    walls, replaced = _walls(scene, np.random.default_rng((base, 1)))
    painted = dict(_painted(scene, finishes))
    finishes["view"] = Finish("view", (1.0, 1.0, 1.0), int(rng.integers(_PATTERNS)))
    lights = _daylight(scene, walls, np.random.default_rng((base, 2)))
    return Home(Surfaces(finishes["floor"], painted, finishes, walls, replaced), lights)


def _shaded(rng: np.random.Generator, material: Any, color: str) -> Finish:
    coded = np.array([int(color[k : k + 2], 16) / 255.0 for k in (1, 3, 5)])
    linear = np.clip(coded**2.2 * (1.0 + rng.uniform(-_SHADE, _SHADE) + rng.uniform(-0.02, 0.02, 3)), 0.0, 0.95)
    r, g, b = (round(float(value), 4) for value in linear)
    return Finish(material, (r, g, b), int(rng.integers(_PATTERNS)))


def _painted(scene: Scene, finishes: Mapping[str, Finish]) -> Iterator[tuple[str, Finish]]:
    """Yield the key and finish of each surface of furniture that has a role; things keep their own colours."""
    role_of = {color: role for role, colors in _data()["roles"].items() for color in colors}
    for thing in scene.objects.values():
        if thing.kind is Kind.ITEM:
            continue
        for shape in (shape for link in asset_for(thing).links for shape in link.shapes if shape.visible):
            key = surface_key(thing.category, shape)
            role = "wall" if thing.category == WALL else role_of.get(key.split("/", 1)[1])
            if role is not None and len(shape.color) == 3:
                yield key, finishes[role]


# ------------------------------------------------------------------------------------------------------- the room


def _walls(scene: Scene, rng: np.random.Generator) -> tuple[tuple[Wall, ...], tuple[str, ...]]:
    """Return walls around all that stands in a scene, with a ceiling, and the scene's own walls that they replace."""
    yaw, low, high, against, replaced = _rectangle(scene)
    R = rotation_z(yaw)[:2, :2]
    middle, (length, width) = R @ ((low + high) / 2), high - low
    splash = any(thing.category in _KITCHEN for thing in scene.objects.values())
    walls = []
    for quarter, (axis, sign) in enumerate(((0, 1.0), (1, 1.0), (0, -1.0), (1, -1.0))):
        along = width if axis == 0 else length
        foot = (low + high) / 2
        foot[axis] = high[axis] if sign > 0 else low[axis]
        inward = yaw + math.pi + quarter * math.pi / 2
        x, y = map(float, R @ foot)
        frame = Wall((x, y, 0.0), inward, ())
        near = tuple(_on_wall(frame, thing) for thing in against.get(quarter, ()))
        walls.append(replace(frame, parts=tuple(_parts(along, near, rng, splash=splash))))
    x, y = map(float, middle)
    half = max(length, width) / 2
    ceiling = WallPart((-0.02, -half, -half), (0.0, half, half), "ceiling")
    return (*walls, Wall((x, y, HEIGHT_M), None, (ceiling,))), replaced


def _rectangle(scene: Scene) -> tuple[float, Array, Array, dict[int, list[SceneObject]], tuple[str, ...]]:
    """Return the room's heading, its corners (2,) in a frame turned so, what stands against each of its sides, and the
    scene's own walls along them."""
    things = [thing for thing in scene.objects.values() if thing.category not in (WALL, FLOOR)]
    built = [thing for thing in scene.objects.values() if thing.category == WALL]
    fixed = [thing for thing in things if thing.kind is not Kind.ITEM]
    largest = max(fixed or things or built, key=lambda thing: thing.extent_m[0] * thing.extent_m[1], default=None)
    yaw = 0.0 if largest is None else yaw_of(built[0] if built else largest) % (math.pi / 2)
    R = rotation_z(yaw)[:2, :2]
    robot = np.asarray(scene.robot.position[:2]) @ R
    reach = {thing.id: Footprint.of(thing).corners_m @ R for thing in (*fixed, *built)}
    sides: dict[tuple[int, float], float] = {}
    against: dict[int, list[SceneObject]] = {}
    replaced: list[str] = []
    for quarter, (axis, sign) in enumerate(((0, 1.0), (1, 1.0), (0, -1.0), (1, -1.0))):
        ends = {thing.id: float((sign * reach[thing.id][:, axis]).max()) for thing in fixed}
        free = max([*ends.values(), sign * float(robot[axis])]) + _FREE_M
        inner = {one.id: float((sign * reach[one.id][:, axis]).min()) for one in built if _faces(one, yaw, axis, sign)}
        # A wall between rooms has things on both sides.
        walls = [place for place in inner.values() if place > max(ends.values(), default=-math.inf) - 0.05]
        backs = {thing.id: ends[thing.id] for thing in fixed if _faces(thing, yaw, axis, sign)}
        most = max(backs.values(), default=-math.inf)
        outermost = most >= free - _FREE_M - 0.05 and any(
            thing.kind is Kind.ARTICULATED for thing in fixed if backs.get(thing.id, -math.inf) > most - 0.05
        )
        at = min(walls) if walls else most + _BACK_GAP_M if outermost else free
        sides[axis, sign] = at
        replaced += [name for name, place in inner.items() if abs(place - at) < _WALL_GAP_M]
        against[quarter] = [thing for thing in fixed if backs.get(thing.id, -math.inf) > at - _WALL_GAP_M]
    low, high = (np.array([sign * sides[axis, sign] for axis in (0, 1)]) for sign in (-1.0, 1.0))
    for axis in (0, 1):
        lack = _LEAST_SIDE_M - (high[axis] - low[axis])
        if lack > 0 and not built:
            # The side that nothing stands against gives way.
            if against[axis]:
                low[axis] -= lack
            else:
                high[axis] += lack
    return yaw, low, high, against, tuple(replaced)


def _faces(thing: SceneObject, yaw: float, axis: int, sign: float) -> bool:
    """Return whether a thing's back, or a wall's outside, looks along a side's outward direction."""
    outward = yaw + (0.0 if axis == 0 else math.pi / 2) + (0.0 if sign > 0 else math.pi)
    return math.cos(yaw_of(thing) - outward) > 0.95


def _on_wall(wall: Wall, thing: SceneObject) -> tuple[float, float, float, str]:
    """Return what a thing covers of a wall: from and to along it, how high, and its category."""
    assert wall.yaw_rad is not None
    along = np.array([-math.sin(wall.yaw_rad), math.cos(wall.yaw_rad)])
    places = (Footprint.of(thing).corners_m - wall.position_m[:2]) @ along
    top = thing.position[2] + thing.extent_m[2] / 2
    return float(places.min()), float(places.max()), top, thing.category


def _parts(
    length: float, near: Sequence[tuple[float, float, float, str]], rng: np.random.Generator, *, splash: bool
) -> Iterator[WallPart]:
    """Yield the boxes of a wall: x inward, y along, z up; with windows and pictures where nothing stands."""
    half, depth = length / 2, 0.14
    holes: list[tuple[float, float]] = []
    width, height = _WINDOW_M
    wanted = [float(y) for y in rng.permutation(np.arange(-half + width, half - width + 0.01, 0.2))]
    for y in wanted if rng.uniform() < 0.8 else ():
        if len(holes) < max(1, int(length / 3.5)) and _is_free(near, holes, y, width / 2 + 0.15, _SILL_M - 0.1):
            holes.append((y, width / 2))
    edge = -half
    low, high = _SILL_M, _SILL_M + height
    for y, wide in sorted(holes):
        yield WallPart((-depth, edge, 0.0), (0.0, y - wide, HEIGHT_M), "wall")
        yield WallPart((-depth, y - wide, 0.0), (0.0, y + wide, low), "wall")
        yield WallPart((-depth, y - wide, high), (0.0, y + wide, HEIGHT_M), "wall")
        yield from _window(y, wide, low, high)
        edge = y + wide
    yield WallPart((-depth, edge, 0.0), (0.0, half, HEIGHT_M), "wall")
    yield WallPart((0.0, -half, 0.0), (0.012, half, _SKIRTING_M), "trim")
    for start, end, top in _strips(near, half) if splash else ():
        # A window interrupts it.
        ends = [start, *(y + side * (wide + 0.06) for y, wide in sorted(holes) for side in (-1, 1)), end]
        for first, last in zip(ends[::2], ends[1::2], strict=True):
            if min(last, end) - max(first, start) > 0.05:
                yield WallPart((0.0, max(first, start), top), (0.008, min(last, end), top + _SPLASH_M), "splash")
    for y in (float(y) for y in rng.permutation(np.arange(-half + 0.6, half - 0.6, 0.25))[:4]):
        if _is_free(near, holes, y, _PICTURE_M[0] / 2 + 0.2, 1.25) and rng.uniform() < 0.6:
            yield from _picture(y, 1.55)
            holes.append((y, _PICTURE_M[0] / 2))


def _strips(near: Sequence[tuple[float, float, float, str]], half: float) -> list[tuple[float, float, float]]:
    """Return from and to along a wall, and the height, of worktops; what stands side by side is one."""
    found: list[tuple[float, float, float]] = []
    for start, end, top, category in sorted(near):
        if category not in _KITCHEN or top > _TALLEST_TOP_M:
            continue
        if found and start < found[-1][1] + 0.05 and abs(top - found[-1][2]) < 0.05:
            start, _, top = found.pop()
        found.append((max(start, -half), min(end, half), top))
    return found


def _is_free(
    near: Sequence[Sequence[Any]], taken: Sequence[tuple[float, float]], y: float, wide: float, z: float
) -> bool:
    covered = any(start < y + wide and end > y - wide and top > z for start, end, top, _ in near)
    return not covered and all(abs(y - other) > wide + span for other, span in taken)


def _window(y: float, wide: float, low: float, high: float) -> Iterator[WallPart]:
    """A pane with the view in a recess, a frame with one upright bar around it, and a sill."""
    yield WallPart((-0.14, y - wide, low), (-0.12, y + wide, high), "view")
    f, back, front = _FRAME_M, -0.12, -0.07
    for low_y, high_y in ((y - wide, y - wide + f), (y - f / 2, y + f / 2), (y + wide - f, y + wide)):
        yield WallPart((back, low_y, low), (front, high_y, high), "trim")
    for low_z, high_z in ((low, low + f), (high - f, high)):
        yield WallPart((back, y - wide, low_z), (front, y + wide, high_z), "trim")
    yield WallPart((-0.07, y - wide - 0.05, low - 0.03), (0.06, y + wide + 0.05, low), "trim")


def _picture(y: float, z: float) -> Iterator[WallPart]:
    half_y, half_z = _PICTURE_M[0] / 2, _PICTURE_M[1] / 2

    def layer(deep: float, share: float, role: str) -> WallPart:
        return WallPart(
            (0.0, y - share * half_y, z - share * half_z), (deep, y + share * half_y, z + share * half_z), role
        )

    yield layer(0.020, 1.0, "timber")
    yield layer(0.021, 0.88, "linen")
    yield layer(0.022, 0.45, "fabric")
    yield layer(0.023, 0.22, "cushion")


def _daylight(scene: Scene, walls: Sequence[Wall], rng: np.random.Generator) -> Lights:
    """Return daylight from the side of a wall with windows; the walls themselves keep nothing of it off."""
    lit = [wall for wall in walls if any(part.role == "view" for part in wall.parts)]
    inward = lit[int(rng.integers(len(lit)))].yaw_rad if lit else scene.robot.yaw_rad
    azimuth, height = (inward or 0.0) + rng.uniform(-0.6, 0.6), math.radians(rng.uniform(48.0, 62.0))
    warmth, light = rng.uniform(-0.04, 0.06), _data()["light"]
    tint = np.array([1.0 + warmth, 1.0, 1.0 - warmth])

    def color(name: str) -> tuple[float, float, float]:
        r, g, b = (round(float(value), 4) for value in light[name] * tint)
        return r, g, b

    across, away = math.cos(height), azimuth + math.pi + rng.uniform(-0.7, 0.7)
    return Lights(
        ambient=color("ambient"),
        sun_direction=(across * math.cos(azimuth), across * math.sin(azimuth), -math.sin(height)),
        sun_color=color("sun"),
        fill_direction=(0.8 * math.cos(away), 0.8 * math.sin(away), -0.5),
        fill_color=color("fill"),
    )
