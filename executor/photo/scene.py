"""The scene of a reconstruction: settled in physics, with the provenance of every value, and its variations.

Source of the variations: the paper has three variations of each reconstruction, of the three assets that match best;
the first of them is the reconstruction itself.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from executor.assets.families.generic import GENERIC
from executor.assets.footprint import Footprint, overlap_depth_m, solid_parts
from executor.photo.errors import LostCause
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.geometry.walls import Wall
from executor.photo.overlaps import SAME_HEIGHT_M, resolve_overlaps
from executor.photo.room.reconstruct import FittedRoom, FittedThing
from executor.photo.separation import CLEARANCE_M
from executor.photo.yielding import YIELDS, clear_walls, yielding
from executor.scenes.file import complete_scene
from executor.scenes.placement import robot_has_room
from executor.scenes.validation import Unsettled, issues, settle
from oag import Scene, SceneError, SceneObject
from oag.model.robots import DEFAULT_ROBOT
from oag.model.scene import about_z

_WALL_M, _THINNEST_M = 0.08, 0.02  # Objects behind a low wall may stand against it.
_NEARER_M = 0.02  # Error of a wall's distance, if an object behind it leaves no room.
_ACROSS, _CORNER_M = 0.9, 0.3  # Walls meet about square; tolerance of ends behind a face.
_START_STEP_M, _START_MOST_M = 0.1, 1.5  # Behind the camera, as far as the robot may start.
_DIGITS = 4
_BEHIND_CLEARANCE_M = 0.001
_LEAST_SHARE = 0.02  # Of what is visible of a thing: less is an edge.


@dataclass(frozen=True)
class MadeScene:
    """The scene of a reconstruction.

    Attributes:
        scene: The scene, settled in physics if `refused` is empty; None if even its form is invalid.
        refused: Why the scene is unusable; empty if it is usable.
        notes: What was moved, as sentences.
        settled_m: id -> how far physics moved the object.
        culprit: Of an unusable scene, the object to blame, if there is one.
    """

    scene: Scene | None
    refused: str
    notes: tuple[str, ...]
    settled_m: Mapping[str, float]
    culprit: str | None = None


def scene_of(found: FittedRoom, name: str) -> tuple[FittedRoom, MadeScene]:
    """Return the room that fits in a scene, and its scene: without overlaps, with facts, settled in physics.

    Walls that reach into things are left out. A thing that physics refuses goes to the nearest free place, then as a
    narrower box: a label is a fact, and only what fits nowhere is left out.

    Args:
        found: The fits.
        name: Name of the scene.
    """
    if not found.things:
        return found, MadeScene(None, "nothing is in it", (), {})
    made = first = made_of(found, found.guesses, name)
    room, changed = found, Counter[str]()
    for _ in range((len(YIELDS) + 1) * len(found.things) + 2):
        if not made.refused:
            return room, made
        thing = next((one for one in room.things if one.id == made.culprit), None)
        walls = () if thing is None or made.scene is None else clear_walls(made.scene, room.walls)
        if len(walls) < len(room.walls):
            # A wall is a plane among points; what has a box is a fact.
            room = replace(room, walls=walls)
        elif thing is None or made.scene is None or first.scene is None:
            break
        elif changed[thing.id] == len(YIELDS):
            room = room.without(thing, LostCause.NO_ROOM, made.refused)
        else:
            fit = replace(thing.fit, guess=found.guesses[thing.id])
            guess = yielding(replace(thing, fit=fit), first.scene, made.scene, changed[thing.id])
            changed[thing.id] += 1
            other = replace(thing, fit=replace(fit, guess=guess))
            room = replace(room, things=tuple(other if one is thing else one for one in room.things))
        if not room.things:
            break
        made = made_of(room, room.guesses, name, fitted=found.guesses)
    return (found, first) if made.refused else (room, made)


def made_of(
    found: FittedRoom,
    guesses: Mapping[str, PoseHypothesis],
    name: str,
    *,
    same_height_m: float = SAME_HEIGHT_M,
    fitted: Mapping[str, PoseHypothesis] | None = None,
) -> MadeScene:
    """Make a scene of pose hypotheses.

    Args:
        found: The walls and detections.
        guesses: id -> pose hypothesis.
        name: Name of the scene.
        same_height_m: Tolerance between an object and the top that it stands on.
        fitted: id -> pose with which reported moves are compared; None: the hypotheses.
    """
    hung = {thing.id for thing in found.things if thing.fit.hangs}
    sized = {thing.id for thing in found.things if thing.detection.size_m is not None}
    guesses, notes = resolve_overlaps(guesses, found.walls, same_height_m, hung, fitted, found.fills, found.on, sized)
    labels = [thing.detection.label for thing in found.things]
    names = {
        thing.id: thing.detection.name_as(guesses[thing.id].entry, min(guesses[thing.id].size_m[:2]), labels)
        for thing in found.things
    }
    colours = {thing.id: thing.colours for thing in found.things}
    data = scene_json(guesses, found.walls, name, names, colours)
    try:
        made = complete_scene(data)
    except SceneError as problem:
        return MadeScene(None, str(problem), tuple(notes), {})
    if made.scene is None:
        return MadeScene(None, "; ".join(made.problems), tuple(notes), {})
    if errors := [issue for issue in issues(made.scene) if issue.error]:
        blamed = next((one.object_id for one in errors if one.object_id in guesses), None)
        return MadeScene(made.scene, "; ".join(map(str, errors)), tuple(notes), {}, _culprit(blamed, guesses))
    try:
        settled = settle(made.scene)
    except Unsettled as problem:
        return MadeScene(made.scene, str(problem), tuple(notes), {}, _culprit(problem.object_id, guesses))
    moved = {
        key: float(np.linalg.norm(np.subtract(settled.objects[key].position, made.scene.objects[key].position)))
        for key in guesses
    }
    return MadeScene(settled, "", tuple(notes), moved)


def _culprit(blamed: str | None, guesses: Mapping[str, PoseHypothesis]) -> str | None:
    """Return the smallest of an object and those that overlap it: the others stand without it."""
    if blamed is None or blamed not in guesses:
        return None
    parts = {key: solid_parts(guess.as_object(key)) for key, guess in guesses.items()}
    overlapping = (key for key in guesses if overlap_depth_m(parts[key], parts[blamed]) > CLEARANCE_M)
    return min((blamed, *overlapping), key=lambda key: math.prod(guesses[key].size_m))


def scene_json(
    guesses: Mapping[str, PoseHypothesis],
    walls: tuple[Wall, ...],
    name: str,
    names: Mapping[str, str],
    colours: Mapping[str, Mapping[str, float]] = MappingProxyType({}),
) -> dict[str, object]:
    """Return the content of a scene file without facts, which follow from geometry.

    Its robot is the one on a lift: real tables and counters are as high as they are.

    Args:
        guesses: id -> pose hypothesis.
        walls: The walls.
        name: Name of the scene.
        names: id -> category in the scene.
        colours: id -> shares of colours that the picture shows of it, by which sentences tell things of one name apart.
    """
    things = {}
    for key, guess in guesses.items():
        made = replace(guess.as_object(key), category=names[key])
        shares = {name: round(share, 2) for name, share in colours.get(key, {}).items() if share >= _LEAST_SHARE}
        more = {"color_shares": shares} if shares else {}
        things[key] = _entry(replace(made, parameters={**made.parameters, **more}))
    footprints = [Footprint.of(guess.as_object()) for guess in guesses.values()]
    taken = list(footprints)
    for number, wall in enumerate(walls):
        key = f"wall_{number}"
        ended = replace(wall, span_m=_ends_m(wall, [one for one in walls if one is not wall]))
        made = _wall(ended, key, _back_m(wall, footprints))
        things[key] = _entry(made)
        taken.append(Footprint.of(made))
    robot: dict[str, object] = {"name": DEFAULT_ROBOT.name}
    if (back_m := _back_m_of_start(taken)) is not None:
        robot |= {"position": [0.0 - back_m, 0.0, 0.0], "yaw": 0.0}
    return {"name": name, "robot": robot, "objects": things}


def _back_m_of_start(footprints: Sequence[Footprint]) -> float | None:
    """Return how far behind the camera the robot starts, with its view; None where things and walls leave no room.

    People say "left" and "behind" of a picture.
    """
    taken = {str(index): one for index, one in enumerate(footprints)}
    steps = (_START_STEP_M * step for step in range(round(_START_MOST_M / _START_STEP_M) + 1))
    return next((back_m for back_m in steps if robot_has_room(-back_m, 0.0, 0.0, taken)), None)


def provenance(found: FittedRoom, made: MadeScene, floor_source: str) -> dict[str, object]:
    """Return the origin of each value of a scene, by object and field.

    Args:
        found, made: The reconstruction.
        floor_source: Origin of the floor.
    """
    return {
        **{thing.id: _origin(thing, made) for thing in found.things},
        **{f"wall_{number}": {"position": "plane fitted to the depth"} for number, _ in enumerate(found.walls)},
        "floor": f"{floor_source}; it is the height 0",
        "robot": "free floor behind the camera, or near it",
        "facts": "geometry",
    }


def _origin(thing: FittedThing, made: MadeScene) -> dict[str, object]:
    place_m, side_m = thing.fit.spread_m
    is_generic = thing.fit.guess.entry.model in GENERIC
    fitted = thing.fit.assumed or (
        "fitted to depth and picture" if math.isfinite(thing.fit.residual_m) else "fitted to the box"
    )
    named = f"{thing.detection.source}: {thing.detection.label}"
    moved_m = made.settled_m.get(thing.id)
    settled = "" if moved_m is None else f"; settled in physics, {1000 * moved_m:.1f} mm"
    kind = "a generic shape: no model of the library fits" if is_generic else "the library's model that fits best"
    return {
        "category": named if thing.detection.category is not None else "no name was given",
        "model": f"{kind}, confidence {thing.fit.confidence:.2f}",
        "position": f"{fitted}, +- {place_m:.3f} m{settled}",
        "orientation": fitted,
        "bbox_extent": f"{fitted}, +- {side_m:.3f} m; what is hidden, by usual sizes, walls and neighbours",
        "parameters": {key: fitted for key in dict(thing.fit.guess.parameters)},
    }


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
    if obj.fixed:
        entry["fixed"] = True
    return entry


def _ends_m(wall: Wall, others: Sequence[Wall]) -> tuple[float, float]:
    """Return the span of a wall; in a corner it ends at the other wall's face, even if it was fitted past it.

    A wall that continues into the room beyond has no corner there.
    """
    low_m, high_m = wall.span_m
    for other in others:
        onto = float(other.normal @ wall.along)
        if abs(onto) < _ACROSS:
            continue
        corner_m = (other.offset_m - wall.offset_m * float(other.normal @ wall.normal)) / onto
        along_m = float(other.along @ (wall.offset_m * wall.normal + corner_m * wall.along))
        if not other.span_m[0] - _CORNER_M < along_m < other.span_m[1] + _CORNER_M:
            continue
        if onto > 0.0 and 0.0 < corner_m - low_m < _CORNER_M:
            low_m = corner_m
        elif onto < 0.0 and 0.0 < high_m - corner_m < _CORNER_M:
            high_m = corner_m
    return low_m, high_m


def _back_m(wall: Wall, footprints: Sequence[Footprint]) -> float:
    """Return how far a wall's back can be behind its face; below 0 if an object behind it reaches through."""
    back_m = wall.thick_m or _WALL_M
    for one in footprints:
        side, nearest = one.corners_m @ wall.along, float((one.corners_m @ wall.normal).max())
        middle = float(np.mean(one.corners_m @ wall.normal))
        if side.max() > wall.span_m[0] and side.min() < wall.span_m[1] and middle < wall.offset_m:
            back_m = min(back_m, wall.offset_m - nearest - _BEHIND_CLEARANCE_M)
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


COUNT = 2
"""Number of variations in addition to the reconstruction itself."""

_HEIGHT_M = 0.10  # Between tops of models that explain the same thing.


@dataclass(frozen=True)
class RoomVariation:
    """One variation of a room.

    Attributes:
        number: 1 for the second best models, 2 for the third.
        models: id -> model, for objects with another model than in the reconstruction.
        made: The scene.
    """

    number: int
    models: Mapping[str, str]
    made: MadeScene


def variations_of(found: FittedRoom, name: str) -> tuple[RoomVariation, ...]:
    """Return the variations of a room in which any object has another model; physics may refuse some.

    Args:
        found: The fits; an object with fewer alternatives keeps the last of them.
        name: Name of the scene.
    """
    varied: list[RoomVariation] = []
    for number in range(1, COUNT + 1):
        guesses, models = {}, {}
        for thing in found.things:
            ranked = (thing.fit.guess, *(one.guess for one in thing.fit.alternatives))
            guesses[thing.id] = ranked[min(number, len(ranked) - 1)]
            if guesses[thing.id] is not thing.fit.guess:
                models[thing.id] = guesses[thing.id].entry.model
        if models and all(models != other.models for other in varied):
            made = made_of(found, guesses, f"{name}_{number}", same_height_m=_HEIGHT_M)
            varied.append(RoomVariation(number, models, made))
    return tuple(varied)
