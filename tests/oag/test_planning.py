"""Plans from goals, and what is left of plans: the judged tables, refusals, sizes, open worlds."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import pytest

import bddl
import oag
from oag.model.actions import flow_to_json
from oag.sizes import Sizing
from tests.oag.absurd import Plan
from tests.oag.planning_cases import scene_named, table, task_named

GOALS = [*table("goals.toml", "goal"), *table("goals_own.toml", "goal")]
STATES = table("repairs.toml", "state")
# A goal takes at most 2 s on an idle machine; a loaded one gets four times as long.
LONGEST_S = 8.0


def test_the_judged_tables_are_complete() -> None:
    assert len(table("goals.toml", "goal")) == 40
    assert len(STATES) == 15


@pytest.mark.parametrize("row", GOALS, ids=lambda row: f"{row['scene']}-{row['goal'][:40]}")
def test_a_goal_gets_a_shortest_proved_plan(row: Mapping[str, Any]) -> None:
    scene = scene_named(row["scene"])
    began = time.perf_counter()
    made = oag.plan(scene, row["goal"])
    assert time.perf_counter() - began < LONGEST_S
    assert made.task is not None, made.refusal
    report = oag.compose(made.task, scene=scene).verify()
    assert report.verdict is oag.Verdict.PROVED
    assert oag.recheck(report.certificate)
    assert len(made.task.subtasks) == row["steps"]
    assert oag.Task.from_json(made.task.to_json(), scene=scene).subtasks == made.task.subtasks


def distance(given: Sequence[oag.SimpleTask], left: Sequence[oag.SimpleTask]) -> int:
    """The least edit distance of a plan to a rest of another, subtask by subtask; flows do not count."""
    old, new = ([(s.target, s.init, s.goal) for s in subtasks] for subtasks in (given, left))
    row = list(range(len(old) + 1))
    # Reversed, so that what falls away is at the end, where any number of subtasks may.
    for count, part in enumerate(reversed(new), 1):
        above, row = row, [count]
        for index, other in enumerate(reversed(old)):
            row.append(min(above[index] + (part != other), above[index + 1] + 1, row[index] + 1))
    return min(row)


@pytest.mark.parametrize("row", STATES, ids=lambda row: row["what"].replace(" ", "-"))
def test_a_state_gets_what_is_left_of_a_plan(row: Mapping[str, Any]) -> None:
    task = task_named(row["task"])
    made = oag.repair(task, row["state"])
    assert made.task is not None and made.report is not None, made.refusal
    assert made.report.verdict is oag.Verdict.PROVED and oag.recheck(made.report.certificate)
    assert made.task.goal == task.goal
    assert made.edits == distance(task.subtasks, made.task.subtasks) == row["edits"]
    names = [subtask.name for subtask in made.task.subtasks]
    assert names == row["left"] if "left" in row else len(names) == row["count"]


def test_a_kept_subtask_keeps_its_numbers_and_drives_where_it_relied_on_the_reset() -> None:
    task = task_named("T1")
    made = oag.repair(task, ["(inside glass_0 gripper)"])
    assert made.task is not None
    flows = {subtask.name: flow_to_json(subtask.flow or ()) for subtask in made.task.subtasks}
    assert flows["open_refrigerator"] == [17, 1, 2, 3, {"4": None}, 5]
    assert flows["put_glass_into_refrigerator"] == [18, {"13": 0.4}, {"9": 0.1}, 5]


@pytest.mark.parametrize("name", ["T1", "T2", "pen_into_drawer", "two_containers", "stack_and_store"])
def test_from_every_moment_of_a_plan_its_rest_is_left(name: str) -> None:
    """Where the rest of a plan is proved from what holds then, it is returned as it is."""
    task = task_named(name)
    for done in range(len(task.subtasks) + 1):
        before = replace(task, subtasks=task.subtasks[:done], goal=bddl.And(()), goal_given=True)
        trace = oag.compose(before).verify().trace
        assert trace is not None
        items = [key for key, thing in task.scene.objects.items()] if task.scene else []
        facts = [f"(inside {key} gripper)" for key in items if trace.state.hand == f"holding {key}"]
        for fact, entry in trace.state.entries():
            if entry.value is True and len(fact) > 1 and trace.state.value(fact) is True:
                facts.append(f"({' '.join(fact)})")
        made = oag.repair(task, facts)
        assert made.task is not None
        assert made.edits == 0
        assert [s.name for s in made.task.subtasks] == [s.name for s in task.subtasks[done:]]


@pytest.mark.parametrize(
    ("name", "goal", "code", "said"),
    [
        ("T1", "(ontop table_0 refrigerator_0)", "impossible", "table_0 is furniture"),
        ("T1", "(exists (?g - water_glass) (nextto ?g table_0))", "impossible", "no primitive changes nextto"),
        ("T1", "(open table_0)", "impossible", "no articulated fixture"),
        ("T1", "(open gripper)", "impossible", "no object of the scene"),
        ("T1", "(ontop gripper table_0)", "impossible", "no object of the scene"),
        ("T1", "(ontop glass_0 gripper)", "impossible", "ontop gripper"),
        ("T1", "(or (open table_0) (inside glass_0 table_0))", "impossible", "nothing can be inside table_0"),
        ("T1", "(and (or (open glass_0) (open refrigerator_0)) (open table_0))", "impossible", "table_0"),
        ("T1", "(and (open refrigerator_0) (not (open refrigerator_0)))", "impossible", "open refrigerator_0"),
        ("05", "(exists (?p - plate) (inside ?p fridge_0))", "impossible", "plate_0 would be scaled"),
        ("03", "(and (inside bear_0 gripper) (inside book_0 gripper))", "impossible", ""),
        ("T1", "(and (inside glass_0 refrigerator_0) (ontop glass_0 table_0))", "no-plan", "inside(glass_0"),
        ("T1", "(and (inside glass_0 gripper) (ontop glass_0 refrigerator_0))", "no-plan", "refrigerator_0"),
    ],
)
def test_what_cannot_be_is_refused_with_the_reason(name: str, goal: str, code: str, said: str) -> None:
    made = oag.plan(scene_named(name), goal)
    assert not made and made.task is None and made.refusal is not None
    assert made.refusal.code == code and said in made.refusal.problem
    assert made.refusal.to_json()["code"] == code
    assert code in repr(made)


@pytest.mark.parametrize(
    ("goal", "hint"),
    [
        ("(inside glass_9 refrigerator_0)", "did you mean glass_0?"),
        ("(insde glass_0 refrigerator_0)", "write (inside glass_0 refrigerator_0)"),
        ("(inside glass_0)", "write (inside "),
        ("(open refrigerator_0", "write (open refrigerator_0)"),
    ],
)
def test_a_goal_that_cannot_be_read_is_misuse_with_what_can(goal: str, hint: str) -> None:
    with pytest.raises(oag.TaskError) as raised:
        oag.plan(scene_named("T1"), goal)
    assert hint in str(raised.value)


@pytest.mark.parametrize(
    ("goal", "steps"),
    [
        ("(not (open gripper))", 0),
        ("(not (ontop robot table_0))", 0),
        ("(imply (open refrigerator_0) (open table_0))", 0),
        ("(or (open table_0) (open refrigerator_0))", 1),
        ("(or (open gripper) (open refrigerator_0))", 1),
        ("(or (ontop glass_0 gripper) (inside glass_0 table_0) (inside glass_0 gripper))", 1),
    ],
)
def test_what_cannot_be_is_no_reason_to_refuse_another_way(goal: str, steps: int) -> None:
    made = oag.plan(scene_named("T1"), goal)
    assert made.task is not None and len(made.task.subtasks) == steps
    assert made.report and oag.recheck(made.report.certificate)


@pytest.mark.parametrize(
    "fact",
    [
        "(open gripper)",
        "(open table_0)",
        "(ontop gripper table_0)",
        "(inside robot refrigerator_0)",
        "(ontop floor table_0)",
        "(ontop glass_0 gripper)",
    ],
)
def test_a_fact_that_cannot_be_is_the_fault_of_the_scene(fact: str) -> None:
    task = task_named("T1")
    with pytest.raises(oag.SceneError, match="facts: "):
        oag.repair(task, [fact])
    scene = replace(scene_named("T1"), facts=(bddl.parse_formula(fact),))
    with pytest.raises(oag.SceneError, match="facts: "):
        oag.plan(scene, "(open refrigerator_0)")
    report = oag.compose(replace(task, scene=scene)).verify()
    assert report.verdict is oag.Verdict.REFUTED and report.errors[0].code == "bddl/kind"


@pytest.mark.parametrize("state", ["(ontop glass_0 table_0)", None, 3])
def test_a_state_is_a_list_of_facts(state: Any) -> None:
    with pytest.raises(oag.SceneError, match="expected a list of facts"):
        oag.repair(task_named("T1"), state)


def test_an_open_world_is_planned_for_as_far_as_a_plan_can_be_proved() -> None:
    scene = replace(
        scene_named("T1"), facts=(bddl.parse_formula("(ontop glass_0 table_0)"),), closed=frozenset({"ontop", "inside"})
    )
    opened = oag.plan(scene, "(and (inside glass_0 refrigerator_0) (not (open refrigerator_0)))")
    assert opened.task is not None and len(opened.task.subtasks) == 4
    unknown = oag.plan(scene, "(nextto glass_0 refrigerator_0)")
    assert unknown.refusal is not None and unknown.refusal.code == "impossible"
    nothing = replace(scene, facts=(), closed=frozenset())
    refused = oag.plan(nothing, "(not (ontop glass_0 refrigerator_0))")
    assert refused.task is not None and refused.report
    refused = oag.plan(nothing, "(forall (?x - object) (not (inside ?x refrigerator_0)))")
    assert refused.refusal is not None and "inside" in refused.refusal.problem


def test_sizes_are_written_down_or_kept() -> None:
    scene = scene_named("T1")
    made = oag.plan(scene, "(inside glass_0 gripper)")
    assert made.task is not None and set(made.task.scales) == {"glass_0"}
    kept = oag.plan(scene, "(inside glass_0 gripper)", sizing=Sizing(keep=True))
    assert kept.refusal is not None and "keep its size" in kept.refusal.problem


def test_a_search_ends_at_its_bound() -> None:
    objects = {f"cabinet_{i}": {"category": "cabinet", "bbox_extent": [0.6, 0.6, 1.0]} for i in range(6)}
    objects |= {f"cup_{i}": {"category": "cup", "bbox_extent": [0.05, 0.05, 0.1]} for i in range(9)}
    facts = [f"(ontop cup_{i} cabinet_0)" for i in range(9)]
    scene = oag.Scene.from_json({"objects": objects, "facts": facts, "closed": ["ontop", "inside", "open"]})
    goal = "(exists (?c - cup) (and (inside ?c cabinet_1) (inside ?c cabinet_2)))"
    made = oag.plan(scene, goal)
    assert made.refusal is not None and made.refusal.code == "too-large" and made.refusal.states == made.states > 50


@pytest.mark.parametrize(
    ("facts", "goal", "steps"),
    [
        (
            ("ontop bowl_0 table_0", "inside apple_0 bowl_0"),
            "(and (inside apple_0 refrigerator_0) (inside apple_0 bowl_0))",
            ["open_refrigerator_0", "pick_up_bowl_0", "put_bowl_0_inside_refrigerator_0"],
        ),
        (
            ("inside bowl_0 refrigerator_0", "inside apple_0 bowl_0"),
            "(and (not (inside apple_0 refrigerator_0)) (inside apple_0 bowl_0) (not (open refrigerator_0)))",
            ["open_refrigerator_0", "pick_up_bowl_0", "put_bowl_0_on_table_0", "close_refrigerator_0"],
        ),
    ],
)
def test_a_plan_moves_what_carries_a_thing(facts: tuple[str, ...], goal: str, steps: list[str]) -> None:
    scene = Plan("carried", "apple_0 bowl_0 refrigerator_0 table_0", facts, (), "and").scene()
    made = oag.plan(scene, goal)
    assert made.task is not None and made.report and oag.recheck(made.report.certificate)
    assert [subtask.name for subtask in made.task.subtasks] == steps


_ON_TABLE = ("ontop cup table", "ontop mug table", "ontop pen table")
_AWAY = "(inside cup cabinet) (inside mug cabinet) (not (open cabinet))"


@pytest.mark.parametrize(
    ("objects", "facts", "goal", "steps"),
    [
        # A shut door is in the way to where a thing goes.
        ("refrigerator bowl egg table", ["inside bowl refrigerator", "ontop egg table"], "(inside egg bowl)", 3),
        ("cabinet safe phone table", ["inside safe cabinet", "ontop phone table"], "(inside phone safe)", 4),
        ("cabinet safe phone table", ["inside safe cabinet", "ontop phone table"], "(open safe)", 2),
        # A thing leaves, or gets into, what its new place stands in.
        (
            "cabinet box apple table",
            ["inside box cabinet", "ontop apple table"],
            "(and (inside apple box) (not (inside apple cabinet)))",
            4,
        ),
        (
            "cabinet bowl plate table",
            ["open cabinet", "inside plate cabinet", "ontop bowl table"],
            "(and (ontop plate bowl) (inside plate cabinet))",
            4,
        ),
        # The shorter of two ways: each thing is put down once, and only what has to be taken.
        (
            "drawer apple orange egg cup mug pen cabinet table",
            ["inside apple drawer", "inside orange drawer", "inside egg drawer", *_ON_TABLE],
            "(or (and (forall (?x - object) (not (inside ?x drawer))) (not (open drawer)))"
            f" (and {_AWAY} (inside pen cabinet) (open drawer)))",
            8,
        ),
        (
            "drawer apple plate egg tray cup mug pen cabinet table",
            ["inside plate drawer", "ontop apple plate", "inside tray drawer", "ontop egg tray", *_ON_TABLE],
            "(or (and (ontop apple drawer) (not (inside apple drawer)) (ontop egg drawer) (not (inside egg drawer)))"
            f" (and {_AWAY}))",
            5,
        ),
    ],
)
def test_a_plan_is_shortest_with_things_in_things(objects: str, facts: Sequence[str], goal: str, steps: int) -> None:
    scene = oag.scene({name: name for name in objects.split()}, [f"({fact})" for fact in facts], "all")
    made = oag.plan(scene, goal)
    assert made.task is not None and made.report and oag.recheck(made.report.certificate, scene=scene), made.refusal
    assert len(made.task.subtasks) == steps


def test_a_thing_is_put_back_to_where_the_kept_plan_takes_it_from() -> None:
    objects = {"drawer_0": "drawer", "cabinet_0": "cabinet", "apple_0": "apple", "bowl_0": "bowl", "table_0": "table"}
    scene = oag.scene(objects, ["(inside apple_0 bowl_0)", "(ontop bowl_0 table_0)"], "all")
    steps = [oag.open("drawer_0"), oag.pick("apple_0"), oag.place("apple_0", inside="drawer_0")]
    task = oag.task(scene, goal="(inside apple_0 drawer_0)", steps=steps)
    made = oag.repair(task, ["(inside apple_0 gripper)", "(ontop bowl_0 table_0)"])
    assert made.task is not None and made.edits == 1
    assert [subtask.goal for subtask in made.task.subtasks[1:]] == [subtask.goal for subtask in task.subtasks]
