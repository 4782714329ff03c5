"""The reconstruction as a scene of this project, with where every value comes from, and what physics says of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from executor.assets.footprint import Footprint
from executor.photo.fitting.body import Guess
from executor.photo.room.reconstruct import FittedRoom, FittedThing
from executor.photo.room.supports import EQUAL_M, is_on_one, tops_of
from executor.photo.space.walls import Wall
from executor.photo.tidy import SAME_HEIGHT_M, tidied
from executor.scenes.furnishing.furnish import furnished
from executor.scenes.plausible import flaws
from executor.scenes.settle import Unsettled, settle
from oag import Scene, SceneError, SceneObject
from oag.model.scenefile import about_z

_WALL_M, _THINNEST_M = 0.08, 0.02  # What is behind a wall that is looked over may stand against it.
_NEARER_M = 0.02  # So much a wall may be nearer than it was seen, where what is behind it leaves no room.
_ACROSS, _CORNER_M = 0.9, 0.3  # Walls meet about square to each other; so far behind a face ends are seen.
_DIGITS = 4
_CLEAR_M = 0.001


@dataclass(frozen=True)
class MadeScene:
    """What became of a reconstruction.

    Attributes:
        scene: The scene, settled in physics where `refused` is empty; None where not even the form holds.
        refused: Why it is no scene that can be worked in; empty when it is one.
        notes: What was moved, in sentences.
        settled_m: id -> how far physics moved it.
    """

    scene: Scene | None
    refused: str
    notes: tuple[str, ...]
    settled_m: Mapping[str, float]


def scene_of(
    found: FittedRoom, name: str, hardly_px: float, *, same_height_m: float = SAME_HEIGHT_M
) -> tuple[FittedRoom, MadeScene]:
    """Returns what is in the scene of a reconstruction, and that: without overlaps, with facts, settled in physics.

    What stands on nothing is left out. Where no such room can be, and can without one thing that is hardly seen or that
    nobody has put a box around, that is left out, too.

    Args:
        found: The fits.
        name: Of the scene.
        hardly_px: Area of the largest box of what is hardly seen.
        same_height_m: Between a thing and the top that it is taken to stand on.
    """
    while hanging := _hanging(found, tidied(found.guesses, found.walls, same_height_m)[0]):
        for thing in [one for one in found.things if one.id in hanging]:
            problem = f"nothing was found that it stands on, {100 * hanging[thing.id]:.0f} cm above the floor"
            found = found.without(thing, problem)
    if not found.things:
        return found, MadeScene(None, "nothing is in it", (), {})
    made = made_of(found, found.guesses, name, same_height_m=same_height_m)
    unsure = [one for one in found.things if one.detection.area_px < hardly_px or not one.boxed]
    for thing in sorted(unsure, key=lambda one: one.detection.area_px) if made.refused else ():
        fewer = found.without(thing, f"with it the room cannot be: {made.refused}")
        other = made_of(fewer, fewer.guesses, name, same_height_m=same_height_m)
        if not other.refused:
            return fewer, other
    return found, made


def made_of(
    found: FittedRoom, guesses: Mapping[str, Guess], name: str, *, same_height_m: float = SAME_HEIGHT_M
) -> MadeScene:
    """Returns the scene of some guesses.

    Args:
        found: The walls, and the boxes that the guesses are of.
        guesses: id -> guess.
        name: Of the scene.
        same_height_m: Between a thing and the top that it is taken to stand on.
    """
    guesses, notes = tidied(guesses, found.walls, same_height_m)
    if hanging := _hanging(found, guesses):
        listed = ", ".join(f"{key} {100 * height_m:.0f} cm above the floor" for key, height_m in hanging.items())
        return MadeScene(None, f"nothing is under {listed}", tuple(notes), {})
    names = {thing.id: thing.detection.name_as(guesses[thing.id].entry) for thing in found.things}
    data = scene_json(guesses, found.walls, name, names)
    try:
        made = furnished(data)
    except SceneError as problem:
        return MadeScene(None, str(problem), tuple(notes), {})
    if made.scene is None:
        return MadeScene(None, "; ".join(made.problems), tuple(notes), {})
    errors = [str(flaw) for flaw in flaws(made.scene) if flaw.error]
    if errors:
        return MadeScene(made.scene, "; ".join(errors), tuple(notes), {})
    try:
        settled = settle(made.scene)
    except Unsettled as problem:
        return MadeScene(made.scene, str(problem), tuple(notes), {})
    moved = {
        key: float(np.linalg.norm(np.subtract(settled.objects[key].position, made.scene.objects[key].position)))
        for key in guesses
    }
    return MadeScene(settled, "", tuple(notes), moved)


def scene_json(
    guesses: Mapping[str, Guess], walls: tuple[Wall, ...], name: str, names: Mapping[str, str]
) -> dict[str, object]:
    """Returns a scene file's content, without facts: those follow from geometry.

    Args:
        guesses: id -> guess.
        walls: The walls.
        name: Of the scene.
        names: id -> its category in the scene.
    """
    things = {key: _entry(replace(guess.as_object(key), category=names[key])) for key, guess in guesses.items()}
    footprints = [Footprint.of(guess.as_object()) for guess in guesses.values()]
    for number, wall in enumerate(walls):
        key = f"wall_{number}"
        ended = replace(wall, span_m=_ends_m(wall, [one for one in walls if one is not wall]))
        things[key] = _entry(_wall(ended, key, _back_m(wall, footprints)))
    return {"name": name, "objects": things}


def provenance(found: FittedRoom, made: MadeScene, floor_source: str) -> dict[str, object]:
    """Returns where the values of a scene come from, by object and field.

    Args:
        found, made: The reconstruction.
        floor_source: What the floor is known by.
    """
    return {
        **{thing.id: _origin(thing, made) for thing in found.things},
        **{f"wall_{number}": {"position": "plane fitted to the depth"} for number, _ in enumerate(found.walls)},
        "floor": f"{floor_source}; it is the height 0",
        "robot": "free floor near the camera",
        "facts": "geometry",
    }


def _origin(thing: FittedThing, made: MadeScene) -> dict[str, object]:
    spread_m = thing.fit.spread_m
    fitted = "fitted to depth and picture" if spread_m is None else f"fitted to box and picture, +- {spread_m:.2f} m"
    fitted = thing.fit.assumed or fitted
    label = "chosen by the fit"
    if thing.detection.category is not None:
        named = f"{thing.detection.source}: {thing.detection.label}"
        label = named if thing.detection.category == thing.fit.guess.entry.category else f"{label}, against {named}"
    moved_m = made.settled_m.get(thing.id)
    return {
        "category": label,
        "model": f"{fitted}, confidence {thing.fit.confidence:.2f}",
        "position": fitted + (f"; settled in physics, {1000 * moved_m:.1f} mm" if moved_m is not None else ""),
        "orientation": fitted,
        "bbox_extent": f"{fitted}; what is hidden, by the model's usual sizes, walls and neighbours",
        "parameters": {key: fitted for key in dict(thing.fit.guess.parameters)},
    }


def _hanging(found: FittedRoom, guesses: Mapping[str, Guess]) -> dict[str, float]:
    """Return id -> how high above the floor it is, of what stands neither on that nor on any other thing."""
    tops = list(tops_of(replace(thing.fit, guess=guesses[thing.id]) for thing in found.things))
    return {key: one.bottom_m for key, one in guesses.items() if not is_on_one(one, tops, EQUAL_M)}


def _entry(obj: SceneObject) -> dict[str, object]:
    entry: dict[str, object] = {
        "category": obj.category,
        "model": obj.model,
        "position": [round(value, _DIGITS) for value in obj.position],
        "orientation": [round(value, 9) for value in obj.orientation],
        "bbox_extent": [round(value, _DIGITS) for value in obj.bbox_extent],
    }
    if obj.parameters:
        entry["parameters"] = dict(obj.parameters)
    return entry


def _ends_m(wall: Wall, others: Sequence[Wall]) -> tuple[float, float]:
    """From where to where a wall goes: in a corner it ends at the other wall's face, though that was seen past its end.

    What goes through to the room beyond is no corner.
    """
    low_m, high_m = wall.span_m
    for other in others:
        onto = float(other.normal @ wall.along)
        if abs(onto) < _ACROSS:
            continue
        corner_m = (other.offset_m - wall.offset_m * float(other.normal @ wall.normal)) / onto
        beside_m = float(other.along @ (wall.offset_m * wall.normal + corner_m * wall.along))
        if not other.span_m[0] - _CORNER_M < beside_m < other.span_m[1] + _CORNER_M:
            continue
        if onto > 0.0 and 0.0 < corner_m - low_m < _CORNER_M:
            low_m = corner_m
        elif onto < 0.0 and 0.0 < high_m - corner_m < _CORNER_M:
            high_m = corner_m
    return low_m, high_m


def _back_m(wall: Wall, footprints: Sequence[Footprint]) -> float:
    """How far behind a wall's face its back can be for what stands behind it; below 0 where that reaches through."""
    back_m = wall.thick_m or _WALL_M
    for one in footprints:
        side, nearest = one.corners_m @ wall.along, float((one.corners_m @ wall.normal).max())
        middle = float(np.mean(one.corners_m @ wall.normal))
        if side.max() > wall.span_m[0] and side.min() < wall.span_m[1] and middle < wall.offset_m:
            back_m = min(back_m, wall.offset_m - nearest - _CLEAR_M)
    return back_m


def _wall(wall: Wall, key: str, back_m: float) -> SceneObject:
    low, high = wall.span_m
    back_m = max(back_m, _THINNEST_M - _NEARER_M)
    thick_m = max(back_m, _THINNEST_M)
    behind = (wall.offset_m - back_m + thick_m / 2) * wall.normal + (low + high) / 2 * wall.along
    yaw = math.atan2(-wall.normal[1], -wall.normal[0])
    return SceneObject(
        id=key,
        category="wall",
        model="wall",
        position=(float(behind[0]), float(behind[1]), wall.top_m / 2),
        orientation=about_z(yaw),
        bbox_extent=(thick_m, high - low, wall.top_m),
    )
