"""What a person knows of an asset and its files do not say: a JSON file beside it that overrules what is inferred.

    {"category": "cabinet", "height_m": 0.8, "front": "-y",
     "handles": [{"joint": "door", "position_m": [0, 0, 0], "axis": [0, 0, 1], "outward": [-1, 0, 0],
                  "length_m": 0.2, "thickness_m": 0.02}],
     "places": [{"name": "shelf", "kind": "interior", "link": "body", "center_m": [0, 0, 0],
                 "half_extents_m": [0.2, 0.2, 0.1], "opening": [-1, 0, 0], "joint": "door"}],
     "mass_kg": 0.3, "friction": 0.8}

Lengths and directions are in the finished asset's frame: metres, the middle of its box, front to -x, z up, joints shut.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from executor.assets.imports.asset_folder import ImportRefused, read_text
from oag.model.forms import first_mistake

Coordinate = Annotated[float, Field(ge=-10, le=10)]
Triple = tuple[Coordinate, Coordinate, Coordinate]
CATEGORY = re.compile(r"^[A-Za-z][A-Za-z0-9_]{0,59}$")
Length = Annotated[float, Field(gt=0, le=10)]


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class SideHandle(_Strict):
    """A handle; see `executor.assets.model.Handle`."""

    joint: str
    position_m: Triple
    axis: Triple
    outward: Triple
    length_m: Length
    thickness_m: Length


class SidePlace(_Strict):
    """A place; see `executor.assets.model.Region`."""

    name: str = Field(min_length=1, max_length=60)
    kind: Literal["interior", "surface"]
    link: str
    center_m: Triple
    half_extents_m: tuple[Length, Length, Length]
    opening: Triple
    joint: str | None = None


class SideFile(_Strict):
    """Everything that can be told; what is left out is inferred."""

    category: str | None = Field(default=None, pattern=CATEGORY.pattern)
    synset: str | None = Field(default=None, max_length=80, pattern=r"^[a-z0-9_'-]+\.[a-z]\.\d\d$")
    height_m: Length | None = None
    up: Literal["y", "z"] | None = None
    front: Literal["-x", "+x", "-y", "+y"] | None = None
    handles: tuple[SideHandle, ...] | None = None
    places: tuple[SidePlace, ...] | None = None
    mass_kg: Annotated[float, Field(gt=0, le=500)] | None = None
    friction: Annotated[float, Field(gt=0, le=2)] | None = None


def read_side_file(file: Path | None) -> SideFile:
    """Returns what a side file says; nothing without one.

    Raises:
        ImportRefused: The file is no JSON, or a value in it is not of its form; the message names the first one.
    """
    if file is None:
        return SideFile()
    try:
        return SideFile.model_validate_json(read_text(file))
    except ValidationError as error:
        legal = ", ".join(SideFile.model_fields)
        raise ImportRefused(file, first_mistake(error, SideFile), f"its fields are {legal}") from error
