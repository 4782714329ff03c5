"""Things on tops, on shelves, in compartments and on other things: without overlap, and away from edges."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from executor.assets.footprint import EDGES, Footprint, region_frame, yaw_of
from executor.assets.library import asset_for
from executor.assets.model import Region
from executor.geometry import Array, rotation_z
from executor.scenes.rooms.room import NoRoom, Room
from oag import SceneObject

Range = tuple[float, float]
EDGE_M = 0.02
CLEAR_M = 0.03
HEADROOM_M = 0.02
_TRIES = 300


@dataclass(frozen=True, slots=True)
class AtEdge:
    """A place along an edge of a top or a shelf.

    Attributes:
        side: "-x" (the front), "+x", "+y" or "-y", in the support's own frame.
        inset_m: How far from that edge the thing's middle is.
        along_m: How far along that edge from its middle; the whole edge by default.
    """

    side: str
    inset_m: Range = (0.08, 0.16)
    along_m: Range | None = None


@dataclass(frozen=True, slots=True)
class Beside:
    """Next to another thing, with a gap from a range."""

    object_id: str
    gap_m: Range = (0.05, 0.15)


@dataclass(frozen=True, slots=True)
class Clearance:
    """The least distances of a thing that is put somewhere: to the edges of the place, and to everything else."""

    edge_m: float = EDGE_M
    other_m: float = CLEAR_M


AMPLE = Clearance()


def place(
    room: Room,
    obj: SceneObject,
    support: str,
    *,
    region: str | None = None,
    at: tuple[float, float] | AtEdge | None = None,
    beside: Beside | None = None,
    yaw_rad: float | None = None,
    clear: Clearance = AMPLE,
) -> str:
    """Puts a thing on another or in it, at a place drawn from what the arguments allow, and returns its id.

    Args:
        room: The room.
        obj: The thing, not yet placed.
        support: Id of what it is put on or in.
        region: Which of the support's places; by default its top, else the first one that is high enough.
        at: Its middle in the region, from the region's middle, along the support's own x and y; or the edge that it
            is near to; anywhere by default.
        beside: What it is next to.
        yaw_rad: Its turn in the support's own frame; any by default.
        clear: How far it is from edges and from everything else.

    Raises:
        NoRoom: No free place was found; the message says on what.
    """
    if obj.id in room.objects:
        raise NoRoom(obj.id, "the room has a thing of this id already")
    space = _region(room, obj, support, region)
    T_region, half = region_frame(room.objects[support], space)
    room.relate("inside" if space.kind == "interior" else "ontop", obj.id, support)
    problem = "found no free place on {}"
    for _ in range(1 if isinstance(at, tuple) and yaw_rad is not None else _TRIES):
        yaw = float(room.rng.uniform(-math.pi, math.pi)) if yaw_rad is None else yaw_rad
        yaw += room.turn_rad(obj.id)
        reach = np.abs(rotation_z(yaw)[:2, :2]) @ [obj.extent_m[0] / 2, obj.extent_m[1] / 2]
        free = half - reach - clear.edge_m
        local = np.array(at if isinstance(at, tuple) else _somewhere(room, half, free, at))
        if (np.abs(local) > free + 1e-9).any():
            over_m = float((np.abs(local) - free).max())
            if (half < reach).any():
                problem = f"is too large for {{}}: {_cm(2 * reach)} on {_cm(2 * half)}"
            else:
                problem = f"would be {100 * over_m:.1f} cm too near to the edge of {{}}, or over it"
            continue
        mine = _standing(obj, T_region, local, yaw_of(room.objects[support]) + yaw)
        blocker = room.blocker(obj.id, mine, clear.other_m)
        if blocker is not None:
            problem = f"found no free place on {{}}; {blocker} is in the way"
            continue
        if beside is not None:
            low, high = beside.gap_m
            if not low <= mine.gap_m(Footprint.of(room.objects[beside.object_id])) <= high:
                problem = f"found no free place on {{}} {low:.2f} to {high:.2f} m from {beside.object_id}"
                continue
        room.put(obj, mine.x_m, mine.y_m, mine.low_m, mine.yaw_rad)
        return obj.id
    room.forget(obj.id)
    raise NoRoom(obj.id, problem.format(f"{support} ({space.name})"))


def scatter(
    room: Room,
    models: Sequence[str],
    support: str,
    count: int,
    *,
    region: str | None = None,
    beside: Beside | None = None,
    clear: Clearance = AMPLE,
) -> tuple[str, ...]:
    """Puts up to `count` different things somewhere on a support and returns their ids.

    Things that find no place are left out: clutter asks for none in particular.

    Args:
        room: The room.
        models: What to choose from; each is taken at most once.
        support: Id of what they are put on or in.
        count: How many at most.
        region, beside, clear: As for `place`; every thing is beside that one.
    """
    chosen = [str(model) for model in room.rng.permutation(list(models))[:count]]
    found = []
    for model in chosen:
        obj = room.draw(model)
        try:
            found.append(place(room, obj, support, region=region, beside=beside, clear=clear))
        except NoRoom:
            continue
    return tuple(found)


def _region(room: Room, obj: SceneObject, support: str, name: str | None) -> Region:
    """The named region, or the one that the thing best goes to."""
    regions = asset_for(room.objects[support]).regions
    if name is not None:
        named = [space for space in regions if space.name == name]
        if not named:
            known = ", ".join(space.name for space in regions) or "none"
            raise NoRoom(obj.id, f"{support} has no place {name!r}; it has {known}")
        return named[0]
    high = [space for space in regions if space.height_m >= obj.extent_m[2] + HEADROOM_M]
    tops = [space for space in high if space.kind == "surface" and space.name == "top"]
    if not high:
        raise NoRoom(obj.id, f"no place of {support} is high enough for {obj.extent_m[2]:.2f} m")
    return (tops or high)[0]


def _cm(sides_m: Array) -> str:
    return " x ".join(f"{100 * side:.0f}" for side in sides_m) + " cm"


def _somewhere(room: Room, half: Array, free: Array, edge: AtEdge | None) -> tuple[float, float]:
    """A place in a region: anywhere, or near one of its edges."""
    rng = room.rng
    if edge is None:
        wide = np.maximum(free, 0.0)
        return float(rng.uniform(-wide[0], wide[0])), float(rng.uniform(-wide[1], wide[1]))
    axis, sign = EDGES[edge.side]
    span = max(float(free[1 - axis]), 0.0)
    low, high = edge.along_m or (-span, span)
    local = [0.0, 0.0]
    local[axis] = sign * float(half[axis] - rng.uniform(*edge.inset_m))
    local[1 - axis] = float(rng.uniform(low, high))
    return local[0], local[1]


def _standing(obj: SceneObject, T_region: Array, local: Array, yaw_rad: float) -> Footprint:
    """The thing's footprint when it stands at a place of a region."""
    x, y, _, _ = T_region @ [local[0], local[1], 0.0, 1.0]
    length, width, height = obj.extent_m
    low = float(T_region[2, 3])
    return Footprint(float(x), float(y), yaw_rad, length / 2, width / 2, low, low + height)
