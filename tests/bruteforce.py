"""An oracle for plans: complete states, simulated one by one; shares no code with the package it judges.

A state is a set of true facts plus the robot's base, arm and hand. It knows the relations ontop and inside and the
property open, items, fixtures and surfaces, and nothing of knowledge, links or patterns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

# ("ontop", a, b), ("inside", a, b) or ("open", f).
Fact = tuple[str, ...]
Literal = tuple[Fact, bool]


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
    init: tuple[Literal, ...]
    goal: tuple[Literal, ...]
    flow: tuple[int, ...]

    @property
    def place(self) -> tuple[str, str] | None:
        for fact, wanted in self.goal:
            if wanted and fact[0] in ("ontop", "inside") and fact[1] == self.target and fact[2] != "gripper":
                return fact[0], fact[2]
        return None


@dataclass(frozen=True)
class Kinds:
    """Which objects are items, and which fixtures can be opened."""

    items: frozenset[str]
    fixtures: frozenset[str]


def allowed(world: World, part: Part, action: int, kinds: Kinds) -> bool:
    """Whether a primitive's precondition holds."""
    target = part.target
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
    if action == 5 and part.place is not None and world.hand == target and target in kinds.items:
        relation, support = part.place
        if world.base != support:
            return False
        return not (relation == "inside" and support in kinds.fixtures and ("open", support) not in world.true)
    return True


def act(world: World, part: Part, action: int, kinds: Kinds) -> World:
    """The state after a primitive's intended outcome."""
    target = part.target
    carried = world.hand if world.hand in kinds.items else None
    if action in (17, 18):
        moved = replace(world, base=target if action == 17 else part.support, arm=("home", ""))
        return _lifted(moved, carried)
    if action == 1:
        return replace(world, arm=("before", target))
    if action == 2:
        return replace(world, arm=("at", target))
    if action == 3:
        return replace(world, hand=target)
    if action == 4:
        return replace(world, true=world.true | {("open", target)})
    if action == 19:
        return replace(world, true=world.true - {("open", target)})
    if action == 5:
        released = replace(world, hand=None)
        if carried != target or part.place is None:
            return released
        relation, support = part.place
        true = (world.true | {(relation, target, support)}) - {(relation, support, target)}
        return replace(released, true=true)
    if action == 6:
        return replace(world, arm=("home", ""))
    if action == 7:
        return _lifted(replace(world, arm=("free", "")), carried)
    return replace(world, arm=("free", ""))


def _lifted(world: World, item: str | None) -> World:
    """The state in which an item rests nowhere any more."""
    if item is None:
        return world
    return replace(world, true=frozenset(f for f in world.true if f[0] == "open" or f[1] != item))


def run(world: World, parts: tuple[Part, ...], goal: tuple[Literal, ...], kinds: Kinds) -> tuple[str, int, int] | None:
    """None when a plan runs through and reaches its goal, else the first place that fails: kind, subtask, step."""
    for index, part in enumerate(parts):
        if not all(map(world.holds, part.init)):
            return "init", index, -1
        for step, action in enumerate(part.flow):
            if not allowed(world, part, action, kinds):
                return "precondition", index, step
            world = act(world, part, action, kinds)
        if not all(map(world.holds, part.goal)):
            return "goal", index, -1
    return None if all(map(world.holds, goal)) else ("task-goal", len(parts), -1)


def consistent(world: World) -> bool:
    """Whether a state could be: nothing on or in itself, and no two things each on, or each in, the other."""
    for fact in world.true:
        if fact[0] != "open" and (fact[1] == fact[2] or (fact[0], fact[2], fact[1]) in world.true):
            return False
    return True


def completions(known: dict[Fact, bool], unknown: tuple[Fact, ...], base: str | None) -> Iterator[World]:
    """Every complete start state that agrees with what is known."""
    stated = frozenset(fact for fact, value in known.items() if value)
    for values in product((False, True), repeat=len(unknown)):
        extra = frozenset(fact for fact, value in zip(unknown, values, strict=True) if value)
        world = World(stated | extra, base=base, arm=("home", ""))
        if consistent(world):
            yield world
