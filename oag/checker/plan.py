"""A certificate's plan, followed from its start: what is needed where, and what every step writes.

Part of the independent check: it knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Any

from oag.checker.actions import PRIMITIVES, action_of
from oag.checker.cases import Place, Rejected, require
from oag.checker.form import Given, given_of, needed_of, start_of
from oag.model.facts import ANY, HAND, ROBOT_FACTS, Fact, Value
from oag.table.invariants import excluded, with_consequences
from oag.table.library import Context, Needed, Rows, open_at_top, placement_among, placement_of

NEVER: tuple[int, Value] = (-1, None)
_BY_TIME = itemgetter(0)


class Impossible(Rejected):
    """What is taken for given breaks an invariant, so that no state is meant."""


class PlanRun:
    """A plan as far as it was followed.

    Attributes:
        context: The objects of the subtask that it stands in.
        given: What is still to be taken for given, the next one last.
        time: Where it stands; what is written at an earlier time counts.
        latest: The last write of each fact or pattern: when, and what.
    """

    def __init__(self, data: Mapping[str, Any], given: Sequence[Any] = (), *, complete: bool = False) -> None:
        """Stands at the start.

        Args:
            data: The certificate.
            given: Triples (time, fact, value) of what is taken for given of what is unknown.
            complete: Follow one run: whatever is unknown and not given is false, from where it became unknown, and
                what is known may be given as well.

        Raises:
            Rejected: The start is none, the reset supplies what it cannot, or something given has not that form.
        """
        # Of one time, what stands first is taken first: what comes later may follow from it, not the other way round.
        self.given: list[Given] = sorted(map(given_of, given), key=_BY_TIME)[::-1] if given else []
        self.time = 1
        self._plan, self._scene, self._complete = data["plan"], data["scene"], complete
        self.latest: dict[Fact, tuple[int, Value]] = {fact: (0, value) for fact, value in start_of(data).items()}
        for fact in [fact for fact, (_, value) in self.latest.items() if value is True]:
            for stated, known in with_consequences(fact, True):
                if self.last(stated)[1] is None:
                    self.latest[stated] = (0, known)
                elif self.last(stated)[1] != known:
                    raise Rejected(f"the start breaks an invariant: {fact}")

    def last(self, fact: Fact) -> tuple[int, Value]:
        """Returns when a fact was last written, -1 for never, and what; at one time the most specific write counts."""
        latest = self.latest
        best = latest.get(fact, NEVER)
        if len(fact) == 3:
            name, first, second = fact
            for pattern in ((name, first, ANY), (name, ANY, second), (name, ANY, ANY)):
                if pattern in latest and latest[pattern][0] > best[0]:
                    best = latest[pattern]
        elif len(fact) == 2 and latest.get((fact[0], ANY), NEVER)[0] > best[0]:
            best = latest[fact[0], ANY]
        return best

    def value(self, fact: Fact) -> Value:
        """Returns what a fact is known to be; None when it is unknown, which in a complete run is the robot's alone."""
        value = self.last(fact)[1]
        return False if value is None and self._complete and fact not in ROBOT_FACTS else value

    def places(self) -> Iterator[tuple[Place, Needed]]:
        """Yields what is needed where, in order, while the steps in between write what the table says.

        A subtask without a flow yields its goal at the place ("no-flow", subtask, -1).

        Raises:
            Rejected: Somebody went on after such a subtask, or what the hand does is unknown.
        """
        require(HAND in self.latest, "what the hand does is unknown: neither the scene nor the reset says so")
        articulated, items, time = tuple(self._scene["articulated"]), frozenset(self._scene["items"]), self.time
        vessels = tuple(key for key in self._scene["items"] if open_at_top(self._scene["objects"][key]))
        latest, tables, given = self.latest, dict[tuple[Any, ...], Rows](), self.given
        for index, subtask in enumerate(self._plan["subtasks"]):
            target, goal = subtask["target"], needed_of(subtask["goal"])
            placement = placement_among(goal, target) if isinstance(goal, tuple) else placement_of(goal, target)
            key = (target, subtask["support_goal"], placement)
            context = Context(*key, target in items, articulated, vessels)
            rows = tables.setdefault(key, Rows(context))
            self.context = context
            if given:
                self._take()
            yield ("init", index, -1), needed_of(subtask["init"])
            if subtask["flow"] is None:
                yield ("no-flow", index, -1), goal
                raise Rejected(f"subtask {index} has no flow, and nothing shows that it can have none")
            for position, item in enumerate(subtask["flow"]):
                if given:
                    self._take()
                primitive, parameter = (PRIMITIVES[item], None) if type(item) is int else action_of(item)
                wanted, written = rows.row(primitive, latest[HAND][1], parameter)
                if wanted:
                    yield ("precondition", index, position), wanted
                now = time + 1
                for fact, value in written:
                    latest[fact] = (now, value)
                self.time = time = now + 1
            if given:
                self._take()
            yield ("goal", index, -1), goal
        self._take()
        yield ("task-goal", len(self._plan["subtasks"]), -1), needed_of(self._plan["goal"])

    def take(self, time: int, fact: Fact, value: bool) -> None:
        """Takes something for given.

        Raises:
            Impossible: It breaks an invariant.
            Rejected: It is known; or a complete run gives it another value than it had before.
        """
        since, held = self.last(fact)
        if self._complete and held is value:
            return
        require(held is None, f"{fact} is assumed though it is known")
        require(not self._complete or time == max(since, 0), f"a run changes {fact} at {time}, where nothing does")
        if value and excluded(fact, self.value):
            raise Impossible(f"{fact} is assumed against an invariant")
        for stated, known in with_consequences(fact, value):
            self.latest[stated] = (time, known)

    def _take(self) -> None:
        """Takes for given what is due by now."""
        while self.given and self.given[-1][0] <= self.time:
            self.take(*self.given.pop())
