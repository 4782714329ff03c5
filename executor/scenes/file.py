"""Load scenes by name or from files, and complete scene files with the library's models and with geometry.

A file may leave out models, sizes, heights, support relations and door states. The library supplies models and sizes;
geometry supplies the rest. Files of Digital Cousins are converted.
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import bddl
from executor.assets.families.controls import SWITCHING
from executor.assets.footprint import Footprint, region_frame, yaw_of
from executor.assets.library import LIBRARY, asset_for
from executor.assets.model import Asset
from executor.assets.parameters import AssetError
from executor.geometry import Array
from executor.scenes.digital_cousins import SceneWithNotes, from_cousins
from executor.scenes.library import described_in, file_of, has_predicate, holds_cousins
from executor.scenes.library import load as load_named
from executor.scenes.models import NoDefaultSize, complete_object, implausible_object_size
from executor.scenes.placement import EDGE_M, AtEdge, Clearance, PlaceSpec, place, robot_has_room, robot_near
from executor.scenes.room import CLOSED, NoRoom, Room
from executor.scenes.support_relations import (
    STANDING,
    SWITCHED,
    control_states,
    derive_support_relations,
    door_states,
    fallen_solids,
    is_upright,
    standing_states,
    upright_solids,
)
from oag import Scene, SceneError, SceneObject
from oag.model.codec import Document, Source, load
from oag.model.diagnostics import InputError, listed
from oag.model.domain import BUILT_IN, Domain
from oag.model.forms import ObjectForm, SceneForm, domain_for, examine_scene, infeasible_of, object_of, robot_of
from oag.model.robots import DEFAULT_ROBOT
from oag.model.scene import FLOOR, RobotPose, about_z, read_closed, read_facts
from oag.model.symbols import Kind
from oag.primitives.cargo import VAGUE

FLOOR_AROUND_M = 1.5
"""Margin of the floor around the objects, where the robot drives."""

HANDY_M = 0.65
"""Preferred height for the arm: of several boards or drawers, the nearest to it is taken."""

FLOOR_THICKNESS_M = 0.12
_CLEARANCES = (Clearance(), Clearance(edge_m=0.01, other_m=0.01))
_EDGES = ("-x", "-y", "+y", "+x")  # The front first, the back last.
_INSETS_M = (0.08, 0.16)
_ROUNDED = 0.02  # What two digits may change in the length of a quaternion.
_SMALL_M = 0.12  # Tops and hollows with smaller half sides have one place, their middle.


@dataclass(frozen=True, slots=True)
class CompletedScene:
    """The result of completing a scene file.

    Attributes:
        scene: The scene; None if something in the file is wrong.
        problems: All errors, with the place in the file.
        rest: In case of errors, the scene without the erroneous entries, if there is one.
        warnings: Values that were read otherwise than written.
    """

    scene: Scene | None
    problems: tuple[str, ...] = ()
    rest: Scene | None = None
    warnings: tuple[str, ...] = ()


def complete_scene(source: Source, domain: Domain = BUILT_IN) -> CompletedScene:
    """Return the scene of a file that needs categories and places only, or all its errors.

    A category stands for the library's first model of it at a default size. `on` and `in` find a free place, near the
    front; x y alone puts an object on the floor. If the file lists no `closed`, geometry gives the support relations
    and door states. They are added to the facts, and `executor.scenes.validation.issues` reports contradicting facts.
    The floor is an object of the scene if an item stands on it.

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
            return CompletedScene(None, tuple(problems))
    completion = _SceneCompletion(document, form, lost, domain)
    completion.place_all()
    problems += completion.problems
    try:
        scene = completion.scene()
    except SceneError as problem:
        return CompletedScene(None, (*problems, _at_place(problem)), completion.without_statements())
    warnings = tuple(_stretched(document))
    return (
        CompletedScene(None, tuple(problems), scene, warnings) if problems else CompletedScene(scene, warnings=warnings)
    )


def _stretched(document: Document) -> Iterator[str]:
    """Yield quaternions of a well-formed file whose length differs from one by more than rounding."""
    data: Any = document.data
    for key, entry in data["objects"].items():
        length = math.sqrt(sum(part * part for part in entry.get("orientation") or ()))
        if length and abs(length - 1.0) > _ROUNDED:
            message = f"is a quaternion of length {length:.3g}, expected 1; it was divided by its length"
            yield f"objects.{key}.orientation: {message}"


def _at_place(problem: InputError) -> str:
    hint = f" ({problem.hint})" if problem.hint else ""
    return f"{problem.place}: {problem.problem}{hint}" if problem.place else f"{problem.problem}{hint}"


def _without(document: Document, problems: tuple[InputError, ...]) -> tuple[Document, set[str]]:
    """Return a document without its malformed entries, and the ids of the objects among them."""
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


class _SceneCompletion:
    """A scene under construction.

    Attributes:
        problems: Errors so far, with the place in the file.
    """

    def __init__(self, document: Document, form: SceneForm, lost: set[str], domain: Domain) -> None:
        self.problems: list[str] = []
        self._document, self._form, self._lost, self._domain = document, form, lost, domain_for(document, form, domain)
        self._room = Room(form.name or "scene", "", np.random.default_rng(0), 0.0, 0.0)
        # (support, region, number of the choice) -> width that found no place there; wider items are skipped.
        self._refused_width_m: dict[tuple[str, str, int], float] = {}
        self._controls: tuple[bddl.Formula, ...] = ()
        self._standing: tuple[bddl.Formula, ...] = ()
        self._stated: list[bddl.Atom] = []  # From `on` and `in` of entries with a whole position.

    def place_all(self) -> None:
        """Place every object: those with a position first, then those on or in others."""
        waiting: dict[str, tuple[ObjectForm, SceneObject]] = {}
        for key, form in self._form.objects.items():
            try:
                one = self._draft(key, complete_object(key, form))
            except (NoDefaultSize, AssetError) as problem:
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
            self._refuse_unplaced(key, form, waiting)

    def scene(self) -> Scene:
        """Return the scene of all placed objects.

        Raises:
            SceneError: A fact or `closed` is malformed.
        """
        objects = {key: self._room.objects[key] for key in self._form.objects if key in self._room.objects}
        self._controls = tuple(control_states(objects.values()))
        # A file that states what is closed says itself what is known of its things.
        self._standing = tuple(standing_states(objects.values())) if self._form.closed is None else ()
        if self._domain.built_in and self._standing:
            self._domain = Domain.fallen(appliances=bool(self._controls))
        elif self._domain.built_in and self._controls:
            self._domain = Domain.appliances()
        facts, closed = self._facts(objects)
        robot = self._robot(objects)
        objects = self._with_floor(objects, robot)
        scene = Scene(
            name="scene" if self._form.name is None else self._form.name,
            robot=robot,
            objects=objects,
            facts=(*facts, *self._derived(objects, facts)) if self._form.closed is None else facts,
            closed=closed,
            variation=dict(self._form.variation or {}),
            known=infeasible_of(self._form.known),
            domain=self._domain,
        )
        return with_neighbours(scene)

    def without_statements(self) -> Scene | None:
        """Return the scene without facts, `closed` and the robot's pose, one of which is malformed."""
        self._form = self._form.model_copy(update={"facts": None, "closed": None, "robot": None})
        try:
            return self.scene()
        except SceneError:
            return None  # There is no floor for the robot either.

    def _draft(self, key: str, form: ObjectForm) -> SceneObject | None:
        """Return an object at its place, or at the origin if its place is still open; None for the floor."""
        place = ("objects", key)
        if form.category == FLOOR and form.bbox_extent is None:
            if key != FLOOR:
                raise self._document.fail(
                    place, f"the floor's id is {FLOOR!r}", f'"{FLOOR}": {{"category": "{FLOOR}"}}'
                )
            return None
        self._check_place(key, form, self._form.objects[key].bbox_extent is not None)
        one = object_of(self._document, key, form.model_copy(update={"on": None, "in_": None, "at": None}))
        if (message := implausible_object_size(one)) is not None:
            raise self._document.fail(place, message, "lengths are metres")
        _check_control(one, asset_for(one))  # Both refuse what its model cannot be.
        for relation, other in (("ontop", form.on), ("inside", form.in_)):
            if other is not None and len(form.position or ()) == 3:
                self._stated.append(bddl.Atom(relation, (key, other)))
        return one

    def _check_place(self, key: str, form: ObjectForm, is_sized: bool) -> None:
        """Refuse places that are given twice or not at all.

        Args:
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
        """Whether an object's height, or its whole place, depends on a top or a hollow."""
        return (form.on or form.in_) is not None and form.on != FLOOR and len(form.position or ()) < 3

    def _is_there(self, form: ObjectForm) -> bool:
        return (form.on or form.in_) in self._room.objects

    def _refuse_unplaced(self, key: str, form: ObjectForm, waiting: Mapping[str, object]) -> None:
        """Report that an object's support has no place itself, unless that was reported already."""
        support = form.on or form.in_
        if support in waiting:
            self._refuse(key, f"{support} stands on or in it in turn; give one of them a position")

    def _place(self, key: str, form: ObjectForm, one: SceneObject) -> None:
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
        has_heading = form.heading_deg is not None or form.orientation is not None
        turn_rad = yaw_of(one) - yaw_of(carrier) if has_heading else 0.0
        refused = ""
        frames = [(region, *region_frame(carrier, region)) for region in regions]
        anywhere = form.at is None and form.position is None and one.kind is Kind.ITEM
        across_m = math.hypot(*one.extent_m[:2])
        for region, T, half in sorted(frames, key=lambda frame: abs(float(frame[1][2, 3]) - HANDY_M)):
            for number, (at, clear) in enumerate(self._choices(form, one, T, half)):
                tried = (support, region.name, number)
                if anywhere and across_m >= self._refused_width_m.get(tried, math.inf):
                    refused = refused or f"found no free place on {support} ({region.name})"
                    continue
                try:
                    place(self._room, one, PlaceSpec(support, region.name, at, yaw_rad=turn_rad, clear=clear))
                    return
                except NoRoom as problem:
                    refused = refused or str(problem).partition(": ")[2]
                if anywhere:
                    self._refused_width_m[tried] = across_m
        self._refuse(key, refused)

    def _choices(
        self, form: ObjectForm, one: SceneObject, T_region: Array, half: Array
    ) -> Iterator[tuple[tuple[float, float] | AtEdge | None, Clearance]]:
        """Yield the places to try in a region: the given one, else places near its edges, the front first."""
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
        """Return the robot's start: from the file, else at the origin or on the free floor nearest to it.

        A file that names no robot is for the default one. Where it states `closed`, it may have been written for the
        paper's before robots had names, and keeps it.
        """
        form = self._form.robot
        start = RobotPose() if form is None else robot_of(form)
        if self._form.closed is None and (form is None or form.name is None is form.scale):
            start = replace(start, name=DEFAULT_ROBOT.name)
        if form is not None and form.model_fields_set - {"scale", "name"}:
            return start
        if robot_has_room(0.0, 0.0, 0.0, {name: Footprint.of(obj) for name, obj in objects.items()}):
            return start
        try:
            return replace(robot_near(objects, (0.0, 0.0)), name=start.name)
        except NoRoom as problem:
            raise SceneError(str(problem), source=self._document.source, hint="give the robot a position") from None

    def _facts(self, objects: Mapping[str, SceneObject]) -> tuple[tuple[bddl.Formula, ...], frozenset[str]]:
        """Return the facts that the file states, and the completely known predicates.

        Facts about malformed entries are skipped, since those are reported themselves.
        """
        stated = [fact for fact in self._form.facts or () if not self._lost.intersection(_words(fact))]
        facts = read_facts(stated, objects, self._document.source, self._domain)
        known = {literal.atom for fact in facts for literal in bddl.literals(fact) or ()}
        stated_by_entries = tuple(atom for atom in self._stated if atom not in known and atom.args[1] not in self._lost)
        given = self._form.closed
        usual = CLOSED | (SWITCHED if self._controls else set()) | (STANDING if self._standing else set())
        here = frozenset(predicate for predicate in usual if has_predicate(self._domain, predicate))
        closed = here if given is None else read_closed(given, self._document.source, self._domain)
        return (*facts, *self._in_domain(stated_by_entries)), closed

    def _derived(self, objects: Mapping[str, SceneObject], facts: tuple[bddl.Formula, ...]) -> tuple[bddl.Formula, ...]:
        """Return the geometric facts that the file does not state."""
        stated = {literal.atom for fact in facts for literal in bddl.literals(fact) or ()}
        found: list[bddl.Formula] = [
            *derive_support_relations(upright_solids(objects), fallen_solids(objects).values()),
            *door_states(objects.values()),
            *self._controls,
            *self._standing,
        ]
        return self._in_domain(fact for fact in found if stated.isdisjoint(bddl.atoms(fact)))

    def _in_domain(self, facts: Iterable[bddl.Formula]) -> tuple[bddl.Formula, ...]:
        """Return the facts, concluded from geometry, whose predicates the domain has."""
        return tuple(f for f in facts if all(has_predicate(self._domain, atom.predicate) for atom in bddl.atoms(f)))

    def _with_floor(self, objects: dict[str, SceneObject], robot: RobotPose) -> dict[str, SceneObject]:
        """Return the objects with the floor if it is listed or named, or if an item stands on it."""
        if FLOOR in objects:
            return objects
        listed = FLOOR in self._form.objects and FLOOR not in self._lost
        named = any(form.on == FLOOR for form in self._form.objects.values())
        named = named or any(FLOOR in _words(fact) for fact in self._form.facts or ())
        floor = floor_of(objects, robot)
        if self._form.closed is None and not (listed or named):
            around, fallen = upright_solids({**objects, FLOOR: floor}), fallen_solids(objects).values()
            named = any(atom.args[1] == FLOOR for atom in derive_support_relations(around, fallen))
        return {**objects, FLOOR: floor} if listed or named else objects


def _check_control(one: SceneObject, asset: Asset) -> None:
    """Refuse a button or a knob, and what is on by one, of a thing that has none."""
    asked = {parameter.name: word for parameter in SWITCHING if (word := parameter.read(one)) != parameter.words[0]}
    if asked and not asset.controls:
        models = ", ".join(model for model, entry in LIBRARY.items() if set(SWITCHING) <= set(entry.parameters))
        name, word = next(iter(asked.items()))
        problem = f"parameter {name!r} is {word!r}, and it has neither a button nor a knob"
        raise AssetError(one, problem, f"with the parameter 'control' these models have one: {models}")


def _words(fact: object) -> list[str]:
    return str(fact).replace("(", " ").replace(")", " ").split()


def with_neighbours(scene: Scene) -> Scene:
    """Return a scene with the facts of `nextto`, `touching` and `under` that detectors read, where these are closed.

    What its facts say of them is kept. Things touch as they stand, before anything falls.
    """
    closed = [predicate for predicate in VAGUE if predicate in scene.closed]
    if not closed:
        return scene
    # A scene without them is read without the engine.
    from executor.sim.detectors import true_atoms
    from executor.sim.world import World

    with World(scene) as world:
        world.step()
        found = true_atoms(world, closed)
    stated = {literal.atom for fact in scene.facts for literal in bddl.literals(fact) or ()}
    return replace(scene, facts=(*scene.facts, *(atom for atom in found if atom not in stated)))


def with_floor(scene: Scene) -> Scene:
    """Return a scene with the floor as an object."""
    if FLOOR in scene.objects:
        return scene
    return replace(scene, objects={**scene.objects, FLOOR: floor_of(scene.objects, scene.robot)})


def floor_of(objects: Mapping[str, SceneObject], robot: RobotPose) -> SceneObject:
    """Return the floor under and around all objects; its top is at height 0."""
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


Listener = Callable[[tuple[str, ...]], None]

_FLOOR_NAMES = frozenset({"floor", "ground"})


def load_scene(name_or_path: str | Path, domain: Domain = BUILT_IN) -> Scene:
    """Return a scene of the package by its name, or the scene of a JSON file.

    An argument that ends in `.json`, has a folder in it, or exists as a file is a file. The library and geometry supply
    what the file leaves out; without `closed` the robot is `panda-lift` where none is named. A file of Digital Cousins
    (`scene_0_info.json`) gets models of the library; see `executor.scenes.digital_cousins`. Facts are in the predicates
    of the domain.

    Raises:
        SceneNotFound: The package has no scene of that name; the message suggests near ones.
        SceneError: The file is missing or malformed, or its content makes no scene; all errors are listed. Also if the
            argument is neither a name nor a path.
    """
    return load_with_notes(name_or_path, domain).scene


def scene_for(
    query: str,
    name_or_path: str | Path,
    *,
    robot: str = "",
    listen: Listener = lambda notes: None,
    domain: Domain = BUILT_IN,
) -> Scene:
    """Return the scene for a sentence: that of `load_scene`, with the floor if the sentence names it.

    Args:
        robot: Name of the robot; by default the scene's own.
        listen: Receives the differences between the scene and its file, in sentences.
        domain: What the scene is described in.
    """
    found = load_with_notes(name_or_path, domain)
    listen(found.notes)
    scene = found.scene
    if robot:
        scene = scene.with_robot(robot)
    return with_floor(scene) if _FLOOR_NAMES.intersection(re.findall(r"\w+", query.casefold())) else scene


def load_with_notes(name_or_path: str | Path, domain: Domain = BUILT_IN) -> SceneWithNotes:
    """Return a scene as `load_scene` does, with its differences from the file, in sentences."""
    path = file_of(name_or_path)
    if path is None:
        return SceneWithNotes(described_in(load_named(str(name_or_path)), domain), ())
    if holds_cousins(path):
        made = from_cousins(path)
        return replace(made, scene=described_in(made.scene, domain))
    found = complete_scene(path, domain)
    if found.scene is None:
        message = found.problems[0] if len(found.problems) == 1 else listed(found.problems)
        raise SceneError(message, source=path.name)
    return SceneWithNotes(found.scene, found.warnings)
