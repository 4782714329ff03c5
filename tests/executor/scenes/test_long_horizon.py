"""The long-horizon scenes: equal seeds, equal scenes; varied ones; nothing overlaps and all facts are so."""

from __future__ import annotations

from functools import cache

import pytest

import oag
from executor.scenes.long_horizon import FAMILIES, QUERIES, draw
from executor.scenes.pair import ScenePair
from executor.scenes.rooms.footprint import Footprint
from executor.scenes.settle import overlaps, settle
from executor.world.world import World
from oag import SceneObject
from oag.task.sizes import WIDEST_GRASP_M

SEEDS = range(12100, 12116)


@cache
def drawn(family: str) -> tuple[ScenePair, ...]:
    return tuple(draw(family, seed) for seed in SEEDS)


@pytest.mark.parametrize("family", FAMILIES)
def test_equal_seeds_give_equal_pairs_and_others_other_ones(family: str) -> None:
    first, second = drawn(family)[:2]
    assert draw(family, SEEDS[0]) == first
    assert first.scene.objects != second.scene.objects


@pytest.mark.parametrize("family", FAMILIES)
def test_nothing_overlaps_and_the_facts_are_what_the_detectors_read(family: str) -> None:
    for pair in drawn(family)[:3]:
        with World(pair.scene, oracle=True) as world:
            assert max((depth_m for _, _, depth_m in overlaps(world)), default=0.0) < 0.001
        again = settle(pair.scene, most_moved_m=0.001)
        assert again.facts == pair.scene.facts


@pytest.mark.parametrize("family", FAMILIES)
def test_the_plan_is_proved_and_what_it_takes_hold_of_fits_the_gripper(family: str) -> None:
    for pair in drawn(family):
        assert pair.query == QUERIES[family]
        assert oag.compose(pair.task, scene=pair.scene).verify()
        assert set(pair.task.scales.values()) == {1.0}
        for subtask in pair.task.subtasks:
            target = pair.scene[subtask.target]
            assert target.role == "A" or min(target.extent_m[:2]) <= WIDEST_GRASP_M


@pytest.mark.parametrize("family", FAMILIES)
def test_ids_name_files(family: str) -> None:
    assert [pair.id for pair in drawn(family)] == [f"{family}-{seed:06d}" for seed in SEEDS]


@pytest.mark.parametrize("family", ["T1", "T2"])
def test_refrigerators_vary(family: str) -> None:
    fridges = [pair.scene["refrigerator_0"] for pair in drawn(family)]
    assert len({fridge.model for fridge in fridges}) >= 4
    assert {fridge.parameters.get("hinge") for fridge in fridges} >= {"left", "right"}
    assert len({fridge.extent_m for fridge in fridges}) == len(fridges)
    flanked = [_neighbours(pair) for pair in drawn(family)]
    assert {sides for sides, _ in flanked} >= {(), ("left",), ("right",), ("left", "right")}
    gaps = [gap for _, found in flanked for gap in found]
    assert any(gap < 0.006 for gap in gaps) and any(gap > 0.02 for gap in gaps)
    assert any(_stock(pair) for pair in drawn(family)) and any(not _stock(pair) for pair in drawn(family))


@pytest.mark.parametrize("family", FAMILIES)
def test_tables_clutter_and_robots_vary(family: str) -> None:
    pairs = drawn(family)
    target = {"T1": "glass_0", "T2": "apple_0", "T3": "apple_0"}.get(family, "")
    beside = [_beside(pair, target or pair.task.subtasks[-1].target) for pair in pairs]
    assert sum(count > 0 for count in beside) > len(pairs) // 2
    sides = {_side(pair.scene["table_0"]) for pair in pairs}
    assert sides == {"north", "south", "west"}
    yaws = [pair.scene.robot.yaw_rad for pair in pairs]
    assert max(yaws) - min(yaws) > 3.0
    items = [sum(obj.role == "B" for obj in pair.scene.objects.values()) for pair in pairs]
    assert max(items) >= 6 and min(items) <= 5


def test_apples_and_cups_vary() -> None:
    assert {pair.scene["apple_0"].model for pair in drawn("T2")} == {"red_apple", "half_apple"}
    assert {pair.task.subtasks[0].support_init for pair in drawn("T3")} == {"cabinet_0", "table_0"}
    assert {pair.task.subtasks[0].target for pair in drawn("T4")} == {"glass_0", "cup_0"}


def test_an_unknown_family_is_refused() -> None:
    with pytest.raises(ValueError, match="there is no family 'T7'; the long-horizon families are T1, T2, T3, T4"):
        draw("T7", 0)


def test_an_id_that_names_no_file_is_refused() -> None:
    pair = drawn("T4")[0]
    with pytest.raises(ValueError, match="cannot name a file"):
        ScenePair("a/b", pair.family, pair.query, pair.scene, pair.task)


def _neighbours(pair: ScenePair) -> tuple[tuple[str, ...], list[float]]:
    """Sides of the refrigerator on which something stands in its row, and the gaps."""
    fridge = Footprint.of(pair.scene["refrigerator_0"])
    sides, gaps = set(), []
    for obj in pair.scene.objects.values():
        gap = Footprint.of(obj).gap_m(fridge)
        along = obj.role == "A" and abs(Footprint.of(obj).yaw_rad) < 1e-6 and obj.category != "wall"
        if along and obj.id not in ("refrigerator_0", "table_0") and gap < 0.11 and obj.position[2] < 0.5:
            sides.add("left" if obj.position[1] > fridge.y_m else "right")
            gaps.append(gap)
    return tuple(sorted(sides)), gaps


def _stock(pair: ScenePair) -> int:
    return sum("(inside" in str(fact) and "refrigerator_0" in str(fact) for fact in pair.scene.facts)


def _beside(pair: ScenePair, target: str) -> int:
    mine = Footprint.of(pair.scene[target])
    others = [obj for obj in pair.scene.objects.values() if obj.role == "B" and obj.id != target]
    return sum(mine.beside(Footprint.of(obj)) and mine.gap_m(Footprint.of(obj)) < 0.18 for obj in others)


def _side(table: SceneObject) -> str:
    yaw = Footprint.of(table).yaw_rad
    return "north" if 0.5 < yaw < 2.6 else "south" if -2.6 < yaw < -0.5 else "west"
