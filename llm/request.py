"""What a query asks for: wishes about single objects in the order of the query, and the sentence that says so."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby

from llm.intent import PREPOSITION, Intent, IntentKind


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
