"""From a reconstruction to a scene of the library's models; what has no likeness is refused, all of it at once."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import bddl
from executor.assets.footprint import Footprint
from executor.assets.library import asset_for
from executor.assets.parameters import AssetError
from executor.scenes.cousins.arrange import Arrangement
from executor.scenes.cousins.form import Cousin, Reconstruction, read
from executor.scenes.cousins.likeness import (
    FLAT,
    Unlike,
    Upright,
    category_of,
    model_for,
    shaped,
    upright,
    written_category,
)
from executor.scenes.rooms.room import CLOSED, NoRoom
from oag import Kind, Scene, SceneError, SceneObject, kind_of

FLOOR = "floor"
ON_FLOOR_M = 0.10
"""Without a scene graph, what hangs no higher than this above the floor or a top stands on it."""

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
        raise SceneError(f"{count}; without them in its `objects` it can be read:{listed}", source=str(path))
    try:
        robot = room.robot((float(found.camera_m[0]), float(found.camera_m[1])))
    except NoRoom as problem:
        raise SceneError(str(problem), source=str(path)) from problem
    facts: list[bddl.Formula] = [bddl.Atom(name, (thing, support)) for name, thing, support in room.relations]
    facts += [bddl.Not(bddl.Atom("open", (key,))) for key, obj in room.objects.items() if obj.kind is Kind.ARTICULATED]
    in_order = {draft.obj.id: room.objects[draft.obj.id] for draft in drafts.values()}
    return Converted(Scene(found.name, robot, in_order, tuple(facts), CLOSED), (*notes, *room.notes))


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
        if draft.obj.id in {other.obj.id for other in drafts.values()}:
            problems.append(f"{cousin.id}: another object is called {draft.obj.id} too")
            continue
        drafts[cousin.id] = draft
        if draft.at.turned:
            notes.append(f"{cousin.id} has its front at -y, where the camera was")
    return drafts, notes, problems


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
    return _Draft(cousin, obj, at)


def _arrange(room: Arrangement, drafts: Mapping[str, _Draft], found: Reconstruction) -> list[str]:
    """Puts everything in its place, supports first, and returns what found none."""
    beneath = {cousin.id: cousin.beneath for cousin in found.cousins}
    support_of = {key: _support(draft, drafts, beneath) for key, draft in drafts.items()}
    waiting = sorted(drafts, key=lambda key: _bottom_m(drafts[key]))
    problems: list[str] = []
    there: set[str | None] = {None, FLOOR}
    while ready := [key for key in waiting if support_of[key] in there]:
        for key in ready:
            waiting.remove(key)
            draft, support = drafts[key], support_of[key]
            try:
                if support is not None and support != FLOOR:
                    room.place(draft.obj, draft.at, drafts[support].obj.id)
                else:
                    hangs_m = draft.at.centre_m[2] - draft.obj.extent_m[2] / 2
                    room.put(draft.obj, draft.at, hangs_m if support is None else 0.0)
                there.add(key)
            except NoRoom as problem:
                problems.append(str(problem))
    return [*problems, *(f"{key}: stands on what stands on it, or on what has no place" for key in waiting)]


def _support(draft: _Draft, drafts: Mapping[str, _Draft], beneath: Mapping[str, str | None]) -> str | None:
    """What a thing stands on: an id of the file, "floor", or None for what hangs."""
    if not draft.cousin.on_floor:
        return None
    below = draft.cousin.beneath
    if below is None:
        return _by_position(draft, drafts)
    seen = {draft.cousin.id}
    # What lies flat was left out; what stood on it stands on what was below.
    while below not in drafts and below != FLOOR:
        if below in seen:
            return FLOOR
        seen.add(below)
        below = beneath.get(below) or FLOOR
    return below


def _by_position(draft: _Draft, drafts: Mapping[str, _Draft]) -> str:
    """The thing with the nearest top under the middle of another one; the floor where there is none."""
    x, y, _ = draft.at.centre_m
    best, nearest_m = FLOOR, ON_FLOOR_M
    for key, other in drafts.items():
        length, width, _ = other.at.size_m
        top = Footprint(*other.at.centre_m[:2], other.at.yaw_rad, length / 2, width / 2)
        over = other is not draft and top.gap_m(Footprint(x, y, 0.0, 0.0, 0.0)) <= 0.0
        gap_m = abs(_bottom_m(draft) - _bottom_m(other) - other.at.size_m[2])
        if over and gap_m < nearest_m:
            best, nearest_m = key, gap_m
    return best


def _bottom_m(draft: _Draft) -> float:
    return draft.at.centre_m[2] - draft.at.size_m[2] / 2
