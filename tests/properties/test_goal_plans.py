"""Plans for random goals are as short as those of an oracle that knows complete states only."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oag
from tests.bruteforce import Condition, Fact, Kinds, Part, World, act, added, allowed, meets
from tests.properties.formulas import text
from tests.properties.plans import (
    CATEGORIES,
    FACTS,
    FIXTURES,
    ITEMS,
    KINDS,
    RESTING_FACTS,
    closing,
    opening,
    picking,
    placing,
    scene_of,
)

MOST_STEPS = 5
WORLD_KINDS = Kinds(KINDS.items, KINDS.fixtures, tuple(CATEGORIES.items()))
HELD: tuple[Fact, ...] = tuple(("inside", item, "gripper") for item in ITEMS)
# Everything that a robot may do with these objects, one subtask each.
PARTS: tuple[Part, ...] = (
    *map(opening, FIXTURES),
    *map(closing, FIXTURES),
    *(picking(fact[1], fact) for fact in RESTING_FACTS),
    *(placing(fact[1], fact[0], fact[2]) for fact in RESTING_FACTS),
    *(
        Part(item, None, ((held, False),), ((held, True),), (17, 1, 2, 3, 7, 6))
        for item, held in zip(ITEMS, HELD, strict=True)
    ),
)


@st.composite
def conditions(draw: st.DrawFn, depth: int = 2) -> Condition:
    word = draw(
        st.sampled_from(("literal", "forall", "exists", "forn", "and", "or", "imply") if depth else ("literal",))
    )
    if word == "literal":
        return draw(st.sampled_from((*FACTS, *HELD))), draw(st.booleans())
    if word in ("and", "or", "imply"):
        return word, draw(conditions(depth - 1)), draw(conditions(depth - 1))
    number = (draw(st.integers(0, 2)),) if word == "forn" else ()
    category = draw(st.sampled_from(("cup", "apple", "fridge", "object")))
    fact = draw(st.sampled_from([fact for fact in FACTS if category == "object" or CATEGORIES[fact[1]] == category]))
    return (word, *number, "?x", category, ((fact[0], "?x", *fact[2:]), draw(st.booleans())))


@st.composite
def starts(draw: st.DrawFn) -> World:
    true = frozenset[Fact](draw(st.sets(st.sampled_from([("open", f) for f in FIXTURES]))))
    held = draw(st.sampled_from((None, None, None, *ITEMS)))
    for item in ITEMS:
        place = draw(st.sampled_from((None, *(f for f in RESTING_FACTS if f[1] == item))))
        if place is not None and item != held:
            true = added(true, place)
    return World(true, arm=("home", ""), hand=held)


def shortest(start: World, goal: Condition) -> int | None:
    """The least number of subtasks after which a goal holds, up to a few."""
    seen, layer = {(start.true, start.hand)}, [start]
    for length in range(MOST_STEPS + 1):
        if any(meets(world, goal, WORLD_KINDS) for world in layer):
            return length
        following = []
        for world in layer:
            for part in PARTS:
                after = _done(world, part)
                if after is not None and (after.true, after.hand) not in seen:
                    seen.add((after.true, after.hand))
                    following.append(after)
        layer = following
    return None


def _done(world: World, part: Part) -> World | None:
    if not all(meets(world, condition, KINDS) for condition in part.init):
        return None
    for action in part.flow:
        if not allowed(world, part, action, KINDS):
            return None
        world = act(world, part, action, KINDS)
    return world if all(meets(world, condition, KINDS) for condition in part.goal) else None


def scene_at(world: World) -> oag.Scene:
    facts = [f"({' '.join(fact)})" for fact in sorted(world.true)]
    facts += [] if world.hand is None else [f"(inside {world.hand} gripper)"]
    return scene_of(CATEGORIES, KINDS, facts, ("ontop", "inside", "open"))


def check_plan(start: World, goal: Condition) -> None:
    made, least = oag.plan(scene_at(start), text(goal)), shortest(start, goal)
    if made.task is None:
        assert least is None, f"refused ({made.refusal}), and {least} subtasks reach it"
        return
    assert made.report
    assert least is None or len(made.task.subtasks) <= least


@given(starts(), conditions())
@settings(max_examples=30, deadline=None)
def test_a_plan_is_found_where_one_exists_and_is_shortest(start: World, goal: Condition) -> None:
    check_plan(start, goal)


@pytest.mark.slow
@given(starts(), conditions())
@settings(max_examples=600, deadline=None)
def test_so_at_length(start: World, goal: Condition) -> None:
    check_plan(start, goal)


@given(starts(), starts(), conditions())
@settings(max_examples=20, deadline=None)
def test_a_repair_is_proved_and_never_longer_in_edits_than_a_new_plan(
    start: World, other: World, goal: Condition
) -> None:
    made, again = oag.plan(scene_at(start), text(goal)), oag.plan(scene_at(other), text(goal))
    if made.task is None:
        return
    mended = oag.repair(made.task, scene_at(other))
    assert bool(mended) is bool(again)
    if mended.task is not None and again.task is not None:
        assert mended.report and mended.edits <= len(again.task.subtasks) <= len(mended.task.subtasks)
    rest = oag.repair(made.task, scene_at(start))
    assert rest.task is not None and rest.edits == 0
    assert replace(rest.task, scene=None).subtasks == made.task.subtasks
