"""Random small worlds and plans, in the form of the oracle and as the package's own scenes and tasks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from hypothesis import strategies as st

import oag
from tests.bruteforce import Action, Fact, Kinds, Literal, Part, World, added, completions, consistent, following, split

ITEMS = ("cup_0", "apple_0")
FIXTURES = ("fridge_0", "cabinet_0")
SURFACES = ("table_0",)
HOLLOW = (*FIXTURES, "cup_0")
CATEGORIES = {"cup_0": "cup", "apple_0": "apple", "fridge_0": "fridge", "cabinet_0": "cabinet", "table_0": "table"}
KINDS = Kinds(frozenset(ITEMS), frozenset(FIXTURES))
OPEN_FACTS: tuple[Fact, ...] = tuple(("open", fixture) for fixture in FIXTURES)
RESTING_FACTS: tuple[Fact, ...] = tuple(
    (relation, item, support)
    for item in ITEMS
    for relation, supports in (("ontop", (*SURFACES, *FIXTURES, *ITEMS)), ("inside", HOLLOW))
    for support in supports
    if support != item
)
FACTS: tuple[Fact, ...] = (*OPEN_FACTS, *RESTING_FACTS)
# Places whose converse is not ruled out by the kinds of things; a step may write either of the two.
CROSSED: tuple[Fact, ...] = (
    ("ontop", "cup_0", "apple_0"),
    *(("ontop", item, fixture) for item in ITEMS for fixture in FIXTURES),
    *(("inside", "cup_0", fixture) for fixture in FIXTURES),
)
MOVES = (1, 2, 3, 4, 5, 6, 7, 9, 13, 17, 18, 19, 20)


@dataclass(frozen=True)
class Case:
    """A plan with what is known at its start; `unknown` lists the facts that are not.

    Of a predicate in `closed`, only what holds is stated in the scene.
    """

    known: dict[Fact, bool]
    unknown: tuple[Fact, ...]
    parts: tuple[Part, ...]
    goal: tuple[Literal, ...]
    closed: tuple[str, ...] = ()

    def starts(self) -> list[World]:
        """Every complete start state."""
        return list(completions(self.known, self.unknown, self.parts[0].target if self.parts else None))

    @property
    def loose(self) -> bool:
        """Whether it is open what carries what: then an answer may be left open that the oracle has."""
        carrying = any(fact[2] in ITEMS and self.known.get(fact) is not False for fact in RESTING_FACTS)
        carrying = carrying or any(part.place is not None and part.place[1] in ITEMS for part in self.parts)
        # A condition may ask for furniture on an item, of which no start says anything.
        asked = {fact for part in self.parts for fact, _ in (*part.init, *part.goal)}
        heaped = any(fact[-1] in ITEMS and fact[1] not in ITEMS for fact in asked)
        return heaped or (carrying and any(fact[0] in ("ontop", "inside") for fact in self.unknown))

    def scene(self) -> oag.Scene:
        """The same start as a scene."""
        stated = {fact: value for fact, value in self.known.items() if value or fact[0] not in self.closed}
        return scene_of(CATEGORIES, KINDS, map(literal_text, stated.items()), self.closed)

    def task(self) -> oag.Task:
        """The same plan as a task."""
        return oag.Task.from_json(self.task_json(), scene=self.scene())

    def task_json(self) -> dict[str, object]:
        """The plan as a task file has it."""
        return json_of(self.parts, self.goal, conjunction)


# Large enough for anything else, and for each other.
_SIZES = {"cup": [0.12, 0.12, 0.12]}


def scene_of(
    categories: Mapping[str, str], kinds: Kinds, facts: Iterable[str], closed: Iterable[str] = ()
) -> oag.Scene:
    """A scene of objects of these categories, in which the facts hold."""
    objects = {
        name: {
            "category": category,
            "bbox_extent": _SIZES.get(category, [0.05, 0.05, 0.1]) if name in kinds.items else [0.6, 0.6, 1.0],
        }
        for name, category in categories.items()
    }
    return oag.Scene.from_json({"name": "small", "objects": objects, "facts": list(facts), "closed": list(closed)})


def json_of(
    parts: tuple[Part, ...], goal: tuple[Any, ...], said: Callable[[tuple[Any, ...]], str]
) -> dict[str, object]:
    """A plan as a task file has it; `said` gives conditions as BDDL."""
    subtasks = [
        {
            "target": part.target,
            "support_init": None,
            "support_goal": part.support,
            "init": said(part.init),
            "goal": said(part.goal),
            "flow": [_json_action(*split(action)) for action in part.flow],
        }
        for part in parts
    ]
    return {"goal": said(goal), "sub_tasks": subtasks}


def _json_action(number: int, parameter: Any) -> object:
    """A primitive with its number as a task file has it."""
    if parameter is None and ((number < 7 and number != 4) or number in (17, 18)):
        return number
    return {str(number): list(parameter) if isinstance(parameter, tuple) else parameter}


def literal_text(literal: Literal) -> str:
    """A literal as BDDL."""
    fact, wanted = literal
    text = f"({' '.join(fact)})"
    return text if wanted else f"(not {text})"


def conjunction(literals: tuple[Literal, ...]) -> str:
    """Literals as one BDDL formula."""
    return f"(and {' '.join(map(literal_text, literals))})" if literals else "(and)"


def opening(fixture: str) -> Part:
    return Part(fixture, None, ((("open", fixture), False),), ((("open", fixture), True),), (17, 1, 2, 3, 4, 5))


def closing(fixture: str) -> Part:
    return Part(fixture, None, ((("open", fixture), True),), ((("open", fixture), False),), (17, 1, 2, 3, 19, 5))


def picking(item: str, resting: Fact) -> Part:
    flow = (17, 1, 2, 3, 7, 6) if resting[0] == "inside" else (17, 1, 2, 3, 7)
    return Part(item, None, ((resting, True),), ((resting, False),), flow)


def placing(item: str, relation: str, support: str) -> Part:
    held: Literal = (("inside", item, "gripper"), True)
    return Part(item, support, (held,), (((relation, item, support), True),), (18, 13, 9, 5))


@st.composite
def parts(draw: st.DrawFn) -> Part:
    """One subtask from a template, its flow perhaps damaged."""
    item, fixture = draw(st.sampled_from(ITEMS)), draw(st.sampled_from(FIXTURES))
    other = draw(st.sampled_from([name for name in (*FIXTURES, *SURFACES, *ITEMS) if name != item]))
    relation = draw(st.sampled_from(("ontop", "inside") if other in HOLLOW else ("ontop",)))
    resting = draw(st.sampled_from([fact for fact in RESTING_FACTS if fact[1] == item]))
    part = draw(
        st.sampled_from((opening(fixture), closing(fixture), picking(item, resting), placing(item, relation, other)))
    )
    return replace(part, flow=draw(flows(part)))


@st.composite
def flows(draw: st.DrawFn, part: Part) -> tuple[Action, ...]:
    """A subtask's flow, in three of four cases as the template has it."""
    flow: list[Action] = list(part.flow)
    for _ in range(draw(st.sampled_from((0, 0, 0, 1)))):
        index = draw(st.integers(0, len(flow) - 1))
        change = draw(st.sampled_from(("drop", "insert", "replace")))
        if change == "drop":
            del flow[index]
        else:
            move: Action = draw(st.sampled_from([m for m in MOVES if legal(m, part)]))
            if draw(st.booleans()):
                move = numbered(move, draw(st.integers(0, 3)))
            flow[index : index + (change == "replace")] = [move]
    return tuple(flow[:6])


def numbered(move: int, which: int) -> Action:
    """A primitive with a number where it takes one: two that move nothing or leave a door as it must not be, first."""
    if move in (4, 19):
        return move, ((0.0, 0.0), (0.5, 0.9), (0.0, 0.6), (0.02, 0.02))[which]
    return (move, (0.0, 0.3)[which % 2]) if move in (7, 9, 13, 20) else move


def legal(move: int, part: Part) -> bool:
    """Whether a primitive is well formed in a subtask at all."""
    return not (move == 18 and part.support is None) and not (move in (4, 19) and part.target not in FIXTURES)


def carrying(item: str, resting: Fact, support: str, relation: str) -> tuple[Part, ...]:
    """A whole plan: open what has to be open, pick, place, close."""
    doors = dict.fromkeys(name for name in (resting[2], support) if name in FIXTURES)
    core = (picking(item, resting), placing(item, relation, support))
    return (*map(opening, doors), *core, *map(closing, doors))[:4]


@st.composite
def sequences(draw: st.DrawFn) -> tuple[Part, ...]:
    """One to four subtasks: a sensible plan, perhaps with a subtask dropped or swapped, or any subtasks."""
    if draw(st.integers(0, 3)) == 0:
        return tuple(draw(st.lists(parts(), min_size=1, max_size=3)))
    item = draw(st.sampled_from(ITEMS))
    resting = draw(st.sampled_from([fact for fact in RESTING_FACTS if fact[1] == item]))
    support = draw(st.sampled_from([name for name in (*FIXTURES, *SURFACES) if name != resting[2]]))
    plan = list(carrying(item, resting, support, "inside" if support in FIXTURES else "ontop"))
    index = draw(st.integers(0, len(plan) - 1))
    change = draw(st.sampled_from(("none", "none", "drop", "swap", "damage")))
    if change == "drop":
        del plan[index]
    elif change == "swap":
        plan[index], plan[index - 1] = plan[index - 1], plan[index]
    elif change == "damage":
        plan[index] = replace(plan[index], flow=draw(flows(plan[index])))
    return tuple(plan)


@st.composite
def cases(draw: st.DrawFn, most_unknown: int = 5) -> Case:
    """A plan with a start that mostly suits it, some of it unknown."""
    plan = draw(sequences())
    truths = dict.fromkeys(FACTS, False)
    for part in reversed(plan):
        for fact, value in part.init:
            if fact in truths and (fact[0] == "open" or value) and draw(st.integers(0, 5)) > 0:
                truths[fact] = value
    true = frozenset[Fact]()
    for fact in (fact for fact, value in truths.items() if value):
        true = added(true, fact)
    truths = {fact: fact in true for fact in truths}
    unknown = draw(st.sets(st.sampled_from(FACTS), max_size=most_unknown))
    known = {fact: value for fact, value in truths.items() if fact not in unknown}
    ends = [literal for part in plan[-2:] for literal in part.goal]
    goal = tuple(draw(st.lists(st.sampled_from(ends), max_size=2, unique=True)))
    if not satisfiable(goal):
        goal = goal[:1]
    open_predicates = {fact[0] for fact in unknown}
    closed = [name for name in ("inside", "ontop", "open") if name not in open_predicates and draw(st.booleans())]
    return Case(known, tuple(sorted(unknown)), plan, goal, tuple(closed))


@st.composite
def crossed_cases(draw: st.DrawFn) -> Case:
    """A plan that asks, in one condition or in two, for a thing on or in another and not the other way round.

    What it asks for is unknown at first, and what it denies may be written by a step, or follow from what is assumed.
    """
    case = draw(cases(most_unknown=3))
    relation, item, support = draw(st.sampled_from(CROSSED))
    wanted, denied = draw(st.permutations(((relation, item, support), (relation, support, item))))
    unknown = {*case.unknown, wanted, *draw(st.sets(st.just(denied)))}
    literals: tuple[Literal, ...] = ((denied, False), (wanted, True))
    plan = list(case.parts)
    for group in (literals,) if draw(st.booleans()) else ((literal,) for literal in literals):
        index = draw(st.integers(0, len(plan) - 1))
        if draw(st.booleans()):
            plan[index] = replace(plan[index], init=(*plan[index].init, *group))
        else:
            plan[index] = replace(plan[index], goal=(*plan[index].goal, *group))
    known = {fact: value for fact, value in case.known.items() if fact not in unknown}
    closed = tuple(name for name in case.closed if name != relation)
    return Case(known, tuple(sorted(unknown)), tuple(plan), case.goal, closed)


def satisfiable(goal: tuple[Literal, ...]) -> bool:
    """Whether a goal of at most two literals can be true in some state."""
    true = frozenset(fact for fact, wanted in goal if wanted)
    denied = {fact for fact, wanted in goal if not wanted}
    whole = following(true)
    return len({fact for fact, _ in goal}) == len(goal) and denied.isdisjoint(whole) and consistent(World(whole))


@st.composite
def complete_states(draw: st.DrawFn, part: Part | None = None) -> World:
    """Any complete state that the invariants allow; near a subtask's objects when one is given."""
    true = frozenset[Fact]()
    for fact in sorted(draw(st.sets(st.sampled_from(FACTS), max_size=6))):
        true = added(true, fact)
    names: tuple[str, ...] = (*ITEMS, *FIXTURES, *SURFACES)
    hands: tuple[str | None, ...] = (None, *ITEMS, *FIXTURES)
    if part is not None and draw(st.integers(0, 3)) > 0:
        names = (part.target, part.support or part.target)
        hands = (None, part.target)
    return World(
        true,
        base=draw(st.sampled_from(names)),
        arm=(draw(st.sampled_from(("before", "at"))), draw(st.sampled_from(names))),
        hand=draw(st.sampled_from(hands)),
    )


@st.composite
def situations(draw: st.DrawFn) -> tuple[World, Part]:
    """A complete state and a subtask that is under way in it."""
    part = draw(parts())
    return draw(complete_states(part)), part
