"""Sentences near to readable ones that mean something else: they are refused, or read for what they say."""

from __future__ import annotations

import pytest

import llm
from oag import Scene
from tests.llm.kitchens import SCENES, conjuncts

FLAT = SCENES["flat"]


@pytest.mark.parametrize(
    ("query", "code"),
    [
        # Going is not moving what was put down before.
        ("put the apple in the fridge and return to the table", "not-understood"),
        ("put the can in the bin, then move on to the sofa", "not-understood"),
        ("open the safe, put the keys in and return to the table", "not-understood"),
        ("open the safe and then place the keys inside and carry on to the sofa", "not-understood"),
        ("put the can on the sofa and put in the bin", "not-understood"),
        ("pick up the can and move onto the sofa", "not-understood"),
        # Two things stay two.
        ("put the big and small box on the table", "unknown-object"),
        ("throw the big and small box away", "unknown-object"),
        ("put the red and blue mug on the sofa", "unknown-object"),
        # "With" is together with, too.
        ("put the red mug with the salt on the counter", "ambiguous-reading"),
        ("put the red mug with plate_1 on the counter", "ambiguous-reading"),
        ("put a mug with a mug on the counter", "ambiguous-reading"),
        ("put the remote with the keys on the table", "ambiguous-reading"),
        ("put the bowl on the counter with the apple", "ambiguous-reading"),
        ("put the apple on the plate with the plate", "ambiguous-object"),
        # Where to, or which one.
        ("throw the remote on the sofa", "unknown-action"),
        ("throw the apple in the safe", "unknown-action"),
        ("pick up the mug at the edge of the table", "ambiguous-object"),
        ("find the fridge and put it on the table", "not-understood"),
        ("find the sofa and the table and put the can on it", "not-understood"),
        ("find the apple and open the fridge", "unknown-action"),
        ("I want the mugs off the table", "already-so"),
        ("put the head of lettuce on the counter", "unknown-object"),
    ],
)
def test_what_may_mean_something_else_is_refused(query: str, code: str) -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(query, FLAT)
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("query", "goal"),
    [
        ("put the apple in the fridge, return to the sofa and pick up the remote", "(inside apple_0 refrigerator_0)"),
        ("pick up the can, move to the fridge and put in the fridge", "(inside can_0 refrigerator_0)"),
        ("pick up the can and carry to the sofa", "(ontop can_0 sofa_0)"),
        ("put the yellow and white apple in the bowl", "(inside apple_0 bowl_0)"),
        ("put the bowl with salt on the sofa", "(inside salt_shaker_0 bowl_0)"),
        ("put the bowl containing the apple on the sofa", "(inside apple_0 bowl_0)"),
        ("put the red mug at the edge of the table in the fridge", "(inside mug_0 refrigerator_0)"),
        ("put the can in the corner of the table", "(ontop can_0 table_0)"),
        ("put the keys in the corner of the safe", "(inside key_chain_1 safe_0)"),
        ("find the safe and open it", "(open safe_0)"),
        ("find the bowl and the apple, and put the apple in the bowl", "(inside apple_0 bowl_0)"),
        ("I want the remote from the sofa", "(ontop remote_control_0 table_0)"),
        ("throw the can on the armchair away", "(inside can_0 garbage_can_0)"),
    ],
)
def test_what_says_one_thing_is_read(query: str, goal: str) -> None:
    assert goal in conjuncts(llm.propose(query, FLAT).task.goal)


def test_a_colour_that_names_a_thing_is_one_of_two() -> None:
    table = {"category": "table", "position": [1.0, 0.0, 0.3], "bbox_extent": [0.6, 1.4, 0.6]}
    counter = {"category": "countertop", "position": [0.0, 2.0, 0.45], "bbox_extent": [1.6, 0.6, 0.9]}
    items = {
        f"{kind}_0": {"category": kind, "position": [1.0, y_m, 0.65], "bbox_extent": [0.05, 0.05, 0.06]}
        for kind, y_m in (("orange", 0.0), ("egg", 0.3))
    }
    objects = {"table_0": table, "countertop_0": counter, **items}
    facts = [f"(ontop {key} table_0)" for key in items]
    scene = Scene.from_json({"name": "fruit", "objects": objects, "facts": facts, "closed": ["ontop"]})
    goal = conjuncts(llm.propose("put the orange and white egg on the counter", scene).task.goal)
    assert goal == {"(ontop orange_0 countertop_0)", "(ontop egg_0 countertop_0)"}


def test_both_meanings_of_with_are_suggested() -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose("put the bowl with the apple on the counter", FLAT)
    together, within = caught.value.suggestions
    assert llm.propose(together, FLAT).expanded.task_name == together
    assert llm.propose(within, FLAT).expanded.task_name == within
