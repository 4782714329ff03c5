"""What may be written in a scene file: pydantic models, of which the published JSON schema is made.

Of an object only its category is required here; whoever furnishes the scene wants a place too and takes the rest from
the library of assets (`executor.load_scene`). `Scene.from_json`, which knows no assets, asks for sizes as well.

Importing pydantic takes a good part of this package's time, so this module is imported when a file is read.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from bddl.syntax.tree import NAME_RULE, is_name
from oag.model.errors import InputError
from oag.model.forms import Form, examine, numbers, unfit, vector, within
from oag.model.jsonfile import Document, shown
from oag.model.scenefile import (
    FULL_SCALE,
    LARGEST_M,
    LARGEST_TURN_DEG,
    LARGEST_TURN_RAD,
    LONGEST_NAME,
    PAPER_SCALE,
    SCALES,
    SMALLEST_M,
    id_problem,
)

# As far as rounding lets the norm of a normalised quaternion be from 1.
_UNIT = 1e-15


def _unit_quaternion(value: object) -> tuple[float, ...]:
    """Returns a unit quaternion w x y z, normalised."""
    # Squares of larger numbers lose what they stand for; a unit quaternion has none above 1.
    parts = numbers(value, 4, "quaternion w x y z", -1e6, 1e6)
    norm = math.sqrt(sum(part * part for part in parts))
    if norm < 1e-6:
        raise unfit("expected a quaternion w x y z that is not zero")
    # What was normalised once comes back from a file as it was.
    return parts if abs(norm - 1.0) < _UNIT else tuple(part / norm for part in parts)


def _place(value: object) -> tuple[float, ...]:
    """Returns where something is in the world [m]: three numbers, or two for what stands there."""
    flat = isinstance(value, list | tuple) and len(value) == 2
    return numbers(value, 2 if flat else 3, "x y in metres" if flat else "x y z in metres", -LARGEST_M, LARGEST_M)


def _sayable(category: object) -> object:
    """Returns what something is; a quantifier has to be able to say it."""
    if isinstance(category, str) and not (is_name(category) and len(category) <= LONGEST_NAME):
        problem = f"the category {shown(category)} cannot be used: {NAME_RULE}; {LONGEST_NAME} characters at most"
        raise unfit(problem, "such as water_glass")
    return category


def _robot_scale(value: object) -> object:
    """Returns the size of a robot; there are two."""
    if isinstance(value, int | float) and not isinstance(value, bool) and value in (PAPER_SCALE, FULL_SCALE):
        return value
    raise unfit(f"expected {PAPER_SCALE:g} (the paper's) or {FULL_SCALE:g} (full size), got {shown(value)}")


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
_RobotScale = Annotated[float, Field(ge=PAPER_SCALE, le=FULL_SCALE), BeforeValidator(_robot_scale)]


class RobotForm(Form):
    """Where the robot starts, and how large it is."""

    position: _Place | None = Field(None, description="Its base in the world: x y or x y z in metres; else the origin.")
    yaw: _Radians | None = Field(None, description="Its heading about the vertical in radians; 0 looks along +x.")
    heading_deg: _Degrees | None = Field(None, description="The same in degrees, instead of `yaw`.")
    scale: _RobotScale | None = Field(
        None, description="Size of its arm and hand: 0.7, the paper's, whose hand opens to 56 mm, or 1, to 80 mm."
    )

    @model_validator(mode="after")
    def _turned_once(self) -> Self:
        if self.yaw is not None and self.heading_deg is not None:
            raise unfit("has both 'yaw' (radians) and 'heading_deg'", "keep one of them")
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

    @model_validator(mode="after")
    def _turned_once(self) -> Self:
        if self.orientation is not None and self.heading_deg is not None:
            raise unfit("has both 'orientation' and 'heading_deg'", "keep one of them")
        return self


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
        "ontop, inside and open, as geometry says; [] leaves what is not said unknown.",
    )
    variation: Mapping[str, Any] | None = Field(None, description="Ranges for what a seed varies.")
    provenance: Mapping[str, Any] | None = Field(
        None, description="Where its values come from, by object and field, for people; not read."
    )


def json_schema() -> dict[str, object]:
    """Returns the JSON schema of scene files, as it is published."""
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **SceneForm.model_json_schema()}


def examine_scene(document: Document) -> tuple[SceneForm | None, tuple[InputError, ...]]:
    """Returns a scene file's content, or everything that is malformed in it."""
    objects = document.data.get("objects") if isinstance(document.data, Mapping) else None
    entries = objects.items() if isinstance(objects, Mapping) else ()
    categories = {str(key): one.get("category") if isinstance(one, Mapping) else None for key, one in entries}
    unfit_ids = {key: said for key, category in categories.items() if (said := id_problem(key, category))}
    form, mistakes = examine(document, SceneForm)
    problems = (*(document.fail(("objects", key), said) for key, said in unfit_ids.items()), *mistakes)
    return (None, problems) if problems else (form, ())


def read_scene(document: Document) -> SceneForm:
    """Returns a scene file's content.

    Raises:
        SceneError: The first thing that is malformed, with its place and what was expected.
    """
    form, problems = examine_scene(document)
    if form is None:
        raise problems[0]
    return form
