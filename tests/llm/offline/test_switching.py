"""Wishes to switch things: how people say them, what they mean, and what is refused with the true reason."""

from __future__ import annotations

from dataclasses import replace

import pytest

import bddl
import llm
import oag
from llm.errors import QueryError
from llm.offline.lexicon import built_in
from llm.offline.planner import understand
from oag import SceneObject

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


@pytest.mark.parametrize("thing", ["mug", "microwave", "oven", "dishwasher"])
@pytest.mark.parametrize(
    "query",
    [
        "push the {}",
        "turn the {} upside down",
        "switch the {} and the table",
        "turn the {}",
        "turn the {} to the left",
        "turn the {} around",
        "turn the {} on the counter",
        "rotate the {}",
        "flip the {}",
        "twist the {}",
        "hit the {}",
        "tap the {}",
        "switch the {}",
        "press the {} to the right",
        "press the {} door",
        "press the door of the {}",
        "turn on the door of the {}",
        "press",
    ],
)
def test_words_of_switching_do_nothing_else(query: str, thing: str) -> None:
    codes = ("unknown-action", "not-understood", "affordance", "several-objects", "unknown-place")
    assert refusal(query.format(thing)).code in codes


@pytest.mark.parametrize(
    ("query", "words"),
    [
        ("turn the knob to the left", '"to the left" says which way'),
        ("turn the knob of the oven to the right", '"to the right" says which way'),
        ("press the microwave door", '"the microwave door" is a door'),
        ("rotate the oven", '"rotate" alone does not say'),
        ("press the start button of the microwave", '"start" says which button'),
        ("press the left button of the microwave", '"left" says which button'),
        ("press the microwave's buttons", "microwave_0 has one button"),
        ("turn the knobs", "oven_0 has one knob"),
        ("press three buttons", "which has 2"),
        ("press both buttons of the microwave", '"both buttons" counts them'),
        ("press the radio button", "radio"),
    ],
)
def test_words_that_say_more_than_on_or_off_are_no_less(query: str, words: str) -> None:
    assert words in str(refusal(query))


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        ("press the microwave", MICROWAVE),
        ("operate the oven", OVEN),
        ("toggle the dishwasher", DISHWASHER_OFF),
        ("press the microwave button and the dishwasher button", f"(and {MICROWAVE} {DISHWASHER_OFF})"),
        ("press the button of the microwave and the dishwasher", f"(and {MICROWAVE} {DISHWASHER_OFF})"),
        ("press the microwave button and the oven knob", f"(and {MICROWAVE} {OVEN})"),
        ("turn on the oven and the microwave button", f"(and {MICROWAVE} {OVEN})"),
        ("press the buttons of the microwave and the dishwasher", f"(and {MICROWAVE} {DISHWASHER_OFF})"),
        ("press both buttons", f"(and {MICROWAVE} {DISHWASHER_OFF})"),
        ("press all buttons", f"(and {MICROWAVE} {DISHWASHER_OFF})"),
        ("press the buttons", f"(and {MICROWAVE} {DISHWASHER_OFF})"),
        ("turn every knob", OVEN),
        ("turn off the dishwasher next to the door", DISHWASHER_OFF),
        ("press the push button of the microwave", MICROWAVE),
    ],
)
def test_parts_are_those_of_the_things_beside_them(query: str, wanted: str) -> None:
    assert bddl.equivalent(SCENE.domain.formula(goal(query)), SCENE.domain.formula(wanted), SCENE.categories)


def test_a_describing_word_of_a_part_is_left_out_with_a_note() -> None:
    meant = understand("press the red button of the microwave", SCENE, built_in())
    assert bddl.format(meant.goal) == MICROWAVE and '"red" changes nothing in the plan' in meant.notes


def test_a_thing_whose_name_has_a_word_of_switching_is_that_thing() -> None:
    scene = oag.scene(
        objects={"lamp_0": "lamp", "remote_control_0": "remote_control", "mug_0": "mug", "table_0": "table"}
        | {"shelf_0": "shelf"},
        facts=["(has_button lamp_0)", "(ontop remote_control_0 table_0)", "(ontop mug_0 shelf_0)"],
        closed=SCENE.closed,
        domain=SCENE.domain,
    )
    swapped = "(and (ontop remote_control_0 shelf_0) (ontop mug_0 table_0))"
    assert goal("switch the remote control and the mug", scene) == swapped
    assert goal("switch the places of the remote control and the mug", scene) == swapped


def lamp(key: str, y_m: float, category: str = "lamp") -> SceneObject:
    return SceneObject(key, category, "lamp_on_stem", (1.0, y_m, 0.9), (1, 0, 0, 0), (0.2, 0.2, 0.4), fixed=True)


LAMPS = oag.scene(
    objects={"lamp_0": lamp("lamp_0", 0.5), "lamp_1": lamp("lamp_1", -0.5), "mug_0": "mug", "table_0": "table"},
    facts=["(has_button lamp_0)", "(has_button lamp_1)", "(ontop mug_0 table_0)"],
    closed=SCENE.closed,
    domain=SCENE.domain,
)


@pytest.mark.parametrize("query", ["turn on the {} lamp's button", "turn the {} lamp on", "turn on the {} lamp"])
@pytest.mark.parametrize(("side", "lamp"), [("left", "lamp_0"), ("right", "lamp_1")])
def test_a_side_tells_like_things_apart(query: str, side: str, lamp: str) -> None:
    assert goal(query.format(side), LAMPS) == f"(toggled_on {lamp})"


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_refusal_repeats_the_side_that_was_said(side: str) -> None:
    found = refusal(f"turn on the {side} dishwasher")
    assert f"switch on {side} dishwasher" in str(found)


def test_a_lamp_is_a_light_unless_something_else_is_called_so() -> None:
    assert goal("switch on the left light", LAMPS) == "(toggled_on lamp_0)"
    assert goal("switch on the lights", LAMPS) == "(and (toggled_on lamp_0) (toggled_on lamp_1))"
    assert goal("flip the switch of the right light", LAMPS) == "(toggled_on lamp_1)"
    assert goal("pick up the light mug", LAMPS) == "(inside mug_0 gripper)"
    facts = (*LAMPS.facts, LAMPS.domain.formula("(has_button light_0)"))
    both = replace(LAMPS, objects={**LAMPS.objects, "light_0": lamp("light_0", 0.0, "light")}, facts=facts)
    assert goal("switch on the light", both) == "(toggled_on light_0)"


@pytest.mark.parametrize(
    "query", ["don't turn on the microwave", "move the oven switch", "switch the mug to the table", "press", "turn"]
)
def test_where_something_can_be_switched_nothing_says_that_there_is_no_joint(query: str) -> None:
    assert "joint" not in str(refusal(query)) and 'does not know "turn"' not in str(refusal(query))


def test_other_verbs_beyond_a_plan_keep_their_reason() -> None:
    assert "the scene has no joint of that kind" in str(refusal("unlock the microwave"))
    assert "nothing here pushes a thing" in str(refusal("push the microwave"))
    assert "nothing here turns a thing over" in str(refusal("turn the mug upside down"))


@pytest.mark.parametrize("query", ["turn on the oven", "press the button of the oven", "switch the oven off"])
def test_where_nothing_can_be_switched_the_reason_is_that(query: str) -> None:
    plain = oag.scene(objects={"oven_0": "oven", "mug_0": "mug"}, facts=[], closed="all")
    found = refusal(query, plain)
    assert "the scene has no joint of that kind" in str(found)
