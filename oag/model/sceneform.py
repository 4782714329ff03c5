"""What may be written in a scene file: pydantic models, of which the published JSON schema is made.

Of an object only its category is required here; whoever furnishes the scene wants a place too and takes the rest from
the library of assets (`executor.load_scene`). `Scene.from_json`, which knows no assets, asks for sizes as well.

Importing pydantic takes a good part of this package's time, so this module is imported when a file is read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError

from oag.model.errors import InputError, SceneError
from oag.model.jsonfile import JsonNode
from oag.model.scenefile import (
    LARGEST_M,
    LARGEST_TURN_DEG,
    LARGEST_TURN_RAD,
    LONGEST_NAME,
    SCALES,
    SMALLEST_M,
    check_id,
    read_category,
    read_extent,
    read_factors,
    read_place,
    read_point,
    read_quaternion,
)

_UNFIT = "unfit"  # The type of errors that this package's own readers found.


def _by(reader: Callable[[JsonNode], object]) -> BeforeValidator:
    """Returns the validator that reads a value with one of this package's readers, whose words stay."""

    def read(value: object) -> object:
        try:
            return reader(JsonNode(value, "", "", InputError))
        except InputError as problem:
            said = {"problem": problem.problem, "place": problem.place, "hint": problem.hint}
            raise PydanticCustomError(_UNFIT, "{problem}", said) from None

    return BeforeValidator(read)


def _turn(limit: float) -> BeforeValidator:
    return _by(lambda node: node.within(-limit, limit))


_Coordinate = Annotated[float, Field(ge=-LARGEST_M, le=LARGEST_M)]
_Length = Annotated[float, Field(ge=SMALLEST_M, le=LARGEST_M)]
_Factor = Annotated[float, Field(ge=SCALES[0], le=SCALES[1])]
_Place = Annotated[tuple[_Coordinate, ...], Field(min_length=2, max_length=3), _by(read_place)]
_Point = Annotated[tuple[_Coordinate, _Coordinate], _by(read_point)]
_Quaternion = Annotated[tuple[float, float, float, float], _by(read_quaternion)]
_Extent = Annotated[tuple[_Length, _Length, _Length], _by(read_extent)]
_Scale = Annotated[tuple[_Factor, _Factor, _Factor], _by(read_factors)]
_Category = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), _by(read_category)]
_Degrees = Annotated[float, Field(ge=-LARGEST_TURN_DEG, le=LARGEST_TURN_DEG), _turn(LARGEST_TURN_DEG)]
_Radians = Annotated[float, Field(ge=-LARGEST_TURN_RAD, le=LARGEST_TURN_RAD), _turn(LARGEST_TURN_RAD)]


class _ScenePart(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class RobotForm(_ScenePart):
    """Where the robot starts."""

    position: _Place | None = Field(None, description="Its base in the world: x y or x y z in metres; else the origin.")
    yaw: _Radians | None = Field(None, description="Its heading about the vertical in radians; 0 looks along +x.")
    heading_deg: _Degrees | None = Field(None, description="The same in degrees, instead of `yaw`.")


class ObjectForm(_ScenePart):
    """One object: what it is, where it is, which way it faces."""

    category: _Category = Field(description="What it is, such as water_glass; `scene2demo assets` lists what is known.")
    model: str | None = Field(
        None, description="Its model in the library; by default the category's first one, or the nearest in size."
    )
    position: _Place | None = Field(
        None,
        description="In the world, metres. x y z: the middle of its box. x y: it stands there, on what `on` names, "
        "else on the floor.",
    )
    on: str | None = Field(None, description='Id of what it stands on, or "floor"; a free place near an edge is found.')
    in_: str | None = Field(None, alias="in", description="Id of what it is in; a free place is found.")
    at: _Point | None = Field(
        None, description="With `on` or `in`: x y in metres from the middle of that top or floor, along its own axes."
    )
    heading_deg: _Degrees | None = Field(
        None,
        description="Turn about the vertical in degrees: the front of furniture looks along -x at 0, along -y at 90. "
        "By default 0, or as what it stands on or in.",
    )
    orientation: _Quaternion | None = Field(
        None,
        description="A unit quaternion w x y z instead of `heading_deg`, also for what lies or leans.",
    )
    bbox_extent: _Extent | None = Field(
        None, description="Size along its own x y z in metres, before `scale`; by default a usual size of its model."
    )
    scale: _Scale | None = Field(None, description="Factors along its own axes; by default 1 each.")
    parameters: Mapping[str, Any] | None = Field(
        None, description="What shapes the model besides its size, such as hinge, drawers or open_fraction."
    )


class SceneForm(_ScenePart):
    """A scene: what is there, where, and, where geometry does not say it, what holds."""

    model_config = ConfigDict(extra="forbid", frozen=True, title="Scene2Demo scene")

    schema_: str | None = Field(None, alias="$schema", description="Where this schema is, for editors; not read.")
    name: str | None = Field(None, description="For people and records.")
    robot: RobotForm | None = Field(
        None, description="Where the robot starts; by default at the origin, or on the free floor nearest to it."
    )
    objects: dict[str, ObjectForm] = Field(
        description="id -> object. Ids have letters, digits, '_', '.' and '-'. The floor may be listed as "
        '"floor": {"category": "floor"}.'
    )
    facts: list[str] | None = Field(
        None,
        description="What holds at the start, such as (not (open refrigerator_0)). Without `closed`, what stands on or "
        "in what and what is open follows from geometry, and facts that say otherwise are refused.",
    )
    closed: list[str] | None = Field(
        None,
        description="Predicates that `facts` lists completely: what it does not say of them is false. By default "
        "ontop, inside and open, as geometry says; [] leaves what is not said unknown.",
    )
    variation: Mapping[str, Any] | None = Field(None, description="Ranges for what a seed varies.")


_FORMS: Mapping[str, type[_ScenePart]] = {"": SceneForm, "objects": ObjectForm, "robot": RobotForm}


def json_schema() -> dict[str, object]:
    """Returns the JSON schema of scene files, as it is published."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **SceneForm.model_json_schema()}


def read_form(root: JsonNode) -> SceneForm:
    """Returns a scene file's content by its form.

    Raises:
        SceneError: The first thing that is malformed, with its place and what was expected.
    """
    found = examine(root)
    if isinstance(found, SceneForm):
        return found
    raise found[0]


def examine(root: JsonNode) -> SceneForm | tuple[SceneError, ...]:
    """Returns a scene file's content, or everything that is malformed in it."""
    problems: list[InputError] = []
    for key, node in _members(root, "objects"):
        try:
            check_id(key, node)
        except SceneError as problem:
            problems.append(problem)
    try:
        form = SceneForm.model_validate(_plain(root.value))
    except ValidationError as error:
        problems += [_said(root, each) for each in error.errors(include_url=False)]
    if problems:
        return tuple(SceneError(p.problem, source=p.source, place=p.place, hint=p.hint) for p in problems)
    return form


def _members(root: JsonNode, key: str) -> list[tuple[str, JsonNode]]:
    """Returns the members of one of a document's objects; none where there is no such thing."""
    node = root.get(key)
    if node is None or not isinstance(node.value, Mapping):
        return []
    return [(str(name), node.child(str(name), value)) for name, value in node.value.items()]


def _plain(value: object) -> object:
    """Returns a document whose forms are dictionaries, as pydantic wants them; what is in them stays as it is."""
    if not isinstance(value, Mapping):
        return value
    objects, robot = value.get("objects"), value.get("robot")
    changed = dict(value)
    if isinstance(objects, Mapping):
        changed["objects"] = {
            key: dict(entry) if isinstance(entry, Mapping) else entry for key, entry in objects.items()
        }
    if isinstance(robot, Mapping):
        changed["robot"] = dict(robot)
    return changed


def _said(root: JsonNode, error: ErrorDetails) -> InputError:
    """Returns a finding of pydantic in this package's words, with the place in the file."""
    *above, last = error["loc"] or ("",)
    parent = root.at(above)
    node = root.at(error["loc"])
    kind = error["type"]
    if kind == _UNFIT:
        context = error.get("ctx", {})
        return node.below(context["place"]).fail(context["problem"], context["hint"])
    if kind == "missing":
        return parent.missing(str(last))
    if kind == "extra_forbidden":
        form = _FORMS[str(above[0]) if above else ""]
        known = [field.alias or name for name, field in form.model_fields.items()]
        return parent.unread(str(last), known)
    wanted = _WANTED.get(kind)
    return node.fail(f"cannot be used: {error['msg']}") if wanted is None else node.expected(wanted)


_WANTED = {
    "string_type": "a string",
    "string_unicode": "text",
    "list_type": "a list",
    "dict_type": "an object",
    "mapping_type": "an object",
    "model_type": "an object",
    "model_attributes_type": "an object",
    "invalid_key": "an object with names as keys",
}
