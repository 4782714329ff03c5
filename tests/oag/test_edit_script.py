"""The edits between two decompositions: they make one of the other, and no shorter ones do."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import oag
from oag.edit_script import edit_script
from oag.normal_form import content

SCENE = oag.scene(
    {"drawer_0": "drawer", "drawer_1": "drawer", "apple_0": "apple", "table_0": "table"},
    ["(ontop apple_0 table_0)"],
    "all",
)
STEPS = st.sampled_from(
    [
        oag.open("drawer_0"),
        oag.open("drawer_1"),
        oag.close("drawer_0"),
        oag.pick("apple_0"),
        oag.place("apple_0", inside="drawer_0"),
        oag.place("apple_0", ontop="table_0"),
    ]
)
GOALS = st.sampled_from(["(open drawer_0)", "(inside apple_0 drawer_0)"])


@st.composite
def plans(draw: st.DrawFn) -> oag.Task:
    """Any steps in any order: plans need not work to be compared."""
    made = oag.task(SCENE, steps=draw(st.lists(STEPS, max_size=5)), goal=draw(GOALS))
    return replace(made, scales=draw(st.sampled_from([{}, {"apple_0": 0.5}])))


def rows(task: oag.Task, *, flows: bool) -> list[str]:
    return [str({k: v for k, v in content(subtask).items() if flows or k != "flow"}) for subtask in task.subtasks]


def fewest(first: tuple[str, ...], second: tuple[str, ...]) -> int:
    """The oracle: every way to insert, leave out and change."""

    @cache
    def of(i: int, j: int) -> int:
        if i == len(first) or j == len(second):
            return len(first) - i + len(second) - j
        return min(of(i + 1, j) + 1, of(i, j + 1) + 1, of(i + 1, j + 1) + (first[i] != second[j]))

    return of(0, 0)


@given(plans(), plans(), st.booleans())
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
def test_a_script_makes_the_second_plan_with_the_fewest_changes(one: oag.Task, other: oag.Task, flows: bool) -> None:
    script = edit_script(one, other, flows=flows)
    made = script.apply(one)
    assert rows(made, flows=flows) == rows(other, flows=flows)
    assert made.goal == other.goal and dict(made.scales) == dict(other.scales)
    assert script.subtasks == fewest(tuple(rows(one, flows=flows)), tuple(rows(other, flows=flows)))
    assert edit_script(one, one, flows=flows).edits == () and len(repr(script)) <= 200


def test_the_words_say_what_changes_where() -> None:
    whole = oag.task(SCENE, goal="(open drawer_0)", steps=[oag.open("drawer_0"), oag.pick("apple_0")])
    less = oag.task(SCENE, goal="(open drawer_0)", steps=[oag.pick("apple_0"), oag.open("drawer_1")])
    assert str(edit_script(whole, less)).splitlines() == [
        'leave out T1 "open drawer 0"',
        'insert "open drawer 1" as T2',
    ]
    other = oag.task(SCENE, goal="(inside apple_0 drawer_0)", steps=[oag.open("drawer_1")])
    words = edit_script(oag.task(SCENE, goal="(open drawer_0)", steps=[oag.open("drawer_0")]), other).words
    assert words[0].startswith('T1 "open drawer 0": target drawer_0 to drawer_1, init')
    assert words[1] == "task goal (open drawer_0) to (inside apple_0 drawer_0)"
