"""Targets that are drawn otherwise: within the paper's ranges, before the gripper's sizes."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from executor.assets.footprint import yaw_of
from executor.data.generation import series_of
from executor.data.units import UNVARIED, DemoUnit
from executor.data.work import drawn_values, prepare_unit
from executor.scenes.generators.families import scene_name_for_seed
from oag import Scene
from oag.sizes import PAPER_GRIPPER

pytestmark = pytest.mark.physics


def _unit(seed: int, *vary: str, distractors: int = 0, family: str = "T1") -> DemoUnit:
    wishes = {"seed": seed, "episodes": 1, "vary": list(vary), "distractors": distractors}
    (series,) = series_of({**wishes, "sources": [{"families": [family]}]})
    return next(series.units())


def _drawn(unit: DemoUnit) -> tuple[Scene, dict[str, dict[str, float]]]:
    """Return a unit's scene, and what is said to be drawn of its targets."""
    todo = prepare_unit(unit)
    return todo.graph.scene, drawn_values(unit, todo.graph.scene, todo.perturbations)["target"]


@pytest.mark.parametrize("seed", [62400, 62401, 62402])
def test_targets_stray_within_the_papers_ranges_and_still_fit_the_hand(seed: int) -> None:
    usual = prepare_unit(_unit(seed)).graph.scene
    other, drawn = _drawn(_unit(seed, "target"))
    assert drawn.keys() == {"glass_0", "refrigerator_0"}
    for perturbation in drawn.values():
        assert all(0.9 <= perturbation[side] <= 1.1 for side in ("wider", "deeper", "higher"))
        assert abs(perturbation["turned_rad"]) <= math.pi / 12
    glass, before, after = drawn["glass_0"], usual["glass_0"], other["glass_0"]
    assert after.extent_m != before.extent_m
    assert min(after.extent_m[:2]) <= PAPER_GRIPPER.widest_m
    shape = (after.scale[2] / after.scale[0]) / (before.scale[2] / before.scale[0])
    assert shape == pytest.approx(glass["higher"] / glass["wider"], rel=1e-6)
    fridge = drawn["refrigerator_0"]
    assert other["refrigerator_0"].scale == (fridge["wider"], fridge["deeper"], fridge["higher"])
    assert yaw_of(other["refrigerator_0"]) == pytest.approx(fridge["turned_rad"])  # It stands at the east wall.
    assert {name for name, thing in other.objects.items() if thing.scale != (1.0, 1.0, 1.0)} == drawn.keys()


def test_what_stands_on_furniture_strays_as_far_as_there_is_room() -> None:
    microwave = replace(_unit(62400, "target", family="T5"), index=5)
    usual = prepare_unit(replace(microwave, variation=UNVARIED)).graph.scene["microwave_0"]
    scene, drawn = _drawn(microwave)
    (perturbation,), thing = drawn.values(), scene["microwave_0"]
    assert drawn.keys() == {"microwave_0"}
    assert thing.scale == (perturbation["wider"], perturbation["deeper"], perturbation["higher"])
    assert yaw_of(thing) - yaw_of(usual) == pytest.approx(perturbation["turned_rad"])


def test_what_a_target_is_drawn_as_does_not_depend_on_other_axes() -> None:
    alone, both = _unit(62400, "target"), _unit(62400, "target", "physics", "surfaces")
    assert prepare_unit(alone).graph.scene == prepare_unit(both).graph.scene


@pytest.mark.slow
def test_distractors_stand_on_what_the_task_does_not_use_and_move_nothing_else() -> None:
    added = 0
    for seed in (62400, 62401, 62402):
        usual, other = prepare_unit(_unit(seed)).graph, prepare_unit(_unit(seed, distractors=4)).graph
        more = other.scene.objects.keys() - usual.scene.objects.keys()
        assert more == drawn_values(_unit(seed, distractors=4), other.scene, {})["distractors"].keys()
        assert len(more) <= 4
        added += len(more)
        assert {part.target for part in other.task.subtasks} == {part.target for part in usual.task.subtasks}
        assert not {other.scene[name].category for name in more} & {t.category for t in usual.scene.objects.values()}
        for name, thing in usual.scene.objects.items():
            assert math.dist(other.scene[name].position, thing.position) < 0.01
    assert added > 0


def test_sizes_are_adjusted_once_where_a_sentence_is_asked_of_a_scene() -> None:
    asked = {"query": "pick up the glass", "scene": "kitchen_t1"}
    (series,) = series_of({"seed": 62400, "episodes": 1, "sources": [asked]})
    todo = prepare_unit(next(series.units()))
    glass = todo.graph.scene["glass_0"]
    assert glass.scale != (1.0, 1.0, 1.0) and min(glass.extent_m[:2]) <= PAPER_GRIPPER.widest_m
    assert todo.graph.scene.with_scales(todo.graph.task.scales)["glass_0"] == glass


def test_a_sentence_may_be_about_the_kitchen_that_each_seed_draws() -> None:
    (series,) = series_of({"seed": 62990, "episodes": 2, "sources": [{"query": "pick up the glass", "scene": "t1"}]})
    origins = {unit.origin for unit in series.units()}
    assert [(origin.scene, origin.scene_key) for origin in origins] == [("t1", "")]
    assert (
        scene_name_for_seed("t1", 62990) == "t1-62990"
        and scene_name_for_seed("t1-5", 62990) == "t1-5"
        and scene_name_for_seed("t5", 1) == "t5"
    )


@pytest.mark.slow
def test_each_seed_draws_its_own_kitchen_for_a_sentence() -> None:
    (series,) = series_of({"seed": 62990, "episodes": 2, "sources": [{"query": "pick up the glass", "scene": "t1"}]})
    first, second = (prepare_unit(unit).graph.scene for unit in series.units())
    assert (first.name, second.name) == ("t1_062990", "t1_062991")
    assert first.objects.keys() != second.objects.keys() or first.robot != second.robot
