"""A scene: its objects with their boxes, what is known to hold at the start, and what is known completely.

Scene files have the form of `oag.model.forms`; ids, facts and closed predicates are checked here.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from importlib import import_module
from typing import Self

import bddl
from bddl.terminal import pluralize
from oag.model.codec import Source, as_json, brief, did_you_mean, expected, fields_json, load, shown
from oag.model.diagnostics import SceneError
from oag.model.domain import BUILT_IN, Domain
from oag.model.infeasible import Infeasible
from oag.model.robots import FULL_SIZE, PAPER_ROBOT, Robot, robot_named
from oag.model.symbols import GRIPPER, Kind, Role, kind_of

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
NO_BOX: Vector3 = (0.0, 0.0, 0.0)
"""Extent of an object whose size is not known."""
ROBOT = "robot"
FLOOR = "floor"
"""Id and category of the floor, where a scene lists it."""

# Names that facts may use in addition to the scene's objects.
OWN_NAMES = ("gripper", "robot", "ground", FLOOR)
# Names that formulas can have: no blank, no parenthesis, no `*`, which stands for any object.
_OBJECT_ID = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")
# Limits: a building fits in, and the arithmetic of poses loses no digits.
LARGEST_M = 1000.0
SMALLEST_M = 1e-4
LARGEST_TURN_RAD = 1000.0
LARGEST_TURN_DEG = 36_000.0
# Factors of sizes.
SCALES = (1e-6, 1e6)
# Rooms and substances are named, not listed: arguments that stand for them are free.
FREE_PARAMETERS = frozenset({"room", "substance"})
# Ids and categories appear in every message, and ids name files.
LONGEST_NAME = 200


def triple(values: Iterable[float]) -> tuple[float, float, float]:
    """Return three numbers as a tuple of three."""
    x, y, z = values
    return (x, y, z)


@dataclass(frozen=True, slots=True)
class RobotPose:
    """Where the robot starts, and which one it is.

    Attributes:
        position: Of the mobile base in the world [m].
        yaw_rad: Heading about +z.
        name: Of its record, a key of `oag.model.robots.ROBOTS`.
    """

    position: Vector3 = (0.0, 0.0, 0.0)
    yaw_rad: float = 0.0
    name: str = PAPER_ROBOT.name

    @property
    def model(self) -> Robot:
        """The robot's record."""
        return robot_named(self.name)


UPRIGHT_DEG = 15.0
"""What leans no more than this from how it stands by nature is upright."""


@dataclass(frozen=True, slots=True)
class SceneObject:
    """One object of a scene, in the world frame (z up, metres, quaternions w x y z).

    Attributes:
        id: Unique in the scene, such as `glass_0`.
        category: What it is, such as `water_glass`; decides `kind` and `role`.
        model: Name of the asset that stands for it.
        position: Centre of its bounding box [m].
        bbox_extent: Size of its bounding box [m] along its own axes, before `scale`; `NO_BOX` where it is not known.
        scale: Factor along each of its own axes.
        parameters: Geometry of the asset, not read by this package.
        domain_kind: The kind that an own domain gives its category, or None; scenes fill it in.
        fixed: Whether it is fixed to the room, as a picture is to its wall; its kind is then `Kind.FIXED`.
    """

    id: str
    category: str
    model: str
    position: Vector3
    orientation: Quaternion
    bbox_extent: Vector3
    scale: Vector3 = (1.0, 1.0, 1.0)
    parameters: Mapping[str, object] = field(default_factory=dict)
    domain_kind: Kind | None = None
    fixed: bool = False

    @property
    def extent_m(self) -> Vector3:
        """Size of the bounding box [m] along the object's own axes, scale applied."""
        return triple(size * factor for size, factor in zip(self.bbox_extent, self.scale, strict=True))

    def __repr__(self) -> str:
        return brief(f"<SceneObject {self.id} ({self.category}), {self.kind.value}>")

    @property
    def has_box(self) -> bool:
        """False where the size is not known, so that nothing can be concluded from it."""
        return self.bbox_extent != NO_BOX

    @property
    def kind(self) -> Kind:
        """Articulated fixture, support or item, from the category, unless it is fixed."""
        if self.fixed:
            return Kind.FIXED
        if self.domain_kind is not None:
            return self.domain_kind
        (x, y, _), (along_x, along_y, _) = self.bbox_extent, self.scale
        return kind_of(self.category, min(x * along_x, y * along_y))

    @property
    def role(self) -> Role:
        """The paper's type: "A" (fixture, never scaled) or "B" (manipulable item)."""
        return self.kind.role

    @property
    def height_m(self) -> float:
        """Height [m] of the box that bounds the object in the world, its orientation taken into account."""
        w, x, y, z = self.orientation
        up = (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y))
        return sum(abs(cosine) * size for cosine, size in zip(up, self.extent_m, strict=True))

    @property
    def lean_deg(self) -> float:
        """Angle [deg] between the object's own z axis and the vertical: 0 where it stands, 90 where it lies."""
        _, x, y, _ = self.orientation
        return math.degrees(math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y)))))

    def scaled(self, factor: float) -> Self:
        """Return the object scaled by a factor about the middle of its bottom, which stays where it is."""
        smaller = replace(self, scale=triple(value * factor for value in self.scale))
        x, y, z = self.position
        return replace(smaller, position=(x, y, z - 0.5 * (self.height_m - smaller.height_m)))


@dataclass(frozen=True, slots=True)
class Scene:
    """A scene and what is known of it.

    Attributes:
        name: For people and records.
        robot: Where the robot starts, and which one it is.
        objects: id -> object.
        facts: Literals that hold at the start; their texts are accepted and read.
        closed: Predicates known completely: what no fact states of them is false at the start.
        variation: Ranges for randomisation, not read by this package.
        known: What geometry found impossible in it.
        domain: Its predicates, the kinds of its categories, and the primitives that plans in it may use.
    """

    name: str
    robot: RobotPose
    objects: Mapping[str, SceneObject]
    facts: tuple[bddl.Formula, ...] = ()
    closed: frozenset[str] = frozenset()
    variation: Mapping[str, object] = field(default_factory=dict)
    known: tuple[Infeasible, ...] = ()
    domain: Domain = BUILT_IN

    def __post_init__(self) -> None:
        """Read facts given as texts, and check them as in a file: an ignored mistake would prove too much."""
        refused = partial(SceneError, source="(Scene)")
        given: object = self.objects
        if not isinstance(given, Mapping):
            raise refused(expected("an object", given), place="objects")
        for key, thing in given.items():
            if not isinstance(thing, SceneObject):
                hint = f"{key} is no file's mapping here"
                raise refused(f"expected a SceneObject, got {shown(thing)}", place=f"objects.{key}", hint=hint)
        if self.domain.kinds:
            kinds = {key: self.domain.kind_of(thing.category) for key, thing in given.items()}
            things = {key: replace(thing, domain_kind=kinds[key]) for key, thing in given.items()}
            object.__setattr__(self, "objects", things)
        object.__setattr__(self, "facts", read_facts(self.facts, self.objects, "(Scene)", self.domain))
        self._check_held()
        object.__setattr__(self, "closed", read_closed(self.closed, "(Scene)", self.domain))
        for number, found in enumerate(self.known):
            if (found.place is None) is (found.kind in ("ontop", "inside")):
                wanted = "an object's id" if found.place is None else "none, or the kind ontop or inside"
                reason = f"{found.kind} takes {'a place' if found.place is None else 'no place'}; expected {wanted}"
                raise refused(reason, place=f"known[{number}].place")
            for name in filter(None, (found.thing, found.place)):
                if name not in self.objects:
                    hint = did_you_mean(name, self.objects)
                    raise refused(f"unknown object {name!r}", place=f"known[{number}]", hint=hint)
        read = [
            read_facts(found.given, self.objects, "(Scene)", self.domain, f"known[{number}].given")
            for number, found in enumerate(self.known)
        ]
        known = (replace(found, given=given) for found, given in zip(self.known, read, strict=True))
        object.__setattr__(self, "known", tuple(known))

    def __repr__(self) -> str:
        counts = f"{pluralize(len(self.objects), 'object')}, {pluralize(len(self.facts), 'fact')}"
        return f"<Scene {shown(self.name)}: {counts}>"

    def _check_held(self) -> None:
        """Refuse a fact that puts something into the gripper that it cannot hold."""
        for number, fact in enumerate(self.facts):
            for literal in bddl.literals(fact) or ():
                predicate, *names = literal.atom.label
                held = literal.value and predicate == "inside" and names[1:] == [GRIPPER]
                first = names[0] if names else ""
                if held and (first not in self.objects or self.objects[first].kind is not Kind.ITEM):
                    problem = f"the gripper cannot hold {first}; expected an item of the scene"
                    raise SceneError(problem, source=self.name, place=f"facts[{number}]")

    @classmethod
    def from_json(cls, source: Source, domain: Domain = BUILT_IN) -> Self:
        """Return the scene that a JSON file, or a mapping of the same form, describes in a domain, by default its own.

        A file that names no robot is for the paper's here; `executor.load_scene` and the commands take `panda-lift`.

        Raises:
            SceneError: The one first thing that is malformed, with its place in the JSON and what was expected.
        """
        # Loads pydantic, which takes as long as this package.
        found: Self = import_module("oag.model.forms").scene_in(load(source, SceneError), cls, domain)
        return found

    def to_json(self) -> dict[str, object]:
        """Return the mapping that `from_json` reads back into an equal scene."""
        return {
            "name": self.name,
            "robot": _write_robot(self.robot),
            "objects": {key: _write_object(thing) for key, thing in self.objects.items()},
            "facts": [bddl.format(fact) for fact in self.facts],
            "closed": sorted(self.closed),
            "variation": dict(self.variation),
            **({"known": as_json(self.known)} if self.known else {}),
            **({} if self.domain.built_in else {"domain": self.domain.to_json()}),
        }

    @property
    def categories(self) -> dict[str, str]:
        """The category of each object, which quantifiers range over."""
        return {key: thing.category for key, thing in self.objects.items()}

    def with_scales(self, factors: Mapping[str, float]) -> Self:
        """Return the scene with some objects scaled (the paper's size adjustment), their bottoms in place."""
        objects = dict(self.objects)
        for key, factor in factors.items():
            if not factor > 0.0:
                raise SceneError(f"expected a scale greater than 0, got {factor}", source=self.name, place=key)
            objects[key] = self[key].scaled(factor)
        return replace(self, objects=objects)

    def knowing(self, found: Iterable[Infeasible]) -> Self:
        """Return the scene with more of what geometry found impossible in it."""
        return replace(self, known=tuple(dict.fromkeys((*self.known, *found))))

    def with_robot(self, name: str) -> Self:
        """Return the scene with another robot at the same place."""
        return replace(self, robot=replace(self.robot, name=name))

    def __getitem__(self, object_id: str) -> SceneObject:
        """Return an object; a SceneError names near ids when there is none with that id."""
        try:
            return self.objects[object_id]
        except KeyError:
            near = bddl.near_names(object_id, tuple(self.objects))
            hint = f"did you mean {' or '.join(near)}?" if near else f"it has {', '.join(self.objects) or 'none'}"
            raise SceneError(f"has no object {object_id!r}", source=self.name, hint=hint) from None


def _write_robot(robot: RobotPose) -> dict[str, object]:
    written: dict[str, object] = {"position": list(robot.position), "yaw": robot.yaw_rad}
    if robot.name == FULL_SIZE.name:
        # As scenes were written before robots had names; earlier versions read it.
        written["scale"] = robot.model.scale
    elif robot.name != PAPER_ROBOT.name:
        written["name"] = robot.name
    return written


def _write_object(thing: SceneObject) -> dict[str, object]:
    if not thing.has_box:
        return {"category": thing.category}
    written = {
        key: value
        for key, value in fields_json(thing).items()
        if key not in ("id", "parameters", "domain_kind", "fixed")
    }
    written |= {"parameters": dict(thing.parameters)} if thing.parameters else {}
    return written | ({"fixed": True} if thing.fixed else {})


def id_problem(key: str, category: object) -> str:
    """Return why an object of a category cannot have an id: no formula can name it, or it is reserved; else ""."""
    if key in OWN_NAMES and not key == category == FLOOR:
        own = f"{', '.join(OWN_NAMES[:-1])} and {OWN_NAMES[-1]}"
        return f"the id {key!r} is reserved: {own} are in every scene; name the object otherwise"
    if not _OBJECT_ID.fullmatch(key) or len(key) > LONGEST_NAME:
        return (
            f"the id {shown(key)} cannot be used; expected letters a to z, digits, '_', '.' and '-', "
            f"{LONGEST_NAME} at most, not starting with '.' or '-', such as glass_0"
        )
    return ""


def about_z(turn_rad: float) -> tuple[float, float, float, float]:
    """Return the quaternion w x y z of a turn about the vertical."""
    return (math.cos(turn_rad / 2), 0.0, 0.0, math.sin(turn_rad / 2)) if turn_rad else (1.0, 0.0, 0.0, 0.0)


def read_closed(given: object, source: str, domain: Domain = BUILT_IN) -> frozenset[str]:
    """Return the predicates that a scene declares to know completely; raises SceneError for anything else."""
    names = _listed(given, "closed", source)
    for index, name in enumerate(names):
        if not isinstance(name, str) or name not in domain.predicates:
            reason = f"unknown predicate {name!r}" if isinstance(name, str) else expected("a string", name)
            hint = did_you_mean(name, domain.predicates) if isinstance(name, str) else ""
            raise SceneError(reason, source=source, place=f"closed[{index}]", hint=hint)
    return frozenset(map(str, names))


def read_facts(
    given: object, objects: Iterable[str], source: str, domain: Domain = BUILT_IN, place: str = "facts"
) -> tuple[bddl.Formula, ...]:
    """Return the literals that hold at the start, from formulas or their texts.

    Each must be ground, of this scene, and not contradicted; raises SceneError otherwise. The source is for messages.
    """
    known = (*objects, *OWN_NAMES)
    values: dict[bddl.Atom, bool] = {}
    facts = []
    for index, text in enumerate(_listed(given, place, source)):
        refused = partial(SceneError, source=source, place=f"{place}[{index}]")
        if isinstance(text, bddl.Formula):
            formula = text
        elif isinstance(text, str):
            try:
                formula = domain.formula(text)
            except bddl.BDDLError as problem:
                raise refused(problem.first_messages, hint=problem.first_hint) from problem
        else:
            raise refused(expected("a string", text))
        literals = bddl.literals(formula)
        if literals is None:
            raise refused("a fact must be a literal, such as (ontop glass_0 table_0) or (not (open fridge_0))")
        for literal in literals:
            reason, hint = _unfit_fact(literal.atom, known, domain)
            if not reason and values.setdefault(literal.atom, literal.value) is not literal.value:
                reason = f"contradicts an earlier fact about {bddl.format(literal.atom)}"
            if reason:
                raise refused(reason, hint=hint)
        facts.append(formula)
    return tuple(facts)


def _listed(given: object, place: str, source: str) -> Collection[object]:
    if not isinstance(given, list | tuple | set | frozenset):
        raise SceneError(expected("a list", given), source=source, place=place)
    return given


def _unfit_fact(atom: bddl.Atom, known: tuple[str, ...], domain: Domain) -> tuple[str, str]:
    """Return the problem of a fact and a hint: an unknown predicate or object, or a wrong arity."""
    spec = domain.predicates.get(atom.predicate)
    if spec is None:
        return f"unknown predicate {atom.predicate!r}", did_you_mean(atom.predicate, domain.predicates)
    if len(atom.args) != spec.arity:
        return f"{atom.predicate} takes {spec.arity} arguments, got {len(atom.args)}", ""
    for name, parameter in zip(atom.args, spec.parameters, strict=True):
        if parameter not in FREE_PARAMETERS and name not in known:
            return f"unknown object {name!r}", did_you_mean(name, known)
    return "", ""
