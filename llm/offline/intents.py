"""Intents and refusals of the offline planner, and the scene state that they are evaluated in.

An intent is a wish about a single object, in the order of the query. `Surroundings` holds affordances, supports,
open doors and what the hand holds.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from itertools import groupby
from types import MappingProxyType
from typing import Literal, get_args

import bddl
from llm.errors import RefusalCode
from oag import Scene, SceneObject
from oag.model.scene import UPRIGHT_DEG
from oag.model.symbols import GRIPPER, Kind
from oag.model.where import Where
from oag.sizes import TO_THE_AIM, Sizing

Relation = Literal["inside", "ontop"]
RELATIONS: tuple[Relation, ...] = get_args(Relation)
PREPOSITION: dict[Relation, str] = {"inside": "into", "ontop": "onto"}
_MOST_NAMED = 6
_TALL, _ROUND_M = 1.2, 1e-3  # Times as high as wide: it is there to stand. Round things are as long as wide.


class IntentKind(Enum):
    """Kinds of intents that a simple or compound task can fulfil.

    Those of switching are of the domain of appliances, and standing things up is of that of fallen things.
    """

    OPEN = "open"
    CLOSE = "close"
    PICK = "pick up"
    PLACE = "put"
    PUSH = "push"
    STAND = "stand up"
    SWITCH_ON = "switch on"
    SWITCH_OFF = "switch off"

    @property
    def moves_an_item(self) -> bool:
        """True for picking up, putting, pushing and standing up."""
        return self in (IntentKind.PICK, IntentKind.PLACE, IntentKind.PUSH, IntentKind.STAND)

    @property
    def puts_down(self) -> bool:
        """True for what ends with a thing on or in something else than the hand."""
        return self in (IntentKind.PLACE, IntentKind.STAND)

    @property
    def is_a_switching(self) -> bool:
        """True for what a button or a knob does."""
        return self in (IntentKind.SWITCH_ON, IntentKind.SWITCH_OFF)

    @property
    def is_about_a_door(self) -> bool:
        """True for opening and closing, which move a door and no item."""
        return self in (IntentKind.OPEN, IntentKind.CLOSE)


@dataclass(frozen=True, slots=True)
class Intent:
    """One intent about one object; only PLACE and PUSH have a relation and a destination.

    `where` is the part of what is opened or of the destination, or the spot next to another thing, that is meant.
    """

    kind: IntentKind
    target: str
    relation: Relation | None = None
    destination: str | None = None
    where: Where | None = None

    def __str__(self) -> str:
        return _clause((self,))

    @property
    def outcome(self) -> str:
        """State after the intent is fulfilled, in words such as "glass_0 is in the hand"."""
        if self.kind.is_about_a_door:
            return f"{self.target} is {'open' if self.kind is IntentKind.OPEN else 'closed'}"
        if self.kind.is_a_switching:
            return f"{self.target} is {'on' if self.kind is IntentKind.SWITCH_ON else 'off'}"
        if self.kind is IntentKind.STAND:
            return f"{self.target} stands upright"
        if self.destination is None:
            return f"{self.target} is in the hand"
        return f"{self.target} is {'in' if self.relation == 'inside' else 'on'} {self.destination}"

    @property
    def wish(self) -> bddl.Formula:
        """Literal that the intent makes true, without side conditions."""
        if self.kind.is_about_a_door:
            is_open = bddl.Atom("open", (self.target,))
            return is_open if self.kind is IntentKind.OPEN else bddl.Not(is_open)
        if self.kind.is_a_switching:
            is_on = bddl.Atom("toggled_on", (self.target,))
            return is_on if self.kind is IntentKind.SWITCH_ON else bddl.Not(is_on)
        if self.kind is IntentKind.STAND:
            return bddl.Atom("upright", (self.target,))
        if self.relation is None or self.destination is None:
            return bddl.Atom("inside", (self.target, "gripper"))
        return bddl.Atom(self.relation, (self.target, self.destination))


@dataclass(frozen=True, slots=True)
class Request:
    """Intents in order; a command about several objects is one intent for each of them."""

    intents: tuple[Intent, ...]

    @classmethod
    def of(cls, wish: Intent | Request) -> Request:
        """Return an intent as a request; a request is returned unchanged."""
        return wish if isinstance(wish, Request) else cls((wish,))

    def __str__(self) -> str:
        """Return the sentence that asks for it, every object by its id; the offline planner reads it back."""
        return ", then ".join(_clause(group) for group in self.groups())

    def groups(self) -> tuple[tuple[Intent, ...], ...]:
        """Group neighbouring intents that differ in their target only."""
        alike = groupby(self.intents, key=_place_of)
        return tuple(tuple(group) for _, group in alike)


def _place_of(intent: Intent) -> tuple[IntentKind, Relation | None, str | None, str]:
    return intent.kind, intent.relation, intent.destination, str(intent.where or "")


def merge_repeated(intents: Iterable[Intent]) -> Request:
    """Return the request without repetitions among neighbouring intents of one kind and place."""
    groups = Request(tuple(intents)).groups()
    return Request(tuple(intent for group in groups for intent in dict.fromkeys(group)))


def _clause(group: tuple[Intent, ...]) -> str:
    first = group[0]
    targets, where = enumeration(intent.target for intent in group), first.where
    if first.relation is None or first.destination is None:
        return f"{first.kind.value} {f'the {where} of ' if where is not None else ''}{targets}"
    if where is not None and where.other:
        return f"{first.kind.value} {targets} {where}"
    part = f"the {where} of " if where is not None else ""
    return f"{first.kind.value} {targets} {PREPOSITION[first.relation]} {part}{first.destination}"


def enumeration(names: Iterable[str]) -> str:
    """Return names as a sentence lists them: "a", "a and b", "a, b and c"."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def alternatives(ids: Iterable[str], link: str = " or ") -> str:
    """Join ids or phrases; of many, the first ones and the number of the others."""
    named = tuple(ids)
    if len(named) > _MOST_NAMED:
        named = (*named[: _MOST_NAMED - 1], f"{len(named) - _MOST_NAMED + 1} more")
    return link.join(named)


def order_for_one_hand(request: Request) -> Request:
    """Reorder a request so that one hand can follow it, if the final state stays the same.

    "Pick up the glass, open the refrigerator, put the glass into it" cannot be followed literally: the hand that
    holds the glass is not free for the handle. A pick that is followed by a placing of the same object is part of
    that placing. Doors opened between the two are opened before, doors closed between them are closed after.
    """
    intents = list(request.intents)
    index = 0
    while index < len(intents):
        stop = _placing_of(intents, index)
        if stop is None:
            index += 1
            continue
        between = intents[index + 1 : stop]
        opened = [intent for intent in between if intent.kind is IntentKind.OPEN]
        closed = [intent for intent in between if intent.kind is IntentKind.CLOSE]
        # Other objects picked up in between are placed in turn; a second pick of this one is a repetition.
        picked = [i for i in between if i.kind is IntentKind.PICK and i.target != intents[index].target]
        switched = [intent for intent in between if intent.kind.is_a_switching]
        intents[index : stop + 1] = [*opened, intents[stop], *closed, *switched, *picked]
    return merge_repeated(intents)


def carries_past_doors(request: Request) -> bool:
    """Decide whether a request, followed literally, moves a door while the hand carries something."""
    intents = list(request.intents)
    stops = ((index, _placing_of(intents, index)) for index in range(len(intents)))
    return any(
        stop is not None and any(intent.kind.is_about_a_door for intent in intents[index:stop]) for index, stop in stops
    )


def _placing_of(intents: list[Intent], index: int) -> int | None:
    pick = intents[index]
    if pick.kind is not IntentKind.PICK:
        return None
    doors: set[str] = set()
    for later in range(index + 1, len(intents)):
        intent = intents[later]
        if intent.kind.puts_down and intent.target == pick.target:
            return later
        if intent.kind.puts_down or intent.target in doors:
            return None
        if intent.kind.is_about_a_door:
            doors.add(intent.target)
    return None


class Refusal(Exception):
    """Obstacle of one reading; `understand` converts the most informative one into a QueryError.

    Attributes:
        code: Kind of refusal.
        problem: The obstacle.
        understood: The understood part, or empty for the reading's own words.
        scene: Descriptions of relevant objects.
        instead: Intents that may have been meant; some of them may be infeasible too.
        among: Ids of the objects that may be meant.
        decides: Whether it says more than the refusals of other readings.
        in_vain: Whether the reading lacks a verb or a place, so that it could not have become a plan.
    """

    def __init__(
        self,
        code: RefusalCode,
        problem: str,
        *,
        understood: str = "",
        scene: Sequence[str] = (),
        instead: Sequence[Intent | Request] = (),
        among: Sequence[str] = (),
    ) -> None:
        super().__init__(problem)
        self.code: RefusalCode = code
        self.problem = problem
        self.understood = understood
        self.scene = tuple(scene)
        self.instead: tuple[Intent | Request, ...] = tuple(instead)
        self.among = tuple(among)
        self.decides = False
        self.in_vain = False

    @property
    def progress(self) -> tuple[bool, bool, int]:
        """How far the reading got; larger values are more informative."""
        return not self.in_vain, self.decides, get_args(RefusalCode).index(self.code)

    @property
    def leaves_choice(self) -> bool:
        """Whether the reading could still be the intended one, so that no other may replace it."""
        return self.code.startswith("ambiguous") and not self.in_vain


def no_action(near: Sequence[str] = ()) -> Refusal:
    """Return the refusal of a query without an action of the library."""
    meant = f"; did you mean {' or '.join(near)}?" if near else ""
    return Refusal(
        "unknown-action",
        "it names no action of the library, which opens and closes things, picks them up, "
        f"and puts them into or onto others{meant}",
    )


# What switches an appliance.
ControlPart = Literal["button", "knob"]
CONTROL_PARTS: tuple[ControlPart, ...] = get_args(ControlPart)
CONTROLS: Mapping[str, ControlPart | Literal[""]] = MappingProxyType(
    {
        **dict.fromkeys(("button", "buttons"), "button"),
        **dict.fromkeys(("knob", "knobs", "dial", "dials"), "knob"),
        **dict.fromkeys(("switch", "switches", "control", "controls"), ""),
    }
)
"""What they are called -> which of them that is; "" for either."""

# What an item without a surface bears things on, where sizes allow it.
Crown = Literal["flat", "rim"]
CROWNS: tuple[Crown, ...] = get_args(Crown)

# Kinds of closures of an opening.
Front = Literal["door", "drawer"]
FRONTS: tuple[Front, ...] = get_args(Front)


@dataclass(frozen=True, slots=True)
class Affordances:
    """What can be done with an object.

    Attributes:
        interior, surface, door: Whether things go into it, and onto it, and whether it is opened and closed.
        top: Whether it carries things all the same, where a sentence says so: "to the oven" is into it.
        fronts: Its doors or drawers, as far as known.
        crown: What bears things on it although it has no surface: the flat top of a can, the rim of a cup.
    """

    interior: bool = False
    surface: bool = False
    door: bool = False
    top: bool = False
    fronts: frozenset[Front] = frozenset()
    crown: Crown | None = None

    def opens_by(self, front: Front) -> bool:
        """Decide whether opening the object can be called opening a door, or a drawer.

        A plan opens an object as a whole. An object with both is opened by its doors, which close its larger
        compartments; one that is not known to have a drawer has none.
        """
        return self.door and (self.fronts == {"drawer"}) is (front == "drawer")


_SHAPES = {
    "generic_box": Affordances(surface=True),
    "generic_cylinder": Affordances(surface=True),
    "generic_slab_on_legs": Affordances(surface=True),
    "generic_slab_with_back": Affordances(surface=True),
    "generic_panel_on_stand": Affordances(),
    "generic_open_box": Affordances(interior=True),
    "generic_open_cylinder": Affordances(interior=True),
    "carton": Affordances(surface=True),
    "book_lying": Affordances(surface=True),
}
"""By the model, whatever things are called: a refrigerator that is there as a box alone has no door, and a carton is
closed."""

_OPEN_SHAPES = ("generic_slab_with_back",)
"""Models of what stands open, whatever the facts: a laptop whose screen is up, beside a closed one."""


def affordances(thing: SceneObject, listed: Affordances | None, facts: Mapping[bddl.Atom, bool]) -> Affordances:
    """Return an object's affordances: those of its category or shape, and those that the scene's facts imply.

    Args:
        thing: The object.
        listed: Affordances of its category in a lexicon, or None without an entry. Then a fixture (type A) counts as
            one with a door, a support as one with a surface, and an item (type B) as neither container nor support.
        facts: Stated atoms. An object with something inside has an interior, whatever its category. A fixture that
            is stated to be open or not has one behind its door, such as a nightstand with a drawer.

    Returns:
        The affordances. Doors and drawers are known from the lexicon, and from the words of the category and of the
            model, such as `cabinet_two_doors`.
    """
    if thing.kind is Kind.FIXED:
        return Affordances()
    is_fixture = thing.role == "A"
    closed = thing.kind is Kind.ARTICULATED
    unlisted = Affordances(interior=closed, door=closed, surface=thing.kind is Kind.SUPPORT)
    base = _SHAPES.get(thing.model) or listed or unlisted
    stated = ((atom, value) for atom, value in facts.items() if atom.args[-1] == thing.id)
    shown = {atom.predicate for atom, value in stated if value or atom.predicate == "open"}
    return Affordances(
        interior=base.interior or "inside" in shown or ("open" in shown and is_fixture),
        surface=base.surface or ("ontop" in shown and not base.top),
        door=base.door or "open" in shown,
        top=base.top,
        fronts=base.fronts | fronts_in(thing.category) | fronts_in(thing.model.rsplit("/", 1)[-1]),
        crown=base.crown,
    )


def fronts_in(name: str) -> frozenset[Front]:
    """Return the doors and drawers that a category's or model's name mentions."""
    words = set(re.split(r"[^a-z]+", name.lower()))
    return frozenset(front for front in FRONTS if words & {front, f"{front}s"})


def distinct_doors(model: str) -> frozenset[str] | None:
    """Return the words that tell the doors of a model apart, as its name says; None where it does not say.

    A pair of doors is beside each other, a freezer's door is above or below the other one, and "one_door" is alone.
    """
    words = set(re.split(r"[^a-z]+", model.rsplit("/", 1)[-1].lower()))
    if "doors" in words or {"side", "by"} <= words:
        return frozenset({"left", "right", "first", "second", "last"})
    if "freezer" in words and "drawer" not in words:
        return frozenset({"top", "bottom", "first", "second", "last"})
    return frozenset() if words & {"door", "hinge", "freezer"} else None


@dataclass(frozen=True, slots=True)
class Support:
    """Support or container of an object: `relation` to `object_id` (which may be the gripper)."""

    relation: Relation
    object_id: str

    def __str__(self) -> str:
        return f"{'in' if self.relation == 'inside' else 'on'} {self.object_id}"


@dataclass(frozen=True, slots=True)
class Surroundings:
    """State of a scene, for queries during planning.

    Attributes:
        scene: The scene.
        known: Every stated atom with its value.
        affordances: Affordances of each object, by id.
        standing: Known supports of each object, containers first; stored by object because they are queried often.
        sizing: Rule for sizes.
    """

    scene: Scene
    known: Mapping[bddl.Atom, bool]
    affordances: Mapping[str, Affordances]
    standing: Mapping[str, tuple[Support, ...]] = field(repr=False)
    sizing: Sizing = TO_THE_AIM

    @classmethod
    def of(cls, scene: Scene, listed: Mapping[str, Affordances]) -> Surroundings:
        """Return the state of a scene from its facts; `listed` has the known affordances of categories."""
        stated = (bddl.literals(fact) or () for fact in scene.facts)
        known = {literal.atom: literal.value for literals in stated for literal in literals}
        can = {key: affordances(thing, listed.get(thing.category), known) for key, thing in scene.objects.items()}
        return cls(scene, known, can, _standing(known))

    def value(self, atom: bddl.Atom) -> bool | None:
        """Evaluate an atom at the start: True, False, or None if the scene does not state it.

        Source: open world, except for the predicates that the scene declares closed.
        """
        known = self.known.get(atom)
        return False if known is None and atom.predicate in self.scene.closed else known

    def is_open(self, object_id: str) -> bool | None:
        """Decide whether an object is open at the start, by its shape or a fact; None where the scene does not say."""
        return self.scene.objects[object_id].model in _OPEN_SHAPES or self.value(bddl.Atom("open", (object_id,)))

    def control(self, object_id: str) -> ControlPart | None:
        """Return what switches an object: its button, its knob, or nothing."""
        found = (part for part in CONTROL_PARTS if self.value(bddl.Atom(f"has_{part}", (object_id,))))
        return next(found, None)

    def is_on(self, object_id: str) -> bool | None:
        """Decide whether an object is switched on at the start; None where the scene does not say."""
        return self.value(bddl.Atom("toggled_on", (object_id,)))

    def can_stand(self, object_id: str) -> bool:
        """Decide whether an object has one way in which it stands: it is taller than wide, round, or hollow.

        A scene in which something lies states it; elsewhere it follows from the box and what the thing is for.
        """
        if "can_stand" in self.scene.domain.predicates:
            return self.value(bddl.Atom("can_stand", (object_id,))) is True
        along, across, height = self.scene.objects[object_id].extent_m
        is_round = abs(along - across) < _ROUND_M < abs(height - along)  # Balls and dice are as high as they are wide.
        return self.affordances[object_id].interior or height > _TALL * min(along, across) or is_round

    def is_upright(self, object_id: str) -> bool | None:
        """Decide whether an object stands at the start; None where the scene does not say."""
        if "upright" in self.scene.domain.predicates:
            return self.value(bddl.Atom("upright", (object_id,)))
        thing = self.scene.objects[object_id]
        return thing.lean_deg <= UPRIGHT_DEG if thing.has_box else None

    def supports(self, object_id: str) -> tuple[Support, ...]:
        """Return the stated supports of an object, containers first."""
        return self.standing.get(object_id, ())

    def support(self, object_id: str) -> Support | None:
        """Return the nearest support of an object; None if the scene does not state one."""
        return next(iter(self.supports(object_id)), None)

    def chain(self, object_id: str) -> tuple[Support, ...]:
        """Return the object's support, the support of that, and so on outwards."""
        found: list[Support] = []
        visited = {object_id}
        step = self.support(object_id)
        while step is not None and step.object_id not in visited:
            found.append(step)
            visited.add(step.object_id)
            step = self.support(step.object_id)
        return tuple(found)

    def is_shut(self, object_id: str) -> bool:
        """Decide whether an object has a door that is not known to be open.

        A container whose door state is not stated counts as closed: opening it is then part of the plan, and
        `verify` lists the assumption.
        """
        return object_id in self.affordances and self.affordances[object_id].door and not self.is_open(object_id)

    def doors_in_the_way(self, intent: Intent) -> tuple[str, ...]:
        """Return the closed containers to open before an item can be taken or placed as wanted.

        They are in the order of opening: outer containers come first, and those around the item come before those
        around its destination. There are none for opening and closing.
        """
        if not intent.kind.moves_an_item:
            return ()
        around = [self.chain(intent.target), () if intent.destination is None else self.chain(intent.destination)]
        doors = [step.object_id for chain in around for step in reversed(chain) if step.relation == "inside"]
        if intent.destination is not None and intent.relation == "inside":
            doors.append(intent.destination)
        return tuple(dict.fromkeys(filter(self.is_shut, doors)))

    def fulfils(self, intent: Intent) -> bool:
        """Decide whether an intent is known to be fulfilled; of parts and spots nothing is known."""
        return intent.where is None and all(
            self.value(literal.atom) is literal.value for literal in bddl.literals(intent.wish) or ()
        )

    def after(self, intent: Intent) -> Surroundings:
        """Return the state after an intent is fulfilled; doors on its way keep their state.

        Objects in or on the target move along with it.
        """
        if intent.kind.is_about_a_door:
            return self.with_doors((intent.target,), intent.kind is IntentKind.OPEN)
        if intent.kind.is_a_switching:
            is_on = bddl.Atom("toggled_on", (intent.target,))
            return replace(self, known={**self.known, is_on: intent.kind is IntentKind.SWITCH_ON})
        if intent.kind is IntentKind.STAND:
            return replace(self, known={**self.known, bddl.Atom("upright", (intent.target,)): True})
        known = dict(self.known)
        for support in self.supports(intent.target):
            known[bddl.Atom(support.relation, (intent.target, support.object_id))] = False
        wish = {literal.atom: literal.value for literal in bddl.literals(intent.wish) or ()}
        return replace(self, known=known | wish, standing={**self.standing, **_standing(wish)})

    def with_doors(self, doors: Iterable[str], is_open: bool) -> Surroundings:
        """Return the state with some doors opened or closed."""
        return replace(self, known={**self.known, **{bddl.Atom("open", (door,)): is_open for door in doors}})

    def held(self) -> tuple[str, ...]:
        """Return the ids of held objects."""
        return self.cargo(GRIPPER)

    def cargo(self, object_id: str) -> tuple[str, ...]:
        """Return the objects in or on an object, which move along with it."""
        return tuple(key for key in self.scene.objects if any(s.object_id == object_id for s in self.supports(key)))

    def described(self, object_id: str) -> str:
        """Describe an object with category, place and state, such as "glass_0 (water_glass) on table_0"."""
        category = self.scene.objects[object_id].category
        text = object_id if object_id.rsplit("_", 1)[0] == category else f"{object_id} ({category})"
        support = self.support(object_id)
        if support is not None:
            text += f" {support}"
        state = self.known.get(bddl.Atom("open", (object_id,)))
        return text if state is None else f"{text}, {'open' if state else 'closed'}"

    def bearing(self, object_id: str) -> str:
        """Describe an object's position from the robot's start, such as "1.2 m ahead of the robot, on its left"."""
        robot, place = self.scene.robot, self.scene.objects[object_id].position
        dx, dy = place[0] - robot.position[0], place[1] - robot.position[1]
        angle = math.atan2(dy, dx) - robot.yaw_rad
        forward, left = math.cos(angle), math.sin(angle)
        main = "ahead of" if forward > 0 else "behind"
        side = "" if abs(left) < 0.26 else f", on its {'left' if left > 0 else 'right'}"  # 15 degrees
        return f"{math.hypot(dx, dy):.1f} m {main} the robot{side}"


def _standing(known: Mapping[bddl.Atom, bool]) -> dict[str, tuple[Support, ...]]:
    found: dict[str, tuple[Support, ...]] = {}
    for relation in RELATIONS:
        for atom, value in known.items():
            if value and atom.predicate == relation:
                found[atom.args[0]] = (*found.get(atom.args[0], ()), Support(relation, atom.args[1]))
    return found
