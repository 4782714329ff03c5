"""Random plans whose conditions go beyond literals, in the form of the oracle and as the package's own tasks.

Three items, two of a category, two fixtures of a category, and a surface; whether items are beside each other is said
of some pairs, and carrying one leaves it open.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from hypothesis import strategies as st

import oag
from tests.bruteforce import Condition, Fact, Kinds, Part, World, completions
from tests.bruteforce import added as added_to
from tests.properties.plans import closing, json_of, opening, picking, placing, scene_of

CUPS = ("cup_0", "cup_1")
ITEMS = (*CUPS, "apple_0")
FIXTURES = ("fridge_0", "fridge_1")
SURFACES = ("table_0",)
CATEGORIES = {
    "cup_0": "cup",
    "cup_1": "cup",
    "apple_0": "apple",
    "fridge_0": "fridge",
    "fridge_1": "fridge",
    "table_0": "table",
}
BESIDE: tuple[Fact, ...] = (("nextto", "cup_0", "apple_0"), ("nextto", "cup_1", "apple_0"))
KINDS = Kinds(frozenset(ITEMS), frozenset(FIXTURES), tuple(CATEGORIES.items()), BESIDE)
RESTING: tuple[Fact, ...] = tuple(
    (relation, item, support)
    for item in ITEMS
    for relation, supports in (("ontop", (*SURFACES, *FIXTURES, *ITEMS)), ("inside", (*FIXTURES, *CUPS)))
    for support in supports
    if support != item
)
DOORS: tuple[Fact, ...] = tuple(("open", fixture) for fixture in FIXTURES)
FACTS: tuple[Fact, ...] = (*DOORS, *RESTING, *BESIDE)


@dataclass(frozen=True)
class FormulaCase:
    """A plan with what is known at its start; `unknown` lists the facts that are not, all others are stated."""

    known: dict[Fact, bool]
    unknown: tuple[Fact, ...]
    parts: tuple[Part, ...]
    goal: tuple[Condition, ...]

    @property
    def loose(self) -> bool:
        """Whether it is open what carries what: then an answer may be left open that the oracle has."""
        carrying = any(fact[2] in ITEMS and self.known.get(fact) is not False for fact in RESTING)
        carrying = carrying or any(part.place is not None and part.place[1] in ITEMS for part in self.parts)
        return carrying and any(fact[0] in ("ontop", "inside") for fact in self.unknown)

    def starts(self) -> list[World]:
        """Every complete start state."""
        return list(completions(self.known, self.unknown, self.parts[0].target))

    def scene(self) -> oag.Scene:
        """The same start as a scene."""
        return scene_of(CATEGORIES, KINDS, map(text, self.known.items()))

    def task(self) -> oag.Task:
        """The same plan as a task."""
        return oag.Task.from_json(json_of(self.parts, self.goal, joined), scene=self.scene())


def text(condition: Condition) -> str:
    """A literal or a formula as BDDL; names with a question mark are variables in both."""
    word, *parts = condition
    if isinstance(word, tuple):
        said = f"({' '.join(word)})"
        return said if parts[0] else f"(not {said})"
    if word in ("and", "or", "not", "imply"):
        return f"({' '.join((word, *map(text, parts)))})"
    number = [f"({parts.pop(0)})"] if word in ("forn", "fornpairs") else []
    *binders, body = parts
    variables = [f"({name} - {category})" for name, category in zip(binders[::2], binders[1::2], strict=True)]
    return f"({' '.join((word, *number, *variables, text(body)))})"


def joined(conditions: tuple[Condition, ...]) -> str:
    """Conditions as one BDDL formula."""
    return f"(and {' '.join(map(text, conditions))})" if conditions else "(and)"


@st.composite
def conditions(draw: st.DrawFn, facts: tuple[Fact, ...] = FACTS, depth: int = 2) -> Condition:
    """A formula of a few operators over some facts and over all objects of a category."""
    word = draw(st.sampled_from(("literal", "quantifier", "or", "and", "imply", "not") if depth else ("literal",)))
    if word == "literal":
        return draw(st.sampled_from(facts)), draw(st.booleans())
    if word == "quantifier":
        return draw(quantified())
    parts = [draw(conditions(facts, depth - 1)) for _ in range(1 if word == "not" else 2)]
    return (word, *parts)


@st.composite
def either_way(draw: st.DrawFn, facts: tuple[Fact, ...]) -> Condition:
    """A formula that holds either way, though its parts may be unknown; perhaps only by the invariants."""
    one, other = draw(conditions(facts)), draw(conditions(facts))
    relation, above, below = draw(st.sampled_from([fact for fact in RESTING if fact[2] in ITEMS]))
    return draw(
        st.sampled_from(
            (
                ("or", one, ("not", one)),
                ("imply", ("and", one, other), one),
                ("imply", one, ("or", other, one)),
                ("not", ("and", ((relation, above, below), True), ((relation, below, above), True))),
                (
                    "forall",
                    "?x",
                    "cup",
                    ("forall", "?y", "cup", ("imply", (("ontop", "?x", "?y"), True), (("ontop", "?y", "?x"), False))),
                ),
                ("forall", "?x", "cup", (("inside", "?x", "?x"), False)),
            )
        )
    )


@st.composite
def quantified(draw: st.DrawFn) -> Condition:
    """A quantifier over cups or fridges, perhaps one inside another, or over what cannot be open or have an inside."""
    word = draw(st.sampled_from(("forall", "exists", "forn", "forpairs", "fornpairs")))
    number = (draw(st.integers(0, 2)),) if word in ("forn", "fornpairs") else ()
    if word in ("forpairs", "fornpairs"):
        second = draw(st.sampled_from(("cup", "fridge", "apple")))
        body = draw(bodies(second))
        return (word, *number, "?x", "cup", "?y", second, body)
    if draw(st.booleans()):
        category = draw(st.sampled_from(("fridge", "fridge", "cup", "table", "object")))
        return (word, *number, "?x", category, (("open", "?x"), draw(st.booleans())))
    if draw(st.booleans()):
        inner = draw(st.sampled_from(("forall", "exists")))
        second = draw(st.sampled_from(("cup", "fridge", "apple", "table", "object")))
        return (word, *number, "?x", "cup", (inner, "?y", second, draw(bodies(second))))
    return (word, *number, "?x", "cup", draw(bodies(None)))


@st.composite
def bodies(draw: st.DrawFn, second: str | None) -> Condition:
    """A literal, or two joined, about the variables x and, of a second category, y."""
    choices: list[Fact] = [("ontop", "?x", "table_0"), ("inside", "?x", "fridge_0"), ("ontop", "?x", "apple_0")]
    if second is not None:
        choices = [("ontop", "?x", "?y"), ("inside", "?x", "?y")]
    if second == "apple":
        choices.append(("nextto", "?x", "?y"))
    one, other = draw(st.sampled_from(choices)), draw(st.sampled_from(choices))
    left, right = (one, draw(st.booleans())), (other, draw(st.booleans()))
    return draw(st.sampled_from((left, left, ("or", left, right), ("and", left, right))))


@st.composite
def plans(draw: st.DrawFn) -> tuple[Part, ...]:
    """A plan that moves an item, its doors seen to, perhaps without one of its subtasks or steps."""
    item = draw(st.sampled_from(ITEMS))
    resting = draw(st.sampled_from([fact for fact in RESTING if fact[1] == item]))
    support = draw(st.sampled_from([name for name in (*FIXTURES, *SURFACES) if name != resting[2]]))
    doors = [name for name in dict.fromkeys((resting[2], support)) if name in FIXTURES]
    relation = "inside" if support in FIXTURES else "ontop"
    plan = [*map(opening, doors), picking(item, resting), placing(item, relation, support), *map(closing, doors)][:4]
    change = draw(st.sampled_from(("none", "none", "none", "subtask", "step", "only")))
    index = draw(st.integers(0, len(plan) - 1))
    if change == "subtask" and len(plan) > 1:
        del plan[index]
    elif change == "step":
        flow = plan[index].flow
        cut = draw(st.integers(0, len(flow) - 1))
        plan[index] = replace(plan[index], flow=(*flow[:cut], *flow[cut + 1 :]))
    elif change == "only":
        plan = [plan[index]]
    return tuple(plan)


@st.composite
def formula_cases(draw: st.DrawFn, most_unknown: int = 6) -> FormulaCase:
    """A plan some of whose conditions are formulas, with a start that mostly suits it and is known in part."""
    plan = list(draw(plans()))
    truths = dict.fromkeys(FACTS, False)
    for part in reversed(plan):
        for fact, value in part.init:
            if fact in truths and draw(st.integers(0, 7)) > 0:
                truths[fact] = value
    likely = [fact for part in plan for fact, _ in (*part.init, *part.goal) if fact in truths]
    size = draw(st.integers(0, most_unknown))
    candidates = st.one_of(st.sampled_from(FACTS), st.sampled_from(likely or FACTS))
    unknown = set(draw(st.lists(candidates, min_size=size, max_size=size)))
    # Conditions mostly speak of what is unknown, or else three-valued evaluation would do.
    interesting = tuple(sorted(unknown)) or FACTS
    for _ in range(draw(st.integers(0, 3))):
        index, where = draw(st.integers(0, len(plan) - 1)), draw(st.sampled_from(("init", "goal")))
        added = draw(st.one_of(conditions(interesting), either_way(interesting)))
        if where == "init":
            plan[index] = replace(plan[index], init=(*plan[index].init, added))
        else:
            plan[index] = replace(plan[index], goal=(*plan[index].goal, added))
    goal = tuple(draw(st.lists(st.one_of(conditions(interesting), either_way(interesting)), max_size=2)))
    true = frozenset[Fact]()
    for fact in (fact for fact, value in truths.items() if value):
        true = added_to(true, fact)
    known = {fact: fact in true for fact in truths if fact not in unknown}
    return FormulaCase(known, tuple(sorted(unknown)), tuple(plan), goal)
