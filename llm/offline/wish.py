"""What a query asks for once its words stand for objects of the scene."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum
from itertools import groupby
from typing import Literal

import bddl
from llm.errors import RefusalCode

Relation = Literal["inside", "ontop"]
PREPOSITION: dict[Relation, str] = {"inside": "into", "ontop": "onto"}


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
        if self.relation is None or self.destination is None:
            return f"{self.kind.value} {self.target}"
        return f"{self.kind.value} {self.target} {PREPOSITION[self.relation]} {self.destination}"

    @property
    def wish(self) -> bddl.Formula:
        """The literal that the wish makes true, side conditions apart."""
        if self.kind is IntentKind.OPEN:
            return bddl.Atom("open", (self.target,))
        if self.kind is IntentKind.CLOSE:
            return bddl.Not(bddl.Atom("open", (self.target,)))
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
        return tuple(
            tuple(group)
            for _, group in groupby(self.intents, key=lambda intent: (intent.kind, intent.relation, intent.destination))
        )

    @property
    def ids(self) -> tuple[str, ...]:
        """Every object that a wish names, once, in order."""
        named = (key for intent in self.intents for key in (intent.target, intent.destination) if key is not None)
        return tuple(dict.fromkeys(named))


def enumeration(names: Iterable[str]) -> str:
    """Returns names as a sentence lists them: "a", "a and b", "a, b and c"."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


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
    # A wish that follows itself at once, now that nothing stands between the two, is one wish.
    return Request(tuple(wish for wish, _ in groupby(intents)))


def carries_past_doors(request: Request) -> bool:
    """Decides whether a request, followed to the letter, minds a door while the hand carries something."""
    for index in range(len(request.intents)):
        stop = _placing_of(list(request.intents), index)
        if stop is not None and any(intent.kind.is_about_a_door for intent in request.intents[index:stop]):
            return True
    return False


def _placing_of(intents: list[Intent], index: int) -> int | None:
    """Returns where the object that is picked up at the index is placed, if the hand only minds doors until then."""
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


def _clause(group: tuple[Intent, ...]) -> str:
    """Returns one wish with all its targets."""
    first = group[0]
    text = f"{first.kind.value} {enumeration(intent.target for intent in group)}"
    if first.relation is None or first.destination is None:
        return text
    return f"{text} {PREPOSITION[first.relation]} {first.destination}"


# The further a reading got before something stood in its way, the more it says about what was meant.
_PROGRESS: tuple[RefusalCode, ...] = (
    "empty",
    "too-long",
    "not-understood",
    "unknown-action",
    "missing-place",
    "unknown-object",
    "several-objects",
    "wrong-place",
    "unsupported-relation",
    "unknown-place",
    "hand-full",
    "affordance",
    "ambiguous-relation",
    "ambiguous-object",
    "already-so",
    "ambiguous-reading",
    "too-large",
    "unproved",
    "model-declined",
)


_MOST_NAMED = 6


def alternatives(ids: Iterable[str], link: str = " or ") -> str:
    """Returns ids, or what is said of them, as a sentence lists them; of many, the first ones and how many more."""
    named = tuple(ids)
    if len(named) > _MOST_NAMED:
        named = (*named[: _MOST_NAMED - 1], f"{len(named) - _MOST_NAMED + 1} more")
    return link.join(named)


class Refusal(Exception):
    """One reading's obstacle; `understand` turns the one that says most into a QueryError.

    Attributes:
        code: Which refusal it is.
        problem: What stands in the way.
        understood: What was understood, or empty for the reading's own words.
        scene: Descriptions of objects that matter here.
        instead: Wishes that may have been meant; some of them may not be possible either.
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
        # Whether the reading lacks a verb or a place, so that it could not have become a plan.
        self.in_vain = False
        self.instead: tuple[Intent | Request, ...] = tuple(instead)

    @property
    def progress(self) -> tuple[bool, int]:
        """How far the reading got; what is larger says more."""
        return not self.in_vain, _PROGRESS.index(self.code)

    @property
    def leaves_choice(self) -> bool:
        """Whether the reading could still have been meant, so that no other one may be taken in its place."""
        return self.code.startswith("ambiguous") and not self.in_vain
