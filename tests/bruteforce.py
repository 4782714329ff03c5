"""An oracle for plans: complete states, simulated one by one; shares no code with the package it judges.

A state is a set of true facts plus the robot's base, arm and hand. It knows the relations ontop, inside and nextto and
the property open, items, fixtures and surfaces, and nothing of knowledge, links or patterns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Any

# ("ontop", a, b), ("inside", a, b), ("nextto", a, b) or ("open", f).
Fact = tuple[str, ...]
Literal = tuple[Fact, bool]
# A literal, or a word with what it joins: ("or", c, d), ("not", c), ("forall", variable, category, c),
# ("forn", n, variable, category, c), ("forpairs", variable, category, variable, category, c), ...
Condition = tuple[Any, ...]
# What things are called that are open at the top.
OPEN_AT_TOP = ("bowl", "cup", "mug", "box", "basket", "bucket", "pan", "pot", "tray")
# The number of a primitive, alone or with its own number: (7, 0.2), (19, (0.0, 0.6)).
Action = int | tuple[int, Any]


@dataclass(frozen=True)
class World:
    """A complete state."""

    true: frozenset[Fact]
    base: str | None = None
    arm: tuple[str, str] | None = None
    hand: str | None = None

    def holds(self, literal: Literal) -> bool:
        """Whether a literal is true; (inside, x, gripper) reads the hand."""
        fact, wanted = literal
        if fact[0] == "inside" and fact[2] == "gripper":
            return (self.hand == fact[1]) is wanted
        return (fact in self.true) is wanted


@dataclass(frozen=True)
class Part:
    """One subtask of a plan; `place` is the literal (relation, support) that its goal wants of its target."""

    target: str
    support: str | None
    init: tuple[Condition, ...]
    goal: tuple[Condition, ...]
    flow: tuple[Action, ...]

    @property
    def place(self) -> tuple[str, str] | None:
        for fact, wanted in (literal for condition in self.goal for literal in conjoined(condition)):
            if wanted and fact[0] in ("ontop", "inside") and fact[1] == self.target and fact[2] != "gripper":
                return fact[0], fact[2]
        return None


@dataclass(frozen=True)
class Kinds:
    """Which objects are items, which fixtures can be opened, and for formulas what the categories have.

    `vague` lists the facts that carrying one of their objects leaves open.
    """

    items: frozenset[str]
    fixtures: frozenset[str]
    categories: tuple[tuple[str, str], ...] = ()
    vague: tuple[Fact, ...] = ()

    @property
    def open_at_top(self) -> frozenset[str]:
        """The items that a hand lifts things out of, by what they are called."""
        return frozenset(name for name in self.items if name.split("_")[-2] in OPEN_AT_TOP)

    def of(self, category: str) -> list[str]:
        """The objects of a category."""
        return [name for name, own in self.categories if category in (own, "object")]


def conjoined(condition: Condition) -> Iterator[Literal]:
    """The literals that have to be true for a condition to be."""
    word, *parts = condition
    if isinstance(word, tuple):
        yield word, parts[0]
    elif word == "and":
        yield from (literal for part in parts for literal in conjoined(part))
    elif word == "not":
        value, core = False, parts[0]
        while core[0] == "not":
            value, core = not value, core[1]
        if isinstance(core[0], tuple):
            yield core[0], core[1] is value


def meets(world: World, condition: Condition, kinds: Kinds) -> bool:
    """Whether a literal or a formula is true in a complete state."""
    return _meets(world, condition, kinds, {})


def _meets(world: World, condition: Condition, kinds: Kinds, bound: dict[str, str]) -> bool:
    parts: list[Any]
    word, *parts = condition
    if isinstance(word, tuple):
        return world.holds((tuple(bound.get(name, name) for name in word), parts[0]))
    if word in ("and", "or", "not", "imply"):
        truths: list[bool] = [_meets(world, part, kinds, bound) for part in parts]
        if word == "imply":
            return truths[1] or not truths[0]
        return not truths[0] if word == "not" else all(truths) if word == "and" else any(truths)
    number = parts.pop(0) if word in ("forn", "fornpairs") else None
    *binders, body = parts
    if len(binders) == 2:
        variable, category = binders
        found = [_meets(world, body, kinds, {**bound, variable: name}) for name in kinds.of(category)]
        if number is not None:
            return sum(found) == number
        return all(found) if word == "forall" else any(found)
    first, left, second, right = binders
    lefts, rights = kinds.of(left), kinds.of(right)
    pairs = {
        (one, other)
        for one, other in product(lefts, rights)
        if one != other and _meets(world, body, kinds, {**bound, first: one, second: other})
    }
    wanted = min(len(lefts), len(rights)) if number is None else number
    return any(
        all(pair in pairs for pair in zip(chosen, others, strict=True))
        for chosen in permutations(lefts, wanted)
        for others in permutations(rights, wanted)
    )


def read_action(item: Any) -> Action:
    """An action as task files and certificates have it: 17, or {"15": 0.3}."""
    if not isinstance(item, dict):
        return int(item)
    ((number, parameter),) = item.items()
    return (int(number), tuple(parameter) if isinstance(parameter, list) else parameter)


def split(action: Action) -> tuple[int, Any]:
    """An action's primitive, and its number or None."""
    return action if isinstance(action, tuple) else (action, None)


def allowed(world: World, part: Part, action: Action, kinds: Kinds) -> bool:
    """Whether a primitive's precondition holds."""
    target, (action, _) = part.target, split(action)
    if action == 1:
        return world.base == target
    if action == 2:
        return world.arm == ("before", target)
    if action == 3:
        if world.arm != ("at", target) or world.hand is not None:
            return False
        shut_in = [f for f in kinds.fixtures if ("inside", target, f) in world.true and ("open", f) not in world.true]
        return not (target in kinds.items and shut_in)
    if action in (4, 19):
        return world.hand == target and target not in kinds.items
    if action == 5 and world.hand in kinds.items and world.hand != target:
        # Somebody else's thing would fall.
        return False
    if action == 5 and part.place is not None and world.hand == target and target in kinds.items:
        relation, support = part.place
        if world.base != support or support in system(world, target):
            return False
        if any(("inside", support, f) in world.true and ("open", f) not in world.true for f in kinds.fixtures):
            return False
        return not (relation == "inside" and support in kinds.fixtures and ("open", support) not in world.true)
    return True


def carried_by(world: World, action: Action, kinds: Kinds) -> str | None:
    """The thing in the hand that a primitive moves: the hand stays for 3, 4, 5 and 19, and where the number is 0."""
    number, parameter = split(action)
    return world.hand if world.hand in kinds.items and number not in (3, 4, 5, 19) and parameter != 0 else None


def act(world: World, part: Part, action: Action, kinds: Kinds) -> World:
    """The state after a primitive's intended outcome."""
    carried, target, (action, number) = carried_by(world, action, kinds), part.target, split(action)
    if number == 0:
        return world
    if action in (17, 18):
        moved = replace(world, base=target if action == 17 else part.support, arm=("home", ""))
        return _lifted(moved, carried)
    if action in (1, 2):
        return _lifted(replace(world, arm=("before" if action == 1 else "at", target)), carried, kinds.open_at_top)
    if action == 3:
        return replace(world, hand=target)
    if action in (4, 19):
        wide = _ends_open(("open", target) in world.true, action, number)
        return replace(world, true=world.true | {("open", target)} if wide else world.true - {("open", target)})
    if action == 5:
        released = replace(world, hand=None)
        if world.hand != target or target not in kinds.items or part.place is None:
            return released
        relation, support = part.place
        true = set(world.true) | {(relation, target, support)}
        true.discard((relation, support, target))
        # What it carries comes along, into the support and into whatever that is in.
        outer = {fact[2] for fact in world.true if fact[:2] == ("inside", support)}
        for thing in system(world, target):
            own = {support} if relation == "inside" else set()
            true |= {("inside", thing, place) for place in outer | own if place != thing}
        return replace(released, true=frozenset(true))
    out = None if action in (6, 13, 14, 15, 16) else kinds.open_at_top
    return _lifted(replace(world, arm=("home" if action == 6 else "free", "")), carried, out)


def system(world: World, item: str) -> frozenset[str]:
    """A thing with all that rests on or in it, on or in that, and so on."""
    found = {item}
    while more := {f[1] for f in world.true if f[0] in ("ontop", "inside") and f[2] in found} - found:
        found |= more
    return frozenset(found)


def _ends_open(is_open: bool, action: int, limits: object) -> bool:
    """Whether a joint is past a twentieth of its range in the end; limits are fractions of it.

    Opening ends at the upper limit. Closing goes down to the lower one, as far as the distance of the two lets it.
    """
    low, high = limits if isinstance(limits, tuple) else (0.0, 1.0)
    if action == 4:
        return high > 0.05
    return low > 0.05 or (is_open and low == high)


def _lifted(world: World, item: str | None, vessels: frozenset[str] | None = None) -> World:
    """The state in which an item rests on nothing any more, nor in one of some vessels, all by default."""

    def left(fact: Fact) -> bool:
        return fact[0] == "ontop" or (fact[0] == "inside" and (vessels is None or fact[2] in vessels))

    if item is None:
        return world
    moving = system(world, item)
    gone = {f for f in world.true if left(f) and f[1] in moving and f[2] not in moving}
    return replace(world, true=world.true - gone)


def successors(world: World, part: Part, action: Action, kinds: Kinds) -> Iterator[World]:
    """Every state after a primitive's intended outcome: what is beside a thing that is carried along is left open."""
    after = act(world, part, action, kinds)
    carried = carried_by(world, action, kinds)
    moving = frozenset[str]() if carried is None else system(world, carried)
    loose = frozenset(fact for fact in kinds.vague if not moving.isdisjoint(fact[1:]))
    for values in product((False, True), repeat=len(loose)):
        some = frozenset(fact for fact, value in zip(sorted(loose), values, strict=True) if value)
        yield replace(after, true=(after.true - loose) | some)


# Kind, subtask and step of something that a plan needs.
Place = tuple[str, int, int]


def needs(parts: tuple[Part, ...], goal: tuple[Condition, ...], kinds: Kinds) -> Iterator[tuple[Place, Any, Any]]:
    """Yield every place of a plan with what decides it and, for a step, what comes after it."""
    for index, part in enumerate(parts):
        yield ("init", index, -1), lambda w, p=part: all(meets(w, c, kinds) for c in p.init), None
        for step, action in enumerate(part.flow):
            yield (
                ("precondition", index, step),
                lambda w, p=part, a=action: allowed(w, p, a, kinds),
                lambda w, p=part, a=action: successors(w, p, a, kinds),
            )
        yield ("goal", index, -1), lambda w, p=part: all(meets(w, c, kinds) for c in p.goal), None
    yield ("task-goal", len(parts), -1), lambda w: all(meets(w, c, kinds) for c in goal), None


def decided(
    starts: list[World], parts: tuple[Part, ...], goal: tuple[Condition, ...], kinds: Kinds
) -> tuple[str, list[tuple[Place, str]]]:
    """The verdict on a plan, and the grade of every place over the runs that came so far; it ends where none does."""
    worlds = set(starts)
    grades: list[tuple[Place, str]] = []
    for place, holds, after in needs(parts, goal, kinds):
        going_on = set(filter(holds, worlds))
        grades.append((place, "FAILS" if not going_on else "HOLDS" if going_on == worlds else "POSSIBLE"))
        if not going_on:
            return "REFUTED", grades
        worlds = going_on if after is None else {each for world in going_on for each in after(world)}
    return ("CONDITIONAL" if any(grade == "POSSIBLE" for _, grade in grades) else "PROVED"), grades


def run(
    world: World, parts: tuple[Part, ...], goal: tuple[Condition, ...], kinds: Kinds
) -> tuple[str, int, int] | None:
    """None when a plan runs through and reaches its goal, else the first place that fails: kind, subtask, step."""
    for index, part in enumerate(parts):
        if not all(meets(world, condition, kinds) for condition in part.init):
            return "init", index, -1
        for step, action in enumerate(part.flow):
            if not allowed(world, part, action, kinds):
                return "precondition", index, step
            world = act(world, part, action, kinds)
        if not all(meets(world, condition, kinds) for condition in part.goal):
            return "goal", index, -1
    return None if all(meets(world, condition, kinds) for condition in goal) else ("task-goal", len(parts), -1)


def reachable(world: World, part: Part, actions: tuple[int, ...], kinds: Kinds) -> dict[World, int]:
    """Every state that some flow of a subtask leads to, with the length of the shortest one."""
    lengths = {world: 0}
    layer = [world]
    while layer:
        following = []
        for state in layer:
            for action in actions:
                if allowed(state, part, action, kinds):
                    after = act(state, part, action, kinds)
                    if after not in lengths:
                        lengths[after] = lengths[state] + 1
                        following.append(after)
        layer = following
    return lengths


def consistent(world: World) -> bool:
    """Whether a state could be: nothing carries itself, and what is carried is inside what its carrier is inside."""
    resting = [fact for fact in world.true if fact[0] in ("ontop", "inside")]
    for _, thing, place in resting:
        if place in system(world, thing):
            return False
        if any(("inside", thing, f[2]) not in world.true for f in resting if f[:2] == ("inside", place)):
            return False
    return True


def following(facts: Iterable[Fact]) -> frozenset[Fact]:
    """Facts about places with what follows from them: a thing is inside what its carrier is inside."""
    true = set(facts)
    while (
        more := {
            ("inside", thing, outer[2])
            for name, thing, *place in true
            if name in ("ontop", "inside")
            for outer in true
            if outer[:2] == ("inside", *place)
        }
        - true
    ):
        true |= more
    return frozenset(true)


def added(facts: frozenset[Fact], fact: Fact) -> frozenset[Fact]:
    """The facts with another one and what follows, or without it where that cannot be."""
    more = following({*facts, fact})
    return more if consistent(World(more)) else facts


def completions(known: dict[Fact, bool], unknown: tuple[Fact, ...], base: str | None) -> Iterator[World]:
    """Every complete start state that agrees with what is known."""
    stated = frozenset(fact for fact, value in known.items() if value)
    for values in product((False, True), repeat=len(unknown)):
        extra = frozenset(fact for fact, value in zip(unknown, values, strict=True) if value)
        world = World(stated | extra, base=base, arm=("home", ""))
        if consistent(world):
            yield world
