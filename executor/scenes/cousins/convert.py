"""From a reconstruction to a scene of the library's models; what has no likeness is refused, all of it at once."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import bddl
from executor.assets.library import asset_for
from executor.assets.parameters import AssetError
from executor.scenes.cousins.arrange import FLOOR_SPOT, MOST_MOVED_M, STANDS_M, Arrangement, Spot
from executor.scenes.cousins.form import Cousin, Reconstruction, read
from executor.scenes.cousins.likeness import (
    FLAT,
    Unlike,
    Upright,
    category_of,
    model_for,
    models_of,
    shaped,
    unlike_size,
    upright,
    written_category,
)
from executor.scenes.rooms.room import CLOSED, NoRoom
from oag import Kind, Scene, SceneError, SceneObject, kind_of
from oag.model.scenefile import FLOOR, id_problem

_MANY = 3  # So many things that lean one way say something of the camera.
_LEAN_DEG = 3.0  # Reconstructions are not exact.
_ONE_WAY = 0.05
_UPRIGHT = 0.99

_NO_NAME = re.compile(r"[^A-Za-z0-9_.-]+")


@dataclass(frozen=True, slots=True)
class Converted:
    """A scene, and in sentences what differs from the reconstruction."""

    scene: Scene
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Draft:
    """A thing with its likeness, not yet placed."""

    cousin: Cousin
    obj: SceneObject
    at: Upright


def from_cousins(path: str | Path) -> Converted:
    """Returns the scene of a `scene_k_info.json`, its objects the library's models that are most like them.

    Category and size choose the model; the size stays, but for models of fixed proportions. Tops carry what stands on
    them by the scene graph (`scene_k_graph.json` beside the file), or by position where there is none. The robot
    starts on the free floor that is nearest to the camera.

    Raises:
        SceneError: The file is malformed, or some of its objects cannot be taken over; the message lists them all.
    """
    found = read(Path(path))
    drafts, notes, problems = _drafts(found)
    room = Arrangement()
    if not problems:
        problems = _arrange(room, drafts, found)
    if problems:
        listed = "".join(f"\n  - {problem}" for problem in problems)
        count = f"{len(problems)} of {len(found.cousins)} objects cannot be taken over"
        hint = _camera_hint(found)
        raise SceneError(f"{count}{hint}; without them in its `objects` it can be read:{listed}", source=str(path))
    try:
        robot = room.robot((float(found.camera_m[0]), float(found.camera_m[1])))
    except NoRoom as problem:
        raise SceneError(str(problem), source=str(path)) from problem
    facts: list[bddl.Formula] = [bddl.Atom(name, (thing, support)) for name, thing, support in room.relations]
    facts += [bddl.Not(bddl.Atom("open", (key,))) for key, obj in room.objects.items() if obj.kind is Kind.ARTICULATED]
    in_order = {draft.obj.id: room.objects[draft.obj.id] for draft in drafts.values()}
    return Converted(Scene(found.name, robot, in_order, tuple(facts), CLOSED), (*found.notes, *notes, *room.notes))


def _drafts(found: Reconstruction) -> tuple[dict[str, _Draft], list[str], list[str]]:
    """Likenesses by the ids of the file, notes, and what has none."""
    drafts: dict[str, _Draft] = {}
    notes, problems = [], []
    for cousin in found.cousins:
        if cousin.category.lower() in FLAT:
            notes.append(f"{cousin.id} was left out: nothing meets a {cousin.category}")
            continue
        try:
            draft = _draft(cousin, found)
        except Unlike as problem:
            problems.append(f"{cousin.id}: {problem}")
            continue
        except AssetError as problem:
            problems.append(str(problem))
            continue
        if said := id_problem(draft.obj.id, draft.obj.category):
            problems.append(f"{cousin.id}: {said}")
            continue
        if draft.obj.id in {other.obj.id for other in drafts.values()}:
            problems.append(f"{cousin.id}: another object is called {draft.obj.id} too")
            continue
        drafts[cousin.id] = draft
        if draft.obj.id != cousin.id:
            notes.append(f"{cousin.id!r} is called {draft.obj.id} here: ids have letters, digits, '_', '.' and '-'")
        if draft.at.turned:
            notes.append(f"{cousin.id} has its front at -y, where the camera was")
    return drafts, [*notes, *_leans(drafts.values())], problems


def _leans(drafts: Collection[_Draft]) -> Iterator[str]:
    """Yields what leaned before it was set upright: all of it in one sentence where all leaned one way."""
    leans = np.array([draft.at.lean for draft in drafts]).reshape(-1, 2)
    middle = leans.mean(axis=0) if len(leans) else np.zeros(2)
    tilt_deg = math.degrees(math.asin(min(1.0, float(np.linalg.norm(middle)))))
    if len(leans) >= _MANY and tilt_deg > _LEAN_DEG and np.linalg.norm(leans - middle, axis=1).max() < _ONE_WAY:
        axis = int(np.argmax(np.abs(middle)))
        towards = f"{'+' if middle[axis] > 0.0 else '-'}{'xy'[axis]}"
        said = f"everything leans by {tilt_deg:.0f} degrees towards {towards}"
        yield f"{said}: it was set upright; the camera's pose in the file may be tilted"
        return
    for draft in drafts:
        if draft.at.lean_deg > _LEAN_DEG:
            yield f"{draft.obj.id} leans by {draft.at.lean_deg:.0f} degrees: it was set upright"


def _camera_hint(found: Reconstruction) -> str:
    """Returns what to say where everything would be upright with the camera's quaternion read as w x y z."""
    R_camera = found.T_camera[:3, :3]
    w, x, y, z = Rotation.from_matrix(R_camera).as_quat()
    R_swapped = Rotation.from_quat([x, y, z, w]).as_matrix()
    # How upright each one's own z axis is.
    now = [cousin.T_world[2, 2] for cousin in found.cousins]
    then = [(R_swapped @ R_camera.T @ cousin.T_world[:3, :3])[2, 2] for cousin in found.cousins]
    if len(now) < _MANY or min(then) < _UPRIGHT or max(now) > _UPRIGHT:
        return ""
    return " (cam_pose[1] looks like w x y z: everything would be upright then; expected x y z w)"


def _draft(cousin: Cousin, found: Reconstruction) -> _Draft:
    category = category_of(cousin.category)
    front = kind_of(category, min(cousin.extent_m[:2])) is Kind.ARTICULATED
    at = upright(cousin, found.camera_m, front=front)
    entry = model_for(category, at.size_m)
    obj = SceneObject(
        id=_NO_NAME.sub("_", cousin.id).lstrip(".-"),
        category=written_category(cousin.category, entry),
        model=entry.model,
        position=(0.0, 0.0, 0.0),
        orientation=(1.0, 0.0, 0.0, 0.0),
        bbox_extent=shaped(entry, at.size_m),
    )
    asset_for(obj)  # Refuses a size that its parts do not fit in.
    if (said := unlike_size(at.size_m, models_of(category))) is not None:
        raise Unlike(said)
    return _Draft(cousin, obj, at)


def _arrange(room: Arrangement, drafts: Mapping[str, _Draft], found: Reconstruction) -> list[str]:
    """Puts everything in its place, supports and what is lower first, and returns what found none."""
    beneath = {cousin.id: cousin.beneath for cousin in found.cousins}
    support_of = {key: _stated_support(key, drafts, beneath) for key in drafts}
    waiting = sorted(drafts, key=lambda key: drafts[key].at.bottom_m)
    problems: list[str] = []
    there: set[str | None] = {None, FLOOR}
    while (key := next((key for key in waiting if support_of[key] in there), None)) is not None:
        waiting.remove(key)
        draft = drafts[key]
        try:
            if draft.cousin.on_floor:
                room.place(draft.obj, draft.at, _spot(room, draft, support_of[key], drafts))
            else:
                room.put(draft.obj, draft.at, draft.at.centre_m[2] - draft.obj.extent_m[2] / 2)
            there.add(key)
        except NoRoom as problem:
            problems.append(str(problem))
    return [*problems, *(f"{key}: stands on what stands on it, or on what has no place" for key in waiting)]


def _stated_support(key: str, drafts: Mapping[str, _Draft], beneath: Mapping[str, str | None]) -> str | None:
    """What a thing stands on by the scene graph: an id of the file or "floor"; None where its height has to tell."""
    if not drafts[key].cousin.on_floor:
        return None
    passed = {key}
    below = beneath.get(key)
    # What lies flat was left out; what stood on it stands on what was below.
    while below is not None and below not in drafts and below != FLOOR:
        if below in passed:
            return None
        passed.add(below)
        below = beneath.get(below)
    return below


def _spot(room: Arrangement, draft: _Draft, stated: str | None, drafts: Mapping[str, _Draft]) -> Spot:
    """Returns what a thing is put on: what the scene graph says, unless the thing is far from that.

    Raises:
        NoRoom: There is nothing.
    """
    if stated is None:
        return room.spot_below(draft.obj, draft.at)
    if stated == FLOOR:
        spot, most_m = FLOOR_SPOT, STANDS_M
    else:
        spot, most_m = room.spot_on(draft.obj, draft.at, drafts[stated].obj.id), MOST_MOVED_M
    away_m = draft.at.bottom_m - spot.height_m
    if abs(away_m) <= most_m:
        return spot
    by_height = room.spot_below(draft.obj, draft.at)
    if by_height != spot:
        side = "above" if away_m > 0.0 else "below"
        said = f"the scene graph has {draft.obj.id} on {spot.name}, and it is {100 * abs(away_m):.0f} cm {side} that"
        room.notes.append(f"{said}; by its height it is on {by_height.name}")
    return by_height
