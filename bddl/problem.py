"""Problem and domain files as values, with the parts that LIBERO adds to BDDL.

LIBERO adds regions, fixtures, an instruction, objects of interest and styles.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import TypeAlias

from bddl.ast import Binder, Formula, Place, Placed, Span, check_name, set_place
from bddl.diagnostics import Diagnostic

# The category that every object of a scene belongs to, as in typed PDDL.
ROOT_CATEGORY = "object"
# What the name of a wildcard ends in, which stands for all further objects of its category in a room.
WILDCARD = "_*"


@dataclass(frozen=True, slots=True)
class TypedObject(Placed):
    """An object that a problem declares, with its category."""

    name: str
    category: str
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        check_name("object", self.name)
        check_name("category", self.category)


_set_name, _set_category = TypedObject.__dict__["name"].__set__, TypedObject.__dict__["category"].__set__


def make_object(name: str, category: str, place: Place) -> TypedObject:
    """Return an object whose names need no check, with its place not yet computed."""
    made = object.__new__(TypedObject)
    _set_name(made, name)
    _set_category(made, category)
    set_place(made, place)
    return made


# The objects of a scene: their categories by name, or as a problem declares them.
Objects: TypeAlias = Mapping[str, str] | Iterable[TypedObject]


def categories_of(objects: Objects) -> Mapping[str, str]:
    """Return the category of each object, by name.

    Example:
        >>> categories_of([TypedObject("glass_0", "glass")])
        {'glass_0': 'glass'}
    """
    if isinstance(objects, Mapping):
        return objects
    found: dict[str, str] = {}
    given: Iterable[object] = objects if hasattr(objects, "__iter__") else [objects]
    for item in given:
        if not isinstance(item, TypedObject):
            raise TypeError(
                "Objects are given as a mapping from names to categories, such as {'glass_0': 'glass'}, or as the "
                f"declared objects of a problem; {item!r} is neither."
            )
        found[item.name] = item.category
    return found


@dataclass(frozen=True, slots=True)
class Problem(Placed):
    """A problem file: declared objects, what holds at the start, and the goal.

    Attributes:
        name: Name of the problem.
        domain: Name of the domain it belongs to.
        objects: Declared objects, in order.
        init: Literals that hold at the start, in order.
        goal: The goal.
        warnings: Findings in the text that the profile tolerates.
        span: Where the problem stands in its text, or None when it was not parsed.
    """

    name: str
    domain: str
    objects: tuple[TypedObject, ...]
    init: tuple[Formula, ...]
    goal: Formula
    warnings: tuple[Diagnostic, ...] = field(default=(), compare=False, repr=False, kw_only=True)
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        check_name("problem", self.name)
        check_name("domain", self.domain)

    @property
    def categories(self) -> dict[str, str]:
        """The category of each declared object, by name: the `objects` that evaluation asks for."""
        return {item.name: item.category for item in self.objects}


@dataclass(frozen=True, slots=True)
class DomainPredicate:
    """A predicate that a domain declares.

    Attributes:
        name: Its name, in lower case.
        parameters: Its parameters with their types, in order; an untyped one has the type `object`.
        span: Where the declaration stands in its text, or None when it was not parsed.
    """

    name: str
    parameters: tuple[Binder, ...]
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        check_name("predicate", self.name)
        for parameter in self.parameters:
            check_name("variable", parameter.variable)
            check_name("category", parameter.category)

    @property
    def arity(self) -> int:
        """How many arguments it takes."""
        return len(self.parameters)


@dataclass(frozen=True, slots=True)
class DomainAction:
    """An action of a domain, which is stored and not interpreted.

    Attributes:
        name: Its name.
        text: The whole form on one line, comments left out.
        span: Where the form stands in its text, or None when it was not parsed.
    """

    name: str
    text: str
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class Domain:
    """A domain file.

    Attributes:
        name: Name of the domain.
        requirements: Its requirements, such as `:adl`, in order.
        types: Its types with their supertypes, in order; one without a supertype has `object`.
        predicates: Its predicates, in order.
        actions: Its actions, in order.
        warnings: Findings in the text that are tolerated.
        span: Where the domain stands in its text, or None when it was not parsed.
    """

    name: str
    requirements: tuple[str, ...] = ()
    types: tuple[TypedObject, ...] = ()
    predicates: tuple[DomainPredicate, ...] = ()
    actions: tuple[DomainAction, ...] = ()
    warnings: tuple[Diagnostic, ...] = field(default=(), compare=False, repr=False, kw_only=True)
    span: Span | None = field(default=None, compare=False, repr=False, kw_only=True)

    def __post_init__(self) -> None:
        check_name("domain", self.name)


# End of an unterminated instruction: no sentence holds the beginning of a section.
SECTION_START = re.compile(r"\(\s*:")
# Attributes of a region.
REGION_ATTRIBUTES = (":target", ":ranges", ":yaw_rotation", ":rgba")
# Attributes of the style of a part of the scene.
STYLE_ATTRIBUTES = (":floor", ":wall")
# Attributes whose value is a list of rows of numbers, as in (:ranges ((0 0 1 1))).
ROWS = frozenset({":ranges", ":yaw_rotation"})


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle on a surface, in the frame of the region's target [m]."""

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
        ranges: Where on the target things may be placed; a site of the target's own model has none.
        yaw_rad: Least and greatest yaw of what is placed there [rad]; None when the file omits it.
        rgba: Colour of the region; None when the file omits it.
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
        """Its name in formulas: that of its target, an underscore, its own."""
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
        # super() without arguments fails here: a dataclass with slots is a second class object.
        Problem.__post_init__(self)
        if SECTION_START.search(self.language):
            raise ValueError(f"An instruction cannot hold the beginning of a section, `(:`: {self.language!r}.")


_DECIMAL = r"\d+(?:\.\d*)?(?:e[+-]?\d+)?|\.\d+(?:e[+-]?\d+)?"
_NUMBER = re.compile(rf"(?P<sign>[+-]?)(?P<value>{_DECIMAL})", re.IGNORECASE)
_MULTIPLE = re.compile(
    rf"(?P<sign>[+-]?)(?:(?P<factor>{_DECIMAL})\*)?(?:np\.|math\.)?pi(?:/(?P<divisor>{_DECIMAL}))?", re.IGNORECASE
)


def read_number(text: str) -> float | None:
    """Return the finite number that a word denotes, or None.

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
