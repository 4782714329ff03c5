"""A certificate's plan, followed from its start: what is needed where, and what every step writes.

Part of the independent check: it knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from operator import itemgetter
from typing import Any

import bddl
from oag.checker.cases import Place, Rejected, require
from oag.exact.invariants import excluded, with_consequences
from oag.facts import ANY, EEF, EMPTY, HAND, HOME, NEAR, Fact, Value, condition_on, generalisations
from oag.library import Clause, Context, Needed, Rows, needed, placement_among, placement_of
from oag.primitives import Primitive

_NEVER: tuple[int, Value] = (-1, None)
_BY_TIME = itemgetter(0)
# A flow has primitives by number, or as the one key of a mapping.
_PRIMITIVES: dict[Any, Primitive] = {key: p for p in Primitive for key in (int(p), str(int(p)))}


class PlanRun:
    """A plan as far as it was followed.

    Attributes:
        context: The objects of the subtask that it stands in.
        given: What is still to be assumed, the next one last.
    """

    def __init__(self, data: Mapping[str, Any], given: Iterable[Any], *, lenient: bool = False) -> None:
        """Stands at the start.

        Args:
            data: The certificate.
            given: Triples (time, fact, value) of what is assumed.
            lenient: Let what is known be assumed as well, when it is the same.

        Raises:
            Rejected: The start breaks an invariant, or the reset supplies what it cannot.
        """
        self.given = sorted(((time, tuple(f), v) for time, f, v in given), key=_BY_TIME, reverse=True)
        self._plan, self._scene, self._lenient = data["plan"], data["scene"], lenient
        # The last write of each fact or pattern: when, and what.
        self._latest: dict[Fact, tuple[int, Value]] = {tuple(f): (0, value) for f, value in self._scene["start"]}
        for fact, (_, value) in self._latest.items():
            fits = value is False or (value is True and ANY not in fact) or fact == HAND
            require(fits, f"the start gives {fact} the value {value!r}")
            require(not (value is True and excluded(fact, self.value)), f"the start breaks an invariant: {fact}")
        supplied = [(EEF, HOME), (HAND, EMPTY), *((NEAR, subtask["target"]) for subtask in self._plan["subtasks"][:1])]
        for fact, value in ((tuple(e["fact"]), e["value"]) for e in data["assumptions"] if e["kind"] == "reset"):
            require(fact not in self._latest and (fact, value) in supplied, f"the reset does not supply {fact}")
            self._latest[fact] = (0, value)

    def last(self, fact: Fact) -> tuple[int, Value]:
        """Returns when a fact was last written, -1 for never, and what; at one time the most specific write counts."""
        latest = self._latest
        best = latest.get(fact, _NEVER)
        if len(fact) > 1:
            for pattern in generalisations(fact):
                written = latest.get(pattern)
                if written is not None and written[0] > best[0]:
                    best = written
        return best

    def value(self, fact: Fact) -> Value:
        """Returns what a fact is known to be, None when it is unknown."""
        return self.last(fact)[1]

    def places(self) -> Iterator[tuple[Place, Needed]]:
        """Yields what is needed where, in order, while the steps in between write what the table says.

        A subtask without a flow yields its goal at the place ("no-flow", subtask, -1).

        Raises:
            Rejected: Somebody went on after such a subtask.
        """
        articulated, items = tuple(self._scene["articulated"]), frozenset(self._scene["items"])
        latest, tables, time = self._latest, dict[tuple[Any, ...], Rows](), 1
        for index, subtask in enumerate(self._plan["subtasks"]):
            target, goal = subtask["target"], _needed(subtask["goal"])
            placement = placement_among(goal, target) if isinstance(goal, tuple) else placement_of(goal, target)
            key = (target, subtask["support_goal"], placement)
            rows = tables.get(key)
            if rows is None:
                rows = tables[key] = Rows(Context(*key, target in items, articulated))
            else:
                rows.shared()
            self.context = rows.context
            self._assume(time)
            yield ("init", index, -1), _needed(subtask["init"])
            if subtask["flow"] is None:
                yield ("no-flow", index, -1), goal
                raise Rejected(f"subtask {index} has no flow, and nothing shows that it can have none")
            for position, item in enumerate(subtask["flow"]):
                if self.given:
                    self._assume(time)
                primitive = _PRIMITIVES[item] if type(item) is int else _primitive(item)
                wanted, written = rows.row(primitive, latest.get(HAND, _NEVER)[1])
                if wanted:
                    yield ("precondition", index, position), wanted
                for fact, value in written:
                    latest[fact] = (time + 1, value)
                time += 2
            self._assume(time)
            yield ("goal", index, -1), goal
        self._assume(time)
        yield ("task-goal", len(self._plan["subtasks"]), -1), _needed(self._plan["goal"])

    def _assume(self, now: int) -> None:
        """Writes what is assumed by now, which must be unknown, or to the lenient just so."""
        while self.given and self.given[-1][0] <= now:
            time, fact, value = self.given.pop()
            held = self.value(fact)
            require(held is None or (self._lenient and held == value), f"{fact} is assumed though it is known")
            require(value is not True or not excluded(fact, self.value), f"{fact} is assumed against an invariant")
            for stated, known in with_consequences(fact, value):
                self._latest[stated] = (time, known)


def check_form(plan: Mapping[str, Any]) -> None:
    """Checks that a plan can be read to its end, which following it to a failure does not."""
    _needed(plan["goal"])
    for subtask in plan["subtasks"]:
        _needed(subtask["init"]), _needed(subtask["goal"]), subtask["target"], subtask["support_goal"]
        for item in subtask["flow"] or ():
            _primitive(item)


def _primitive(item: Any) -> Primitive:
    """Returns the primitive of an action of a flow."""
    if type(item) is not int:
        (item,) = item.keys()
    return _PRIMITIVES[item]


def _needed(condition: Any) -> Needed:
    """Returns the clauses of a list of [atom, value], or the formula that a text says."""
    if isinstance(condition, str):
        return needed(bddl.parse_formula(condition))
    clauses: list[Clause] = []
    for names, value in condition:
        if type(value) is not bool or ANY in "".join(names):
            raise Rejected(f"{names} is no literal")
        clauses.append((condition_on(tuple(names), value),))
    return tuple(clauses)
