"""Targets that are drawn otherwise: within the paper's ranges, before the gripper's sizes."""

from __future__ import annotations

import math

import pytest

from executor.datasets.plan import series_of
from executor.datasets.units import DemoUnit
from executor.datasets.work import drawn_values, prepared
from oag.task.sizes import PAPER_GRIPPER

pytestmark = pytest.mark.physics


def _unit(seed: int, *vary: str, distractors: int = 0) -> DemoUnit:
    wishes = {"seed": seed, "episodes": 1, "vary": list(vary), "distractors": distractors}
    (series,) = series_of({**wishes, "sources": [{"families": ["T1"]}]})
    return next(series.units())


@pytest.mark.parametrize("seed", [62400, 62401, 62402])
def test_a_target_strays_within_the_papers_ranges_and_still_fits_the_hand(seed: int) -> None:
    _, usual = prepared(_unit(seed))
    _, other = prepared(_unit(seed, "target"))
    drawn = drawn_values(_unit(seed, "target"), other)["target"]
    assert list(drawn) == ["glass_0"]
    stray = drawn["glass_0"]
    assert 0.9 <= stray["wider"] <= 1.1
    assert 0.9 <= stray["higher"] <= 1.1
    assert abs(stray["turned_rad"]) <= math.pi / 12
    before, after = usual.scene["glass_0"], other.scene["glass_0"]
    assert after.extent_m != before.extent_m
    assert min(after.extent_m[:2]) <= PAPER_GRIPPER.widest_m
    shape = (after.scale[2] / after.scale[0]) / (before.scale[2] / before.scale[0])
    assert shape == pytest.approx(stray["higher"] / stray["wider"], rel=1e-6)
    furniture = [name for name, thing in usual.scene.objects.items() if thing.role == "A"]
    assert all(other.scene[name] == usual.scene[name] for name in furniture)


def test_what_a_target_is_drawn_as_does_not_depend_on_other_axes() -> None:
    alone, both = _unit(62400, "target"), _unit(62400, "target", "physics", "surfaces")
    assert prepared(alone)[1].scene == prepared(both)[1].scene


def test_distractors_stand_on_what_the_task_does_not_use_and_move_nothing_else() -> None:
    added = 0
    for seed in (62400, 62401, 62402):
        usual, other = prepared(_unit(seed))[1], prepared(_unit(seed, distractors=4))[1]
        more = other.scene.objects.keys() - usual.scene.objects.keys()
        assert more == drawn_values(_unit(seed, distractors=4), other)["distractors"].keys()
        assert len(more) <= 4
        added += len(more)
        assert {part.target for part in other.task.subtasks} == {part.target for part in usual.task.subtasks}
        assert not {other.scene[name].category for name in more} & {t.category for t in usual.scene.objects.values()}
        for name, thing in usual.scene.objects.items():
            assert math.dist(other.scene[name].position, thing.position) < 0.01
    assert added > 0
