"""The canonical form on cases that can be read: names, the rules one by one, order, and what it leaves alone."""

from __future__ import annotations

import json
import random
from typing import Any

import pytest

import oag
from benchmarks.noise import corrupted, variant
from benchmarks.noise_tasks import carrying, closing, opening, ten_tasks
from oag.model.actions import flow_to_json
from oag.model.diagnostics import MissingScene
from oag.normal_form import resolver
from tests.oag.paper import NAMES, scene, task_json

BASES = {base.name: base for base in ten_tasks()}


def form(data: dict[str, Any], name: str = "T1") -> oag.Task:
    """The canonical form of task JSON in one of the paper's scenes."""
    return oag.canonical(oag.Task.from_json(data, scene=scene(name)))


def names(task: oag.Task) -> list[str]:
    """The names of its subtasks."""
    return [subtask.name for subtask in task.subtasks]


def kitchen() -> oag.Scene:
    """A scene with things of one noun, and of several."""
    sizes = {"category": "cup", "bbox_extent": [0.05, 0.05, 0.1]}
    big = {"category": "fridge", "bbox_extent": [0.7, 0.7, 1.7]}
    objects = {"refrigerator_0": big, "cup_0": sizes, "cup_1": sizes, "obj_17": {**sizes, "category": "water_glass"}}
    return oag.Scene.from_json({"objects": objects, "closed": ["ontop", "inside", "open"]})


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        ("refrigerator_0", "refrigerator_0"),
        ("Refrigerator 0", "refrigerator_0"),
        ("refrigerator-0", "refrigerator_0"),
        ("the fridge", "refrigerator_0"),
        ("FRIDGE_0", "refrigerator_0"),
        ("icebox", "refrigerator_0"),
        ("cup1", "cup_1"),
        ("water glass", "obj_17"),
        ("Gripper", "gripper"),
        ("cup", "cup"),
        ("cup_2", "cup_2"),
        ("fridge_1", "fridge_1"),
        ("mug", "mug"),
        ("glass", "glass"),
        ("", ""),
    ],
)
def test_names_mean_one_object_or_stay_as_they_are(said: str, meant: str) -> None:
    assert resolver(kitchen())(said) == meant


@pytest.mark.parametrize("name", NAMES)
def test_the_papers_tasks_keep_their_subtasks_and_verdict(name: str) -> None:
    task = form(task_json(name), name)
    assert len(task.subtasks) == len(task_json(name)["sub_tasks"])
    assert oag.compose(task).verify()
    assert oag.canonical(task) == task
    assert oag.recheck(oag.compose(task).verify().certificate)


def test_subtasks_are_named_by_what_they_do() -> None:
    assert names(form(task_json("T1"))) == [
        "open_refrigerator_0",
        "pick_up_glass_0",
        "put_glass_0_inside_refrigerator_0",
        "close_refrigerator_0",
    ]
    assert form(task_json("T1")).subtasks[2].detail == "Put glass_0 inside refrigerator_0."


def test_a_missing_step_is_never_added() -> None:
    data = task_json("T1")
    del data["sub_tasks"][0]
    task = form(data)
    assert len(task.subtasks) == 3
    assert oag.compose(task).verify().verdict is oag.Verdict.REFUTED


def test_a_repetition_goes_and_a_second_opening_stays() -> None:
    data = task_json("T1")
    data["sub_tasks"].insert(1, {**data["sub_tasks"][0], "init": "(open refrigerator_0)"})
    assert form(data) == form(task_json("T1"))
    again = task_json("T1")
    again["sub_tasks"].append({**again["sub_tasks"][0], "flow": [17, 1, 2, 3, 4, 5]})
    assert len(form(again).subtasks) == 5


def test_without_flows_the_five_tuples_are_enough() -> None:
    plain, merged = task_json("T1"), task_json("T1")
    pick, put = merged["sub_tasks"][1:3]
    merged["sub_tasks"][1:3] = [{**put, "support_init": pick["support_init"], "init": pick["init"]}]
    for data in (plain, merged):
        for subtask in data["sub_tasks"]:
            del subtask["flow"]
    assert form(merged) == form(plain)
    assert all(subtask.flow is None for subtask in form(merged).subtasks)
    with_flows = oag.Task.from_json(task_json("T1"), scene=scene("T1"))
    without = oag.Task.from_json(plain, scene=scene("T1"))
    assert oag.canonical_digest(with_flows) != oag.canonical_digest(without)
    assert oag.canonical_digest(with_flows, flows=False) == oag.canonical_digest(without, flows=False)


def test_the_goal_read_off_the_subtasks_is_the_same_for_every_wording() -> None:
    plain, merged = task_json("T1"), task_json("T1")
    pick, put = merged["sub_tasks"][1:3]
    joined = {**put, "support_init": pick["support_init"], "init": pick["init"], "flow": pick["flow"] + put["flow"]}
    merged["sub_tasks"][1:3] = [joined]
    for data in (plain, merged):
        del data["goal"]
    assert form(plain).goal == form(merged).goal
    assert not form(plain).goal_given


def test_a_form_without_a_given_goal_has_the_verdict_of_its_plan() -> None:
    """What is read off a form is what was read off the plan, whatever its subtask goals were called."""
    for goal in ("(inside glass_0 gripper)", "(not (ontop glass_0 table_0))", "(and (inside glass_0 gripper))"):
        data = task_json("T1")
        del data["goal"]
        data["sub_tasks"][1]["goal"] = goal
        task = oag.Task.from_json(data, scene=scene("T1"))
        assert oag.compose(task).verify().verdict is oag.Verdict.PROVED
        assert form(data) == form({key: value for key, value in task_json("T1").items() if key != "goal"})
    data["sub_tasks"].append({**data["sub_tasks"][0], "goal": "(hot glass_0)", "init": "(and)", "flow": [17]})
    task = oag.Task.from_json(data, scene=scene("T1"))
    verdicts = {oag.compose(each).verify().verdict for each in (task, oag.canonical(task))}
    assert verdicts == {oag.compose(task).verify().verdict}


def test_the_goal_of_a_form_survives_its_file() -> None:
    data = task_json("T1")
    del data["goal"]
    data["sub_tasks"] = data["sub_tasks"][:2]
    written = form(data)
    assert oag.Task.from_json(written.to_json()).goal == written.goal


def test_a_plan_that_is_not_proved_keeps_its_subtasks() -> None:
    """What it rests on stands in its conditions; names and formulas are in order all the same."""
    data = task_json("T1")
    data["sub_tasks"][1] |= {"target": "The Glass", "init": "(and (ontop glass table) (ontop glass table))"}
    del data["sub_tasks"][0]
    refuted = form(data)
    assert oag.compose(refuted).verify().verdict is oag.Verdict.REFUTED
    assert [subtask.name for subtask in refuted.subtasks] == [s["task_activity_name"] for s in data["sub_tasks"]]
    assert refuted.subtasks[0].target == "glass_0" and str(refuted.subtasks[0].init) == "(ontop glass_0 table_0)"
    assumed = task_json("T1")
    assumed["sub_tasks"][0]["init"] = "(and (hot glass_0) (not (open refrigerator_0)))"
    conditional = form(assumed)
    assert oag.compose(conditional).verify().verdict is oag.Verdict.CONDITIONAL
    assert "(hot glass_0)" in str(conditional.subtasks[0].init)


def test_conditions_say_what_a_movement_changes_whatever_was_written() -> None:
    data = task_json("T1")
    data["sub_tasks"][0] |= {"init": "(and (not (open refrigerator_0)) (ontop glass_0 table_0))"}
    data["sub_tasks"][2] |= {"goal": "(and (inside glass_0 refrigerator_0) (open refrigerator_0))"}
    assert form(data) == form(task_json("T1"))


def test_a_factor_of_one_is_no_factor() -> None:
    assert form({**task_json("T1"), "scales": {"glass_0": 1.0}}) == form({**task_json("T1"), "scales": {}})
    assert form({**task_json("T1"), "scales": {"glass_0": 0.9}}) != form({**task_json("T1"), "scales": {}})


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("(forall (?a - water_glass) (hot ?a))", "(forall (?b - water_glass) (hot ?b))"),
        (
            "(exists (?a - table) (forall (?b - water_glass) (ontop ?b ?a)))",
            "(exists (?b - table) (forall (?a - water_glass) (ontop ?a ?b)))",
        ),
        (
            "(forpairs (?a - water_glass) (?b - table) (ontop ?a ?b))",
            "(forpairs (?x1 - water_glass) (?x0 - table) (ontop ?x1 ?x0))",
        ),
        (
            "(or (forn (1) (?a - table) (hot ?a)) (open refrigerator_0))",
            "(or (open refrigerator_0) (forn (1) (?z - table) (hot ?z)))",
        ),
    ],
)
def test_how_variables_are_called_does_not_matter(one: str, other: str) -> None:
    assert form({**task_json("T1"), "goal": one}) == form({**task_json("T1"), "goal": other})


def test_variables_with_other_roles_are_told_apart() -> None:
    one = "(exists (?a - table) (forall (?b - table) (under ?a ?b)))"
    other = "(exists (?a - table) (forall (?b - table) (under ?b ?a)))"
    assert form({**task_json("T1"), "goal": one}) != form({**task_json("T1"), "goal": other})


@pytest.mark.parametrize(
    ("cut", "whole"),
    [
        ([{"7": 0.1}, {"7": 0.1}], [{"7": 0.2}]),
        ([{"7": 0.1}, {"7": 0.1}, {"7": 0.1}], [{"7": 0.3}]),
        ([{"7": 0.9}, {"7": 0.9}], [{"7": 1.2}, {"7": 0.6}]),
        ([{"13": 2.0}, {"13": 2.0}], [{"13": 3.0}, {"13": 1.0}]),
        ([{"7": 0.1}, {"20": 90}, {"20": 90}, {"20": 90}], [{"7": 0.1}, {"20": 180}, {"20": 90}]),
    ],
)
def test_a_move_cut_into_several_is_one_move(cut: list[Any], whole: list[Any]) -> None:
    def lifted(moves: list[Any]) -> dict[str, Any]:
        data = task_json("T1")
        data["sub_tasks"][1]["flow"] = [17, 1, 2, 3, *moves]
        return data

    assert form(lifted(cut)) == form(lifted(whole))
    assert form(lifted(cut)) != form(lifted([{"7": 0.25}]))


def test_moves_with_open_numbers_or_other_kinds_are_not_added_up() -> None:
    moves = [{"7": None}, {"7": 0.1}, {"9": 0.1}, {"10": 0.1}, {"13": None}, {"13": None}]
    data = task_json("T1")
    data["sub_tasks"][1]["flow"] = [17, 1, 2, 3, *moves]
    assert flow_to_json(form(data).subtasks[1].flow or ())[4:] == moves


def test_independent_parts_are_put_in_one_order_and_dependent_ones_are_not() -> None:
    drawers = BASES["drawers"]
    room = oag.Scene.from_json(drawers.scene)

    def ordered(blocks: list[int]) -> list[str]:
        listed = [subtask for index in blocks for subtask in drawers.blocks[index]]
        data = {"goal": f"(and {' '.join(drawers.goal)})", "sub_tasks": listed}
        return names(oag.canonical(oag.Task.from_json(data, scene=room)))

    assert ordered([0, 1, 2, 3, 4, 5]) == ordered([3, 0, 4, 1, 5, 2]) == ordered([3, 4, 5, 0, 1, 2])
    assert ordered([0, 1, 2, 3, 4, 5]) != ordered([1, 0, 2, 3, 4, 5])


def test_moving_a_container_does_not_change_places_with_filling_it() -> None:
    packing = BASES["packing"]
    room = oag.Scene.from_json(packing.scene)
    forms = []
    for order in ([0, 1, 2, 4, 3], [1, 2, 0, 4, 3]):
        listed = [subtask for index in order for subtask in packing.blocks[index]]
        forms.append(oag.canonical(oag.Task.from_json({"goal": "(and)", "sub_tasks": listed}, scene=room)))
    assert forms[0] != forms[1]


def test_a_plan_that_is_not_well_formed_keeps_its_subtasks() -> None:
    data = task_json("T1")
    data["sub_tasks"][1]["target"] = "chalice_0"
    data["sub_tasks"][0]["target"] = "the fridge"
    task = form(data)
    assert [subtask.target for subtask in task.subtasks][:2] == ["refrigerator_0", "chalice_0"]
    assert names(task)[0] == "open_refrigerator"


def test_a_scene_is_needed() -> None:
    with pytest.raises(MissingScene):
        oag.canonical(oag.Task.from_json(task_json("T1")))
    assert oag.canonical(oag.Task.from_json(task_json("T1")), scene("T1")).subtasks


def test_long_plans() -> None:
    """A chain of 200 subtasks in which every door is opened and closed twice."""
    count = 50
    things = {f"cup_{n}": {"category": "cup", "bbox_extent": [0.05, 0.05, 0.1]} for n in range(count)}
    furniture = {
        "fridge_0": {"category": "fridge", "bbox_extent": [1, 1, 1]},
        "table_0": {"category": "table", "bbox_extent": [1, 1, 1]},
    }
    facts = ["(not (open fridge_0))", *(f"(ontop {thing} table_0)" for thing in things)]
    room = oag.Scene.from_json({"objects": {**furniture, **things}, "facts": facts, "closed": ["ontop", "inside"]})
    listed: list[Any] = []
    for thing in things:
        blocks = (opening("fridge_0"), carrying(thing, "ontop", "table_0", "inside", "fridge_0"), closing("fridge_0"))
        listed += [subtask for block in blocks for subtask in block]
    doors = [s for s in listed if s["target"] == "fridge_0"]
    twice = [copy for s in listed for copy in ((s, {**s, "init": s["goal"]}) if s in doors else (s,))]
    goal = f"(and {' '.join(f'(inside {thing} fridge_0)' for thing in things)})"
    forms = [oag.canonical(oag.Task.from_json({"goal": goal, "sub_tasks": s}, scene=room)) for s in (listed, twice)]
    assert forms[0] == forms[1]
    assert len(forms[0].subtasks) == 4 * count


def test_the_noise_model_is_repeatable_and_does_what_it_says() -> None:
    base = BASES["packing"]
    assert variant(base, 3) == variant(base, 3)
    assert variant(base, 3) != variant(base, 4)
    changes = {change for seed in range(200) for change in variant(base, seed).changes}
    assert changes >= {"reorder", "repeat", "merge", "split", "navigation", "names", "say more", "start from the reset"}
    wrong = {corrupted(base, seed).changes[0] for seed in range(8)}
    assert wrong == {"dropped step", "wrong object", "flipped goal", "swapped roles"}


@pytest.mark.parametrize("name", sorted(BASES))
def test_wordings_have_one_form_and_mistakes_another(name: str) -> None:
    """The stability table in small; `python -m benchmarks.stability` has the whole."""
    base = BASES[name]
    room = oag.Scene.from_json(base.scene)
    seeds = random.Random(name).sample(range(10**6), 8)
    wordings = [oag.Task.from_json(variant(base, seed).task, scene=room) for seed in seeds]
    broken = [oag.Task.from_json(corrupted(base, seed).task, scene=room) for seed in seeds]
    own = {oag.canonical_digest(task) for task in wordings}
    assert len(own) == 1
    assert not own & {oag.canonical_digest(task) for task in broken}
    assert len({json.dumps(task.to_json()) for task in wordings}) == len(wordings)
