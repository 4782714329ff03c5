"""The certificate checker: small, independent, and not to be fooled by hand-made changes."""

from __future__ import annotations

import ast
import copy
import json
import sys
from pathlib import Path
from typing import Any

import pytest

import oag
from tests.forgeries import REPLACEMENTS, VALIDATOR, claim_holds, rehashed, same, single_changes
from tests.framings import framings
from tests.oag.paper import NAMES, invalid, task_json, verify

ROOM = Path(__file__).parents[2] / "oag" / "certificate"
SOURCES = [ROOM / name for name in ("check.py", "check_plan.py", "formulas.py", "schema.py")]
# The rows of an own domain are part of the table; a certificate repeats them.
TABLE = {"oag.model.domain", "oag.model.symbols", "oag.primitives.cargo", "oag.primitives.table"}


def certificate(name: str = "T1") -> dict[str, Any]:
    """A task's certificate as JSON."""
    made = verify(task_json(name), name).certificate
    assert made is not None
    data: dict[str, Any] = json.loads(json.dumps(made.to_json()))
    return data


@pytest.mark.parametrize("source", SOURCES, ids=lambda source: source.stem)
def test_it_imports_the_table_only(source: Path) -> None:
    text = source.read_text(encoding="utf-8")
    nodes = list(ast.walk(ast.parse(text)))
    imported = {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module}
    named = {alias.name.split(".")[0] for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    own = {f"oag.certificate.{other.stem}" for other in SOURCES}
    assert {name for name in imported if name.startswith("oag")} <= TABLE | own
    assert (named | {name.split(".")[0] for name in imported}) - sys.stdlib_module_names <= {"bddl", "oag"}


def test_all_of_it_is_short() -> None:
    assert sum(len(source.read_text(encoding="utf-8").splitlines()) for source in SOURCES) <= 1150


@pytest.mark.parametrize("name", NAMES)
def test_certificates_pass(name: str) -> None:
    assert oag.recheck(certificate(name))


def test_a_dropped_link_is_noticed() -> None:
    data = certificate()
    for index in range(len(data["links"])):
        less = copy.deepcopy(data)
        del less["links"][index]
        assert not oag.recheck(less)


def check_every_change(data: dict[str, Any], *replacements: Any) -> None:
    """Check that no change of one value passes, unless what the certificate then says is so."""
    for changed in single_changes(data, replacements):
        if oag.recheck(changed):
            assert VALIDATOR.is_valid(changed)
            assert all(same(changed[key], data[key]) for key in ("verdict", "plan", "scene", "failure"))
        elif "plan" in changed and "scene" in changed and oag.recheck(rehashed(changed)):
            assert VALIDATOR.is_valid(changed)
            assert claim_holds(changed, ()) is not False


def refutation(name: str) -> dict[str, Any]:
    """A wrong plan's certificate as JSON."""
    made = invalid(name).certificate
    assert made is not None
    data: dict[str, Any] = json.loads(json.dumps(made.to_json()))
    return data


@pytest.mark.slow
def test_every_deletion_swap_and_addition_is_noticed_or_harmless() -> None:
    check_every_change(certificate(), None, 1)
    check_every_change(refutation("dropped_open"), None, 1)
    check_every_change(small(0), None, 1)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_every_change_of_a_proof_is_noticed_or_harmless(name: str) -> None:
    check_every_change(certificate(name), *REPLACEMENTS)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["dropped_open", "dropped_grasp", "goal_undone", "wrong_start"])
def test_every_change_of_a_refutation_is_noticed_or_harmless(name: str) -> None:
    check_every_change(refutation(name), *REPLACEMENTS)


def test_a_moved_producer_is_noticed() -> None:
    data = certificate()
    for link in data["links"]:
        link[-1] += 2
        assert "is written at" in oag.recheck(data).reason
        link[-1] -= 2


def test_what_is_known_cannot_be_assumed_away() -> None:
    report = invalid("dropped_open")
    assert report.certificate is not None
    data = json.loads(json.dumps(report.certificate.to_json()))
    data["assumptions"].append({"kind": "assumed", "time": 1, "fact": ["open", "refrigerator_0"], "value": True})
    assert oag.recheck(data).reason.startswith("nothing that the plan needs forces what is assumed")
    data = certificate()
    data["assumptions"].append({"kind": "assumed", "time": 1, "fact": ["open", "refrigerator_0"], "value": True})
    data["verdict"] = "CONDITIONAL"
    assert oag.recheck(data).reason == "('open', 'refrigerator_0') is assumed though it is known"


def test_a_dropped_reset_is_noticed() -> None:
    data = certificate()
    data["assumptions"] = data["assumptions"][1:]
    assert "near" in oag.recheck(data).reason


def test_the_reset_supplies_nothing_else() -> None:
    data = certificate()
    data["assumptions"].append({"kind": "reset", "fact": ["hot", "glass_0"], "value": True})
    assert oag.recheck(data).reason == "the reset does not supply ('hot', 'glass_0')"


def test_a_changed_plan_is_noticed_by_its_hash_and_by_its_links() -> None:
    data = certificate()
    data["plan"]["subtasks"].pop()
    assert oag.recheck(data).reason == "task_hash is of something else"
    assert not oag.recheck(rehashed(data))


def test_a_refutation_cannot_be_sold_as_a_proof() -> None:
    report = invalid("dropped_open")
    assert report.certificate is not None
    data = json.loads(json.dumps(report.certificate.to_json()))
    data["verdict"] = "PROVED"
    assert oag.recheck(data).reason == "the evidence is for REFUTED, the verdict says PROVED"
    data["failure"] = None
    assert not oag.recheck(data)


def test_another_table_of_primitives_is_noticed() -> None:
    data = certificate()
    data["library_sha"] = "0" * 64
    assert oag.recheck(data).reason == "it was made with another table of primitives"


@pytest.mark.parametrize("junk", [{}, {"plan": 1}, [], 3, "certificate"])
def test_junk_is_rejected_not_raised(junk: Any) -> None:
    result = oag.recheck(junk)
    assert not result
    assert result.reason.startswith("there is no certificate" if junk is None else "malformed certificate")


def test_a_plan_of_no_subtasks_can_rest_on_an_assumption() -> None:
    scene = oag.Scene.from_json({"objects": {"box_0": {"category": "drawer", "bbox_extent": [1, 1, 1]}}})
    report = oag.compose(oag.Task.from_json({"goal": "(open box_0)", "sub_tasks": []}, scene=scene)).verify()
    assert report.verdict is oag.Verdict.CONDITIONAL
    assert oag.recheck(report.certificate)


def test_what_is_needed_twice_is_assumed_once() -> None:
    data = task_json("T3")
    data["sub_tasks"][0]["init"] = "(and (hot apple_0) (hot apple_0))"
    report = verify(data, "T3")
    assert report.verdict is oag.Verdict.CONDITIONAL
    assert report.trace is not None and len(report.trace.assumptions) == 1
    assert oag.recheck(report.certificate)


def test_an_assumption_is_not_needed_for_what_a_step_wrote() -> None:
    """What is carried is in nothing, so that the cup in the bowl need not be assumed to have nothing in it."""
    objects = {
        "table_0": {"category": "table", "bbox_extent": [1.0, 1.0, 0.7]},
        **{name: {"category": "cup", "bbox_extent": [0.05, 0.05, 0.1]} for name in ("cup_0", "cup_1")},
    }
    scene = oag.Scene.from_json({"objects": objects, "facts": ["(ontop cup_1 table_0)"]})
    pick = {**PICK, "target": "cup_1", "init": "(ontop cup_1 table_0)", "goal": "(not (ontop cup_1 table_0))"}

    def certificate_for(goal: str) -> dict[str, Any]:
        made = oag.compose(oag.Task.from_json({"goal": goal, "sub_tasks": [pick]}, scene=scene)).verify().certificate
        assert made is not None and oag.recheck(made), oag.recheck(made)
        data: dict[str, Any] = json.loads(json.dumps(made.to_json()))
        return data

    # Honest: it is asked for, beside what excludes it, which the lift has written.
    asked = certificate_for("(and (not (inside cup_1 cup_0)) (inside cup_0 cup_1))")
    assert [entry["text"] for entry in asked["assumptions"] if entry["kind"] == "assumed"] == ["inside(cup_0, cup_1)"]
    forged = certificate_for("(and (not (inside cup_1 cup_0)) (hot cup_0))")
    assert forged["verdict"] == "CONDITIONAL"
    (link,) = [link for link in forged["links"] if link[3] == ["inside", "cup_1", "cup_0"]]
    (hot,) = [entry for entry in forged["assumptions"] if entry["kind"] == "assumed"]
    forged["assumptions"].append({**hot, "fact": ["inside", "cup_0", "cup_1"], "text": "inside(cup_0, cup_1)"})
    link[-1] = hot["time"]
    assert "nothing needs it" in oag.recheck(forged).reason


def test_an_assumption_that_dates_again_what_a_step_wrote_is_confirmed_and_not_to_be_bent() -> None:
    """Taking the glass out writes that it is not inside; assuming the oven to be inside the glass says so again."""
    objects = {
        "oven_0": {"category": "oven", "bbox_extent": [0.6, 0.6, 1.0]},
        "glass_0": {"category": "glass", "bbox_extent": [0.05, 0.05, 0.1]},
    }
    scene = oag.Scene.from_json({"objects": objects, "facts": ["(open oven_0)"], "closed": ["ontop"]})
    held = {"target": "glass_0", "goal": "(inside glass_0 gripper)"}
    taken = {**held, "init": "(and)", "flow": [17, 1, 2, 3, {"7": 0.2}, 6]}
    asked = {**held, "init": "(and (not (inside glass_0 oven_0)) (inside oven_0 glass_0))", "flow": []}
    task = oag.Task.from_json({"goal": "(inside glass_0 gripper)", "sub_tasks": [taken, asked]}, scene=scene)
    report = oag.compose(task).verify()
    assert report.verdict is oag.Verdict.CONDITIONAL and report.certificate is not None
    data = json.loads(json.dumps(report.certificate.to_json()))
    result = oag.recheck(data)
    assert result, result.reason
    (again,) = (link for link in data["links"] if link[3] == ["inside", "glass_0", "oven_0"])
    assert again[-1] == 13
    again[-1] = 12
    assert not oag.recheck(rehashed(data)), "the earlier write is not the last one"


def test_certificates_of_another_version_are_refused_by_name() -> None:
    data = certificate()
    data["schema"] = "scene2demo-certificate/1"
    reason = oag.recheck(data).reason
    assert "'scene2demo-certificate/1'" in reason and "'scene2demo-certificate/3'" in reason


# Opening a door takes nothing off the table.
UNREACHABLE = {
    "target": "refrigerator_0",
    "support_goal": None,
    "init": "(ontop glass_0 table_0)",
    "goal": "(not (ontop glass_0 table_0))",
}


def test_a_search_without_a_flow_is_confirmed_and_not_to_be_bent() -> None:
    made = verify({**task_json("T1"), "sub_tasks": [UNREACHABLE]}, "T1").certificate
    assert made is not None
    data: dict[str, Any] = json.loads(json.dumps(made.to_json()))
    assert oag.recheck(data).reason == "('no-flow', 0, -1) fails, as claimed"
    for index in range(len(data["search"]["states"])):
        less = copy.deepcopy(data)
        del less["search"]["states"][index]
        assert not oag.recheck(less)
    for bent in (
        {"search": None},
        {"failure": ["goal", 0, -1]},
        {"failure": None, "verdict": "PROVED"},
        {"failure": None, "verdict": "PROVED", "search": None, "counterexample": None},
        {"search": {**data["search"], "facts": data["search"]["facts"][1:]}},
        {"search": {**data["search"], "subtask": 1}},
    ):
        assert not oag.recheck({**data, **bent})


PICK = {
    "target": "glass_0",
    "support_goal": None,
    "init": "(ontop glass_0 table_0)",
    "goal": "(not (ontop glass_0 table_0))",
    "flow": [1, 2, 3, {"7": 0.2}],
}
PUT = {
    "target": "glass_0",
    "support_goal": "refrigerator_0",
    "init": "(inside glass_0 gripper)",
    "goal": "(inside glass_0 refrigerator_0)",
    "flow": [18, 5],
}
DOOR = {"target": "refrigerator_0", "support_goal": None, "init": "(and)", "goal": "(open refrigerator_0)", "flow": [6]}
SMALL: tuple[tuple[list[dict[str, Any]], str | None, list[str], str], ...] = (
    ([PICK, PUT], None, [], "CONDITIONAL"),
    ([PICK, PUT], "(inside glass_0 refrigerator_0)", ["(open refrigerator_0)"], "PROVED"),
    ([{**PICK, "init": "(and (ontop glass_0 table_0) (open refrigerator_0))"}], None, [], "CONDITIONAL"),
    ([DOOR], None, ["(not (open refrigerator_0))"], "REFUTED"),
    ([PICK, {**DOOR, "init": "(open refrigerator_0)", "goal": "(not (open refrigerator_0))"}], None, [], "REFUTED"),
    (
        [{**PICK, "support_goal": "table_0", "goal": "(ontop glass_0 table_0)", "flow": [5, 17, 1, 2, 3, 7, 18, 5]}],
        None,
        ["(open refrigerator_0)"],
        "PROVED",
    ),
)


def small(index: int) -> dict[str, Any]:
    """The certificate of a small plan."""
    subtasks, goal, facts, verdict = SMALL[index]
    kinds = {"refrigerator_0": "refrigerator", "glass_0": "water_glass", "table_0": "table"}
    objects = {
        name: {"category": category, "bbox_extent": [0.05, 0.05, 0.1] if name == "glass_0" else [0.8, 0.8, 1]}
        for name, category in kinds.items()
    }
    scene = oag.Scene.from_json({"objects": objects, "facts": ["(ontop glass_0 table_0)", *facts]})
    task = {"sub_tasks": subtasks} if goal is None else {"sub_tasks": subtasks, "goal": goal}
    report = oag.compose(oag.Task.from_json(task, scene=scene)).verify()
    assert report.verdict.value == verdict and report.certificate is not None
    data: dict[str, Any] = json.loads(json.dumps(report.certificate.to_json()))
    return data


@pytest.mark.slow
def test_every_change_of_a_search_is_noticed_or_harmless() -> None:
    made = verify({**task_json("T1"), "sub_tasks": [UNREACHABLE]}, "T1").certificate
    assert made is not None
    check_every_change(json.loads(json.dumps(made.to_json())), *REPLACEMENTS)


@pytest.mark.slow
@pytest.mark.parametrize("index", range(len(SMALL)))
def test_every_change_of_a_small_plan_is_noticed_or_harmless(index: int) -> None:
    check_every_change(small(index), *REPLACEMENTS)


@pytest.mark.parametrize("index", range(len(SMALL)))
def test_no_other_verdict_of_a_small_plan_passes(index: int) -> None:
    original = small(index)
    assert oag.recheck(original) and claim_holds(original, ()) is True
    for forged in framings(original):
        if oag.recheck(forged):
            assert claim_holds(forged, ()) is True
