"""Problems of LIBERO: the regions, fixtures, instruction and objects of interest that its files add to BDDL."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

from bddl.syntax.problem import Problem, TypedObject
from bddl.syntax.tree import Span, check_name
from bddl.syntax.vocabulary import predicate_table

# The predicates that LIBERO registers (libero.envs.predicates; MIT), with the number of names that each can take.
LIBERO_PREDICATES = predicate_table((
    ("on item support", "the item rests on the support", "ontop on_top onto upon"),
    ("in item container", "the item is within the container", "inside into within"),
    ("open fixture", "the fixture's joint is open", "opened is_open"),
    ("close fixture", "the fixture's joint is shut", "closed shut is_closed"),
    ("turnon device", "the device is switched on", "turn_on toggled_on turned_on"),
    ("turnoff device", "the device is switched off", "turn_off turned_off toggled_off"),
    ("up item", "the item is held a metre high or more", "raised lifted"),
    ("true item", "always", ""),
    ("false item", "never", ""),
    ("printjointstate fixture", "always; LIBERO prints the joint for whoever debugs", ""),
))  # fmt: skip

# What ends an instruction that was not ended: no sentence holds the beginning of a section.
SECTION_START = re.compile(r"\(\s*:")
# What a region may say of itself.
REGION_ATTRIBUTES = (":target", ":ranges", ":yaw_rotation", ":rgba")
# What the description of a part of the scene may say of it.
STYLE_ATTRIBUTES = (":floor", ":wall")
# Attributes whose value is a list of rows of numbers, as in (:ranges ((0 0 1 1))).
ROWS = frozenset({":ranges", ":yaw_rotation"})


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle on a surface, in metres in the frame of the region's target."""

    x_min_m: float
    y_min_m: float
    x_max_m: float
    y_max_m: float


@dataclass(frozen=True, slots=True)
class Region:
    """A named part of an object, on which things are placed at the start, or which is opened or filled.

    Attributes:
        name: Its name within its target, such as `plate_region`.
        target: The fixture or object that it is a part of.
        ranges: Where on the target things may be put; a site of the target's own model has none.
        yaw_rad: Least and greatest yaw of what is put there; None when the file does not say.
        rgba: The colour it is drawn in; None when the file does not say.
        span: Where the region stands in its text, or None when it was not parsed.

    Example:
        >>> Region("plate_region", "main_table").key
        'main_table_plate_region'
    """

    name: str
    target: str
    ranges: tuple[Rectangle, ...] = ()
    yaw_rad: tuple[float, float] | None = None
    rgba: tuple[float, float, float, float] | None = None
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        check_name("region", self.name)
        check_name("object", self.target)

    @property
    def key(self) -> str:
        """The name by which formulas speak of it: that of its target, an underscore, its own."""
        return f"{self.target}_{self.name}"


@dataclass(frozen=True, slots=True)
class SceneStyle:
    """How a part of the scene looks.

    Attributes:
        name: Name of the part.
        floor: Style of its floor, or None.
        wall: Style of its walls, or None.
    """

    name: str
    floor: str | None = None
    wall: str | None = None


@dataclass(frozen=True, slots=True)
class LiberoProblem(Problem):
    """A problem file of LIBERO.

    Attributes:
        language: The instruction, letter for letter as the file has it.
        regions: In order.
        fixtures: Furniture and appliances with their types, in order; `objects` has the things that can be moved.
        objects_of_interest: Names of objects, fixtures and regions, in order.
        styles: How the scene looks; empty in most files.
    """

    language: str = field(default="", kw_only=True)
    regions: tuple[Region, ...] = field(default=(), kw_only=True)
    fixtures: tuple[TypedObject, ...] = field(default=(), kw_only=True)
    objects_of_interest: tuple[str, ...] = field(default=(), kw_only=True)
    styles: tuple[SceneStyle, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        # super() without arguments does not find its way in a class that slots have made anew.
        Problem.__post_init__(self)
        if SECTION_START.search(self.language):
            raise ValueError(f"An instruction cannot hold the beginning of a section, `(:`: {self.language!r}.")


_DECIMAL = r"\d+(?:\.\d*)?(?:e[+-]?\d+)?|\.\d+(?:e[+-]?\d+)?"
_NUMBER = re.compile(rf"(?P<sign>[+-]?)(?P<value>{_DECIMAL})", re.IGNORECASE)
_MULTIPLE = re.compile(
    rf"(?P<sign>[+-]?)(?:(?P<factor>{_DECIMAL})\*)?(?:np\.|math\.)?pi(?:/(?P<divisor>{_DECIMAL}))?", re.IGNORECASE
)


def read_number(text: str) -> float | None:
    """Returns the number that a word says, or None when it says none or one that is not finite.

    Example:
        >>> read_number("-1.5e-1"), read_number("-pi/2"), read_number("9**9")
        (-0.15, -1.5707963267948966, None)
    """
    found = _NUMBER.fullmatch(text)
    if found is not None:
        value = float(found["value"])
    else:
        found = _MULTIPLE.fullmatch(text)
        if found is None:
            return None
        divisor = float(found["divisor"] or 1.0)
        value = math.pi * float(found["factor"] or 1.0) / divisor if divisor else math.inf
    return (-value if found["sign"] == "-" else value) if math.isfinite(value) else None
