"""What an exact decision tells the progression of a plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from oag.facts import Condition, Fact, Value
from oag.obligations import Grade


@dataclass(frozen=True, slots=True)
class Decision:
    """What was decided of the obligations that progression had left open.

    Attributes:
        fails: Index of the first obligation that no run meets; None when some run meets all.
        grades: Grades of the open obligations before that one, each over the runs that meet all earlier ones.
        given: What to assume where the plan needs it, by the index of the obligation that first speaks of it. With
            it every obligation up to `fails` holds, or all; none of it can be left out.
        run: A run that gets to the obligation that fails, as (time, fact, value) for everything unknown that the plan
            speaks of; at time 0 the start. None when nothing fails.
        miss: When something has to be assumed, a run that misses an obligation, in the same form; else None.
    """

    fails: int | None = None
    grades: Mapping[int, Grade] = field(default_factory=dict)
    given: Mapping[int, tuple[Condition, ...]] = field(default_factory=dict)
    run: tuple[tuple[int, Fact, Value], ...] | None = None
    miss: tuple[tuple[int, Fact, Value], ...] | None = None


NOTHING_DECIDED = Decision()
