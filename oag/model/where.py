"""Where exactly a subtask ends: at a part of a thing, or next to another one, which symbols do not tell apart."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, Self, get_args

Side = Literal["next to", "left of", "right of", "behind", "in front of"]
Part = Literal["door", "drawer", "shelf"]
WHICH = (
    "left", "right", "top", "middle", "bottom", "first", "second", "third", "fourth", "fifth", "sixth", "last",
)  # fmt: skip
"""Words for one of several parts."""

_FORM = re.compile(rf"(?:({'|'.join(get_args(Side))}) (\S+)|({'|'.join(WHICH)}) ({'|'.join(get_args(Part))}))")
EXPECTED = f"one of {', '.join(get_args(Side))} and an id, or such as 'third drawer', 'left door', 'top shelf'"


@dataclass(frozen=True, slots=True)
class Where:
    """A spot next to another thing, or a part of the thing that a subtask is about.

    Attributes:
        relation: On which side of the other thing, as seen from the robot's start; empty for a part.
        other: Its id.
        which: Which of several parts; empty for a spot.
        part: The kind of part.
    """

    relation: str = ""
    other: str = ""
    which: str = ""
    part: str = ""

    def __str__(self) -> str:
        """Return the text that `parse` reads."""
        return f"{self.relation} {self.other}" if self.relation else f"{self.which} {self.part}"

    @classmethod
    def parse(cls, text: object) -> Self:
        """Return what a text of a task file says; a ValueError where it has another form."""
        match = _FORM.fullmatch(text) if isinstance(text, str) else None
        if match is None:
            raise ValueError(f"expected {EXPECTED}")
        return cls(*(group or "" for group in match.groups()))
