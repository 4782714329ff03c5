"""The scene of a reconstruction: overlaps resolved, provenance of every value, settled in physics, variations.

Source of the variations: the paper has three variations of each reconstruction, of the three assets that match best;
the first of them is the reconstruction itself.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from executor.assets.families.generic import GENERIC
from executor.assets.footprint import Footprint, overlap_depth_m, region_frame, solid_parts, swept_parts
from executor.assets.library import asset_for
from executor.geometry import rotation_z
from executor.photo.errors import LostCause
from executor.photo.fitting.hypothesis import PoseHypothesis, is_round, raycaster_of
from executor.photo.fitting.likelihood import AT_WALLS
from executor.photo.fitting.starts import generic_models
from executor.photo.geometry.walls import Wall
from executor.photo.room.estimate import is_item, is_on_one, tops_of
from executor.photo.room.reconstruct import FittedRoom, FittedThing
from executor.scenes.file import complete_scene
from executor.scenes.validation import Unsettled, issues, settle
from oag import Scene, SceneError, SceneObject
from oag.model.robots import DEFAULT_ROBOT
from oag.model.scene import about_z
from oag.model.symbols import Kind, kind_of

SAME_HEIGHT_M = 0.02
"""Between a thing and the top that it is taken to stand on, where both were fitted to one picture."""

_ROUNDS = 4
_CLEARANCE_M = 0.001
_SHAVED_M = 0.08
"""Two pieces in a row that overlap by less are both made narrower: their sides were misjudged."""

_OPENED_RAD, _SWING_STEPS = math.pi / 2, 16  # As doors are opened where people live.
_NOISE_RAD = math.radians(3.0)  # Uncertainty of a cabinet's heading by depth at 5 m.
_PARALLEL = math.sin(math.radians(8.0))
_EDGE_M, _EDGE_STEPS = 0.004, 24
_HIGHER_M = 0.002
_NEAR_HEIGHT_M = 0.13  # Between a thing on nothing that has a box, and a top beside it.
_FARTHEST_M = 0.5  # A thing is moved onto a top: the next one that is as high may be across the room.
_GUESSED_FAR_M = 1.5  # Without depth it was fitted to a top's height, and may be off by the error of both sizes.
_GROWN_M = 1.0  # A table is fitted to what is visible of it: things at the height of its top are on it so far off.
_ON_ITEM, _ON_TOP = 0.7, 0.4
"""Share of an item's half sides in which a middle is stable; share of a thing's own ones that lies on furniture."""

_REPORTED_M = 0.005
_IN_WALL_M = 0.003
_HANGS_M = 0.2  # A top that is nearer is likelier than a wall.
_STEP_M, _TURNS = 0.03, 16  # Of places around one that is taken.


_YIELDS = ((1.0, 1.0, 0.3), (0.5, 1.0, 0.4), (0.4, 0.7, 0.6), (0.25, 0.4, 2.0))
"""How far a thing yields until physics accepts it: shares of its depth along the view and of its other sides, and its
way [m]."""


def resolve_overlaps(
    guesses: Mapping[str, PoseHypothesis],
    walls: Sequence[Wall],
    same_height_m: float = SAME_HEIGHT_M,
    hung: Collection[str] = (),
) -> tuple[dict[str, PoseHypothesis], list[str]]:
    """Move and shrink hypotheses until none overlap; report moves of more than half a centimetre as sentences.

    Args:
        guesses: id -> pose hypothesis.
        walls: The walls.
        same_height_m: Tolerance between an object and the top that it stands on.
        hung: Furniture among them that stays where it is.
    """
    room = dict(guesses)
    large = [key for key, one in room.items() if not is_item(one) and one.bottom_m == 0.0]
    # What carries others is placed before them.
    small = sorted((key for key in room if key not in large), key=lambda key: room[key].bottom_m)
    for key in large:
        if room[key].entry.category in AT_WALLS or is_round(room[key].entry):
            room[key] = _aligned(room[key], walls)
    for key in small:
        tops = tops_of(one for other, one in room.items() if other != key)
        if key not in hung and not is_on_one(room[key], tops, same_height_m):
            _let_carry(room, key)
    for _ in range(_ROUNDS):
        for key in large:
            room[key] = _out_of_walls(room[key], walls)
        for number, key in enumerate(large):
            for other in large[number + 1 :]:
                room[key], room[other] = _apart(room[key], room[other])
    for key, other in itertools.permutations(large, 2):
        room[other] = _clear_of_doors(room[key], room[other])
    farthest_m = _FARTHEST_M if same_height_m <= SAME_HEIGHT_M else _GUESSED_FAR_M
    notes = []
    for key in small:
        others = {other: room[other] for other in room if other != key}
        if key in hung and not is_item(room[key]):
            continue
        room[key] = _on_its_top(room[key], others, same_height_m, farthest_m)
        if is_item(room[key]) and not _stands(room[key], others):
            # Its support may end too early: where nothing is below it, a near top is likelier than the floor.
            room[key] = _on_its_top(room[key], others, _NEAR_HEIGHT_M, farthest_m)
        if is_item(room[key]) and not _stands(room[key], others):
            room[key] = _put_down(room[key], list(others.values()))
            notes.append(f"{key} stands on nothing that has a box; it was put down")
    for _ in range(_ROUNDS):
        for number, key in enumerate(small):
            for other in small[number + 1 :]:
                if not _inside(room[key], room[other]) and not _inside(room[other], room[key]):
                    room[key], room[other] = _pushed(room[key], room[other])
    for key, one in room.items():
        before = guesses[key]
        moved_m = math.dist((one.x_m, one.y_m, one.bottom_m), (before.x_m, before.y_m, before.bottom_m))
        grown_m = max(abs(a - b) for a, b in zip(one.size_m, before.size_m, strict=True))
        if moved_m > _REPORTED_M or grown_m > _REPORTED_M:
            notes.append(f"{key} was moved by {100 * moved_m:.1f} cm and resized by {100 * grown_m:.1f} cm")
    return room, notes


def _let_carry(room: dict[str, PoseHypothesis], key: str) -> None:
    """Let the nearest table whose top is as high as a thing's bottom, and ends before it, reach below its middle."""
    thing, best = room[key], (_GROWN_M, "", np.zeros(2))
    margin_m = _ON_TOP * min(thing.size_m[:2]) / 2 + 2 * _EDGE_M
    for name, piece in room.items():
        is_table = kind_of(piece.entry.category, 0.0) is Kind.SUPPORT and piece.bottom_m == 0.0
        if not is_table or abs(piece.size_m[2] - thing.bottom_m) > SAME_HEIGHT_M:
            continue
        local = rotation_z(piece.yaw_rad)[:2, :2].T @ [thing.x_m - piece.x_m, thing.y_m - piece.y_m]
        out = np.maximum(np.abs(local) + margin_m - np.divide(piece.size_m[:2], 2), 0.0)
        if float(out.max()) < best[0]:
            best = float(out.max()), name, np.copysign(out, local)
    out_m, name, out = best
    if not name or out_m == 0.0:
        return
    piece = room[name]
    length, width, height = piece.size_m
    sides = length + abs(float(out[0])), width + abs(float(out[1]))
    grown = replace(piece, size_m=(*sides, height))
    if raycaster_of(grown) is None:
        slab = replace(GENERIC["generic_slab_on_legs"], category=piece.entry.category)
        grown = replace(grown, entry=slab, parameters=())
    room[name] = _shifted(grown, rotation_z(piece.yaw_rad)[:2, :2] @ out / 2)


def _footprint(guess: PoseHypothesis) -> Footprint:
    return Footprint.of(guess.as_object())


def _shifted(guess: PoseHypothesis, by: np.ndarray) -> PoseHypothesis:
    return replace(guess, x_m=guess.x_m + float(by[0]), y_m=guess.y_m + float(by[1]))


def _aligned(guess: PoseHypothesis, walls: Sequence[Wall]) -> PoseHypothesis:
    """Align a piece with a nearly parallel wall: the rest is noise. Round objects have no corners there."""
    for wall in walls:
        turned = math.remainder(guess.yaw_rad - wall.yaw_rad, math.pi / 2)
        if abs(turned) < _NOISE_RAD or is_round(guess.entry):
            return replace(guess, yaw_rad=guess.yaw_rad - turned)
    return guess


def _out_of_walls(guess: PoseHypothesis, walls: Sequence[Wall]) -> PoseHypothesis:
    for wall in walls:
        corners = _footprint(guess).corners_m
        side = corners @ wall.along
        if side.max() < wall.span_m[0] or side.min() > wall.span_m[1]:
            continue
        nearest, farthest = float((corners @ wall.normal).max()), float((corners @ wall.normal).min())
        into_m = wall.offset_m + _CLEARANCE_M - farthest
        # An object wholly behind a wall is in the next room, visible over the wall.
        if into_m > 0.0 and nearest > wall.offset_m:
            guess = _shifted(guess, into_m * wall.normal)
    return guess


def _apart(first: PoseHypothesis, second: PoseHypothesis) -> tuple[PoseHypothesis, PoseHypothesis]:
    """Separate two pieces of furniture: both are narrowed if they stand in a row, else the smaller one is moved."""
    deep_m = _footprint(first).depth_m(_footprint(second))
    # A chair may stand under a table: their parts decide.
    if deep_m <= 0.0 or overlap_depth_m(solid_parts(first.as_object()), solid_parts(second.as_object())) <= 0.0:
        return first, second
    aside = np.array([-math.sin(first.yaw_rad), math.cos(first.yaw_rad)])
    away = np.array([second.x_m - first.x_m, second.y_m - first.y_m])
    in_row = _stand_alike(first, second)
    # Where one of them is turned a little, its corner is deeper in the other one than its side.
    over_m = max((first.size_m[1] + second.size_m[1]) / 2 - abs(float(away @ aside)), deep_m) + _CLEARANCE_M
    if in_row and over_m < _SHAVED_M:
        sign = math.copysign(1.0, float(away @ aside))
        return _narrower(first, over_m / 2, sign), _narrower(second, over_m / 2, -sign)
    return _pushed(first, second)


def _stand_alike(first: PoseHypothesis, second: PoseHypothesis) -> bool:
    """Return whether two pieces stand as in a row."""
    turned = first.yaw_rad - second.yaw_rad
    return abs(math.sin(turned)) < _PARALLEL and math.cos(turned) > 0


def _clear_of_doors(guess: PoseHypothesis, other: PoseHypothesis) -> PoseHypothesis:
    """Narrow another piece of a row if a door swings into its side.

    The piece with the door often hides that side.
    """
    near_m = (guess.size_m[1] + other.size_m[1]) / 2 + _SHAVED_M
    away = np.array([other.x_m - guess.x_m, other.y_m - guess.y_m])
    aside = np.array([-math.sin(other.yaw_rad), math.cos(other.yaw_rad)])
    if not _stand_alike(guess, other) or abs(float(away @ aside)) > near_m:
        return other
    side, theirs = -math.copysign(1.0, float(away @ aside)), _footprint(other)
    into_m = max(
        (_reach_m(part, theirs, side) for part in swept_parts(guess.as_object(), _OPENED_RAD, _SWING_STEPS)),
        default=0.0,
    )
    return _narrower(other, into_m + _CLEARANCE_M, side) if 0.0 < into_m < _SHAVED_M else other


def _reach_m(part: Footprint, other: Footprint, side: float) -> float:
    """Return how far a part reaches into an object from one side, +1 its own +y; 0 if it does not."""
    if part.depth_m(other) <= 0.0:
        return 0.0
    along = np.linspace(part.corners_m, np.roll(part.corners_m, 1, axis=0), _EDGE_STEPS).reshape(-1, 2)
    local = (along - [other.x_m, other.y_m]) @ rotation_z(other.yaw_rad)[:2, :2]
    inside = (np.abs(local) < [other.half_x_m, other.half_y_m]).all(axis=1)
    return float((other.half_y_m - side * local[inside, 1]).max(initial=0.0))


def _narrower(guess: PoseHypothesis, by_m: float, side: float) -> PoseHypothesis:
    """Narrow a piece on one side, +1 its own +y; move it by what its model does not allow."""
    length, width, height = guess.size_m
    least = guess.entry.width.low
    cut = min(by_m, max(0.0, width - least))
    aside = np.array([-math.sin(guess.yaw_rad), math.cos(guess.yaw_rad)])
    # The rest is moved.
    smaller = replace(guess, size_m=(length, width - cut, height))
    return _shifted(smaller, -side * (cut / 2 + (by_m - cut)) * aside)


def _pushed(first: PoseHypothesis, second: PoseHypothesis) -> tuple[PoseHypothesis, PoseHypothesis]:
    """Move the smaller of two objects along the axis of least overlap."""
    a, b = _footprint(first), _footprint(second)
    if a.depth_m(b) <= 0.0:
        return first, second
    second_gives = second.size_m[0] * second.size_m[1] <= first.size_m[0] * first.size_m[1]
    least: tuple[float, np.ndarray] | None = None
    for yaw in (a.yaw_rad, b.yaw_rad):
        for axis in (np.array([math.cos(yaw), math.sin(yaw)]), np.array([-math.sin(yaw), math.cos(yaw)])):
            mine, theirs = a.corners_m @ axis, b.corners_m @ axis
            for over_m, direction in ((mine.max() - theirs.min(), axis), (theirs.max() - mine.min(), -axis)):
                if least is None or over_m < least[0]:
                    least = float(over_m), direction
    if least is None:
        return first, second
    by = (least[0] + _CLEARANCE_M) * least[1]
    return (first, _shifted(second, by)) if second_gives else (_shifted(first, -by), second)


def _inside(thing: PoseHypothesis, other: PoseHypothesis) -> bool:
    """Return whether an object stands above another's bottom and within its outline: in a bowl, on a plate."""
    mine, theirs = _footprint(thing), _footprint(other)
    return thing.bottom_m > other.bottom_m + _HIGHER_M and mine.gap_m(theirs) < -min(mine.half_x_m, mine.half_y_m)


def _on_its_top(
    guess: PoseHypothesis, others: Mapping[str, PoseHypothesis], same_height_m: float, farthest_m: float
) -> PoseHypothesis:
    """Move an object onto the top or board that it stands on, at exactly its height, so far that it is stable.

    On an item, such as a saucer, its middle is enough.
    """
    best: tuple[float, PoseHypothesis] | None = None
    for other in others.values():
        on_item = is_item(other)
        if on_item and other.bottom_m >= guess.bottom_m:
            continue
        carrier = other.as_object()
        for region in asset_for(carrier).regions:
            T, half = region_frame(carrier, region)
            if abs(float(T[2, 3]) - guess.bottom_m) > same_height_m:
                continue
            turn = T[:2, :2]
            local = turn.T @ (np.array([guess.x_m, guess.y_m]) - T[:2, 3])
            own = guess.yaw_rad - math.atan2(turn[1, 0], turn[0, 0])
            c, s = abs(math.cos(own)), abs(math.sin(own))
            reach = np.array([c * guess.size_m[0] + s * guess.size_m[1], s * guess.size_m[0] + c * guess.size_m[1]]) / 2
            free = _ON_ITEM * half if on_item else np.maximum(half - _ON_TOP * reach - _EDGE_M, 0.0)
            inside = np.clip(local, -free, free)
            aside_m = float(np.linalg.norm(inside - local))
            by_m = math.hypot(aside_m, float(T[2, 3]) - guess.bottom_m)
            if aside_m < (min(other.size_m[:2]) / 2 if on_item else farthest_m) and (best is None or by_m < best[0]):
                x, y = turn @ inside + T[:2, 3]
                best = by_m, replace(guess, x_m=float(x), y_m=float(y), bottom_m=float(T[2, 3]))
    return guess if best is None else best[1]


def _stands(guess: PoseHypothesis, others: Mapping[str, PoseHypothesis]) -> bool:
    """Return whether an object is on the floor, or over a top at its height."""
    return guess.bottom_m == 0.0 or is_on_one(guess, tops_of(others.values()), _HIGHER_M)


def _put_down(guess: PoseHypothesis, others: Sequence[PoseHypothesis]) -> PoseHypothesis:
    """Lower an object that stands on nothing to the nearest top below its middle, or to the floor."""
    at = np.array([guess.x_m, guess.y_m])
    below = [0.0]
    for other in others:
        carrier = other.as_object()
        for region in asset_for(carrier).regions:
            T, half = region_frame(carrier, region)
            inside = (np.abs(T[:2, :2].T @ (at - T[:2, 3])) <= half).all()
            if region.kind == "surface" and inside and T[2, 3] <= guess.bottom_m:
                below.append(float(T[2, 3]))
    return replace(guess, bottom_m=max(below))


_WALL_M, _THINNEST_M = 0.08, 0.02  # Objects behind a low wall may stand against it.
_NEARER_M = 0.02  # Error of a wall's distance, if an object behind it leaves no room.
_ACROSS, _CORNER_M = 0.9, 0.3  # Walls meet about square; tolerance of ends behind a face.
_DIGITS = 4
_BEHIND_CLEARANCE_M = 0.001


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


def scene_of(found: FittedRoom, name: str, *, same_height_m: float = SAME_HEIGHT_M) -> tuple[FittedRoom, MadeScene]:
    """Return the room that fits in a scene, and its scene: without overlaps, with facts, settled in physics.

    Walls that reach into things are left out. A thing that physics refuses goes to the nearest free place, then as a
    narrower box: a label is a fact, and only what fits nowhere is left out.

    Args:
        found: The fits.
        name: Name of the scene.
        same_height_m: Tolerance between an object and the top that it stands on.
    """
    if not found.things:
        return found, MadeScene(None, "nothing is in it", (), {})
    made = first = made_of(found, found.guesses, name, same_height_m=same_height_m)
    room, changed = found, Counter[str]()
    for _ in range((len(_YIELDS) + 1) * len(found.things) + 2):
        if not made.refused:
            return room, made
        thing = next((one for one in room.things if one.id == made.culprit), None)
        walls = () if thing is None or made.scene is None else _clear_walls(made.scene, room.walls)
        if walls != room.walls:
            # A wall is a plane among points; what has a box is a fact.
            room = replace(room, walls=walls)
        elif thing is None or made.scene is None:
            break
        elif changed[thing.id] == len(_YIELDS):
            room = room.without(thing, LostCause.NO_ROOM, made.refused)
        else:
            guess = _yielding(thing, made.scene, *_YIELDS[changed[thing.id]])
            changed[thing.id] += 1
            other = replace(thing, fit=replace(thing.fit, guess=guess))
            room = replace(room, things=tuple(other if one is thing else one for one in room.things))
        if not room.things:
            break
        made = made_of(room, room.guesses, name, same_height_m=same_height_m)
    return (found, first) if made.refused else (room, made)


def _clear_walls(scene: Scene, walls: tuple[Wall, ...]) -> tuple[Wall, ...]:
    """Return the walls that no object reaches into."""
    things = [solid_parts(obj) for obj in scene.objects.values() if obj.category != "wall"]
    planes = [solid_parts(scene.objects[f"wall_{number}"]) for number in range(len(walls))]
    clear = (all(overlap_depth_m(one, parts) <= _IN_WALL_M for one in things) for parts in planes)
    return tuple(itertools.compress(walls, clear))


def _yielding(thing: FittedThing, scene: Scene, deep_share: float, wide_share: float, reach_m: float) -> PoseHypothesis:
    """Return a fit that physics refuses as a narrower box, where nothing else is; the front stays what is measured."""
    guess, obj = thing.fit.guess, scene.objects[thing.id]
    x, y, z = obj.position
    guess = replace(guess, x_m=x, y_m=y, bottom_m=max(0.0, z - guess.size_m[2] / 2))
    if deep_share < 1.0:
        away = math.atan2(y, x) - guess.yaw_rad
        deep, (length, width, height) = int(abs(math.sin(away)) > abs(math.cos(away))), guess.size_m
        sides = [wide_share * length, wide_share * width]
        sides[deep] *= deep_share / wide_share
        if guess.entry.model not in GENERIC:
            box = replace(generic_models(thing.detection)[0], category=guess.entry.category)
            guess = replace(guess, entry=box, parameters=())
        guess = replace(guess, size_m=(sides[0], sides[1], wide_share * height))
    return _at_rest(guess, thing.id, scene, reach_m) or guess


def _at_rest(guess: PoseHypothesis, key: str, scene: Scene, reach_m: float) -> PoseHypothesis | None:
    """Return the nearest place at which a thing is in nothing else, over a top or the floor; None within reach.

    Furniture may hang where it is, if no top is near.
    """
    others = [obj for name, obj in scene.objects.items() if name != key]
    solids = [(Footprint.of(obj), solid_parts(obj)) for obj in others]
    floor = 0.0 if is_item(guess) else guess.bottom_m
    hangs_m = _HANGS_M if floor > 0.0 else 0.0
    places: list[tuple[float, np.ndarray, np.ndarray]] = [(floor, np.eye(4), np.full(2, math.inf))]
    for obj in others if is_item(guess) or hangs_m else ():
        for region in asset_for(obj).regions:
            if region.kind == "surface":
                T, half = region_frame(obj, region)
                places.append((float(T[2, 3]), T, np.asarray(half)))
    turns = np.linspace(0.0, 2.0 * math.pi, _TURNS, endpoint=False)
    steps = [(0.0, 0.0), *((r, turn) for r in np.arange(_STEP_M, reach_m, _STEP_M) for turn in turns)]
    tried = []
    for (by_m, turn), (height_m, T, half) in itertools.product(steps, places):
        at = np.array([guess.x_m + by_m * math.cos(turn), guess.y_m + by_m * math.sin(turn)])
        if (np.abs(T[:2, :2].T @ (at - T[:2, 3])) <= half - _EDGE_M).all():
            cost_m = by_m + abs(height_m - guess.bottom_m) + (hangs_m if math.isinf(half[0]) else 0.0)
            tried.append((cost_m, float(at[0]), float(at[1]), height_m))
    for _, x, y, height_m in sorted(tried):
        moved = replace(guess, x_m=x, y_m=y, bottom_m=height_m)
        own, parts = _footprint(moved), solid_parts(moved.as_object())
        near = (theirs for outline, theirs in solids if own.depth_m(outline) > 0.0)
        if all(overlap_depth_m(parts, theirs) <= _CLEARANCE_M for theirs in near):
            return moved
    return None


def made_of(
    found: FittedRoom, guesses: Mapping[str, PoseHypothesis], name: str, *, same_height_m: float = SAME_HEIGHT_M
) -> MadeScene:
    """Make a scene of pose hypotheses.

    Args:
        found: The walls and detections.
        guesses: id -> pose hypothesis.
        name: Name of the scene.
        same_height_m: Tolerance between an object and the top that it stands on.
    """
    hung = {thing.id for thing in found.things if thing.fit.hangs}
    guesses, notes = resolve_overlaps(guesses, found.walls, same_height_m, hung)
    names = {
        thing.id: thing.detection.name_as(guesses[thing.id].entry, min(guesses[thing.id].size_m[:2]))
        for thing in found.things
    }
    data = scene_json(guesses, found.walls, name, names)
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
    overlapping = (key for key in guesses if overlap_depth_m(parts[key], parts[blamed]) > _CLEARANCE_M)
    return min((blamed, *overlapping), key=lambda key: math.prod(guesses[key].size_m))


def scene_json(
    guesses: Mapping[str, PoseHypothesis], walls: tuple[Wall, ...], name: str, names: Mapping[str, str]
) -> dict[str, object]:
    """Return the content of a scene file without facts, which follow from geometry.

    Its robot is the one on a lift: real tables and counters are as high as they are.

    Args:
        guesses: id -> pose hypothesis.
        walls: The walls.
        name: Name of the scene.
        names: id -> category in the scene.
    """
    things = {key: _entry(replace(guess.as_object(key), category=names[key])) for key, guess in guesses.items()}
    footprints = [Footprint.of(guess.as_object()) for guess in guesses.values()]
    for number, wall in enumerate(walls):
        key = f"wall_{number}"
        ended = replace(wall, span_m=_ends_m(wall, [one for one in walls if one is not wall]))
        things[key] = _entry(_wall(ended, key, _back_m(wall, footprints)))
    return {"name": name, "robot": {"name": DEFAULT_ROBOT.name}, "objects": things}


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
        "robot": "free floor near the camera",
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
