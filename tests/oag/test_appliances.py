"""The domain of appliances: plans with PRESS and TURN are proved, wrong ones refuted, and both are rechecked."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

import oag

FACTS = (
    "(has_button microwave_0)",
    "(has_knob oven_0)",
    "(not (toggled_on microwave_0))",
    "(toggled_on oven_0)",
    "(ontop mug_0 table_0)",
)


def home(*facts: str) -> oag.Scene:
    """Return a scene with a button that is off, and a knob that is on."""
    return oag.scene(
        objects={"microwave_0": "microwave", "oven_0": "oven", "table_0": "table", "mug_0": "mug"},
        facts=[*FACTS, *facts],
        closed=["has_button", "has_knob", "toggled_on", "ontop", "inside", "open"],
        domain=oag.Domain.appliances(),
    )


@pytest.mark.parametrize(
    "steps",
    [
        ["PRESS_ON microwave_0"],
        ["TURN_OFF oven_0", "PRESS_ON microwave_0"],
        ["PRESS_ON microwave_0", "PRESS_OFF microwave_0", "PRESS_ON microwave_0"],
        [oag.open("microwave_0"), "PRESS_ON microwave_0", oag.pick("mug_0")],
    ],
)
def test_right_plans_are_proved_and_rechecked(steps: Sequence[object]) -> None:
    report = oag.compose(oag.task(home(), goal="(toggled_on microwave_0)", steps=steps)).verify()
    assert report.verdict is oag.Verdict.PROVED
    assert oag.recheck(report.certificate)


@pytest.mark.parametrize(
    ("steps", "why"),
    [
        (["TURN_ON microwave_0"], "has_knob"),
        (["PRESS_OFF microwave_0"], "toggled_on"),
        (["PRESS_ON microwave_0", "PRESS_ON microwave_0"], "toggled_on"),
        (["PRESS_ON oven_0"], "has_button"),
        (["TURN_ON oven_0"], "toggled_on"),
        ([oag.pick("mug_0"), "PRESS_ON microwave_0"], "handempty"),
        (["TURN_OFF oven_0"], "toggled_on"),
        (["PRESS_ON microwave_0", "PRESS_OFF microwave_0"], "toggled_on"),
    ],
)
def test_wrong_plans_are_refuted_with_the_reason(steps: Sequence[object], why: str) -> None:
    report = oag.compose(oag.task(home(), goal="(toggled_on microwave_0)", steps=steps)).verify()
    assert report.verdict is oag.Verdict.REFUTED
    assert why in report.text()
    assert oag.recheck(report.certificate)


def test_goals_are_planned_by_what_a_thing_has() -> None:
    both = oag.plan(home(), "(and (toggled_on microwave_0) (not (toggled_on oven_0)))")
    assert both.task is not None
    flows = [str(action.primitive.name) for subtask in both.task.subtasks for action in subtask.flow or ()]
    assert {"PRESS_ON", "TURN_OFF"} <= {name.split()[0] for name in flows}
    nothing = oag.plan(home(), "(toggled_on table_0)")
    assert nothing.task is None and nothing.refusal is not None


def test_the_21_primitives_are_part_of_it_and_a_household_has_none_of_it() -> None:
    domain = oag.Domain.appliances()
    assert list(domain.rows) == ["PRESS_ON", "PRESS_OFF", "TURN_ON", "TURN_OFF"]
    assert domain.inherits and oag.Domain.from_json(domain.to_json()) == domain
    plain = oag.scene(objects={"oven_0": "oven"}, facts=["(toggled_on oven_0)"])
    assert plain.domain.built_in
    assert oag.plan(plain, "(not (toggled_on oven_0))").task is None


def test_what_can_be_switched_is_among_the_wishes() -> None:
    found = {(one.wish.kind, one.sentence) for one in oag.tasks(home(), ["switch-on", "switch-off"])}
    assert found == {("switch-on", "switch on the microwave"), ("switch-off", "switch off the oven")}
