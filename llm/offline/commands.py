"""What a reading of a query says, its words not yet tied to objects of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from llm.affordances import Front

CommandKind = Literal["open", "close", "pick", "place", "clear", "goto", "nowhere", "bare"]
# The terminal of the preposition: TO and FROM leave open whether inside or on top is meant; those of the second line
# tell things apart, but cannot be brought about.
Direction = Literal[
    "INTO", "IN", "ONTO", "ON", "TO", "FROM",
    "NEXT", "CLOSEST", "LEFTOF", "RIGHTOF", "BETWEEN", "UNDER", "BESIDE",
]  # fmt: skip
BESIDES: frozenset[Direction] = frozenset({"NEXT", "CLOSEST", "LEFTOF", "RIGHTOF", "BETWEEN", "UNDER", "BESIDE"})
# Which of several like things is meant, as the robot sees them from its start.
Side = Literal["left", "right", "nearest", "farthest"]


@dataclass(frozen=True, slots=True)
class Place:
    """A preposition with its noun phrase: where something goes, comes from, or stands."""

    direction: Direction
    phrase: NounPhrase
    preposition: str

    def __str__(self) -> str:
        return f"{self.preposition} {self.phrase}"


@dataclass(frozen=True, slots=True)
class NounPhrase:
    """Words that name an object.

    Attributes:
        words: The words without determiner, such as ("water", "glass").
        states: Of them, "open" or "closed" said before the name.
        location: Where the object is said to stand.
        owner: For "the door of the refrigerator", the refrigerator.
        door: Whether the words end in the name of a door.
        several: Whether all objects of the name are meant ("all glasses").
        count: How many there have to be, where the phrase says it ("both glasses").
        one_of: Whether one of several is meant, whichever ("one of the glasses").
        everything: Whether all items are meant, whatever they are called ("everything on the table").
        pronoun: For "it" and "them", whether one or several of the things spoken of before are meant.
        side: Which of several is meant ("the left glass").
    """

    words: tuple[str, ...]
    states: tuple[Literal["open", "closed"], ...] = ()
    location: Place | None = None
    owner: NounPhrase | None = None
    door: bool = False
    several: bool = False
    count: int | None = None
    one_of: bool = False
    everything: bool = False
    pronoun: Literal["it", "them"] | None = None
    side: Side | None = None

    @property
    def front(self) -> Front | None:
        """For words that end in the name of a door, whether that is a door or a drawer."""
        if not self.door:
            return None
        return "drawer" if self.words[-1].startswith("drawer") else "door"

    @property
    def is_only_a_door(self) -> bool:
        """Whether it is "the door" or "the drawer", and says nothing of what it is a part of."""
        plain = self.owner is None and self.location is None and self.side is None and not self.states
        return self.door and len(self.words) == 1 and plain

    def __str__(self) -> str:
        text = " ".join(self.words if self.side is None else (self.side, *self.words))
        if self.owner is not None:
            text += f" of {self.owner}"
        return text if self.location is None else f"{text} {self.location}"


@dataclass(frozen=True, slots=True)
class Command:
    """One wish of a query.

    Attributes:
        kind: What is wanted; "nowhere" lacks its place, "bare" its verb, "clear" is about what a place holds.
        objects: What it is wanted of; of "clear" and "goto", the place.
        source: Where the object is said to be taken from.
        destination: Where it shall go.
        verbless: Whether nothing but a noun and a place is said, as in "apple in the bowl".
    """

    kind: CommandKind
    objects: tuple[NounPhrase, ...]
    source: Place | None = None
    destination: Place | None = None
    verbless: bool = False

    def __str__(self) -> str:
        verbs = {"pick": "pick up ", "place": "put ", "nowhere": "put ", "goto": "go to ", "bare": ""}
        verb = verbs.get(self.kind, f"{self.kind} ")
        verb = "" if self.verbless else verb
        text = verb + " and ".join(str(phrase) for phrase in self.objects)
        if self.source is not None:
            text += f" from {self.source.phrase}"
        return text if self.destination is None else f"{text} {self.destination}"


# All commands of a query in one of its readings.
Reading = tuple[Command, ...]
