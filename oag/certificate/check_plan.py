"""The plan of a certificate, read and followed by the independent checker.

Conditions are lists of literals, or formulas as the language prints them, which `formulas.py` reads strictly: the
formula, printed again, must be the text, word by word. The plan is followed from its start: what is needed where, and
what every step writes.

Part of the independent check: it knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates; docs/bddl.md has the forms of formulas.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from functools import lru_cache
from operator import itemgetter
from typing import Any

import bddl
from bddl.grounding import count_ground_parts
from oag.certificate.formulas import read_formula
from oag.model.domain import BUILT_IN, Domain, DomainError, own_of
from oag.model.symbols import (
    ANY,
    ARTICULATIONS,
    EEF,
    EMPTY,
    HAND,
    HOME,
    NEAR,
    ROBOT_FACTS,
    Fact,
    Kind,
    Parameter,
    Primitive,
    Value,
    condition_of,
    condition_on,
    generalisations,
    gripping,
    holding,
    parameter_problem,
)
from oag.primitives.cargo import NOTHING_CARRIED, Carriage, Starts, carriage_of, circle, closed, denied, is_place
from oag.primitives.table import (
    Clause,
    Context,
    Needed,
    Placement,
    Rows,
    does,
    excluded,
    guarded,
    impossible,
    needed,
    open_at_top,
    own_deeds,
    own_places,
    placement_among,
    placement_of,
    with_consequences,
)

# Kind, subtask and step of what is needed.
Place = tuple[str, int, int]
# Most reads of facts for one distinction of cases; the writer of certificates gives up earlier.
MOST_READS = 400_000
Reader = Callable[[Fact], Value]


class Rejected(Exception):
    """A certificate does not show its verdict."""


def require(condition: bool, reason: str) -> None:
    """Raise Rejected with a reason unless a condition is met."""
    if not condition:
        raise Rejected(reason)


def truth_of(wanted: Needed, read: Reader, objects: Mapping[str, str]) -> bool | None:
    """Return whether clauses or a formula hold for a reader of facts; None when what is known does not decide it."""
    if not isinstance(wanted, tuple):

        def known(atom: bddl.Atom) -> bool | None:
            condition = condition_of(atom, True)
            return condition.grade(read(condition.fact))

        return bddl.evaluate(wanted, known, objects)
    grades = [[condition.grade(read(condition.fact)) for condition in clause] for clause in wanted]
    if any(all(grade is False for grade in clause) for clause in grades):
        return False
    return all(True in clause for clause in grades) or None


# Whether no start gives a fact a value in a case.
Exclusion = Callable[[Fact, bool, Mapping[Fact, Value]], bool]


def truth_by_cases(
    wanted: Needed, tree: list[Any], read: Reader, objects: Mapping[str, str], excludes: Exclusion
) -> bool | None:
    """Return the one value that clauses or a formula have in every case of a distinction.

    The cases are a tree in preorder: an unknown fact stands before its case true and its case false, null ends a case.
    Raises Rejected when a known fact, or none with two values, is distinguished, a case is missing, or cases disagree.
    """
    reads = 0

    def counted(fact: Fact) -> Value:
        nonlocal reads
        reads += 1
        return read(fact)

    pending: list[dict[Fact, bool] | None] = [{}]
    results: set[bool | None] = set()
    for split in tree:
        require(bool(pending), "a case distinction has too many cases")
        case = pending.pop()
        if split is not None:
            fact = tuple(split)
            two_cases = fact not in ROBOT_FACTS and ANY not in fact
            require(two_cases, f"{fact} is the robot's, or a pattern: it has no two cases")
            known = with_values(read, case or {})
            require(known(fact) is None, f"{fact} is known, and cases of it are distinguished")
            # None stands for a case without a state.
            if case is None:
                pending += [None, None]
                continue
            never = excluded(fact, known) or excludes(fact, True, case)
            pending.append(None if excludes(fact, False, case) else {**case, fact: False})
            pending.append(None if never else {**case, fact: True})
        elif case is not None:
            results.add(truth_of(wanted, with_values(counted, case), objects))
            require(reads <= MOST_READS, "a case distinction takes too long to look at")
    require(not pending and len(results) == 1, "the cases of a distinction disagree, or one is missing")
    return results.pop()


def with_values(read: Reader, case: Mapping[Fact, Value]) -> Reader:
    """Return a reader in which some facts have other values: those of a case, or None for facts to ignore."""
    return lambda fact: case[fact] if fact in case else read(fact)


# Parts that the formulas of a plan may have, with every quantifier spelled out over the objects.
MOST_PARTS = 20_000


def needed_of(condition: Any, domain: Domain = BUILT_IN) -> Needed:
    """Return the clauses of a list of [atom, value], or the formula of a text.

    Raises Rejected for a pattern, or a variable of the robot as an atom.
    """
    if isinstance(condition, str):
        formula = read_formula(condition, domain.predicates)
        require(all((atom.predicate, *atom.args) not in ROBOT_FACTS for atom in bddl.atoms(formula)), "no formula")
        return needed(formula)
    clauses: list[Clause] = []
    for names, value in condition:
        fact = tuple(names)
        # The robot's variables alone are about nothing, and predicates of own domains that have no arguments.
        if type(value) is not bool or (len(fact) < 2 and fact[0] not in domain.own_predicates) or ANY in "".join(fact):
            raise Rejected(f"{names} is no literal")
        clauses.append((condition_on(fact, value),))
    return tuple(clauses)


def check_size(plan: Mapping[str, Any], objects: Mapping[str, str], domain: Domain) -> None:
    """Check that the plan's formulas, spelled out over the objects, are not too large to be evaluated."""
    left = MOST_PARTS
    for condition in (plan["goal"], *(s[field] for s in plan["subtasks"] for field in ("init", "goal"))):
        # Without a variable there is no quantifier.
        if isinstance(condition, str) and "?" in condition:
            left -= count_ground_parts(read_formula(condition, domain.predicates), objects, left)
            require(left >= 0, f"its quantifiers say more than {MOST_PARTS} things of the objects")


NEVER: tuple[int, Value] = (-1, None)
_BY_TIME = itemgetter(0)


class Impossible(Rejected):
    """An assumption breaks an invariant, so that no state satisfies it."""


def _last(latest: Mapping[Fact, tuple[int, Value]], fact: Fact) -> tuple[int, Value]:
    best = latest.get(fact, NEVER)
    if len(fact) == 3:
        name, first, second = fact
        for pattern in ((name, first, ANY), (name, ANY, second), (name, ANY, ANY)):
            if pattern in latest and latest[pattern][0] > best[0]:
                best = latest[pattern]
    elif len(fact) == 2 and latest.get((fact[0], ANY), NEVER)[0] > best[0]:
        best = latest[fact[0], ANY]
    elif len(fact) > 3 and latest.get(generalisations(fact)[-1], NEVER)[0] > best[0]:
        best = latest[generalisations(fact)[-1]]
    return best


def _placement(goal: Needed, target: str) -> Placement | None:
    return placement_among(goal, target) if isinstance(goal, tuple) else placement_of(goal, target)


class PlanRun:
    """A plan followed from its start.

    Attributes:
        context: The objects of the current subtask.
        given: Assumptions still to be made, the next one last.
        time: Time of the current place; earlier writes count.
        latest: The last write of each fact or pattern: when, and what.
        before: What was known of a fact before an assumption was written about it, by the fact and the time.
    """

    def __init__(self, data: Mapping[str, Any], given: Sequence[Any] = (), *, complete: bool = False) -> None:
        """Start at the start of the plan.

        Args:
            data: The certificate.
            given: Triples (time, fact, value) to assume of unknown facts.
            complete: Follow one run. Whatever is unknown and not given is false, from where it became unknown. Known
                facts may be given too.
        """
        # Stable by time: a later entry may follow from an earlier one of the same time, not the other way round.
        self.given: list[Given] = sorted(map(given_of, given), key=_BY_TIME)[::-1] if given else []
        self.time = 1
        self.before: dict[tuple[Fact, int], Value] = {}
        self._plan, self._scene, self._complete = data["plan"], data["scene"], complete
        self.domain = domain_of(data)
        self.latest: dict[Fact, tuple[int, Value]] = {fact: (0, value) for fact, value in start_of(data).items()}
        for fact in [fact for fact, (_, value) in self.latest.items() if value is True]:
            for stated, known in with_consequences(fact, True):
                if self.last(stated)[1] is None:
                    self.latest[stated] = (0, known)
                elif self.last(stated)[1] != known:
                    raise Rejected(f"the start breaks an invariant: {fact}")
        self._start = start_of(data)
        self._close()
        # What holds without anything assumed, by which cargo is recognised.
        self._sure = dict(self.latest)
        self._carriage = self._carriage_of()
        self._starts, self._about_start = Starts(NOTHING_CARRIED, self.sure), dict[Fact, Value]()
        # In a complete run cargo is inside what its carrier is inside, whether or not the run says so.
        self._implied = set[Fact]()
        if self._carriage != NOTHING_CARRIED:
            first = dict(self.latest)
            self._starts = Starts(self._carriage, lambda fact: _last(first, fact)[1])
            given_true = {
                fact for time, fact, value in self.given if complete and value and time == 0 and is_place(fact)
            }
            self._implied = closed(self._resting() | given_true) if given_true else set()

    def _close(self) -> None:
        """State what follows: a thing is inside whatever its carrier is inside, and nothing carries itself."""
        resting = self._resting()
        require(not circle(resting), "the start breaks an invariant: things carry each other in a circle")
        for fact in closed(resting) - resting:
            require(fact not in self._start, f"the start denies {fact}, which follows from what carries it")
            self.latest[fact] = (0, True)
        for fact in denied(resting, {fact: value for fact, (_, value) in self.latest.items()}):
            self.latest[fact] = (0, False)

    def _resting(self) -> set[Fact]:
        return {fact for fact, (_, value) in self.latest.items() if value is True and is_place(fact)}

    def _carriage_of(self) -> Carriage:
        placed = set[Fact]()
        for subtask in self._plan["subtasks"]:
            place = _placement(needed_of(subtask["goal"], self.domain), subtask["target"])
            if place is not None:
                placed.add((place.relation, subtask["target"], place.support))
            if self.domain.rows:
                placed.update(own_places(self._own(subtask), subtask["target"], subtask["support_goal"]))
        stated = {**self._start, **{fact: value for fact, (_, value) in self.latest.items()}}
        return carriage_of(self._scene["objects"], frozenset(self._scene["items"]), stated, placed)

    def _own(self, subtask: Mapping[str, Any]) -> tuple[Primitive, ...]:
        """Return the own primitives of a subtask's flow, all that it may have where it lacks one."""
        if subtask["flow"] is None:
            return tuple(self.domain.choices(subtask["target"], subtask["support_goal"], things_of(self._scene)))
        return tuple(action_of(item, self.domain)[0] for item in subtask["flow"])

    def legal(self) -> tuple[Primitive, ...]:
        """Return the primitives that a flow of the current subtask may have."""
        context, own = self.context, tuple[Primitive, ...]()
        if self.domain.rows:
            own = tuple(self.domain.choices(context.target, context.support_goal, things_of(self._scene)))
        illegal = set[Primitive]() if context.target in context.articulated else set(ARTICULATIONS)
        if not (context.target in context.articulated or context.target_is_item):
            illegal.add(Primitive.GRASP)
        if context.support_goal not in self._scene["objects"]:
            illegal.add(Primitive.NAVIGATE_TO_SUPPORT)
        return (*(p for p in Primitive if self.domain.inherits and p not in illegal), *own)

    def sure(self, fact: Fact) -> Value:
        """Return what the start and the steps so far make of a fact, without anything assumed."""
        return _last(self._sure, fact)[1]

    def last(self, fact: Fact) -> tuple[int, Value]:
        """Return when a fact was last written (-1 for never) and what; at one time the most specific write counts."""
        return _last(self.latest, fact)

    def value(self, fact: Fact) -> Value:
        """Return what a fact is known to be. None is unknown; in a complete run only the robot's facts can be."""
        since, value = self.last(fact)
        if value is not None or not self._complete or fact in ROBOT_FACTS:
            return value
        return since < 0 and fact in self._implied

    def places(self) -> Iterator[tuple[Place, Needed]]:
        """Yield the needs of each place in order, while the steps in between write what the table says.

        A subtask without a flow yields its goal at the place ("no-flow", subtask, -1), after which nothing can follow.
        """
        require(HAND in self.latest, "what the hand does is unknown: neither the scene nor the reset says so")
        articulated, items, time = tuple(self._scene["articulated"]), frozenset(self._scene["items"]), self.time
        vessels = tuple(key for key in self._scene["items"] if open_at_top(self._scene["objects"][key]))
        latest, tables, given = self.latest, dict[tuple[Any, ...], Rows](), self.given
        carriage, domain = self._carriage, self.domain
        for index, subtask in enumerate(self._plan["subtasks"]):
            target, goal = subtask["target"], needed_of(subtask["goal"], domain)
            key = (target, subtask["support_goal"], _placement(goal, target))
            context = Context(*key, target in items, articulated, vessels, carriage)
            rows = tables.setdefault(key, Rows(context))
            self.context = context
            if given:
                self._take()
            yield ("init", index, -1), self._init(subtask, key[2], domain)
            if subtask["flow"] is None:
                yield ("no-flow", index, -1), goal
                raise Rejected(f"subtask {index} has no flow, and nothing shows that it can have none")
            for position, item in enumerate(subtask["flow"]):
                if given:
                    self._take()
                primitive, parameter = (PRIMITIVES[item], None) if type(item) is int else action_of(item, domain)
                wanted, written = rows.row(primitive, latest[HAND][1], parameter)
                if wanted:
                    yield ("precondition", index, position), wanted
                now = time + 1
                if rows.carries:
                    written = rows.written(primitive, latest[HAND][1], parameter, self.sure)
                    self._sure.update((fact, (now, value)) for fact, value in written)
                for fact, value in written:
                    latest[fact] = (now, value)
                self.time = time = now + 1
            if given:
                self._take()
            yield ("goal", index, -1), goal
        self._take()
        yield ("task-goal", len(self._plan["subtasks"]), -1), needed_of(self._plan["goal"], domain)

    def _init(self, subtask: Mapping[str, Any], placement: Placement | None, domain: Domain) -> Needed:
        """Return a subtask's initial condition, with what was found impossible left out."""
        init = needed_of(subtask["init"], domain)
        if not self._scene.get("known"):
            return init
        primitives = {action_of(item, domain)[0] for item in subtask["flow"] or ()}
        own = own_deeds(primitives, subtask["target"], subtask["support_goal"])
        found = [
            needed_of(each["given"], domain)
            for each in self._scene["known"]
            if does((each["kind"], each["thing"], each["place"]), subtask["target"], placement, primitives, own)
        ]
        require(all(type(given) is tuple for given in found), "what was found impossible is no list of literals")
        return guarded(init, (given for given in found if isinstance(given, tuple)))

    def take(self, time: int, fact: Fact, value: bool) -> None:
        """Assume a value of a fact; raises Impossible when that breaks an invariant.

        Raises Rejected when it is known, or when a complete run gives it another value than it had before.
        """
        since, held = self.last(fact)
        if self._complete and held is value:
            return
        require(held is None, f"{fact} is assumed though it is known")
        require(not self._complete or time == max(since, 0), f"a run changes {fact} at {time}, where nothing does")
        if value and excluded(fact, self.value):
            raise Impossible(f"{fact} is assumed against an invariant")
        if since < 0:
            if self._starts.exclude(fact, value, self._about_start):
                raise Impossible(f"{fact} is assumed against what carries what")
            self._about_start[fact] = value
        for stated, known in with_consequences(fact, value):
            self.before[stated, time] = self.last(stated)[1]
            self.latest[stated] = (time, known)

    def excludes(self, fact: Fact, value: bool, case: Mapping[Fact, Value], ignored: Collection[Fact] = ()) -> bool:
        """Decide whether no start gives a fact a value in a case; what a step left open is no fact of the start.

        Assumptions about `ignored` facts do not count.
        """
        if self._carriage == NOTHING_CARRIED or self.last(fact)[0] >= 0:
            return False
        given = {each: truth for each, truth in case.items() if self.last(each)[0] < 0}
        assumed = {each: truth for each, truth in self._about_start.items() if each not in ignored}
        return self._starts.exclude(fact, value, {**assumed, **given})

    def _take(self) -> None:
        while self.given and self.given[-1][0] <= self.time:
            self.take(*self.given.pop())


# Value of an unknown fact: time, fact, and value.
Given = tuple[int, Fact, bool]


def start_of(data: Mapping[str, Any]) -> dict[Fact, Value]:
    """Return what is known of the start: by the kinds of objects, by the scene, and by the listed reset."""
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


def check_contents(data: Mapping[str, Any]) -> None:
    """Check that a plan can be read to its end, beyond a failure, and that its objects exist and have one kind."""
    plan, scene, domain = data["plan"], data["scene"], domain_of(data)
    objects, items, articulated = scene["objects"], set(scene["items"]), set(scene["articulated"])
    require(ANY not in "".join(objects.keys()), "the objects have no names")
    require(items | articulated <= objects.keys() and not items & articulated, "an object is of two kinds, or of none")
    for index, subtask in enumerate(plan["subtasks"]):
        support = subtask["support_goal"]
        if subtask["target"] not in objects or (support is not None and support not in objects):
            raise Rejected(f"subtask {index} is about something that the scene does not have")
        check_flow(index, subtask, items, articulated, domain)
        if domain.rows:
            _check_own(index, subtask, scene, domain)
    check_size(plan, objects, domain)
    if data["failure"] is None:
        return
    needed_of(plan["goal"], domain)
    for subtask in plan["subtasks"]:
        needed_of(subtask["init"], domain), needed_of(subtask["goal"], domain)


def domain_of(data: Mapping[str, Any]) -> Domain:
    """Return the domain of a certificate, which it repeats; without one, the built-in one."""
    if "domain" not in data:
        return BUILT_IN
    try:
        return _domain(json.dumps(data["domain"], sort_keys=True))
    except DomainError as problem:
        raise Rejected(f"its domain cannot be used: {problem}") from problem


@lru_cache(maxsize=64)
def _domain(text: str) -> Domain:
    return Domain.from_json(json.loads(text), "(certificate)")


def things_of(scene: Mapping[str, Any]) -> dict[str, tuple[str, Kind]]:
    """Return the category and the kind of each object of a certificate's scene."""
    items, articulated = set(scene["items"]), set(scene["articulated"])
    return {
        name: (category, Kind.ITEM if name in items else Kind.ARTICULATED if name in articulated else Kind.SUPPORT)
        for name, category in scene["objects"].items()
    }


def _check_own(index: int, subtask: Mapping[str, Any], scene: Mapping[str, Any], domain: Domain) -> None:
    """Check that the own primitives of a subtask's flow fit its objects."""
    for item in subtask["flow"] or ():
        own = own_of(action_of(item, domain)[0])
        problem = (
            None if own is None else domain.problem(own, subtask["target"], subtask["support_goal"], things_of(scene))
        )
        require(problem is None, f"subtask {index}: {'' if own is None else own.row.name} {problem}")


# Kind, subtask and step; a fact, its value, and whether it is that; and when it was written.
_LINKS = frozenset((str, int, int, list, value, bool, int) for value in (bool, str))


def is_link(link: Any) -> bool:
    """Return whether something has the form of a link."""
    return type(link) is list and tuple(map(type, link)) in _LINKS and set(map(type, link[3])) == {str} and all(link[3])


def given_of(entry: Any) -> Given:
    """Return one assumption, if it is a fact about the scene's objects."""
    time, fact, value = entry[0], tuple(entry[1]), entry[2]
    require(type(time) is int and time >= 0 and type(value) is bool, f"{fact} cannot be given as {value!r} at {time!r}")
    require(fact not in ROBOT_FACTS and "*" not in "".join(fact), f"{fact} is the robot's, or a pattern: not to assume")
    return time, fact, value


# A flow has primitives by number, or as the one key of a mapping.
PRIMITIVES: dict[Any, Primitive] = {key: p for p in Primitive for key in (int(p), str(int(p)))}


def action_of(item: Any, domain: Domain = BUILT_IN) -> tuple[Primitive, Parameter]:
    """Return the primitive of an action of a flow, with its number."""
    ((key, value),) = item.items() if type(item) is dict else ((item, None),)
    return primitive_of(key, domain), (value[0], value[1]) if isinstance(value, list) else value


def primitive_of(key: Any, domain: Domain) -> Primitive:
    """Return the primitive of a flow's key: a number, or the name of an own one with its further objects."""
    own = domain.primitive(key) if domain.rows and type(key) is str and not key.isdecimal() else None
    return PRIMITIVES[key] if own is None else own


def check_flow(
    index: int,
    subtask: Mapping[str, Any],
    items: Collection[str],
    articulated: Collection[str],
    domain: Domain = BUILT_IN,
) -> None:
    """Check that every action of a subtask's flow fits the kinds of its objects and has a valid parameter.

    `items` can be taken, and `articulated` objects have a joint; the `index` is for the reason.
    """
    fixture, item = subtask["target"] in articulated, subtask["target"] in items
    illegal: dict[Primitive, str] = {} if fixture else dict.fromkeys(ARTICULATIONS, "what has no joint")
    if not (fixture or item):
        illegal[Primitive.GRASP] = "furniture"
    if subtask["support_goal"] is None:
        illegal[Primitive.NAVIGATE_TO_SUPPORT] = "no support"
    rows, inherits = domain.rows, domain.inherits
    for action in subtask["flow"] or ():
        ((key, value),) = action.items() if type(action) is dict else ((action, None),)
        _check_parameter(primitive := primitive_of(key, domain) if rows else PRIMITIVES[key], value)
        if not inherits and own_of(primitive) is None:
            raise Rejected(f"{primitive.name} is not in the domain")
        if primitive in illegal:
            raise Rejected(f"subtask {index}: {primitive.name} is about {illegal[primitive]}")


def _check_parameter(primitive: Primitive, value: Any) -> None:
    """Check that a primitive takes a number, or a pair of numbers; null leaves it to the executor."""
    if value is None:
        return
    numbers = value if type(value) is list else [value]
    # A value that is no number, such as a truth value, becomes NaN, which no primitive takes.
    parameter = [float(number) if type(number) in (int, float) else math.nan for number in numbers]
    require(len(parameter) == (2 if type(value) is list else 1), f"{primitive.name} takes no such list: {value!r:.60}")
    problem = parameter_problem(primitive, (parameter[0], parameter[1]) if type(value) is list else parameter[0])
    require(problem is None, f"{primitive.name} {problem}")
