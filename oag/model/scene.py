"""A scene: its objects with their boxes, what is known to hold at the start, and what is known completely."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import bddl
from oag.model.categories import Kind, Role, kind_of
from oag.model.errors import SceneError
from oag.model.facts import GRIPPER
from oag.model.jsonfile import JsonNode, Source, load, shown
from oag.model.scenefile import (
    LARGEST_TURN_RAD,
    LONGEST_NAME,
    identity_pose,
    read_category,
    read_closed,
    read_extent,
    read_facts,
    read_parameters,
    read_place,
    read_quaternion,
    read_scale,
    triple,
)

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
ROBOT = "robot"
# What is in every world without being listed; a fact or a contact may name it.
_RESERVED_IDS = (GRIPPER, ROBOT, "ground", "floor")
# What every formula can name: no blank, no parenthesis, no `*`, which stands for any object.
_OBJECT_ID = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")


@dataclass(frozen=True, slots=True)
class RobotPose:
    """Where the mobile base starts in the world: position in metres, heading about +z in radians."""

    position: Vector3 = (0.0, 0.0, 0.0)
    yaw_rad: float = 0.0


@dataclass(frozen=True, slots=True)
class SceneObject:
    """One object of a scene, in the world frame (z up, metres, quaternions w x y z).

    Attributes:
        id: Unique in the scene, such as `glass_0`.
        category: What it is, such as `water_glass`; decides `kind` and `role`.
        model: Name of the asset that stands for it.
        position: Centre of its bounding box [m].
        orientation: Unit quaternion w x y z.
        bbox_extent: Size of its bounding box [m] along its own axes, before `scale`.
        scale: Factor along each of its own axes.
        parameters: Geometry of the asset, not read by this package.
    """

    id: str
    category: str
    model: str
    position: Vector3
    orientation: Quaternion
    bbox_extent: Vector3
    scale: Vector3 = (1.0, 1.0, 1.0)
    parameters: Mapping[str, object] = field(default_factory=dict)

    @property
    def extent_m(self) -> Vector3:
        """Size of the bounding box [m] along the object's own axes, scale applied."""
        return triple(size * factor for size, factor in zip(self.bbox_extent, self.scale, strict=True))

    @property
    def kind(self) -> Kind:
        """Articulated fixture, support or item, from the category."""
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

    def scaled(self, factor: float) -> Self:
        """Returns the object scaled by a factor about the middle of its bottom, which stays where it is."""
        smaller = replace(self, scale=triple(value * factor for value in self.scale))
        x, y, z = self.position
        return replace(smaller, position=(x, y, z - 0.5 * (self.height_m - smaller.height_m)))


@dataclass(frozen=True, slots=True)
class Scene:
    """A scene and what is known of it.

    Attributes:
        name: For people and records.
        robot: Where the robot starts.
        objects: id -> object.
        facts: Literals that hold at the start; their texts are accepted and read.
        closed: Predicates known completely: what no fact states of them is false at the start.
        variation: Ranges for randomisation, not read by this package.
    """

    name: str
    robot: RobotPose
    objects: Mapping[str, SceneObject]
    facts: tuple[bddl.Formula, ...] = ()
    closed: frozenset[str] = frozenset()
    variation: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Reads facts that are texts, and checks what is checked in a file: what is passed over would prove too much.

        Raises:
            SceneError: A fact is no literal about these objects or contradicts another one, `closed` lists no
                predicates, or an object is no `SceneObject`.
        """
        given_closed: object = self.closed
        closed = tuple(given_closed) if isinstance(given_closed, set | frozenset) else given_closed
        given = JsonNode({"objects": self.objects, "facts": self.facts, "closed": closed}, "", "(Scene)", SceneError)
        for key, node in given.require("objects").items():
            if not isinstance(node.value, SceneObject):
                raise node.fail(f"expected a SceneObject, got {shown(node.value)}", f"{key} is no file's mapping here")
        object.__setattr__(self, "facts", read_facts(given, self.objects))
        self._check_held()
        object.__setattr__(self, "closed", read_closed(given))

    def _check_held(self) -> None:
        """Raises the error for a fact that puts something into the gripper that it cannot hold."""
        for number, fact in enumerate(self.facts):
            for literal in bddl.literals(fact) or ():
                predicate, first, *rest = literal.atom.label
                held = literal.value and predicate == "inside" and rest == [GRIPPER]
                if held and (first not in self.objects or self.objects[first].kind is not Kind.ITEM):
                    problem = f"the gripper cannot hold {first}; expected an item of the scene"
                    raise SceneError(problem, source=self.name, place=f"facts[{number}]")

    @classmethod
    def from_json(cls, source: Source) -> Self:
        """Returns the scene that a JSON file, or a mapping of the same form, describes.

        Raises:
            SceneError: The one first thing that is malformed, with its place in the JSON and what was expected.
        """
        root = load(source, SceneError)
        root.only("name", "robot", "objects", "facts", "closed", "variation")
        objects = {key: _read_object(key, node) for key, node in root.require("objects").items()}
        robot = root.get("robot")
        return cls(
            name=root.text("name", "scene"),
            robot=RobotPose() if robot is None else _read_robot(robot),
            objects=objects,
            facts=read_facts(root, objects),
            closed=read_closed(root),
            variation=read_parameters(root, "variation"),
        )

    def to_json(self) -> dict[str, object]:
        """Returns the mapping that `from_json` reads back into an equal scene."""
        return {
            "name": self.name,
            "robot": {"position": list(self.robot.position), "yaw": self.robot.yaw_rad},
            "objects": {key: _write_object(thing) for key, thing in self.objects.items()},
            "facts": [bddl.format(fact) for fact in self.facts],
            "closed": sorted(self.closed),
            "variation": dict(self.variation),
        }

    @property
    def categories(self) -> dict[str, str]:
        """The category of each object, which quantifiers range over."""
        return {key: thing.category for key, thing in self.objects.items()}

    def with_scales(self, factors: Mapping[str, float]) -> Self:
        """Returns the scene with some objects scaled (the paper's size adjustment), their bottoms in place.

        Raises:
            SceneError: A factor names no object, or is not positive.
        """
        objects = dict(self.objects)
        for key, factor in factors.items():
            if not factor > 0.0:
                raise SceneError(f"expected a scale greater than 0, got {factor}", source=self.name, place=key)
            objects[key] = self[key].scaled(factor)
        return replace(self, objects=objects)

    def __getitem__(self, object_id: str) -> SceneObject:
        """Returns an object; a SceneError names near ids when there is none of that id."""
        try:
            return self.objects[object_id]
        except KeyError:
            near = bddl.near_names(object_id, tuple(self.objects))
            hint = f"did you mean {' or '.join(near)}?" if near else f"it has {', '.join(self.objects) or 'none'}"
            raise SceneError(f"has no object {object_id!r}", source=self.name, hint=hint) from None


def _read_robot(node: JsonNode) -> RobotPose:
    node.only("position", "yaw")
    position, yaw = node.get("position"), node.get("yaw")
    return RobotPose(
        position=(0.0, 0.0, 0.0) if position is None else read_place(position),
        yaw_rad=0.0 if yaw is None else yaw.within(-LARGEST_TURN_RAD, LARGEST_TURN_RAD),
    )


def _read_object(key: str, node: JsonNode) -> SceneObject:
    if key in _RESERVED_IDS:
        own = f"{', '.join(_RESERVED_IDS[:-1])} and {_RESERVED_IDS[-1]}"
        raise node.fail(f"the id {key!r} is reserved: {own} are in every scene; name the object otherwise")
    if not _OBJECT_ID.fullmatch(key) or len(key) > LONGEST_NAME:
        raise node.fail(
            f"the id {shown(key)} cannot be used; expected letters a to z, digits, '_', '.' and '-', "
            f"not starting with '.' or '-', {LONGEST_NAME} at most, such as glass_0"
        )
    node.only("category", "model", "position", "orientation", "bbox_extent", "scale", "parameters")
    category = read_category(node.require("category"))
    extent = read_extent(node.require("bbox_extent"))
    position, orientation, scale = (node.get(name) for name in ("position", "orientation", "scale"))
    origin, upright = identity_pose()
    return SceneObject(
        id=key,
        category=category,
        model=node.text("model", category),
        position=origin if position is None else read_place(position),
        orientation=upright if orientation is None else read_quaternion(orientation),
        bbox_extent=extent,
        scale=read_scale(scale, extent),
        parameters=read_parameters(node, "parameters"),
    )


def _write_object(thing: SceneObject) -> dict[str, object]:
    written: dict[str, object] = {
        "category": thing.category,
        "model": thing.model,
        "position": list(thing.position),
        "orientation": list(thing.orientation),
        "bbox_extent": list(thing.bbox_extent),
        "scale": list(thing.scale),
    }
    if thing.parameters:
        written["parameters"] = dict(thing.parameters)
    return written
