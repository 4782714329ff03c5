"""Forms of files as pydantic models: readers with messages in this project's words, and the reading of scene files.

The published JSON schema of scene files is generated from `SceneForm`. Of an object only the category is required
there. `executor.load_scene` also needs a place and takes the rest from the library of assets; `Scene.from_json`, which
knows no assets, also needs sizes.

Importing pydantic takes as long as this package, so this module is imported when a file is read.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from typing import Annotated, Any, Self, TypeVar, cast, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, TypeAdapter, ValidationError, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from bddl.ast import NAME_RULE, is_name
from oag.model.codec import Document, did_you_mean, expected, missing, number, place_of, shown
from oag.model.diagnostics import InputError
from oag.model.domain import BUILT_IN, Domain
from oag.model.infeasible import Infeasible, InfeasibleKind
from oag.model.robots import FULL_SIZE, PAPER_ROBOT, ROBOTS
from oag.model.scene import (
    LARGEST_M,
    LARGEST_TURN_DEG,
    LARGEST_TURN_RAD,
    LONGEST_NAME,
    NO_BOX,
    SCALES,
    SMALLEST_M,
    RobotPose,
    Scene,
    SceneObject,
    about_z,
    id_problem,
    read_closed,
    read_facts,
)
from oag.model.symbols import is_known

_UNFIT = "unfit"  # The type of mistakes with a hint, or inside the value that was read.
_Form = TypeVar("_Form")
_WANTED: Mapping[str, str] = {
    "string_type": "a string",
    "string_unicode": "text",
    "string_too_long": "a text of at most {max_length} characters",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "an object",
    "mapping_type": "an object",
    "model_type": "an object",
    "model_attributes_type": "an object",
    "dataclass_type": "an object",
    "named_tuple_type": "an object",
    "invalid_key": "an object with names as keys",
    "bool_type": "true or false",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "finite_number": "a number",
    "literal_error": "{expected}",
    "greater_than": "a number greater than {gt}",
    "greater_than_equal": "a number from {ge} up",
    "less_than": "a number less than {lt}",
    "less_than_equal": "a number of at most {le}",
}


class Form(BaseModel):
    """An object in a file of which every key is known."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class OpenForm(Form):
    """An object in a file of which some keys are read."""

    model_config = ConfigDict(extra="ignore", frozen=True)


def unfit(problem: str, hint: str = "", *at: str | int) -> PydanticCustomError:
    """Return the error of a validator; `at` is the place inside the value that it got."""
    return PydanticCustomError(_UNFIT, "{problem}", {"problem": problem, "hint": hint, "at": at})


def within(low: float, high: float) -> BeforeValidator:
    """Return the validator of a number between two limits."""
    return BeforeValidator(lambda value: number(value, low, high))


def numbers(
    value: object,
    count: int,
    what: str,
    low: float = -math.inf,
    high: float = math.inf,
    at: tuple[str | int, ...] = (),
) -> tuple[float, ...]:
    """Return `count` numbers between two limits; `what` names them and `at` their place, for the message."""
    if not isinstance(value, list | tuple) or len(value) != count:
        raise unfit(expected(f"{count} numbers ({what})", value), "", *at)
    found = []
    for position, entry in enumerate(value):
        try:
            found.append(number(entry, low, high))
        except ValueError as problem:
            raise unfit(str(problem), "", *at, position) from None
    return tuple(found)


def vector(count: int, what: str, low: float = -math.inf, high: float = math.inf) -> BeforeValidator:
    """Return the validator of `count` numbers between two limits."""
    return BeforeValidator(lambda value: numbers(value, count, what, low, high))


def adapter(form: type[_Form]) -> TypeAdapter[_Form]:
    """Return the reader of plain data as a form; making one takes milliseconds, so each is made once."""
    return _adapter(cast("Hashable", form))


@cache
def _adapter(form: Any) -> TypeAdapter[Any]:
    return TypeAdapter(form)


def examine(
    document: Document, form: type[_Form], *path: str | int, domain: Domain = BUILT_IN
) -> tuple[_Form, tuple[()]] | tuple[None, tuple[InputError, ...]]:
    """Return the value at a path of a document, or everything in it that deviates from the form in a domain."""
    try:
        return adapter(form).validate_python(document.at(*path), context=domain), ()
    except ValidationError as problem:
        found = (_words(error, form) for error in problem.errors(include_url=False))
        return None, tuple(document.fail((*path, *place), message, hint) for place, message, hint in found)


def first_mistake(problem: ValidationError, form: object = None) -> str:
    """Return the first deviation from a form: where, what was expected, and the nearest legal names."""
    place, message, hint = _words(problem.errors(include_url=False)[0], form)
    return f"{place_of(place)}: {message}".removeprefix(": ") + (f" ({hint})" if hint else "")


def _words(error: ErrorDetails, form: object) -> tuple[tuple[str | int, ...], str, str]:
    """Return the place of a pydantic error, the problem, and a hint, which may be empty."""
    place, kind, value, context = error["loc"], error["type"], error["input"], error.get("ctx", {})
    if kind == _UNFIT:
        return (*place, *context["at"]), context["problem"], context["hint"]
    if kind == "missing":
        if isinstance(place[-1], int):
            return place[:-1], f"entry {place[-1] + 1} is missing", ""
        return place[:-1], *missing(place[-1], value if isinstance(value, Mapping) else ())
    if kind == "extra_forbidden":
        known = _keys_at(form, place[:-1])
        hint = did_you_mean(str(place[-1]), known, f"expected {', '.join(known)}" if known else "")
        return place[:-1], f"has a key {shown(place[-1])} that nothing reads", hint
    if kind == "value_error":
        return place, str(context["error"]), ""
    wanted = _WANTED.get(kind)
    return place, error["msg"] if wanted is None else expected(wanted.format(**context), value), ""


def _keys_at(form: object, path: tuple[str | int, ...]) -> list[str]:
    """Return the keys that the model at a path of a form has; none where it is no model."""
    at = next(_models(form), None)
    for step in path:
        field = next((f for n, f in (at.model_fields if at else {}).items() if (f.alias or n) == step), None)
        at = at if field is None else next(_models(field.annotation), at)
    return [] if at is None else [field.alias or name for name, field in at.model_fields.items()]


def _models(annotation: object) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)


# Largest deviation of a normalised quaternion's norm from 1 by rounding.
_UNIT = 1e-15


def _unit_quaternion(value: object) -> tuple[float, ...]:
    """Return a unit quaternion w x y z, normalised."""
    # Squares of larger numbers lose precision; a unit quaternion has no component above 1.
    parts = numbers(value, 4, "quaternion w x y z", -1e6, 1e6)
    norm = math.sqrt(sum(part * part for part in parts))
    if norm < 1e-6:
        raise unfit("expected a quaternion w x y z that is not zero")
    # A normalised quaternion is read back unchanged.
    return parts if abs(norm - 1.0) < _UNIT else tuple(part / norm for part in parts)


def _place(value: object) -> tuple[float, ...]:
    """Return a position in the world [m]: three numbers, or two for an object that stands there."""
    flat = isinstance(value, list | tuple) and len(value) == 2
    return numbers(value, 2 if flat else 3, "x y in metres" if flat else "x y z in metres", -LARGEST_M, LARGEST_M)


def _sayable(category: object) -> object:
    """Return a category that a quantifier can name."""
    if isinstance(category, str) and not (is_name(category) and len(category) <= LONGEST_NAME):
        problem = f"the category {shown(category)} cannot be used: {NAME_RULE}; {LONGEST_NAME} characters at most"
        raise unfit(problem, "such as water_glass")
    return category


_OF_SCALE = {robot.scale: robot.name for robot in (PAPER_ROBOT, FULL_SIZE)}


def _robot_scale(value: object) -> object:
    if isinstance(value, int | float) and not isinstance(value, bool) and value in _OF_SCALE:
        return value
    expected_words = f"{PAPER_ROBOT.scale:g} (the paper's) or {FULL_SIZE.scale:g} (full size)"
    raise unfit(f"expected {expected_words}, got {shown(value)}")


def _robot_name(value: object) -> object:
    if isinstance(value, str) and value in ROBOTS:
        return value
    raise unfit(f"expected the name of a robot, got {shown(value)}", f"one of {', '.join(ROBOTS)}")


_Coordinate = Annotated[float, Field(ge=-LARGEST_M, le=LARGEST_M)]
_Length = Annotated[float, Field(ge=SMALLEST_M, le=LARGEST_M)]
_Factor = Annotated[float, Field(ge=SCALES[0], le=SCALES[1])]
_Place = Annotated[tuple[_Coordinate, ...], Field(min_length=2, max_length=3), BeforeValidator(_place)]
_Point = Annotated[tuple[_Coordinate, _Coordinate], vector(2, "x y in metres", -LARGEST_M, LARGEST_M)]
_Quaternion = Annotated[tuple[float, float, float, float], BeforeValidator(_unit_quaternion)]
Extent = Annotated[tuple[_Length, _Length, _Length], vector(3, "x y z in metres, all > 0", SMALLEST_M, LARGEST_M)]
"""Sides of a bounding box [m]."""
_Scale = Annotated[tuple[_Factor, _Factor, _Factor], vector(3, "x y z, all > 0", *SCALES)]
_Category = Annotated[str, Field(min_length=1, max_length=LONGEST_NAME), BeforeValidator(_sayable)]
_Degrees = Annotated[
    float, Field(ge=-LARGEST_TURN_DEG, le=LARGEST_TURN_DEG), within(-LARGEST_TURN_DEG, LARGEST_TURN_DEG)
]
_Radians = Annotated[
    float, Field(ge=-LARGEST_TURN_RAD, le=LARGEST_TURN_RAD), within(-LARGEST_TURN_RAD, LARGEST_TURN_RAD)
]
_RobotScale = Annotated[float, Field(ge=PAPER_ROBOT.scale, le=FULL_SIZE.scale), BeforeValidator(_robot_scale)]
_RobotName = Annotated[str, BeforeValidator(_robot_name)]


class RobotForm(Form):
    """Where the robot starts, and which one it is."""

    position: _Place | None = Field(None, description="Its base in the world: x y or x y z in metres; else the origin.")
    yaw: _Radians | None = Field(None, description="Its heading about the vertical in radians; 0 looks along +x.")
    heading_deg: _Degrees | None = Field(None, description="The same in degrees, instead of `yaw`.")
    scale: _RobotScale | None = Field(
        None, description="Size of its arm and hand: 0.7, the paper's, whose hand opens to 56 mm, or 1, to 80 mm."
    )
    name: _RobotName | None = Field(None, description=f"Which robot it is: {', '.join(ROBOTS)}. Instead of `scale`.")

    @model_validator(mode="after")
    def _turned_once(self) -> Self:
        if self.yaw is not None and self.heading_deg is not None:
            raise unfit("has both 'yaw' (radians) and 'heading_deg'", "keep one of them")
        return self

    @model_validator(mode="after")
    def _named_once(self) -> Self:
        if self.name is not None and self.scale is not None:
            raise unfit("has both 'name' and 'scale'", "keep the name")
        return self


class ObjectForm(Form):
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
    bbox_extent: Extent | None = Field(
        None, description="Size along its own x y z in metres, before `scale`; by default a usual size of its model."
    )
    scale: _Scale | None = Field(None, description="Factors along its own axes; by default 1 each.")
    parameters: Mapping[str, Any] | None = Field(
        None, description="What shapes the model besides its size, such as hinge, drawers or open_fraction."
    )
    fixed: bool | None = Field(
        None, description="Whether it is fixed to the room, as a picture is to its wall: not taken, and no support."
    )

    @model_validator(mode="after")
    def _turned_once(self) -> Self:
        if self.orientation is not None and self.heading_deg is not None:
            raise unfit("has both 'orientation' and 'heading_deg'", "keep one of them")
        return self


class InfeasibleForm(Form):
    """Something that cannot be done while all that is `given` holds."""

    kind: InfeasibleKind = Field(description="What: take, open or close a thing, or put it on or in a place.")
    thing: str = Field(description="Id of the object that it is done to.")
    place: str | None = Field(None, description="Id of the object that it is put on or in.")
    given: list[str] = Field([], description="Literals, such as (ontop bottle_0 shelf_0); [] for always.")
    subtask: str = Field("", description="Name of the subtask in which it was found.")
    reason: str = Field("", description="Why, in a sentence.")


def infeasible_of(forms: Iterable[InfeasibleForm] | None) -> tuple[Infeasible, ...]:
    """Return what a scene file says to be impossible; the scene reads its literals."""
    return tuple(Infeasible(**form.model_dump()) for form in forms or ())


class SceneForm(Form):
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
        "ontop, inside and open, as geometry says; [] leaves what is not said unknown. Of nextto, touching and under, "
        "where listed, detectors add what `facts` does not say.",
    )
    variation: Mapping[str, Any] | None = Field(None, description="Ranges for what a seed varies.")
    known: list[InfeasibleForm] | None = Field(None, description="What geometry found impossible, as `plan` writes it.")
    domain: Mapping[str, Any] | None = Field(
        None, description="The own domain that its facts are in, as domain files have it; by default the built-in one."
    )
    provenance: Mapping[str, Any] | None = Field(
        None, description="Where its values come from, by object and field, for people; not read."
    )


def json_schema() -> dict[str, object]:
    """Return the JSON schema of scene files, as it is published."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **SceneForm.model_json_schema()}


def examine_scene(document: Document) -> tuple[SceneForm | None, tuple[InputError, ...]]:
    """Return a scene file's content, or everything that is malformed in it."""
    objects = document.data.get("objects") if isinstance(document.data, Mapping) else None
    entries = objects.items() if isinstance(objects, Mapping) else ()
    categories = {str(key): one.get("category") if isinstance(one, Mapping) else None for key, one in entries}
    unfit_ids = {key: reason for key, category in categories.items() if (reason := id_problem(key, category))}
    form, mistakes = examine(document, SceneForm)
    problems = (*(document.fail(("objects", key), reason) for key, reason in unfit_ids.items()), *mistakes)
    return (None, problems) if problems else (form, ())


def read_scene(document: Document) -> SceneForm:
    """Return a scene file's content; raises a SceneError with the place of the first thing that is malformed."""
    form, problems = examine_scene(document)
    if form is None:
        raise problems[0]
    return form


def scene_in(document: Document, kind: type[Scene], domain: Domain = BUILT_IN) -> Scene:
    """Return the scene of a file; raises a SceneError with the place of the first thing that is malformed."""
    form = read_scene(document)
    domain = domain_for(document, form, domain)
    bare = not any(map(_has_geometry, form.objects.values()))
    objects = {key: object_of(document, key, one, bare=bare) for key, one in form.objects.items()}
    return kind(
        name="scene" if form.name is None else form.name,
        robot=RobotPose() if form.robot is None else robot_of(form.robot),
        objects=objects,
        facts=read_facts(form.facts or (), objects, document.source, domain),
        closed=read_closed(form.closed or (), document.source, domain),
        variation=dict(form.variation or {}),
        known=infeasible_of(form.known),
        domain=domain,
    )


def domain_for(document: Document, form: SceneForm, domain: Domain = BUILT_IN) -> Domain:
    """Return the domain of a scene file: its own one, or else the given one; raises a SceneError if these differ."""
    if form.domain is None:
        return domain
    own = Domain.from_json(form.domain, f"in {document.source}")
    if domain.built_in or own == domain:
        return own
    given = domain.name_apart_from(own)
    raise document.fail(("domain",), f"is the domain {own.name_apart_from(domain)}, and another one was given: {given}")


def robot_of(form: RobotForm) -> RobotPose:
    """Return the robot's start from its entry in a scene file."""
    x, y, *z = form.position or (0.0, 0.0)
    yaw_rad = form.yaw or 0.0 if form.heading_deg is None else math.radians(form.heading_deg)
    name = form.name or _OF_SCALE[PAPER_ROBOT.scale if form.scale is None else form.scale]
    return RobotPose((x, y, z[0] if z else 0.0), yaw_rad, name)


def _has_geometry(form: ObjectForm) -> bool:
    return any(given is not None for given in (form.bbox_extent, form.position, form.on, form.in_, form.orientation))


def object_of(document: Document, key: str, form: ObjectForm, *, bare: bool = False) -> SceneObject:
    """Return an object from its entry in a scene file; one without a place is at the origin.

    In a `bare` scene no object has geometry; objects of known categories are then without a box.

    Raises SceneError when its size is missing, its place is given by a support, or a value does not fit.
    """
    place = ("objects", key)
    for relation, other in (("on", form.on), ("in", form.in_)):
        if other is not None:
            hint = "executor.load_scene finds the place; or give a position"
            raise document.fail(place, f"its place is said by {relation!r}, which takes its model's geometry", hint)
    if bare and is_known(form.category):
        return SceneObject(key, form.category, form.model or form.category, NO_BOX, about_z(0.0), NO_BOX)
    if form.bbox_extent is None:
        problem, hint = missing("bbox_extent", document.at(*place))
        raise document.fail(place, problem, hint or "executor.load_scene takes it from the library of assets")
    scale = form.scale or (1.0, 1.0, 1.0)
    for side, factor in zip(form.bbox_extent, scale, strict=True):
        if not SMALLEST_M <= side * factor <= LARGEST_M:
            problem = f"makes a side of {side * factor:g} m; expected {SMALLEST_M:g} to {LARGEST_M:g} m"
            raise document.fail((*place, "scale"), problem)
    thing = SceneObject(
        id=key,
        category=form.category,
        model=form.model or form.category,
        position=(0.0, 0.0, 0.0),
        orientation=form.orientation or about_z(math.radians(form.heading_deg or 0.0)),
        bbox_extent=form.bbox_extent,
        scale=scale,
        parameters=dict(form.parameters or {}),
        fixed=bool(form.fixed),
    )
    if form.position is None:
        return thing
    x, y, *z = form.position
    return replace(thing, position=(x, y, z[0] if z else thing.height_m / 2))
