"""What a query asks for: wishes about single objects in the order of the query; and why one becomes no task."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import groupby
from typing import Literal, get_args

import bddl
from llm.errors import RefusalCode

Relation = Literal["inside", "ontop"]
RELATIONS: tuple[Relation, ...] = get_args(Relation)
PREPOSITION: dict[Relation, str] = {"inside": "into", "ontop": "onto"}
_MOST_NAMED = 6


class IntentKind(Enum):
    """The wishes that a simple or compound task of the library can fulfil."""

    OPEN = "open"
    CLOSE = "close"
    PICK = "pick up"
    PLACE = "put"

    @property
    def is_about_a_door(self) -> bool:
        """True for opening and closing, which move a door and no item."""
        return self in (IntentKind.OPEN, IntentKind.CLOSE)


@dataclass(frozen=True, slots=True)
class Intent:
    """One wish about one object.

    Attributes:
        kind: What is wanted.
        target: Id of the object it is about.
        relation: For PLACE, how the target shall stand to the destination; else None.
        destination: For PLACE, the id of the object it shall end up in or on; else None.
    """

    kind: IntentKind
    target: str
    relation: Relation | None = None
    destination: str | None = None

    def __str__(self) -> str:
        return _clause((self,))

    @property
    def outcome(self) -> str:
        """How it is once the wish is fulfilled, in words such as "glass_0 is in the hand"."""
        if self.kind.is_about_a_door:
            return f"{self.target} is {'open' if self.kind is IntentKind.OPEN else 'closed'}"
        if self.destination is None:
            return f"{self.target} is in the hand"
        return f"{self.target} is {'in' if self.relation == 'inside' else 'on'} {self.destination}"

    @property
    def wish(self) -> bddl.Formula:
        """The literal that the wish makes true, side conditions apart."""
        if self.kind.is_about_a_door:
            is_open = bddl.Atom("open", (self.target,))
            return is_open if self.kind is IntentKind.OPEN else bddl.Not(is_open)
        if self.relation is None or self.destination is None:
            return bddl.Atom("inside", (self.target, "gripper"))
        return bddl.Atom(self.relation, (self.target, self.destination))


@dataclass(frozen=True, slots=True)
class Request:
    """Wishes in order; a wish about several objects is one intent for each of them.

    Attributes:
        intents: At least one.
    """

    intents: tuple[Intent, ...]

    @classmethod
    def of(cls, wish: Intent | Request) -> Request:
        """Returns the wish as a request; a single intent becomes one of one wish."""
        return wish if isinstance(wish, Request) else cls((wish,))

    def __str__(self) -> str:
        """Returns the sentence that asks for it, every object by its id; the offline planner reads it back."""
        return ", then ".join(_clause(group) for group in self.groups())

    def groups(self) -> tuple[tuple[Intent, ...], ...]:
        """Returns neighbouring wishes that differ in their target only, together."""
        alike = groupby(self.intents, key=lambda intent: (intent.kind, intent.relation, intent.destination))
        return tuple(tuple(group) for _, group in alike)


def said_once(intents: Iterable[Intent]) -> Request:
    """Returns the request of wishes of which one may repeat another with nothing but its like between the two."""
    groups = Request(tuple(intents)).groups()
    return Request(tuple(intent for group in groups for intent in dict.fromkeys(group)))


def _clause(group: tuple[Intent, ...]) -> str:
    """Returns one wish with all its targets."""
    first = group[0]
    text = f"{first.kind.value} {enumeration(intent.target for intent in group)}"
    if first.relation is None or first.destination is None:
        return text
    return f"{text} {PREPOSITION[first.relation]} {first.destination}"


def enumeration(names: Iterable[str]) -> str:
    """Returns names as a sentence lists them: "a", "a and b", "a, b and c"."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def alternatives(ids: Iterable[str], link: str = " or ") -> str:
    """Returns ids, or what is said of them, as a sentence lists them; of many, the first ones and how many more."""
    named = tuple(ids)
    if len(named) > _MOST_NAMED:
        named = (*named[: _MOST_NAMED - 1], f"{len(named) - _MOST_NAMED + 1} more")
    return link.join(named)


def in_one_hand(request: Request) -> Request:
    """Returns the request in an order that one hand can follow, where that changes nothing at the end.

    "Pick up the glass, open the refrigerator, put the glass into it" cannot be followed to the letter: the hand that
    holds the glass is not free for the handle. A picking up that a placing of the same object follows is a part of
    that placing. What is opened between the two is opened before, what is closed between them is closed after.
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
        # Other objects that were picked up in the same breath are placed in turn; this one is only said twice.
        picked = [i for i in between if i.kind is IntentKind.PICK and i.target != intents[index].target]
        intents[index : stop + 1] = [*opened, intents[stop], *closed, *picked]
    return said_once(intents)


def carries_past_doors(request: Request) -> bool:
    """Decides whether a request, followed to the letter, minds a door while the hand carries something."""
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
        if intent.kind is IntentKind.PLACE and intent.target == pick.target:
            return later
        if intent.kind is IntentKind.PLACE or intent.target in doors:
            return None
        if intent.kind.is_about_a_door:
            doors.add(intent.target)
    return None


class Refusal(Exception):
    """One reading's obstacle; `understand` turns the one that says most into a QueryError.

    Attributes:
        code: Which refusal it is.
        problem: What stands in the way.
        understood: What was understood, or empty for the reading's own words.
        scene: Descriptions of objects that matter here.
        instead: Wishes that may have been meant; some of them may not be possible either.
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
    ) -> None:
        super().__init__(problem)
        self.code: RefusalCode = code
        self.problem = problem
        self.understood = understood
        self.scene = tuple(scene)
        self.instead: tuple[Intent | Request, ...] = tuple(instead)
        self.in_vain = False

    @property
    def progress(self) -> tuple[bool, int]:
        """How far the reading got; what is larger says more about what was meant."""
        return not self.in_vain, get_args(RefusalCode).index(self.code)

    @property
    def leaves_choice(self) -> bool:
        """Whether the reading could still have been meant, so that no other one may be taken in its place."""
        return self.code.startswith("ambiguous") and not self.in_vain
