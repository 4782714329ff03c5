"""The measure of others' plans for VirtualHome: a small home, each kind of stop, and what is outside the language."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import oag
from benchmarks.virtualhome_plans import PEOPLE, Outside, Plan, fixed, plans, read


def _node(number: int, name: str, *properties: str, category: str = "Furniture", states: tuple[str, ...] = ()) -> Any:
    return {"id": number, "class_name": name, "category": category, "properties": properties, "states": states}


HOME = {
    "nodes": [
        _node(1, "kitchen", category="Rooms"),
        _node(2, "table", "SURFACES"),
        _node(3, "freezer", "CAN_OPEN", states=("CLOSED",)),
        _node(4, "apple", "GRABBABLE", category="Props"),
        _node(5, "plate", "GRABBABLE", category="Props"),
        _node(6, "milk", "GRABBABLE", category="Props"),
    ],
    "edges": [
        *({"from_id": number, "to_id": 1, "relation_type": "INSIDE"} for number in range(2, 7)),
        {"from_id": 4, "to_id": 2, "relation_type": "ON"},
        {"from_id": 5, "to_id": 2, "relation_type": "ON"},
        {"from_id": 6, "to_id": 3, "relation_type": "INSIDE"},
    ],
}
APPLE, PLATE, MILK, TABLE, FREEZER = "<apple> (4)", "<plate> (5)", "<milk> (1.6)", "<table> (2)", "<freezer> (3)"


def _plan(folder: Path, *lines: str) -> Plan:
    """Return the plan of people in a checkout's layout, whose home is the small one."""
    for kind, name, text in (
        ("init_and_final_graphs", "file7.json", json.dumps({"init_graph": HOME})),
        ("executable_programs", "file7.txt", "\n".join(["A title", "", *lines])),
    ):
        (folder / kind / "room").mkdir(parents=True, exist_ok=True)
        (folder / kind / "room" / name).write_text(text, encoding="utf-8")
    (found,) = plans(folder, [PEOPLE])
    return found


@pytest.mark.parametrize(
    ("lines", "stops", "at"),
    [
        ([f"[WALK] {TABLE}", f"[GRAB] {APPLE}", f"[PUTBACK] {APPLE} {TABLE}"], "", -1),
        ([f"[OPEN] {FREEZER}", f"[GRAB] {MILK}", f"[PUTBACK] {MILK} {TABLE}", f"[CLOSE] {FREEZER}"], "", -1),
        ([f"[GRAB] {APPLE}", f"[GRAB] {PLATE}"], "full hand", 1),
        ([f"[GRAB] {APPLE}", f"[OPEN] {FREEZER}"], "full hand", 1),
        ([f"[GRAB] {APPLE}", f"[DROP] {APPLE}", f"[PUTBACK] {APPLE} {TABLE}"], "empty hand", 2),
        ([f"[GRAB] {MILK}"], "door", 0),
        ([f"[GRAB] {APPLE}", f"[PUTIN] {APPLE} {FREEZER}"], "door", 1),
        ([f"[OPEN] {FREEZER}", f"[OPEN] {FREEZER}"], "door", 1),
        ([f"[GRAB] {PLATE}", f"[PUTBACK] {PLATE} {PLATE}"], "itself", 1),
    ],
)
def test_the_simulator_and_the_graph_stop_at_the_same_step(
    tmp_path: Path, lines: list[str], stops: str, at: int
) -> None:
    reading = read(_plan(tmp_path, *lines))
    assert (reading.stops, reading.at) == (stops, at)
    report = oag.compose(reading.task).verify()
    assert report.verdict is (oag.Verdict.REFUTED if stops else oag.Verdict.PROVED)
    if stops:
        assert report.errors[0].subtask == at


@pytest.mark.parametrize("goal_given", [True, False])
def test_a_refuted_plan_gets_a_fix_that_proves(tmp_path: Path, goal_given: bool) -> None:
    plan = _plan(tmp_path, f"[GRAB] {MILK}", f"[PUTBACK] {MILK} {TABLE}")
    report = oag.compose(read(plan, goal_given=goal_given).task).verify()
    assert report.task.goal_given is goal_given and fixed(report)[0]


@pytest.mark.parametrize(
    ("lines", "kind"),
    [
        ([f"[WALK] {TABLE}", f"[PUTON] {PLATE}"], "still"),
        (["[GRAB] <cat> (99)"], "unknown"),
        ([f"[OPEN] {APPLE}"], "kind"),
        ([f"[GRAB] {FREEZER}"], "kind"),
    ],
)
def test_what_is_outside_the_language_is_said(tmp_path: Path, lines: list[str], kind: str) -> None:
    with pytest.raises(Outside, match=f"^{kind}$"):
        read(_plan(tmp_path, *lines))


def test_plans_of_models_are_read_where_their_home_is(tmp_path: Path) -> None:
    _plan(tmp_path, f"[GRAB] {APPLE}")
    (tmp_path / "action_sequencing" / "small").mkdir(parents=True)
    entries = {
        "7": {"actions": [f"[GRAB] {APPLE}", None]},
        "8": {"actions": [f"[GRAB] {APPLE}"]},
        "9": {"actions": None},
    }
    (tmp_path / "action_sequencing" / "small" / "error_info.json").write_text(json.dumps(entries), encoding="utf-8")
    (found,) = plans(tmp_path, ["small"])
    assert (found.author, found.name, found.steps) == ("small", "7", (("GRAB", ("4",)),))
    assert {plan.author for plan in plans(tmp_path, ())} == {"small", PEOPLE}
