"""What the roles of a decomposition show, and what a goal concerns, by the facts of a scene."""

from __future__ import annotations

import random
import re
from dataclasses import replace

import pytest

import bddl
import llm
import oag
from llm.proposing.handling import concerns, condition_forms, doors, handling_findings, has_place, role_forms, stakes
from llm.proposing.session import named
from llm.structured.prompting import formula_pattern
from llm.structured.schema import Admitted, Form, Pattern, wire_schema
from oag.model.reading import UNREADABLE
from tests.llm.kitchens import FAMILIES, LATER, ORDINARY, SCENES, STRANGERS, Phrasing

ALL = (*FAMILIES, *LATER, *STRANGERS, *ORDINARY)

FACTS = ["(ontop apple_0 plate_0)", "(inside plate_0 fridge_0)", "(not (open fridge_0))", "(not (open cabinet_0))"]
KINDS = {
    "apple_0": "apple",
    "plate_0": "plate",
    "bowl_0": "bowl",
    "fridge_0": "refrigerator",
    "cabinet_0": "bottom_cabinet",
    "table_0": "table",
}
SCENE = oag.scene(KINDS, [*FACTS, "(ontop bowl_0 cabinet_0)"])


def goal(text: str) -> bddl.Formula:
    return bddl.parse_formula(text)


@pytest.mark.parametrize(
    ("wanted", "kept", "door"),
    [
        ("(and (ontop apple_0 table_0) (not (open fridge_0)))", None, True),
        ("(and (forall (?a - apple) (ontop ?a table_0)) (not (open fridge_0)))", None, True),
        ("(and (ontop bowl_0 table_0) (not (open cabinet_0)))", "(ontop bowl_0 table_0)", False),
        ("(and (inside bowl_0 cabinet_0) (not (open cabinet_0)))", None, True),
        ("(open fridge_0)", None, True),
        ("(ontop bowl_0 cabinet_0)", None, False),
        ("(ontop bowl_0 fridge_0)", None, False),
        ("(ontop bowl_0 plate_0)", None, True),
    ],
)
def test_later_modules_read_what_is_at_stake(wanted: str, kept: str | None, door: bool) -> None:
    assert bddl.format(stakes(goal(wanted), SCENE)) == (kept or wanted)
    assert bool(doors(goal(wanted), SCENE)) is door


def test_what_stands_on_a_plate_is_behind_its_door_and_a_counter_is_no_part() -> None:
    assert concerns(goal("(ontop apple_0 table_0)"), SCENE) == {"apple_0", "table_0", "plate_0", "fridge_0"}
    assert "cabinet_0" not in concerns(goal("(ontop bowl_0 table_0)"), SCENE)


def subtasks(*roles: tuple[str, str | None, str | None]) -> list[oag.SimpleTask]:
    return [oag.SimpleTask(f"t{n}", "", *role, init=UNREADABLE, goal=UNREADABLE) for n, role in enumerate(roles)]


@pytest.mark.parametrize(
    ("wanted", "roles", "codes"),
    [
        ("(ontop apple_0 table_0)", [("apple_0", "plate_0", None), ("apple_0", None, "table_0")], []),
        ("(ontop apple_0 table_0)", [("apple_0", None, "table_0")], ["answer/not-held"]),
        ("(ontop apple_0 table_0)", [("apple_0", "plate_0", None)], ["answer/not-put"]),
        # The plate takes the apple along.
        ("(ontop apple_0 table_0)", [("plate_0", "fridge_0", None), ("plate_0", None, "table_0")], []),
        ("(ontop bowl_0 table_0)", [("bowl_0", "cabinet_0", "cabinet_0")], ["answer/not-put", "answer/not-put"]),
        # What cannot be carried is the goal's mistake.
        ("(ontop table_0 fridge_0)", [], []),
    ],
)
def test_roles_alone_show_what_is_not_held_or_not_put(
    wanted: str, roles: list[tuple[str, str | None, str | None]], codes: list[str]
) -> None:
    found = handling_findings(subtasks(*roles), goal(wanted), SCENE)
    assert [one.code for one in found] == codes


@pytest.mark.parametrize(
    ("roles", "codes"),
    [
        ([("apple_0", "table_0", None), ("apple_0", None, "bowl_0")], ["answer/not-there"]),
        # It is on the plate, and so in the refrigerator.
        ([("apple_0", "plate_0", None), ("apple_0", None, "bowl_0")], []),
        ([("apple_0", "fridge_0", None), ("apple_0", None, "bowl_0")], []),
        # Where it was put before.
        ([("apple_0", "plate_0", "table_0"), ("apple_0", "table_0", None), ("apple_0", None, "bowl_0")], []),
        # Where the plate has taken it.
        (
            [
                ("plate_0", "fridge_0", None),
                ("plate_0", None, "table_0"),
                ("apple_0", "table_0", None),
                ("apple_0", None, "bowl_0"),
            ],
            [],
        ),
        # What the scene does not have is another finding.
        ([("apple_0", "gripper", None), ("apple_0", None, "bowl_0")], []),
    ],
)
def test_a_thing_is_picked_up_where_it_is(roles: list[tuple[str, str | None, str | None]], codes: list[str]) -> None:
    known = replace(SCENE, closed=frozenset({"ontop", "inside"}))
    found = [*handling_findings(subtasks(*roles), goal("(inside apple_0 bowl_0)"), known)]
    assert [one.code for one in found] == codes
    assert [one.fixes for one in found] == [('T1: "target": "apple_0", "support_init": "plate_0"',)] * len(codes)
    assert not [*handling_findings(subtasks(*roles), goal("(inside apple_0 bowl_0)"), SCENE)]


def test_a_thing_without_a_stated_place_may_be_put_down() -> None:
    scene = oag.scene({"die_0": "apple", "table_0": "table"}, [])
    roles = subtasks(("die_0", None, None), ("die_0", None, "table_0"))
    assert not has_place("die_0", scene) and has_place("apple_0", SCENE)
    assert not list(handling_findings(roles, goal("(ontop die_0 table_0)"), scene))


def test_the_pattern_of_formulas_admits_what_kinds_admit() -> None:

    pattern = formula_pattern(SCENE, list(SCENE.objects))
    for text in ("(open fridge_0)", "(not (inside apple_0 gripper))", "(and (ontop apple_0 table_0) (open fridge_0))"):
        assert re.fullmatch(pattern, text)
    for text in ("(open table_0)", "(inside apple_0 table_0)", "(ontop fridge_0 table_0)", "(and)", "open fridge_0"):
        assert not re.fullmatch(pattern, text)
    many = "(and " + " ".join(["(ontop apple_0 table_0)"] * len(SCENE.objects)) + ")"
    assert re.fullmatch(pattern, many)
    assert formula_pattern(oag.scene({"table_0": "table"}, []), ["table_0"]) == ""


def test_entries_that_are_asked_for_are_numbers_of_the_schema() -> None:
    from llm.proposing.modules import Conditions, SubtaskConditions

    listed = wire_schema(Conditions, Admitted(entries=4), (2, 4))["properties"]["sub_tasks"]  # type: ignore[index]
    assert listed["minItems"] == listed["maxItems"] == 2
    assert listed["items"]["properties"]["sub_task"]["enum"] == [2, 4]

    def conditions(*numbers: int, text: str = "(open a)") -> Conditions:
        return Conditions(sub_tasks=[SubtaskConditions(sub_task=n, init=text, goal=text) for n in numbers])

    standing, others = conditions(1, 2, 3), conditions(3, text="(open b)")
    assert [one.init for one in standing.with_entries(others, (3,)).sub_tasks] == ["(open a)", "(open a)", "(open b)"]
    # Another entry than the one that was asked for is no amendment.
    assert standing.with_entries(others, (2,)) is others


def fits(form: Form, entry: dict[str, object]) -> bool:
    """Decide whether a form admits an entry."""
    return all(
        re.search(wanted, str(entry[name])) if isinstance(wanted, Pattern) else entry[name] in wanted
        for name, wanted in form.items()
    )


@pytest.mark.parametrize(
    ("wanted", "name", "target", "start", "end", "fit"),
    [
        ("(inside apple_0 bowl_0)", "open_fridge", "fridge_0", "", "", True),
        ("(inside apple_0 bowl_0)", "pick_up_apple", "apple_0", "plate_0", "", True),
        ("(inside apple_0 bowl_0)", "put_apple_into_bowl", "apple_0", "", "bowl_0", True),
        # Picked up and put down in one entry.
        ("(inside apple_0 bowl_0)", "put_apple_into_bowl", "apple_0", "plate_0", "bowl_0", True),
        # The goal has nothing to do with the cabinet's door.
        ("(inside apple_0 bowl_0)", "open_cabinet", "cabinet_0", "", "", False),
        ("(inside apple_0 bowl_0)", "open_bowl", "bowl_0", "", "", False),
        ("(inside apple_0 bowl_0)", "put_apple_into_bowl", "apple_0", "plate_0", "", False),
        ("(inside apple_0 bowl_0)", "put_apple_back", "apple_0", "plate_0", "plate_0", False),
        ("(inside apple_0 bowl_0)", "put_apple_away", "apple_0", "bowl_0", "table_0", False),
        ("(inside apple_0 bowl_0)", "put_bowl_into_bowl", "bowl_0", "", "bowl_0", False),
        # Nothing lies in or on an apple, unless the goal says so.
        ("(inside apple_0 bowl_0)", "pick_up_bowl", "bowl_0", "apple_0", "", False),
        ("(ontop bowl_0 apple_0)", "put_bowl_on_apple", "bowl_0", "", "apple_0", True),
        ("(inside apple_0 bowl_0)", "pick_up_apple", "apple_0", "", "", False),
    ],
)
def test_the_roles_of_a_subtask_have_a_form_by_its_kind(
    wanted: str, name: str, target: str, start: str, end: str, fit: bool
) -> None:
    entry = {"task_activity_name": name, "target": target, "support_init": start, "support_goal": end}
    forms = role_forms(list(SCENE.objects), goal(wanted), SCENE)
    assert any(fits(form, entry) for form in forms) is fit


def test_a_door_before_the_place_is_concerned_and_every_place_of_a_thing_is_its_home() -> None:
    facts = [
        "(inside plate_0 cabinet_0)",
        "(not (open cabinet_0))",
        "(ontop apple_0 bowl_0)",
        "(inside apple_0 fridge_0)",
    ]
    scene = oag.scene(KINDS, [*facts, "(ontop bowl_0 table_0)"])
    wanted = goal("(ontop apple_0 plate_0)")
    assert "cabinet_0" in doors(wanted, scene)
    forms = role_forms(list(scene.objects), wanted, scene)
    homes = [form["support_init"] for form in forms if form["target"] == ["apple_0"] and "gripper" not in form]
    assert ["bowl_0"] in homes and ["fridge_0"] in homes


@pytest.mark.parametrize("phrasing", random.Random("forms").sample([one for one in ALL if one.goal], 60), ids=str)
def test_the_forms_admit_what_the_offline_planner_plans(phrasing: Phrasing) -> None:
    scene = SCENES[phrasing.scene]
    try:
        task = llm.propose(phrasing.query, scene).task
    except llm.QueryError:
        pytest.skip("not read")
    roles = role_forms(list(scene.objects), task.goal, scene, named(phrasing.query, scene))
    conditions = condition_forms(task.subtasks, list(scene.objects), scene)
    for number, part in enumerate(task.subtasks, start=1):
        start, end = part.support_init or "", part.support_goal or ""
        entry = {"target": part.target, "support_init": start, "support_goal": end}
        entries = [{**entry, "task_activity_name": f"{kind}_it"} for kind in ("open", "pick_up", "put")]
        assert any(fits(form, one) for form in roles for one in entries), entry
        written = {"sub_task": number, "init": bddl.format(part.init), "goal": bddl.format(part.goal)}
        assert any(fits(form, written) for form in conditions), written


@pytest.mark.parametrize(
    "query",
    [
        "put the glass into the fridge, then put the glass on the table",
        "open the fridge and then close it",
        "close the fridge and open it again",
    ],
)
def test_the_forms_admit_a_door_that_the_query_names(query: str) -> None:
    scene = oag.scene({"glass_0": "glass", "fridge_0": "refrigerator", "table_0": "table"}, ["(ontop glass_0 table_0)"])
    forms = role_forms(list(scene.objects), goal("(ontop glass_0 table_0)"), scene, named(query, scene))
    entry = {"task_activity_name": "open_fridge", "target": "fridge_0", "support_init": "", "support_goal": ""}
    assert any(fits(form, entry) for form in forms)
    forms = role_forms(list(scene.objects), goal("(ontop glass_0 table_0)"), scene, named("put the glass down", scene))
    assert not any(fits(form, entry) for form in forms)


@pytest.mark.parametrize(
    ("number", "start", "end", "fit"),
    [
        (1, "(ontop apple_0 plate_0)", "(not (ontop apple_0 plate_0))", True),
        (1, "(ontop apple_0 plate_0)", "(inside apple_0 gripper)", True),
        (1, "(ontop apple_0 plate_0)", "(inside apple_0 bowl_0)", False),
        (1, "(ontop apple_0 table_0)", "(inside apple_0 gripper)", False),
        (2, "(inside apple_0 gripper)", "(and (inside apple_0 bowl_0) (ontop bowl_0 cabinet_0))", True),
        (2, "(inside apple_0 gripper)", "(ontop apple_0 cabinet_0)", False),
        (3, "(open fridge_0)", "(not (open fridge_0))", True),
        # The conditions of the first subtask are none for the second.
        (2, "(ontop apple_0 plate_0)", "(not (ontop apple_0 plate_0))", False),
    ],
)
def test_conditions_have_the_target_where_its_roles_do(number: int, start: str, end: str, fit: bool) -> None:
    roles = subtasks(("apple_0", "plate_0", None), ("apple_0", None, "bowl_0"), ("fridge_0", None, None))
    forms = condition_forms(roles, list(SCENE.objects), SCENE)
    assert any(fits(form, {"sub_task": number, "init": start, "goal": end}) for form in forms) is fit


def test_an_entry_is_of_a_fixture_or_of_an_item_where_a_server_follows_that() -> None:
    from llm.client.openai import chat_body
    from llm.client.profiles import find_profile
    from llm.client.transport import ChatRequest
    from llm.proposing.modules import Decomposition

    forms = role_forms(list(SCENE.objects), goal("(inside apple_0 bowl_0)"), SCENE)
    request = ChatRequest.of(
        "s", "q", json_schema=wire_schema(Decomposition, Admitted(list(SCENE.objects), forms=forms))
    )
    for name, known in (("llama-cpp:x", False), ("openai:gpt-4o", False), ("local:x", True)):
        body = chat_body(request, find_profile(name))
        assert ('"anyOf"' in str(body.get("grammar", "")) or "'anyOf'" in str(body["messages"])) is known
        assert "anyOf" not in str(body.get("response_format", ""))
