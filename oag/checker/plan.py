"""A certificate's plan, followed from its start: what is needed where, and what every step writes.

Part of the independent check: it knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from operator import itemgetter
from typing import Any

from oag.checker.cases import Place, Rejected, require
from oag.checker.formulas import check_size, needed_of
from oag.model.facts import ANY, EEF, EMPTY, HAND, HOME, NEAR, ROBOT_FACTS, Fact, Value, gripping, holding
from oag.model.primitives import ARTICULATIONS, Parameter, Primitive, parameter_problem
from oag.table.invariants import excluded, impossible, with_consequences
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
        before: What was known of a fact before something given was written about it, by the fact and the time.
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
        self.before: dict[tuple[Fact, int], Value] = {}
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
            self.before[stated, time] = self.last(stated)[1]
            self.latest[stated] = (time, known)

    def _take(self) -> None:
        while self.given and self.given[-1][0] <= self.time:
            self.take(*self.given.pop())


# What something unknown has for a value: a time, a fact, and the value.
Given = tuple[int, Fact, bool]


def start_of(data: Mapping[str, Any]) -> dict[Fact, Value]:
    """Returns what is known of the start: by the kinds of things, by the scene, and by the reset as it is said.

    Raises:
        Rejected: That is no start, or the reset supplies what it cannot.
    """
    scene, subtasks = data["scene"], data["plan"]["subtasks"]
    start: dict[Fact, Value] = {}
    for names, value in scene["start"]:
        fact = tuple(names)
        if fact in ROBOT_FACTS:
            hands = (EMPTY, *map(holding, scene["items"]), *map(gripping, scene["articulated"]))
            fits = fact == HAND and value in hands
        else:
            fits = type(value) is bool and not (value and ANY in fact)
        if not fits or fact in start:
            raise Rejected(f"the start gives {fact} the value {value!r}, or gives it twice")
        start[fact] = value
    supplied: dict[Fact, Value] = {EEF: HOME, HAND: EMPTY, NEAR: subtasks[0]["target"] if subtasks else None}
    for entry in data["assumptions"]:
        if entry["kind"] == "reset":
            fact, value = tuple(entry["fact"]), entry["value"]
            if fact in start or value is None or supplied.get(fact) != value:
                raise Rejected(f"the reset does not supply {fact}")
            start[fact] = value
    never: dict[Fact, Value] = dict.fromkeys(impossible(scene["objects"], set(scene["articulated"])), False)
    for fact, value in start.items():
        if value is True and (fact in never or (fact[0], ANY, fact[-1]) in never):
            raise Rejected(f"the start says {fact}, which cannot be for the kinds of things")
    return never | start


def check_form(data: Mapping[str, Any]) -> None:
    """Checks that a plan can be read to its end, which following it to a failure does not, and what it acts on.

    Raises:
        Rejected: A subtask's objects are not the scene's, or the scene's cannot be told apart.
    """
    plan, scene = data["plan"], data["scene"]
    objects, items, articulated = scene["objects"], set(scene["items"]), set(scene["articulated"])
    require(ANY not in "".join(objects.keys()), "the objects have no names")
    require(items | articulated <= objects.keys() and not items & articulated, "an object is of two kinds, or of none")
    for index, subtask in enumerate(plan["subtasks"]):
        support = subtask["support_goal"]
        if subtask["target"] not in objects or (support is not None and support not in objects):
            raise Rejected(f"subtask {index} is about something that the scene does not have")
        check_flow(index, subtask, items, articulated)
    check_size(plan, objects)
    if data["failure"] is None:
        return
    needed_of(plan["goal"])
    for subtask in plan["subtasks"]:
        needed_of(subtask["init"]), needed_of(subtask["goal"])


# Kind, subtask and step; a fact, its value, and whether it is that; and when it was written.
_LINKS = frozenset((str, int, int, list, value, bool, int) for value in (bool, str))


def is_link(link: Any) -> bool:
    """Return whether something has the form of a link."""
    return type(link) is list and tuple(map(type, link)) in _LINKS and set(map(type, link[3])) == {str} and all(link[3])


def given_of(entry: Any) -> Given:
    """Returns one thing that is taken for given, if it is a fact about the scene's objects."""
    time, fact, value = entry[0], tuple(entry[1]), entry[2]
    require(type(time) is int and time >= 0 and type(value) is bool, f"{fact} cannot be given as {value!r} at {time!r}")
    require(fact not in ROBOT_FACTS and "*" not in "".join(fact), f"{fact} is the robot's, or a pattern: not to assume")
    return time, fact, value


# A flow has primitives by number, or as the one key of a mapping.
PRIMITIVES: dict[Any, Primitive] = {key: p for p in Primitive for key in (int(p), str(int(p)))}


def action_of(item: Any) -> tuple[Primitive, Parameter]:
    """Returns the primitive of an action of a flow, with its number."""
    ((key, value),) = ((item, None),) if type(item) is int else item.items()
    return PRIMITIVES[key], (value[0], value[1]) if isinstance(value, list) else value


def check_flow(index: int, subtask: Mapping[str, Any], items: Collection[str], articulated: Collection[str]) -> None:
    """Checks that every action of a subtask's flow can be meant: about its objects' kinds, by a number that it takes.

    Args:
        index: Of the subtask, for the reason.
        subtask: As the certificate has it.
        items, articulated: Objects that can be taken, and that have a joint.

    Raises:
        Rejected: One is not.
    """
    fixture, item = subtask["target"] in articulated, subtask["target"] in items
    illegal: dict[Primitive, str] = {} if fixture else dict.fromkeys(ARTICULATIONS, "what has no joint")
    if not (fixture or item):
        illegal[Primitive.GRASP] = "furniture"
    if subtask["support_goal"] is None:
        illegal[Primitive.NAVIGATE_TO_SUPPORT] = "no support"
    for action in subtask["flow"] or ():
        ((key, value),) = ((action, None),) if type(action) is int else action.items()
        _check_parameter(primitive := PRIMITIVES[key], value)
        if primitive in illegal:
            raise Rejected(f"subtask {index}: {primitive.name} is about {illegal[primitive]}")


def _check_parameter(primitive: Primitive, value: Any) -> None:
    """Checks that a primitive takes a number, or a pair of numbers; null leaves it to the executor."""
    if value is None:
        return
    numbers = value if type(value) is list else [value]
    # What is no number, such as a truth value, is taken for one that no primitive takes.
    parameter = [float(number) if type(number) in (int, float) else math.nan for number in numbers]
    require(len(parameter) == (2 if type(value) is list else 1), f"{primitive.name} takes no such list: {value!r:.60}")
    problem = parameter_problem(primitive, (parameter[0], parameter[1]) if type(value) is list else parameter[0])
    require(problem is None, f"{primitive.name} {problem}")
