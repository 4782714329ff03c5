"""The symbols of plans: kinds of objects, the 21 primitives, facts and conditions.

A kind says how the robot deals with an object: an articulated fixture, a support, or an item that the gripper takes.
What is fixed to the room, such as a picture on a wall, is neither taken nor opened, and nothing is put on it.

A fact is a tuple of strings: a predicate with its arguments, such as `("ontop", "glass_0", "table_0")`, with the value
True or False; or one of the robot's three variables, whose value is a phrase:

    ("near",)   id of the object that the base stands at
    ("eef",)    "home", "free", "before glass_0" or "at glass_0"
    ("hand",)   "empty", "holding glass_0" or "gripping refrigerator_0"

A variable has one value at a time, so three invariants hold by construction: at most one object is held; the hand is
empty exactly when nothing is held or gripped; near and eef are functional. The paper's `(inside glass_0 gripper)` is
the hand's value "holding glass_0". A name may be `*` where a fact is a pattern.

The checker of certificates imports this module and the table of primitives, and nothing else of this package.

Source: docs/semantics.md, States.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from enum import Enum, IntEnum
from functools import lru_cache
from typing import Any, Literal, NamedTuple

import bddl

Role = Literal["A", "B"]


class Kind(Enum):
    """How the robot deals with an object of a category."""

    ARTICULATED = "articulated fixture"
    SUPPORT = "support"
    ITEM = "item"
    FIXED = "fixed thing"

    @property
    def role(self) -> Role:
        """The paper's size-adjustment type: A for fixtures and supports (never scaled), B for items."""
        return "B" if self is Kind.ITEM else "A"


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


# The first words of each line are the paper's own lists; the rest are their close relatives in the asset libraries.
_ARTICULATED = _words(
    "refrigerator fridge cabinet microwave oven drawer dishwasher freezer cupboard wardrobe washer dryer "
    "stove safe nightstand dresser chest door sideboard credenza"
)
_SUPPORT = _words(
    "table desk counter countertop shelf bench workbench island stand sofa couch bed chair armchair stool ottoman "
    "rack sink floor wall toilet bathtub cart trolley crib "
    # Compound names, and those of data sets that write them as one word.
    "garbagecan trashcan dustbin wastebasket recyclingbin garbagebin trashbin sidetable coffeetable diningtable "
    "tvstand sinkbasin bathtubbasin stoveburner stovetop hob"
)
_ITEM = _words(
    "cup glass apple bottle box bowl knife mug plate can jar fork spoon pan pot tray banana orange lemon "
    "pear peach tomato potato onion carrot egg book sponge carton lid kettle teapot pitcher jug block "
    "cube ball basket toy phone remote pen lamp paper newspaper pillow cushion towel cloth "
    "shirt jacket coat sweater blanket scarf hat shoe bag backpack purse keyboard"
)

_RIMMED = _words("bowl cup mug")
"""Items with a wall that two fingers can hold, however wide the item is."""

_SOLID = _words(
    "table desk counter countertop bench workbench island sofa couch bed chair armchair stool ottoman floor wall door "
    "apple knife plate fork spoon banana orange lemon pear peach tomato potato onion carrot egg book sponge "
    "lid block cube ball die toy phone remote pen lamp"
)
"""Categories without an inside; objects of unknown categories may have one."""

_VESSELS = _words("bowl cup mug glass basket box jar pot pan bin bucket")
"""Items that are open at the top, so that things can be put into them."""

_FLAT = _words("plate tray saucer")
"""Items that others stand on."""

_BARE = _words("wall sink door chair refrigerator fridge freezer wardrobe")
"""Furniture on which nothing is put: it is too tall, or has no top."""

_BOARDED = _words("shelf rack bookshelf bookcase shelving")
"""Categories with boards above each other: an item on one is under the next, so that a lift alone does not free it."""

# An object of unknown category whose smaller horizontal side is longer than this counts as furniture: no scaling
# that keeps it recognisable would bring it between the fingers.
FURNITURE_SIDE_M = 0.30


def has_rim(category: str) -> bool:
    """Decide whether things of a category have a wall that two fingers can hold, however wide they are."""
    return _category_words(category)[-1] in _RIMMED


def has_inside(category: str) -> bool:
    """Decide whether objects of a category can contain things: False for tables and apples, True for unknown ones."""
    last = _category_words(category)[-1]
    return last not in _SOLID and last.removesuffix("s") not in _SOLID


def has_boards(category: str) -> bool:
    """Decide whether objects on a category may be under a part of it, as on the boards of a shelf."""
    return _category_words(category)[-1] in _BOARDED


def takes_things(category: str, kind: Kind) -> bool:
    """Decide whether people put things into objects of a category: behind doors, and into what is open at the top."""
    noun = _category_words(category)[-1]
    return has_inside(category) if kind is Kind.ARTICULATED else kind is Kind.ITEM and noun in _VESSELS


def carries_things(category: str, kind: Kind) -> bool:
    """Decide whether people put things onto objects of a category: furniture, and items that are flat."""
    if kind is Kind.FIXED:
        return False
    noun = _category_words(category)[-1]
    return noun in _FLAT if kind is Kind.ITEM else noun not in _BARE


def _category_words(category: str) -> list[str]:
    """Return the words of a category; the last one is the noun."""
    return category.lower().split(".", 1)[0].replace("-", "_").split("_")


def is_known(category: str) -> bool:
    """Decide whether a category has a word of a known kind; the kind of any other is a guess from its size."""
    known = _ARTICULATED | _SUPPORT | _ITEM
    return any(word in known or word.removesuffix("s") in known for word in _nouns(category))


def _nouns(category: str) -> Iterator[str]:
    """Yield the words that may decide a category's kind: compounds that end it, then its words from the last one on."""
    words = _category_words(category)
    yield from ("".join(words[start:]) for start in range(len(words)))
    yield from reversed(words)


@lru_cache(maxsize=4096)
def kind_of(category: str, smaller_side_m: float) -> Kind:
    """Decide the kind of an object from its category, and from its size where the category is not known.

    The last known word of a category, such as `water_glass` or `fridge.n.01`, decides, since compound names end in the
    noun, unless the compound is known itself: a `garbage_can` is no can. An unknown one whose smaller horizontal side
    exceeds `FURNITURE_SIDE_M` counts as an articulated fixture, since that allows the most; a smaller one as an item.

    Source: the paper's object size adjustment (types A and B), extended by common relatives.
    """
    for word in _nouns(category):
        for kind, known in ((Kind.ARTICULATED, _ARTICULATED), (Kind.SUPPORT, _SUPPORT), (Kind.ITEM, _ITEM)):
            if word in known or (word.endswith("s") and word[:-1] in known):
                return kind
    return Kind.ARTICULATED if smaller_side_m > FURNITURE_SIDE_M else Kind.ITEM


MAX_DISTANCE_M = 3.0
MAX_ANGLE_DEG = 180.0
# Joint limits are normalised (0 to 1) or physical (radians or metres); a full turn bounds both.
MAX_JOINT_LIMIT = 2.0 * math.pi


class Primitive(IntEnum):
    """An atomic action of the robot; the value is the ID that flows use in JSON.

    Source: the paper's raw outputs fix 1, 2, 3, 5, 8, 9, 13, 15, 17, 18 and 19. The others follow the order of its
    library.
    """

    APPROACH = 1
    CONVERGE = 2
    GRASP = 3
    ARTICULATE_OPEN = 4
    UNGRASP = 5
    RETREAT = 6
    LIFT_EEF_UP = 7
    LIFT_EEF_DOWN = 8
    MOVE_EEF_FORWARD = 9
    MOVE_EEF_BACKWARD = 10
    MOVE_EEF_LEFT = 11
    MOVE_EEF_RIGHT = 12
    MOVE_BASE_FORWARD = 13
    MOVE_BASE_BACKWARD = 14
    MOVE_BASE_LEFT = 15
    MOVE_BASE_RIGHT = 16
    NAVIGATE_TO_TARGET = 17
    NAVIGATE_TO_SUPPORT = 18
    ARTICULATE_CLOSE = 19
    TURN_BASE_LEFT = 20
    TURN_BASE_RIGHT = 21

    def __reduce_ex__(self, _protocol: object) -> tuple[Any, ...]:
        """Copy by number; a primitive of an own domain (`oag.model.domain`) by its row."""
        own = self.__dict__.get("own")
        return (Primitive, (int(self),)) if own is None else (type(own).primitive, (own,))


class ParameterKind(Enum):
    """What a primitive's parameter means; the value describes it for a person."""

    NONE = "no parameter"
    DISTANCE_M = f"one distance from 0 to {MAX_DISTANCE_M:g} m"
    ANGLE_DEG = f"one angle from 0 to {MAX_ANGLE_DEG:g} degrees"
    JOINT_LIMITS = "joint limits [min, max] with min <= max"
    OWN = "one number in the range that its domain gives"


Parameter = float | tuple[float, float] | None


# The largest magnitude that a kind of parameter may have, and its unit for messages.
_RANGES = {ParameterKind.DISTANCE_M: (MAX_DISTANCE_M, "m"), ParameterKind.ANGLE_DEG: (MAX_ANGLE_DEG, "degrees")}


# Primitives that move a fixture's joint.
ARTICULATIONS = (Primitive.ARTICULATE_OPEN, Primitive.ARTICULATE_CLOSE)
# The first of each pair moves along an axis, the second against it.
OPPOSITES = (
    (Primitive.LIFT_EEF_UP, Primitive.LIFT_EEF_DOWN),
    (Primitive.MOVE_EEF_FORWARD, Primitive.MOVE_EEF_BACKWARD),
    (Primitive.MOVE_EEF_LEFT, Primitive.MOVE_EEF_RIGHT),
    (Primitive.MOVE_BASE_FORWARD, Primitive.MOVE_BASE_BACKWARD),
    (Primitive.MOVE_BASE_LEFT, Primitive.MOVE_BASE_RIGHT),
    (Primitive.TURN_BASE_LEFT, Primitive.TURN_BASE_RIGHT),
)
OPPOSITE = {one: other for pair in OPPOSITES for one, other in (pair, pair[::-1])}
_TURNS = (Primitive.TURN_BASE_LEFT, Primitive.TURN_BASE_RIGHT)
_KINDS = {
    **dict.fromkeys(Primitive, ParameterKind.NONE),
    **dict.fromkeys(ARTICULATIONS, ParameterKind.JOINT_LIMITS),
    **dict.fromkeys(_TURNS, ParameterKind.ANGLE_DEG),
    **{p: ParameterKind.DISTANCE_M for p in Primitive if Primitive.LIFT_EEF_UP <= p <= Primitive.MOVE_BASE_RIGHT},
}


def applicable(primitive: Primitive, kind: Kind) -> bool:
    """Decide whether a primitive can act on a kind of object at all: it has joints to articulate, or can be grasped."""
    if primitive in ARTICULATIONS:
        return kind is Kind.ARTICULATED
    return primitive is not Primitive.GRASP or kind not in (Kind.SUPPORT, Kind.FIXED)


def parameter_kind(primitive: Primitive) -> ParameterKind:
    """Return which kind of parameter a primitive takes."""
    known = _KINDS.get(primitive)
    if known is None:
        known = primitive.__dict__["own"].parameter_kind
    return known


def parameter_problem(primitive: Primitive, parameter: Parameter) -> str | None:
    """Decide whether a parameter fits its primitive: None when it does, else what is wrong.

    A parameter of None always fits: the primitive takes none, or the executor fills it in.
    """
    if parameter is None:
        return None
    kind = parameter_kind(primitive)
    if kind is ParameterKind.NONE:
        return f"takes no parameter, got {parameter!r}"
    if kind is ParameterKind.JOINT_LIMITS:
        return _limits_problem(parameter)
    if kind is ParameterKind.OWN:
        problem: str | None = primitive.__dict__["own"].row.number.problem(parameter)
        return problem
    if isinstance(parameter, tuple):
        return f"takes {kind.value}, got {list(parameter)!r}"
    if not math.isfinite(parameter):
        return f"takes {kind.value}, got {parameter!r}"
    largest, unit = _RANGES[kind]
    if 0.0 <= parameter <= largest:
        return None
    other_way = "; the opposite primitive moves the other way" if parameter < 0.0 else ""
    return f"takes {kind.value}, got {parameter:g} {unit}{other_way}"


def _limits_problem(parameter: float | tuple[float, float]) -> str | None:
    wanted = ParameterKind.JOINT_LIMITS.value
    if not isinstance(parameter, tuple):
        return f"takes {wanted}, got the single number {parameter:g}"
    low, high = parameter
    if not (math.isfinite(low) and math.isfinite(high)):
        return f"takes {wanted}, got {list(parameter)!r}"
    if low > high:
        return f"takes {wanted}, got [{low:g}, {high:g}]"
    if max(abs(low), abs(high)) > MAX_JOINT_LIMIT:
        return f"takes {wanted} within a full turn ({MAX_JOINT_LIMIT:.2f}), got [{low:g}, {high:g}]"
    return None


Fact = tuple[str, ...]
# None is the value "unknown".
Value = bool | str | None
ANY = "*"

NEAR: Fact = ("near",)
EEF: Fact = ("eef",)
HAND: Fact = ("hand",)
ROBOT_FACTS = (NEAR, EEF, HAND)

EMPTY = "empty"
HOME = "home"
FREE = "free"
GRIPPER = "gripper"


def holding(item: str) -> str:
    """Return the hand's value when it holds an item."""
    return f"holding {item}"


def gripping(fixture: str) -> str:
    """Return the hand's value when it grips a fixture's handle."""
    return f"gripping {fixture}"


def held_by(hand: Value) -> str | None:
    """Return the item that a hand of this value holds, or None."""
    return hand[8:] if isinstance(hand, str) and hand.startswith("holding ") else None


class Condition(NamedTuple):
    """A fact that must have a value, or, when not `positive`, must not have it."""

    fact: Fact
    value: bool | str
    positive: bool = True

    def grade(self, value: Value) -> bool | None:
        """Decide the condition for the fact's value: None when that is unknown."""
        return None if value is None else (value == self.value) is self.positive

    def text(self) -> str:
        """Return the condition in words, such as `not open(refrigerator_0)` or `inside(glass_0, gripper)`."""
        words = fact_text(self.fact, self.value)
        return words if self.positive else f"not {words}"

    @property
    def sayable(self) -> bool:
        """True when BDDL has a literal for the condition."""
        return self.fact not in ROBOT_FACTS or (self.fact == HAND and held_by(self.value) is not None)

    def literal(self) -> bddl.Formula | None:
        """Return the condition as a BDDL literal, or None for one about the robot without a BDDL form."""
        if not self.sayable:
            return None
        item = held_by(self.value)
        atom = bddl.Atom(self.fact[0], self.fact[1:]) if item is None else bddl.Atom("inside", (item, GRIPPER))
        return atom if self.positive else bddl.Not(atom)


def satisfying_value(condition: Condition) -> Value:
    """Return a value that makes a condition true."""
    if condition.positive:
        return condition.value
    return EMPTY if condition.fact == HAND else False


def known_as(fact: Fact, value: bool | str) -> Condition:
    """Return the condition that a fact with this value meets."""
    return Condition(fact, True, value) if isinstance(value, bool) else Condition(fact, value)


def condition_of(atom: bddl.Atom, value: bool) -> Condition:
    """Return the condition of a BDDL literal."""
    return condition_on((atom.predicate, *atom.args), value)


def condition_on(names: Fact, value: bool) -> Condition:
    """Return the condition of a literal whose atom is given as its predicate and arguments."""
    if names[0] == "inside" and names[2:] == (GRIPPER,):
        return Condition(HAND, holding(names[1]), value)
    return Condition(names, True, value)


def fact_text(fact: Fact, value: Value) -> str:
    """Return a fact with this value in words."""
    if fact == HAND:
        item = held_by(value)
        if item is not None:
            return f"inside({item}, {GRIPPER})"
        return "handempty" if value == EMPTY else str(value).replace(" ", "(", 1) + ")"
    if fact in (NEAR, EEF):
        return f"{fact[0]}({value})"
    words = f"{fact[0]}({', '.join(fact[1:])})"
    return words if value is True else f"not {words}"


@lru_cache(maxsize=16_384)
def generalisations(fact: Fact) -> tuple[Fact, ...]:
    """Return the fact and the patterns that match it, the most specific first."""
    if len(fact) == 3:
        predicate, first, second = fact
        return (fact, (predicate, first, ANY), (predicate, ANY, second), (predicate, ANY, ANY))
    if len(fact) == 2:
        return (fact, (fact[0], ANY))
    return (fact,) if len(fact) < 2 else (fact, (fact[0], *(ANY,) * (len(fact) - 1)))


def overlap(first: Fact, second: Fact) -> bool:
    """Decide whether two facts or patterns have an instance in common."""
    return (
        len(first) == len(second)
        and first[0] == second[0]
        and all(a == b or ANY in (a, b) for a, b in zip(first[1:], second[1:], strict=True))
    )


def conjunction(goal: bddl.Formula, conditions: Iterable[Condition]) -> bddl.Formula:
    """Return a goal with the conditions that have a BDDL form, each once."""
    parts = dict.fromkeys(bddl.conjuncts(goal))
    for condition in conditions:
        literal = condition.literal()
        if literal is not None:
            parts.setdefault(literal)
    return next(iter(parts)) if len(parts) == 1 else bddl.And(tuple(parts))
