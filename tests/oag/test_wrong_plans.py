"""Wrong plans are refused at the right place, for the right reason, as data."""

from __future__ import annotations

import pytest

import oag
from tests.oag.paper import INVALID, assert_golden, invalid, scene, task_json, verify

# Variant -> code, subtask, step, literal, since, EAI label.
EXPECTED: dict[str, tuple[str, int | None, int | None, str | None, str | None, str | None]] = {
    "dropped_open": ("flow/precondition", 1, 3, "open(refrigerator_0)", "the start", "MISSING_STEP"),
    "dropped_grasp": ("flow/goal-not-reached", 1, None, "not ontop(glass_0, table_0)", "the start", "MISSING_STEP"),
    "dropped_lift": ("flow/goal-not-reached", 1, None, "not ontop(glass_0, table_0)", "the start", "MISSING_STEP"),
    "dropped_converge": ("flow/precondition", 3, 2, "eef(at refrigerator_0)", "T4 step 2 APPROACH", "MISSING_STEP"),
    "close_before_put": ("flow/precondition", 2, 3, "handempty", "T2 step 4 GRASP", "WRONG_TEMPORAL_ORDER"),
    "closed_while_holding": ("flow/precondition", 2, 3, "handempty", "T2 step 4 GRASP", "WRONG_TEMPORAL_ORDER"),
    "closed_too_early": (
        "flow/precondition",
        3,
        3,
        "open(refrigerator_0)",
        "T2 step 5 ARTICULATE_CLOSE",
        "WRONG_TEMPORAL_ORDER",
    ),
    "dropped_close": (
        "goal/not-reached",
        None,
        None,
        "not open(refrigerator_0)",
        "T1 step 4 ARTICULATE_OPEN",
        "MISSING_STEP",
    ),
    "goal_undone": (
        "goal/undone",
        None,
        None,
        "not open(refrigerator_0)",
        "T5 step 4 ARTICULATE_OPEN",
        "WRONG_TEMPORAL_ORDER",
    ),
    "wrong_start": ("context/start", 0, None, "open(refrigerator_0)", "the start", None),
    "wrong_place": ("context/refuted", 1, None, "ontop(glass_0, refrigerator_0)", "the start", "MISSING_STEP"),
    "unknown_object": ("bddl/unknown-object", 1, None, None, None, "UNSEEN_OBJECT"),
    "wrong_arity": ("bddl/arity", 1, None, None, None, "PARAMETER_ERROR"),
    "missing_parenthesis": ("bddl/syntax", 0, None, None, None, "PARSE_ERROR"),
    "unknown_predicate": ("bddl/unknown-predicate", 1, None, None, None, "HALLUCINATION"),
    "too_wide": ("task/size", 1, 3, None, None, "AFFORDANCE_ERROR"),
    "wrong_support": ("task/role-scope", 2, None, None, None, "PARAMETER_ERROR"),
    "opens_a_table": ("bddl/kind", 0, None, None, None, "AFFORDANCE_ERROR"),
    "contradictory": ("task/contradictory", 0, None, None, None, None),
}
SEVERAL = {"unknown_primitive": "flow/unknown-primitive", "parameter_out_of_range": "flow/parameter"}


def test_every_variant_is_expected_something_of() -> None:
    assert set(INVALID) == set(EXPECTED) | set(SEVERAL)


@pytest.mark.parametrize("name", INVALID)
def test_variants_are_refuted_with_their_message(name: str) -> None:
    report = invalid(name)
    assert report.verdict is oag.Verdict.REFUTED
    assert not report
    assert_golden(name, str(report))


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_one_root_cause_at_its_place(name: str) -> None:
    errors = invalid(name).errors
    assert len(errors) == 1, [str(error) for error in errors]
    error = errors[0]
    found = (error.code, error.subtask, error.step, error.literal, error.since, error.eai_label)
    assert found == EXPECTED[name]


@pytest.mark.parametrize("name", sorted(SEVERAL))
def test_independent_mistakes_are_all_reported(name: str) -> None:
    errors = invalid(name).errors
    assert {error.code for error in errors} == {SEVERAL[name]}
    assert len(errors) == (2 if name == "unknown_primitive" else 3)


def test_two_independent_causes_in_one_plan() -> None:
    """The refrigerator is never opened, and the glass is never lifted: two mistakes, both reported."""
    data = task_json("T1")
    data["sub_tasks"].pop(0)
    data["sub_tasks"][0]["flow"].pop()
    errors = verify(data, "T1").errors
    assert [(error.code, error.subtask) for error in errors] == [("flow/goal-not-reached", 0), ("flow/precondition", 1)]


def test_dependent_failures_are_counted_not_reported() -> None:
    assert invalid("close_before_put").errors[0].dependent == 3
    assert "3 later failures follow from this one" in str(invalid("close_before_put"))


def test_unknown_things_come_with_near_names() -> None:
    assert invalid("unknown_object").errors[0].hint == "did you mean glass_0?"
    assert "3 GRASP" in str(invalid("unknown_primitive").errors[0].hint)
    assert "ontop" in str(invalid("unknown_predicate").errors[0].hint)


def test_a_concrete_start_state_is_given() -> None:
    error = invalid("dropped_open").errors[0]
    assert error.start == ("ontop(glass_0, table_0)", "not open(refrigerator_0)", "handempty")
    assert error.stops_at == "T2.4"


def test_refutations_are_certified_where_the_plan_is_well_formed() -> None:
    certificate = invalid("dropped_open").certificate
    assert certificate is not None
    assert oag.recheck(certificate).reason == "('precondition', 1, 3) fails, as claimed"
    assert invalid("unknown_object").certificate is None


def test_taking_something_out_of_a_closed_fixture_is_refused() -> None:
    data = task_json("T1")
    facts = ["(inside glass_0 refrigerator_0)", "(not (open refrigerator_0))"]
    kitchen = oag.Scene.from_json({**scene("T1").to_json(), "facts": facts})
    pick = data["sub_tasks"][1]
    pick |= {"support_init": "refrigerator_0", "init": "(inside glass_0 refrigerator_0)"}
    pick["goal"] = "(inside glass_0 gripper)"
    data |= {"sub_tasks": [pick], "goal": "(inside glass_0 gripper)"}
    error = oag.compose(oag.Task.from_json(data, scene=kitchen)).verify().errors[0]
    assert (error.code, error.step, error.literal) == ("flow/precondition", 3, "open(refrigerator_0)")


def test_reports_are_json() -> None:
    written = invalid("dropped_open").to_json()
    assert written["verdict"] == "REFUTED"
    diagnostics = written["diagnostics"]
    assert isinstance(diagnostics, list)
    assert diagnostics[0]["subtask"] == 1 and diagnostics[0]["step"] == 3
