"""A scene file as a scene: what it leaves out comes from the library, and what stands on or in what from geometry."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

import bddl
from executor.assets.footprint import Footprint, region_frame, yaw_of
from executor.assets.library import asset_for
from executor.assets.parameters import AssetError
from executor.geometry import Array
from executor.scenes.cousins.arrange import Arrangement
from executor.scenes.furnishing.usual import NoUsual, completed, unlike_its_kind
from executor.scenes.rooms import AtEdge, Clearance, NoRoom, Room, place
from executor.scenes.rooms.furniture import robot_has_room
from executor.scenes.rooms.room import CLOSED
from executor.scenes.rooms.tops import EDGE_M
from executor.scenes.standing import door_states, fallen_of, is_upright, relations, things_of
from oag import InputError, Kind, RobotPose, Scene, SceneError, SceneObject
from oag.model.jsonfile import Document, Source, load
from oag.model.scene import object_of, robot_of
from oag.model.scenefile import FLOOR, about_z, read_closed, read_facts
from oag.model.sceneform import ObjectForm, SceneForm, examine_scene

FLOOR_AROUND_M = 1.5
"""How far the floor goes on beyond what stands on it: the robot drives there."""

HANDY_M = 0.65
"""Height at which the arm is most at ease: of several boards or drawers, the one nearest to it is taken."""

FLOOR_THICKNESS_M = 0.12
_CLEARANCES = (Clearance(), Clearance(edge_m=0.01, other_m=0.01))
_EDGES = ("-x", "-y", "+y", "+x")  # The front first, the back last.
_INSETS_M = (0.08, 0.16)
_ROUNDED = 0.02  # What two digits may change in the length of a quaternion.
_SMALL_M = 0.12  # Half of a top or hollow that has one place, its middle.


@dataclass(frozen=True, slots=True)
class Furnished:
    """What came of a scene file.

    Attributes:
        scene: The scene; None where something in the file is wrong.
        problems: All that is wrong, with the place in the file.
        rest: Where something is wrong, the scene without the entries that are, as far as there is one.
        warnings: What was read otherwise than it is written.
    """

    scene: Scene | None
    problems: tuple[str, ...] = ()
    rest: Scene | None = None
    warnings: tuple[str, ...] = ()


def furnished(source: Source) -> Furnished:
    """Returns the scene of a file in which only categories and places have to be said, or all that is wrong in it.

    A category stands for the library's first model of it at a usual size. `on` and `in` find a free place, near the
    front; x y alone stands a thing on the floor. Where the file lists no `closed`, what stands on or in what and what
    is open follows from geometry; it is added to the facts, and `flaws` tells which facts say otherwise. The floor is
    an object of the scene when something small stands on it.

    Raises:
        SceneError: It is no readable JSON.
    """
    document = load(source, SceneError)
    form, malformed = examine_scene(document)
    problems = [_at_place(problem) for problem in malformed]
    lost: set[str] = set()
    if form is None:
        document, lost = _without(document, malformed)
        form, _ = examine_scene(document)
        if form is None:
            return Furnished(None, tuple(problems))
    furnishing = _Furnishing(document, form, lost)
    furnishing.stand_all()
    problems += furnishing.problems
    try:
        scene = furnishing.scene()
    except SceneError as problem:
        return Furnished(None, (*problems, _at_place(problem)), furnishing.without_statements())
    warnings = tuple(_stretched(document))
    return Furnished(None, tuple(problems), scene, warnings) if problems else Furnished(scene, warnings=warnings)


def _stretched(document: Document) -> Iterator[str]:
    """Yields which quaternions of a well-formed file are not of length one, by more than rounding."""
    data: Any = document.data
    for key, entry in data["objects"].items():
        length = math.sqrt(sum(part * part for part in entry.get("orientation") or ()))
        if length and abs(length - 1.0) > _ROUNDED:
            said = f"is a quaternion of length {length:.3g}, expected 1; it was divided by its length"
            yield f"objects.{key}.orientation: {said}"


def _at_place(problem: InputError) -> str:
    hint = f" ({problem.hint})" if problem.hint else ""
    return f"{problem.place}: {problem.problem}{hint}" if problem.place else f"{problem.problem}{hint}"


def _without(document: Document, problems: tuple[InputError, ...]) -> tuple[Document, set[str]]:
    """Returns a document without the entries that are malformed, and the ids of the objects among them."""
    data = dict(document.data) if isinstance(document.data, Mapping) else {}
    objects = data.get("objects")
    entries = dict(objects) if isinstance(objects, Mapping) else {}
    lost = set()
    for problem in problems:
        first, _, rest = problem.place.partition(".")
        key = next((key for key in entries if rest == key or rest.startswith(f"{key}.")), None)
        if first == "objects" and key is not None:
            del entries[key]
            lost.add(key)
        elif first != "objects":
            # An unknown key of the whole file has no place; what is known stays.
            data.pop(first.split("[")[0], None)
    known = SceneForm.model_fields
    data = {key: value for key, value in data.items() if key in known} | {"objects": entries}
    return replace(document, data=data), lost


class _Furnishing:
    """A scene in the making.

    Attributes:
        problems: What was wrong so far, with the place in the file.
    """

    def __init__(self, document: Document, form: SceneForm, lost: set[str]) -> None:
        self.problems: list[str] = []
        self._document, self._form, self._lost = document, form, lost
        self._room = Room(form.name or "scene", "", np.random.default_rng(0), 0.0, 0.0)
        # By support, region and number of the choice: how wide an item found no place there, as wider ones will not.
        self._too_much_m: dict[tuple[str, str, int], float] = {}
        self._said: list[bddl.Atom] = []  # What entries say by `on` and `in` beside a whole position.

    def stand_all(self) -> None:
        """Stands every object in its place: those with a position first, then what stands on or in others."""
        waiting: dict[str, tuple[ObjectForm, SceneObject]] = {}
        for key, form in self._form.objects.items():
            try:
                one = self._draft(key, completed(key, form))
            except (NoUsual, AssetError) as problem:
                self._refuse(key, problem.words if isinstance(problem, AssetError) else str(problem))
                continue
            except SceneError as problem:
                self._lost.add(key)
                self.problems.append(_at_place(problem))
                continue
            if one is None:
                continue
            if self._waits(form):
                waiting[key] = (form, one)
            else:
                self._room.objects[key] = one
        while ready := [key for key, (form, _) in waiting.items() if self._is_there(form)]:
            for key in ready:
                self._place(key, *waiting.pop(key))
        for key, (form, _) in waiting.items():
            self._hopeless(key, form, waiting)

    def scene(self) -> Scene:
        """Returns the scene of everything that stands.

        Raises:
            SceneError: A fact or `closed` is malformed.
        """
        objects = {key: self._room.objects[key] for key in self._form.objects if key in self._room.objects}
        facts, closed = self._facts(objects)
        robot = self._robot(objects)
        objects = self._with_floor(objects, robot)
        return Scene(
            name="scene" if self._form.name is None else self._form.name,
            robot=robot,
            objects=objects,
            facts=(*facts, *self._derived(objects, facts)) if self._form.closed is None else facts,
            closed=closed,
            variation=dict(self._form.variation or {}),
        )

    def without_statements(self) -> Scene | None:
        """Returns the scene without facts, `closed` and the robot's place, one of which is malformed."""
        self._form = self._form.model_copy(update={"facts": None, "closed": None, "robot": None})
        try:
            return self.scene()
        except SceneError:
            return None  # There is no floor for the robot either.

    def _draft(self, key: str, form: ObjectForm) -> SceneObject | None:
        """Returns an object at its place, or at the origin where that is still to be found; None for the floor."""
        place = ("objects", key)
        if form.category == FLOOR and form.bbox_extent is None:
            if key != FLOOR:
                raise self._document.fail(
                    place, f"the floor's id is {FLOOR!r}", f'"{FLOOR}": {{"category": "{FLOOR}"}}'
                )
            return None
        self._check_place(key, form, self._form.objects[key].bbox_extent is not None)
        one = object_of(self._document, key, form.model_copy(update={"on": None, "in_": None, "at": None}))
        if (said := unlike_its_kind(one)) is not None:
            raise self._document.fail(place, said, "lengths are metres")
        asset_for(one)  # Refuses what its model cannot be.
        for relation, other in (("ontop", form.on), ("inside", form.in_)):
            if other is not None and len(form.position or ()) == 3:
                self._said.append(bddl.Atom(relation, (key, other)))
        return one

    def _check_place(self, key: str, form: ObjectForm, is_sized: bool) -> None:
        """Refuses places that are said twice or not at all.

        Args:
            key: The object's id.
            form: Its content.
            is_sized: Whether the file gives its size: such a file may be about facts alone.
        """
        fail = partial(self._document.fail, ("objects", key))
        supports = [other for other in (form.on, form.in_) if other is not None]
        if len(supports) == 2:
            raise fail("has both 'on' and 'in'", "keep one of them")
        if form.at is not None and (not supports or form.position is not None):
            raise fail("'at' is a point of what 'on' or 'in' names", "leave out 'position', and name one")
        if form.position is None and not supports and not is_sized:
            raise fail("has no place", 'add "position": [x, y], or "on": the id of what it stands on')
        if supports == [FLOOR] and form.position is None:
            raise fail("has no place on the floor", 'add "position": [x, y]')
        for other in supports:
            if other not in (*self._form.objects, *self._lost, FLOOR):
                near = bddl.near_names(other, tuple(self._form.objects))
                hint = f"did you mean {' or '.join(near)}?" if near else f"it has {', '.join(self._form.objects)}"
                raise fail(f"there is no object {other!r} to put it on or in", hint)

    def _refuse(self, key: str, problem: str) -> None:
        self._lost.add(key)
        self.problems.append(f"objects.{key}: {problem}")

    def _waits(self, form: ObjectForm) -> bool:
        """Whether an object's height, or its whole place, is that of a top or a hollow."""
        return (form.on or form.in_) is not None and form.on != FLOOR and len(form.position or ()) < 3

    def _is_there(self, form: ObjectForm) -> bool:
        return (form.on or form.in_) in self._room.objects

    def _hopeless(self, key: str, form: ObjectForm, waiting: Mapping[str, object]) -> None:
        """Says that what an object stands on has no place itself, unless that was said already."""
        support = form.on or form.in_
        if support in waiting:
            self._refuse(key, f"{support} stands on or in it in turn; give one of them a position")

    def _place(self, key: str, form: ObjectForm, one: SceneObject) -> None:
        """Puts an object on or in another one, at a free place."""
        support, kind = (form.on, "surface") if form.on is not None else (form.in_, "interior")
        if support is None:
            return
        self._room.rng = np.random.default_rng(zlib.crc32(key.encode()))
        carrier = self._room.objects[support]
        regions = [region for region in asset_for(carrier).regions if region.kind == kind]
        if not regions or not is_upright(one):
            word = "be put on" if kind == "surface" else "be put in"
            problem = (
                f"nothing can {word} {support} ({carrier.category})" if not regions else "it does not stand upright"
            )
            self._refuse(key, f"{problem}; give it a position of three numbers")
            return
        said = form.heading_deg is not None or form.orientation is not None
        turn_rad = yaw_of(one) - yaw_of(carrier) if said else 0.0
        refused = ""
        frames = [(region, *region_frame(carrier, region)) for region in regions]
        anywhere = form.at is None and form.position is None and one.kind is Kind.ITEM
        across_m = math.hypot(*one.extent_m[:2])
        for region, T, half in sorted(frames, key=lambda frame: abs(float(frame[1][2, 3]) - HANDY_M)):
            for number, (at, clear) in enumerate(self._choices(form, one, T, half)):
                tried = (support, region.name, number)
                if anywhere and across_m >= self._too_much_m.get(tried, math.inf):
                    refused = refused or f"found no free place on {support} ({region.name})"
                    continue
                try:
                    place(self._room, one, support, region=region.name, at=at, yaw_rad=turn_rad, clear=clear)
                    return
                except NoRoom as problem:
                    refused = refused or str(problem).partition(": ")[2]
                if anywhere:
                    self._too_much_m[tried] = across_m
        self._refuse(key, refused)

    def _choices(
        self, form: ObjectForm, one: SceneObject, T_region: Array, half: Array
    ) -> Iterator[tuple[tuple[float, float] | AtEdge | None, Clearance]]:
        """Yields the places to try in a region: the one that is said, else near its edges, the front first."""
        exact = Clearance(0.0, 0.0)
        if form.at is not None:
            yield form.at, exact
            return
        if form.position is not None:
            x, y = T_region[:2, :2].T @ (np.asarray(form.position[:2]) - T_region[:2, 3])
            yield (float(x), float(y)), exact
            return
        if one.kind is not Kind.ITEM or max(half) < _SMALL_M:
            yield (0.0, 0.0), exact
        least_m = math.hypot(*one.extent_m[:2]) / 2 + EDGE_M
        inset_m = (max(_INSETS_M[0], least_m), max(_INSETS_M[1], least_m + 0.02))
        for clear in _CLEARANCES:
            yield from ((AtEdge(edge, inset_m), clear) for edge in _EDGES)
            yield None, clear

    def _robot(self, objects: Mapping[str, SceneObject]) -> RobotPose:
        """Returns where the robot starts: as the file says, else at the origin or on the free floor nearest to it."""
        form = self._form.robot
        if form is not None and form.model_fields_set - {"scale"}:
            return robot_of(form)
        start = RobotPose() if form is None else robot_of(form)
        if robot_has_room(0.0, 0.0, 0.0, {name: Footprint.of(obj) for name, obj in objects.items()}):
            return start
        room = Arrangement()
        room.objects.update(objects)
        try:
            return replace(room.robot((0.0, 0.0)), scale=start.scale)
        except NoRoom as problem:
            raise SceneError(str(problem), source=self._document.source, hint="give the robot a position") from None

    def _facts(self, objects: Mapping[str, SceneObject]) -> tuple[tuple[bddl.Formula, ...], frozenset[str]]:
        """Returns the facts that the file states, and the predicates that are known completely.

        Facts about entries that are malformed are passed over: those are told themselves.
        """
        stated = [fact for fact in self._form.facts or () if not self._lost.intersection(_words(fact))]
        facts = read_facts(stated, objects, self._document.source)
        known = {literal.atom for fact in facts for literal in bddl.literals(fact) or ()}
        said = tuple(atom for atom in self._said if atom not in known and atom.args[1] not in self._lost)
        given = self._form.closed
        return (*facts, *said), CLOSED if given is None else read_closed(given, self._document.source)

    def _derived(self, objects: Mapping[str, SceneObject], facts: tuple[bddl.Formula, ...]) -> tuple[bddl.Formula, ...]:
        """Returns what geometry says and no fact does."""
        stated = {literal.atom for fact in facts for literal in bddl.literals(fact) or ()}
        found: list[bddl.Formula] = [
            *relations(things_of(objects), fallen_of(objects).values()),
            *door_states(objects.values()),
        ]
        return tuple(fact for fact in found if stated.isdisjoint(bddl.atoms(fact)))

    def _with_floor(self, objects: dict[str, SceneObject], robot: RobotPose) -> dict[str, SceneObject]:
        """Returns the objects with the floor, where it is listed or named, or a small thing stands on it."""
        if FLOOR in objects:
            return objects
        listed = FLOOR in self._form.objects and FLOOR not in self._lost
        named = any(form.on == FLOOR for form in self._form.objects.values())
        named = named or any(FLOOR in _words(fact) for fact in self._form.facts or ())
        floor = floor_of(objects, robot)
        if self._form.closed is None and not (listed or named):
            around, fallen = things_of({**objects, FLOOR: floor}), fallen_of(objects).values()
            named = any(atom.args[1] == FLOOR for atom in relations(around, fallen))
        return {**objects, FLOOR: floor} if listed or named else objects


def _words(fact: object) -> list[str]:
    return str(fact).replace("(", " ").replace(")", " ").split()


def with_floor(scene: Scene) -> Scene:
    """Returns a scene of which the floor is an object; one that has it comes back as it is."""
    if FLOOR in scene.objects:
        return scene
    return replace(scene, objects={**scene.objects, FLOOR: floor_of(scene.objects, scene.robot)})


def floor_of(objects: Mapping[str, SceneObject], robot: RobotPose) -> SceneObject:
    """Returns the floor under what stands on it and around it; its top is at height 0."""
    places = [np.asarray(robot.position[:2])[None], *(Footprint.of(obj).corners_m for obj in objects.values())]
    corners = np.concatenate(places)
    low, high = corners.min(axis=0) - FLOOR_AROUND_M, corners.max(axis=0) + FLOOR_AROUND_M
    x, y = ((low + high) / 2).round(3)
    length, width = (high - low).round(3)
    return SceneObject(
        id=FLOOR,
        category=FLOOR,
        model=FLOOR,
        position=(float(x), float(y), -FLOOR_THICKNESS_M / 2),
        orientation=about_z(0.0),
        bbox_extent=(float(length), float(width), FLOOR_THICKNESS_M),
    )
