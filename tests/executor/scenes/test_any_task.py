"""T7: wishes that are equal for equal seeds, that nothing filters, and whose labels belong to them."""

from __future__ import annotations

import tomllib
from collections import Counter
from importlib import resources
from types import SimpleNamespace
from typing import Any

import pytest

import bddl
from executor.bench.any_task import _STATED, has_true_reason, labels, run_wish, wish_rows
from executor.scenes.generators import any_task
from executor.scenes.library import load
from oag.model.robots import LIFTED

SEED = 70056  # A scene that is drawn at the first try.


def test_equal_seeds_give_equal_wishes_of_their_label() -> None:
    first, second = any_task.draw(SEED), any_task.draw(SEED)
    assert first.query == second.query == labels()[SEED].query
    assert first.scene.to_json() == second.scene.to_json()
    assert first.scene.robot.model == LIFTED
    assert all(thing.scale == (1.0, 1.0, 1.0) for thing in first.scene.objects.values())


def test_what_cartons_carry_changes_no_room_that_has_a_label() -> None:
    """A carton got a top after the labels were written."""
    assert any_task.draw(70040).query == labels()[70040].query


def test_the_home_of_a_wish_has_a_name() -> None:
    assert load(f"t7-{SEED}").to_json() == any_task.draw(SEED).scene.to_json()


def test_what_is_meant_is_about_the_scene() -> None:
    wish = any_task.draw(70042)
    assert [bddl.format(literal.formula) for literal in wish.meant] == ["(inside can_0 oven_0)"]
    assert {"can_0", "oven_0"} <= wish.scene.objects.keys()


def test_labels_are_in_halves_and_give_reasons_for_what_is_impossible() -> None:
    halves = {"tuning": 50, "judging": 50, "judging-2": 100, "judging-3": 102, "judging-4": 104, "judging-5": 105}
    halves |= {"judging-6": 103, "judging-7": 103, "judging-8": 104, "judging-9": 105}
    assert Counter(label.half for label in labels().values()) == halves
    for label in labels().values():
        assert label.possible in ("yes", "no", "unsure")
        assert bool(label.reasons) is (label.possible == "no") and set(label.reasons) <= _STATED.keys()


def test_every_kind_has_phrasings_and_a_weight() -> None:
    data = tomllib.loads((resources.files(any_task.__package__) / "data" / "any_task.toml").read_text())
    assert data["weights"].keys() == data["phrasings"].keys()


@pytest.mark.parametrize(
    ("ended", "kind", "true"),
    [
        ("refused", "ambiguous-object", True),
        ("refused", "unknown-object", False),
        ("failed", "ambiguous-object", False),
    ],
)
def test_a_refusal_counts_with_a_reason_of_its_label(ended: str, kind: str, true: bool) -> None:
    assert has_true_reason({"ended": ended, "failure": {"kind": kind}, "reasons": ["ambiguous", "too-wide"]}) is true


def test_rates_rest_on_labels() -> None:
    done = {"ended": "succeeded", "stage": "physics", "understood": True, "subtask_names": ["a", "b"], "cpu_s": 4.0}
    results: list[dict[str, Any]] = [
        {**done, "kind": "open", "possible": "yes"},
        {**done, "kind": "open", "possible": "yes", "ended": "failed"},
        {"kind": "swap", "ended": "refused", "stage": "read", "failure": {"kind": "too-large"}, "possible": "yes"},
        {"kind": "swap", "ended": "refused", "stage": "read", "failure": {"kind": "affordance"}, "possible": "unsure"},
        {
            "kind": "absent",
            "ended": "refused",
            "failure": {"kind": "unknown-object"},
            "possible": "no",
            "reasons": ["not-there"],
        },
        {"ended": "not-drawn"},
    ]
    rows = dict(wish_rows(results))
    assert rows["wishes"].startswith("5: 3 possible, 1 impossible")
    assert rows["understood, of the possible"].startswith("2 of 3") and rows["succeeded, of the possible"].startswith(
        "1 of 3"
    )
    assert rows["with a true reason"].startswith("1 of 1")
    assert rows["failed after motion, of the started"].startswith("1 of 2")
    assert rows["  open"] == "2 understood, 2 proved, 2 feasible, 1 succeeded of 2"


def test_a_plan_that_geometry_refuses_was_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    far = SimpleNamespace(failure=SimpleNamespace(kind=SimpleNamespace(value="unreachable")), reason="too far")
    monkeypatch.setattr("executor.bench.any_task.feasible", lambda *_, **__: far)
    found = [run_wish(seed) for seed in (0, 1)]
    assert [(one["stage"], one["proved"]) for one in found] == [("geometry", True), ("read", False)]
