"""Fixes of plans that rest on something unknown even when right: offered, checked, and assuming nothing cheap."""

from __future__ import annotations

import copy
from typing import Any

import pytest

import oag
from tests.oag.other_tasks import picking, placing, scene, task

# Nothing is closed but `open`: whether the egg is in the refrigerator, and where the bowl is, nobody says. What stands
# on the egg goes where the egg goes, and nothing is put into it: that the bowl does not stand there is said.
HALF_KNOWN: dict[str, Any] = {
    **scene("half", {"egg_0": "egg", "bowl_0": "bowl"}, {"fridge_0": "fridge", "island_0": "island"}, []),
    "facts": ["(ontop egg_0 island_0)", "(not (ontop bowl_0 egg_0))"],
    "closed": ["open"],
}
GOAL = "(and (inside egg_0 bowl_0) (imply (inside bowl_0 fridge_0) (open fridge_0)))"
RIGHT = task("egg_into_bowl", GOAL, picking("egg_0", "ontop", "island_0"), placing("egg_0", "inside", "bowl_0"))


def verified(data: dict[str, Any]) -> oag.Report:
    """The report on a plan in the half-known scene."""
    return oag.compose(oag.Task.from_json(data, scene=oag.Scene.from_json(HALF_KNOWN))).verify()


def broken(subtask: int, step: int | None) -> dict[str, Any]:
    """The right plan without one step, or without one subtask."""
    data = copy.deepcopy(RIGHT)
    if step is None:
        del data["sub_tasks"][subtask]
    else:
        del data["sub_tasks"][subtask]["flow"][step]
    return data


def test_the_right_plan_rests_on_two_unknown_things() -> None:
    report = verified(RIGHT)
    assert report.verdict is oag.Verdict.CONDITIONAL
    assert [line.partition(":")[0] for line in report.assumptions if line.endswith("unknown, and needed")] == [
        "not inside(egg_0, fridge_0)",
        "not inside(bowl_0, fridge_0)",
    ]


@pytest.mark.parametrize(
    ("subtask", "step", "kind"),
    [
        (0, 1, "insert-step"),
        (0, 2, "insert-step"),
        (0, 4, "insert-step"),
        (1, 0, "insert-step"),
        (1, 3, "insert-step"),
        (0, None, "insert-subtask"),
        (1, None, "insert-subtask"),
    ],
)
def test_what_is_missing_is_offered_and_nothing_fails_with_it(subtask: int, step: int | None, kind: str) -> None:
    report = verified(broken(subtask, step))
    assert report.verdict is oag.Verdict.REFUTED
    fixes = report.fixes
    assert fixes[0].kind == kind and not fixes[0].proves and fixes[0].remaining == 0
    assert "some things stay unknown" in str(fixes[0])
    for fix in fixes:
        repaired = oag.compose(fix.apply(report.task), fix.apply_to_scene(report.scene)).verify()
        assert repaired.verdict is oag.Verdict.CONDITIONAL
        # That the egg is in the bowl is for the plan to bring about, not to assume.
        assert not any(line.startswith("inside(egg_0, bowl_0)") for line in repaired.assumptions)
