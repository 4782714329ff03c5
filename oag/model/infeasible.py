"""What geometry found impossible, as a fact about a scene: a plan that asks for it again is refuted.

It holds in circumstances: literals that were true where it was found, such as what stands in the way. A plan that
changes one of them first may do the same. Without circumstances it holds always.

Source: docs/semantics.md, Found impossible.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import bddl

InfeasibleKind = Literal["take", "ontop", "inside", "open", "close"]


@dataclass(frozen=True, slots=True)
class Infeasible:
    """Something that cannot be done in a scene.

    Attributes:
        kind: What: to take a thing, to put it `ontop` or `inside` a place, to open it, or to close it.
        thing: Id of the object that it is done to.
        place: Id of the object that it is put on or in; None for other kinds.
        given: Literals; it is impossible while all of them hold. Their texts are read by the scene.
        subtask: Name of the subtask in which it was found.
        reason: Why, in a sentence.
    """

    kind: InfeasibleKind
    thing: str
    place: str | None = None
    given: tuple[bddl.Formula, ...] = ()
    subtask: str = ""
    reason: str = ""

    def to_json(self) -> dict[str, object]:
        """Return it as JSON values, literals as texts."""
        return {
            "kind": self.kind,
            "thing": self.thing,
            "place": self.place,
            "given": list(map(bddl.format, self.given)),
            "subtask": self.subtask,
            "reason": self.reason,
        }

    def __str__(self) -> str:
        given = f"; this holds with {' '.join(map(bddl.format, self.given))}" if self.given else ""
        return f"geometry found it impossible: {' '.join(self.reason.split()) or self.kind}{given}"
