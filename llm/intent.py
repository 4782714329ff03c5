"""What a query asks for once its words stand for objects of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Literal

import bddl

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
