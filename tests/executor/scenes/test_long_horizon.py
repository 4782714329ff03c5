"""The long-horizon scenes: equal seeds, equal scenes; varied ones; nothing overlaps and all facts are so."""

from __future__ import annotations

import math
from functools import cache

import pytest

import oag
from executor.assets.footprint import Footprint, gaps_m
from executor.scenes.generators.long_horizon import FAMILIES, FRIDGE_FRONT_M, PASSAGES_M, QUERIES, TIGHT_FRONTS_M, draw
from executor.scenes.pair import NotDrawn, ScenePair
from executor.scenes.validation import overlaps, settle
from executor.sim.world import World
from oag import SceneObject
from oag.sizes import LEAST_SCALE, PAPER_GRIPPER

SEEDS = range(12100, 12112)


@cache
def drawn(family: str) -> tuple[ScenePair, ...]:
    return tuple(draw(family, seed) for seed in SEEDS)


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_equal_seeds_give_equal_pairs_and_others_other_ones(family: str) -> None:
    first, second = drawn(family)[:2]
    assert draw(family, SEEDS[0]) == first
    assert first.scene.objects != second.scene.objects


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_nothing_overlaps_and_the_facts_are_what_the_detectors_read(family: str) -> None:
    for pair in drawn(family)[:3]:
        with World(pair.scene, oracle=True) as world:
            assert max((depth_m for _, _, depth_m in overlaps(world)), default=0.0) < 0.001
        again = settle(pair.scene)
        assert again.facts == pair.scene.facts
        assert all(math.dist(again[key].position, thing.position) < 0.001 for key, thing in pair.scene.objects.items())


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_the_plan_is_proved_and_what_it_takes_hold_of_fits_the_gripper(family: str) -> None:
    for pair in drawn(family):
        assert pair.query == QUERIES[family]
        assert oag.compose(pair.task, scene=pair.scene).verify()
        assert set(pair.task.scales.values()) == {1.0}
        for subtask in pair.task.subtasks:
            target = pair.scene[subtask.target]
            assert target.role == "A" or min(target.extent_m[:2]) <= PAPER_GRIPPER.widest_m


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_ids_name_files(family: str) -> None:
    assert [pair.id for pair in drawn(family)] == [f"{family}-{seed:06d}" for seed in SEEDS]


@pytest.mark.slow
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


@pytest.mark.slow
def test_widths_of_what_is_taken_vary_and_a_kitchen_without_scaling_says_why_there_is_none() -> None:
    glasses = [pair.scene["glass_0"] for pair in drawn("T1")]
    widths_m = [min(glass.extent_m[:2]) for glass in glasses]
    assert len(set(widths_m)) == len(widths_m) and max(widths_m) - min(widths_m) > 0.008
    assert all(glass.scale[0] >= LEAST_SCALE for glass in glasses)
    with pytest.raises(NotDrawn, match=r"glass_0 is 0\.0.. m wide.*it is to keep its size"):
        draw("T1", SEEDS[0], keep_sizes=True)
    cup = draw("T4", SEEDS[0], keep_sizes=True)
    assert "cup_0" in cup.scene.objects and cup.scene["cup_0"].scale == (1.0, 1.0, 1.0)


@pytest.mark.slow
def test_corners_aisles_and_doors_that_open_half_way_are_drawn() -> None:
    kitchens = [pair for family in ("T1", "T2", "T3") for pair in drawn(family)]
    gaps = [_before(pair) for pair in kitchens]
    assert any(gap < 0.75 for gap in gaps) and any(gap > 1.2 for gap in gaps)
    assert min(gaps) >= TIGHT_FRONTS_M[0] - 1e-6
    aisles = [_aisle(pair) for pair in kitchens]
    assert any(aisle < 0.75 for aisle in aisles) and min(aisles) >= PASSAGES_M[0] - 1e-6
    assert any(_in_a_corner(pair) for pair in drawn("T1") + drawn("T2"))
    assert any(not _in_a_corner(pair) for pair in drawn("T1") + drawn("T2"))


@pytest.mark.slow
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


@pytest.mark.slow
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
    things = {obj.id: Footprint.of(obj) for obj in pair.scene.objects.values() if obj.role == "B" and obj.id != target}
    return sum(gap_m < 0.18 for _, gap_m in gaps_m(Footprint.of(pair.scene[target]), things))


def _side(table: SceneObject) -> str:
    yaw = Footprint.of(table).yaw_rad
    return "north" if 0.5 < yaw < 2.6 else "south" if -2.6 < yaw < -0.5 else "west"


def _piece(pair: ScenePair) -> SceneObject:
    """What the kitchen's row is about."""
    return pair.scene["refrigerator_0" if "refrigerator_0" in pair.scene.objects else "cabinet_0"]


def _before(pair: ScenePair) -> float:
    """Gap between the table and the piece."""
    return Footprint.of(_piece(pair)).gap_m(Footprint.of(pair.scene["table_0"]))


def _aisle(pair: ScenePair) -> float:
    """Gap between the table and the nearest furniture other than the piece."""
    table, piece = Footprint.of(pair.scene["table_0"]), _piece(pair)
    others = [obj for obj in pair.scene.objects.values() if obj.role == "A" and obj.category != "wall"]
    gaps = [table.gap_m(Footprint.of(obj)) for obj in others if obj.id not in ("table_0", piece.id)]
    beside = [gap for gap in gaps if gap > 0.0]
    return min(beside, default=10.0)


def _in_a_corner(pair: ScenePair) -> bool:
    """Whether somebody who opens the door has a wall where there would be floor beyond its hinge."""
    fridge = pair.scene["refrigerator_0"]
    walls = [obj for obj in pair.scene.objects.values() if obj.category == "wall"]
    mine = Footprint.of(fridge)
    side = 1.0 if fridge.parameters.get("hinge") == "left" else -1.0
    edge_m = mine.y_m + side * (mine.half_y_m + 0.6 * FRIDGE_FRONT_M)
    return any(abs(edge_m) > abs(obj.position[1]) - 0.1 for obj in walls if obj.position[1] * side > 1.0)
