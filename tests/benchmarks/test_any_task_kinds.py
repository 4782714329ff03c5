"""Wishes by kind in drawn homes: each is of its kind by sizes and places, whatever geometry says of it."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.any_task_kinds import HIGH_M, KINDS, Asked, Home, show
from executor.scenes.changes import place_of
from executor.scenes.generators import any_task

SEEDS = (85002, 85003, 85004)


@pytest.fixture(scope="module")
def homes() -> list[Home]:
    return [Home(any_task.draw(seed).scene, np.random.default_rng(seed)) for seed in SEEDS]


def first(homes: list[Home], kind: str) -> list[tuple[Home, Asked]]:
    found = [(home, next(KINDS[kind](home), None)) for home in homes]
    return [(home, asked) for home, asked in found if asked is not None]


def test_high_wishes_are_about_a_surface_of_that_height(homes: list[Home]) -> None:
    found = first(homes, "high")
    assert found
    for home, asked in found:
        item, place = asked.meant[0].args
        foot_m = home.scene[item].position[2] - home.scene[item].extent_m[2] / 2
        heights_m = [foot_m, *home.tops_m(place).values()]
        assert any(HIGH_M[0] <= height_m <= HIGH_M[1] for height_m in heights_m)


def test_contents_are_a_second_thing_and_parts_and_spots_are_named(homes: list[Home]) -> None:
    for home, asked in first(homes, "contents"):
        vessel = asked.meant[0].args[1]
        assert len(asked.meant) + sum(place[0] == vessel for place in home.places.values()) > 1
    for kind in ("named-part", "next-to"):
        found = first(homes, kind)
        assert found
        assert all(asked.where is not None for _, asked in found)


def test_what_blocks_is_put_there_and_the_scene_holds(homes: list[Home]) -> None:
    found = first(homes, "blocked")
    assert found
    for home, asked in found:
        moved = [key for key in home.items if place_of(asked.scene, key) != home.places[key]]
        near = [key for key in home.items if asked.scene[key].position != home.scene[key].position]
        assert moved or near
        assert asked.scene.objects.keys() == home.scene.objects.keys()


def test_the_table_has_kinds_that_lack_proofs_and_wishes_that_were_only_proved(
    capsys: pytest.CaptureFixture[str],
) -> None:
    refused = {"kind": "stack", "ended": "not-proved", "failure": {"kind": "misread", "message": ""}}
    failed = {"kind": "high", "ended": "infeasible", "stage": "feasibility", "cpu_s": 2.0, "subtask_names": ["a", "b"]}
    results = [
        refused,
        {"kind": "next-to", "ended": "proved"},
        {**failed, "failure": {"kind": "no-path", "message": ""}},
        {**failed, "ended": "succeeded", "stage": "physics", "failure": None},
    ]
    show(results, ("high", "next-to", "stack", "blocked"), 2)
    table = capsys.readouterr().out.splitlines()
    assert table[0].startswith("high: 2 drawn, 2 proved, 1 feasible, succeeded 1 of 2")
    assert table[1:] == [
        "  unmet: 1 no-path",
        "next-to: 1 drawn, 1 proved (1 fewer than asked for)",
        "stack: 1 drawn, 0 proved (2 fewer than asked for)",
        "  not proved: 1 misread",
        "blocked: 0 drawn, 0 proved (2 fewer than asked for)",
        table[-1],
    ]
    assert table[-1].startswith("of 2 subtasks: 1 of 2")
