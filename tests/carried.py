"""An oracle for plans with cargo: things stand in a forest of direct relations, and everything else is derived from it.

It was written from docs/semantics.md alone, and shares no code with the package or with the other oracle. Worlds are
larger than there: bowls, boxes in boxes, trays, a drawer in a cabinet. A plan goes one way from a complete start.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import product
from random import Random
from typing import Any

# (relation, thing, place), ("open", fixture) or ("nextto", thing, other).
Fact = tuple[str, ...]
Wish = tuple[Fact, bool]

FIXTURES = ("refrigerator_0", "cabinet_0", "drawer_0")
# Category and box [m] of each thing: boxes nest, and everything fits into what `HOLDS` names.
THINGS: dict[str, tuple[str, tuple[float, float, float]]] = {
    "apple_0": ("apple", (0.02, 0.02, 0.02)),
    "apple_1": ("apple", (0.02, 0.02, 0.02)),
    "bowl_0": ("bowl", (0.12, 0.12, 0.12)),
    "cup_0": ("cup", (0.12, 0.12, 0.12)),
    "box_0": ("box", (0.05, 0.3, 0.3)),
    "box_1": ("box", (0.03, 0.1, 0.1)),
    "tray_0": ("tray", (0.05, 0.3, 0.02)),
    "plate_0": ("plate", (0.05, 0.2, 0.02)),
    "table_0": ("table", (1.4, 0.8, 0.7)),
    "refrigerator_0": ("refrigerator", (0.7, 0.7, 1.8)),
    "cabinet_0": ("cabinet", (0.8, 0.8, 1.8)),
    "drawer_0": ("drawer", (0.6, 0.6, 0.5)),
}
ITEMS = tuple(name for name in THINGS if name not in (*FIXTURES, "table_0"))
VESSELS = ("bowl_0", "cup_0", "box_0", "box_1", "tray_0")
HOLDS = {
    "box_0": ("apple_0", "apple_1", "box_1"),
    "box_1": ("apple_0", "apple_1"),
    "bowl_0": ("apple_0", "apple_1", "box_1", "cup_0"),
    "cup_0": ("apple_0", "apple_1", "box_1", "bowl_0"),
    **dict.fromkeys(FIXTURES, ITEMS),
}
# Step names: the numbers are the paper's.
TO_TARGET, TO_SUPPORT, APPROACH, CONVERGE, GRASP, OPEN, CLOSE, RELEASE, RETREAT, LIFT, DRIVE = (
    17,
    18,
    1,
    2,
    3,
    4,
    19,
    5,
    6,
    7,
    13,
)


@dataclass
class Forest:
    """A complete state; `resting` has what was said or done, and `inside` of anything around it follows."""

    resting: set[Fact] = field(default_factory=set)
    open: set[str] = field(default_factory=set)
    # Pairs of which it is known whether one is next to the other, with the answer.
    beside: dict[Fact, bool] = field(default_factory=dict)
    base: str = ""
    arm: str = "home"
    hand: str = ""

    def load(self, name: str) -> set[str]:
        """A thing with all that stands on or in it, directly or through others."""
        found = {name}
        for _ in ITEMS:
            found |= {thing for _, thing, place in self.resting if place in found}
        return found

    def around(self, name: str) -> set[str]:
        """Everything that a thing is inside of."""
        found: set[str] = set()
        for relation, thing, place in self.resting:
            if thing == name:
                found |= self.around(place) | ({place} if relation == "inside" else set())
        return found

    def truth(self, fact: Fact) -> bool | None:
        """Whether a fact is so; None where motion left it open."""
        if fact[0] == "open":
            return fact[1] in self.open
        if fact[0] == "nextto":
            return self.beside.get(fact)
        if fact[2] == "gripper":
            return self.hand == fact[1]
        return fact[2] in self.around(fact[1]) if fact[0] == "inside" else fact in self.resting

    def shut_in(self, name: str) -> bool:
        """Whether a closed door is around a thing, however far out."""
        return any(place in FIXTURES and place not in self.open for place in self.around(name))


@dataclass
class Subtask:
    """One part of a plan; `place` is where its goal puts its target."""

    target: str
    init: list[Wish]
    goal: list[Wish]
    flow: list[int]
    place: tuple[str, str] | None = None


def can(world: Forest, part: Subtask, step: int) -> bool:
    """Whether a step can be done."""
    name, item = part.target, part.target in ITEMS
    if step == APPROACH:
        return world.base == name
    if step == CONVERGE:
        return world.arm == f"before {name}"
    if step == GRASP:
        return world.arm == f"at {name}" and not world.hand and not world.shut_in(name)
    if step in (OPEN, CLOSE):
        return world.hand == name and not item
    if step == RELEASE and world.hand in ITEMS:
        if world.hand != name:
            return False
        if part.place is not None:
            relation, support = part.place
            shut = relation == "inside" and support in FIXTURES and support not in world.open
            return world.base == support and not shut and not world.shut_in(support) and support not in world.load(name)
    return True


def do(world: Forest, part: Subtask, step: int) -> None:
    """Do a step."""
    held = world.hand if world.hand in ITEMS else ""
    if step == GRASP:
        world.hand = part.target
    elif step == OPEN:
        world.open.add(part.target)
    elif step == CLOSE:
        world.open.discard(part.target)
    elif step == RELEASE:
        world.hand = ""
        if held and part.place is not None:
            world.resting.add((part.place[0], held, part.place[1]))
    else:
        if held:
            _take_along(world, held, everything=step in (TO_TARGET, TO_SUPPORT, RETREAT, DRIVE))
        if step in (TO_TARGET, TO_SUPPORT):
            world.base = part.target if step == TO_TARGET or part.place is None else part.place[1]
        names = {APPROACH: f"before {part.target}", CONVERGE: f"at {part.target}", LIFT: "free", DRIVE: "free"}
        world.arm = names.get(step, "home")


def _take_along(world: Forest, held: str, *, everything: bool) -> None:
    """Take a thing with its load off its places; out of furniture only where the hand backs out or drives away."""
    moving = world.load(held)
    for name in moving:
        # What is around it was so through its carriers, which may be left behind.
        kept = () if everything else [place for place in world.around(name) if place not in VESSELS]
        along = {fact for fact in world.resting if fact[1] == name and fact[2] in moving}
        world.resting -= {fact for fact in world.resting if fact[1] == name}
        world.resting |= along | {("inside", name, place) for place in kept if place not in moving}
    for fact in [fact for fact in world.beside if moving & set(fact[1:])]:
        del world.beside[fact]


def outcome(world: Forest, plan: Iterable[Subtask], goal: list[Wish]) -> bool | None:
    """Whether a plan goes through and reaches a goal: None where that hangs on what motion left open."""
    sure = True

    def holds(wishes: list[Wish]) -> bool:
        nonlocal sure
        truths = [(world.truth(fact), wanted) for fact, wanted in wishes]
        sure = sure and all(truth is not None for truth, _ in truths)
        return all(truth is None or truth is wanted for truth, wanted in truths)

    for part in plan:
        if not holds(part.init):
            return False
        for step in part.flow:
            if not can(world, part, step):
                return False
            do(world, part, step)
        if not holds(part.goal):
            return False
    if not holds(goal):
        return False
    return True if sure else None


def start(draw: Random) -> Forest:
    """A random start: everything somewhere, much of it on and in each other."""
    world = Forest(resting={("inside", "drawer_0", "cabinet_0")}, open={f for f in FIXTURES if draw.random() < 0.6})
    order = list(ITEMS)
    draw.shuffle(order)
    settled: list[str] = ["table_0", *FIXTURES]
    for name in order:
        place = draw.choice(settled + [other for other in settled if other in ITEMS])
        relation = "inside" if name in HOLDS.get(place, ()) and draw.random() < 0.8 else "ontop"
        world.resting.add((relation, name, place))
        if relation == "inside" and place in VESSELS and draw.random() < 0.2:
            world.resting.add(("ontop", name, place))
        settled.append(name)
    for _ in range(draw.randrange(3)):
        one, other = draw.sample(ITEMS, 2)
        world.beside["nextto", one, other] = True
    return world


def copied(world: Forest) -> Forest:
    """The same state, to be changed."""
    return Forest(set(world.resting), set(world.open), dict(world.beside), world.base, world.arm, world.hand)


def plan_from(draw: Random, world: Forest) -> tuple[list[Subtask], Forest]:
    """A random plan that mostly goes through, with the state at its end as far as it went."""
    world, plan = copied(world), list[Subtask]()
    for _ in range(draw.randrange(1, 7)):
        held = world.hand if world.hand in ITEMS else ""
        if held and draw.random() < 0.9:
            part = _putting(draw, world, held)
        elif draw.random() < 0.4:
            name = draw.choice([each for each in FIXTURES if draw.random() < 0.1 or not world.shut_in(each)])
            opens = name not in world.open
            wish, step = ("open", name), OPEN if opens else CLOSE
            part = Subtask(name, [(wish, not opens)], [(wish, opens)], [17, 1, 2, 3, step, 5, 6])
        else:
            part = _picking(draw, world)
        if draw.random() < 0.05:
            part.flow[draw.randrange(len(part.flow))] = draw.choice((1, 2, 3, 5, 6, 7, 13, 17))
        if not plan:
            world.base = part.target
        plan.append(part)
        for step in part.flow:
            if not can(world, part, step):
                return plan, world
            do(world, part, step)
    return plan, world


def _picking(draw: Random, world: Forest) -> Subtask:
    # What carries something is the more interesting.
    free = [each for each in ITEMS if not world.shut_in(each)]
    name = draw.choice([each for each in (free if free and draw.random() < 0.9 else ITEMS) for _ in world.load(each)])
    own = sorted(fact for fact in world.resting if fact[1] == name)
    init: list[Wish] = [(draw.choice(own), True)] if own else []
    goal: list[Wish] = [(("inside", name, "gripper"), True)]
    return Subtask(name, init, goal, [17, 1, 2, 3, *draw.choice(([7], [7, 6], [6], [13], [7, 1, 2, 6]))])


def _putting(draw: Random, world: Forest, held: str) -> Subtask:
    places = ["table_0", *FIXTURES, *ITEMS]
    if draw.random() < 0.9:
        places = [each for each in places if each not in world.load(held) and not world.shut_in(each)]
    place = draw.choice([each for each in places if each != held])
    shut = place in FIXTURES and place not in world.open and draw.random() < 0.9
    relation = "inside" if held in HOLDS.get(place, ()) and not shut and draw.random() < 0.8 else "ontop"
    goal: list[Wish] = [((relation, held, place), True)]
    flow = [18, *draw.choice(([13, 5], [7, 5], [5, 6], [13, 5, 6]))]
    return Subtask(held, [(("inside", held, "gripper"), True)], goal, flow, (relation, place))


def wishes(draw: Random, world: Forest, beside: Iterable[Fact]) -> list[Wish]:
    """A goal about the end: mostly what is so there, about things that others carry; perhaps about what is beside."""
    found: dict[Fact, bool] = {}
    if draw.random() < 0.1:
        found |= dict.fromkeys(beside, True)
    for _ in range(draw.randrange(1, 4)):
        name = draw.choice(ITEMS)
        places = [*sorted(world.around(name)), *FIXTURES, draw.choice(ITEMS)]
        fact = ("inside", name, draw.choice([each for each in places if each in HOLDS] or ["cabinet_0"]))
        if draw.random() < 0.2:
            fact = ("ontop", name, draw.choice(("table_0", *ITEMS)))
        truth = world.truth(fact)
        if fact[1] != fact[-1]:
            found[fact] = bool(truth) is (draw.random() < 0.85)
    return list(found.items())


def said(wish: Wish) -> str:
    """A literal as BDDL."""
    text = f"({' '.join(wish[0])})"
    return text if wish[1] else f"(not {text})"


PLACES: tuple[Fact, ...] = tuple(
    (relation, name, place)
    for name in ITEMS
    for place in THINGS
    for relation in ("ontop", "inside")
    if name != place and (relation == "ontop" or place in HOLDS or place == "tray_0")
)


def places(world: Forest) -> set[Fact]:
    """Everything that is so about what is where."""
    return world.resting | {("inside", name, place) for name in (*ITEMS, "drawer_0") for place in world.around(name)}


def possible(world: Forest, left_open: Iterable[Fact]) -> list[Forest]:
    """The states that differ from one at most in some facts about places, in which nothing carries itself."""
    given, facts = places(world), sorted(left_open)
    found: list[Forest] = []
    for values in product((False, True), repeat=len(facts)):
        true = {fact for fact, value in zip(facts, values, strict=True) if value}
        other = replace(copied(world), resting=given - set(facts) | true)
        below = {(thing, place) for _, thing, place in other.resting}
        for _ in ITEMS:
            below |= {(thing, lowest) for thing, place in below for upper, lowest in below if upper == place}
        if all(thing != place for thing, place in below) and places(other) == other.resting:
            found.append(other)
    return found


def scene_json(draw: Random, world: Forest, left_open: Iterable[Fact] = ()) -> dict[str, Any]:
    """The start as a scene: places and doors are known but for some facts; what follows is stated or left out."""
    unknown = set(left_open)
    facts = [*world.resting - unknown, *(("open", name) for name in world.open), *world.beside]
    facts += [fact for fact in sorted(places(world) - world.resting - unknown) if unknown or draw.random() < 0.3]
    objects = {
        name: {"category": category, "bbox_extent": list(box), "position": [1, 0, 0.5]}
        for name, (category, box) in THINGS.items()
    }
    closed = ["open"] if unknown else ["ontop", "inside", "open"]
    robot = {"position": [0, 0, 0], "yaw": 0.0, "scale": 1.0}
    texts = sorted(said((fact, True)) for fact in facts)
    texts += [said((fact, False)) for fact in PLACES if unknown and fact not in unknown and fact not in places(world)]
    return {"name": "small", "robot": robot, "objects": objects, "facts": texts, "closed": closed}


def task_json(plan: Iterable[Subtask], goal: list[Wish]) -> dict[str, Any]:
    """A plan as a task file has it."""
    return {"goal": _joined(goal), "sub_tasks": list(_subtasks(plan))}


def _subtasks(plan: Iterable[Subtask]) -> Iterator[dict[str, Any]]:
    for part in plan:
        yield {
            "target": part.target,
            "support_init": None,
            "support_goal": None if part.place is None else part.place[1],
            "init": _joined(part.init),
            "goal": _joined(part.goal),
            "flow": [{str(step): None} if step in (4, 19, 7, 13) else step for step in part.flow],
        }


def _joined(wishes_: list[Wish]) -> str:
    return f"(and {' '.join(map(said, wishes_))})"
