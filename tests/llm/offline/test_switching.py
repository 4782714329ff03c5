"""Wishes to switch things: how people say them, what they mean, and what is refused with the true reason."""

from __future__ import annotations

import pytest

import bddl
import llm
import oag
from llm.errors import QueryError

SCENE = oag.scene(
    objects={
        "microwave_0": "microwave",
        "oven_0": "oven",
        "dishwasher_0": "dishwasher",
        "table_0": "table",
        "mug_0": "mug",
        "apple_0": "apple",
        "refrigerator_0": "refrigerator",
    },
    facts=[
        "(has_button microwave_0)",
        "(not (toggled_on microwave_0))",
        "(has_knob oven_0)",
        "(not (toggled_on oven_0))",
        "(has_button dishwasher_0)",
        "(toggled_on dishwasher_0)",
        "(ontop mug_0 table_0)",
        "(ontop apple_0 table_0)",
    ],
    closed=["has_button", "has_knob", "toggled_on", "ontop", "inside", "open"],
    domain=oag.Domain.appliances(),
)
MICROWAVE, OVEN, DISHWASHER_OFF = "(toggled_on microwave_0)", "(toggled_on oven_0)", "(not (toggled_on dishwasher_0))"


def goal(query: str, scene: oag.Scene = SCENE) -> str:
    return bddl.format(llm.propose(query, scene).task.goal)


def refusal(query: str, scene: oag.Scene = SCENE) -> QueryError:
    with pytest.raises(QueryError) as found:
        llm.propose(query, scene)
    return found.value


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        ("press the button of the microwave", MICROWAVE),
        ("push the button on the microwave", MICROWAVE),
        ("Please press the microwave's button.", MICROWAVE),
        ("press the microwave button", MICROWAVE),
        ("turn on the microwave", MICROWAVE),
        ("could you switch the microwave on?", MICROWAVE),
        ("power on the microwave", MICROWAVE),
        ("turn on the oven", OVEN),
        ("turn the knob of the stove", OVEN),
        ("turn the oven knob", OVEN),
        ("rotate the dial on the oven", OVEN),
        ("turn the knob", OVEN),
        ("switch on oven_0", OVEN),
        ("switch the dishwasher off", DISHWASHER_OFF),
        ("turn off the dishwasher", DISHWASHER_OFF),
        ("flip the switch of the dishwasher", DISHWASHER_OFF),
        ("press the button of the dishwasher", DISHWASHER_OFF),
        ("turn on the oven and turn it off", "(not (toggled_on oven_0))"),
        ("turn the microwave and the oven on", f"(and {MICROWAVE} {OVEN})"),
        ("turn on the microwave and the oven", f"(and {MICROWAVE} {OVEN})"),
        ("turn on the oven, then turn off the dishwasher", f"(and {OVEN} {DISHWASHER_OFF})"),
    ],
)
def test_a_wish_to_switch_something_is_read(query: str, wanted: str) -> None:
    assert bddl.equivalent(SCENE.domain.formula(goal(query)), SCENE.domain.formula(wanted), SCENE.categories)


def test_it_is_part_of_longer_wishes() -> None:
    task = llm.propose("put the apple into the microwave, close it and turn it on", SCENE).task
    assert [subtask.target for subtask in task.subtasks][-1] == "microwave_0"
    last = [action.primitive.name for action in task.subtasks[-1].flow or ()]
    assert last == ["PRESS_ON", "RETREAT"]
    between = llm.propose("take the mug, turn off the dishwasher and put it on the oven", SCENE).task
    assert {bddl.format(atom) for atom in bddl.atoms(between.goal)} == {
        "(toggled_on dishwasher_0)",
        "(ontop mug_0 oven_0)",
    }


@pytest.mark.parametrize(
    ("query", "code", "words"),
    [
        ("turn on the mug", "affordance", "mug_0 has neither a button nor a knob"),
        ("press the table", "affordance", "table_0 has neither a button nor a knob"),
        ("switch on the fridge", "affordance", "refrigerator_0 has neither a button nor a knob"),
        ("turn the knob of the microwave", "affordance", "microwave_0 has a button and no knob"),
        ("press the button of the oven", "affordance", "oven_0 has a knob and no button"),
        ("press the button", "ambiguous-object", "microwave_0 or dishwasher_0"),
        ("turn on the dishwasher", "already-so", "dishwasher_0 is on already"),
        ("turn off the oven", "already-so", "oven_0 is off already"),
        ("turn on the radio", "unknown-object", "radio"),
        ("press the button of the microwave twice", "not-understood", "twice"),
        ("take the mug and turn on the oven", "hand-full", "the hand holds mug_0"),
    ],
)
def test_what_cannot_be_switched_is_refused_with_the_reason(query: str, code: str, words: str) -> None:
    found = refusal(query)
    assert found.code == code and words in str(found)


def test_a_refusal_offers_what_can_be_switched() -> None:
    assert '"switch on microwave_0"' in str(refusal("turn on the mug"))
    assert '"switch off dishwasher_0"' in str(refusal("press the button"))


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        ("open the microwave", "(open microwave_0)"),
        ("pick up the mug on the table", "(inside mug_0 gripper)"),
        ("take the mug off the table", "(inside mug_0 gripper)"),
        ("put the mug on the oven", "(ontop mug_0 oven_0)"),
    ],
)
def test_other_wishes_mean_what_they_meant(query: str, wanted: str) -> None:
    assert goal(query) == wanted


@pytest.mark.parametrize(
    "query", ["push the mug", "turn the mug upside down", "switch the mug and the dishwasher", "turn the mug", "press"]
)
def test_words_of_switching_do_nothing_else(query: str) -> None:
    assert refusal(query).code in ("unknown-action", "not-understood", "affordance")


@pytest.mark.parametrize("query", ["turn on the oven", "press the button of the oven", "switch the oven off"])
def test_where_nothing_can_be_switched_the_reason_is_that(query: str) -> None:
    plain = oag.scene(objects={"oven_0": "oven", "mug_0": "mug"}, facts=[], closed="all")
    found = refusal(query, plain)
    assert "the scene has no joint of that kind" in str(found)
