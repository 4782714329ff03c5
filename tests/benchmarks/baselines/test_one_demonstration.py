"""One demonstration moved to another room: what moves with its thing, and what is interpolated between."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from benchmarks.baselines.__main__ import main
from benchmarks.baselines.methods import run_baseline
from benchmarks.baselines.one_demonstration import (
    RECORD_HZ,
    HandPose,
    Segment,
    action_between,
    interpolate_moments,
    transform_segment,
)
from executor.bench.units import BenchSetting, Unit
from executor.geometry import inverse, rotation_z, transform

HAND = transform(rotation_z(0.3), [0.4, 0.1, 0.7])
START = HandPose(np.array([1.0, 2.0, 0.5]), HAND, 1.0)
LATER = HandPose(np.array([1.1, 2.0, 0.6]), transform(rotation_z(0.5), [0.45, 0.1, 0.7]), 0.0)


def in_the_world(moment: HandPose) -> np.ndarray:
    base = transform(rotation_z(float(moment.base[2])), [*moment.base[:2], 0.0])
    return base @ moment.T_base_eef


def test_the_hand_stays_where_it_was_beside_its_thing() -> None:
    before = transform(rotation_z(0.2), [1.5, 2.2, 0.8])
    now = transform(rotation_z(2.9), [-3.0, 0.4, 0.95])
    segment = Segment(before, (START, LATER))
    for was, moment in zip(segment.moments, transform_segment(segment, now), strict=True):
        np.testing.assert_allclose(inverse(now) @ in_the_world(moment), inverse(before) @ in_the_world(was), atol=1e-9)
        assert moment.opening == was.opening


def test_what_stands_where_it_stood_is_done_as_it_was() -> None:
    thing = transform(rotation_z(0.2), [1.5, 2.2, 0.8])
    for was, moment in zip((START, LATER), transform_segment(Segment(thing, (START, LATER)), thing), strict=True):
        np.testing.assert_allclose(moment.base, was.base, atol=1e-12)
        np.testing.assert_allclose(moment.T_base_eef, was.T_base_eef, atol=1e-12)


def test_actions_lead_from_one_moment_to_the_next() -> None:
    action = action_between(START, LATER)
    np.testing.assert_allclose(START.T_base_eef[:3, 3] + action[:3], LATER.T_base_eef[:3, 3])
    ahead = rotation_z(0.5)[:2, :2] @ action[7:9]
    np.testing.assert_allclose(START.base[:2] + ahead, LATER.base[:2])
    assert action[6] == 0.0 and action[9] == pytest.approx(0.1) and action[5] == pytest.approx(0.2)


def test_the_way_between_segments_is_straight_and_slow() -> None:
    far = replace(LATER, base=np.array([4.0, -2.0, -2.5]))
    way = [START, *interpolate_moments(START, far), far]
    steps = [action_between(a, b) for a, b in pairwise(way)]
    assert max(np.hypot(*step[7:9]) for step in steps) <= 0.5 / RECORD_HZ + 1e-9
    assert max(np.linalg.norm(step[:3]) for step in steps) <= 0.25 / RECORD_HZ + 1e-9
    heading = (far.base - START.base)[:2] / np.linalg.norm((far.base - START.base)[:2])
    beside = [abs((moment.base - START.base)[:2] @ [-heading[1], heading[0]]) for moment in way]
    assert max(beside) < 1e-9 and {moment.opening for moment in way[:-1]} == {1.0}


@pytest.mark.parametrize(
    ("family", "seed", "episodes"), [("T1", 62800, 1), ("T4", 62795, 6), ("T2", 62804, 2), ("T5", 62799, 37)]
)
def test_it_is_not_measured_where_the_demonstration_was_made(
    family: str, seed: int, episodes: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = [family, "--seed", str(seed), "--episodes", str(episodes), "--out", str(tmp_path / "b")]
    with pytest.raises(SystemExit, match="2"):
        main(["one-demonstration", *asked])
    assert f"--seed {seed}: the demonstrations are of the seeds 62800 to 62804" in capsys.readouterr().err
    assert not (tmp_path / "b").exists()


@pytest.mark.slow
def test_a_refrigerator_is_opened_as_another_one_was() -> None:
    result = run_baseline(Unit("T5", 62000, 0, BenchSetting(baseline="one-demonstration")))
    assert result["ended"] == "succeeded" and [s["succeeded"] for s in result["subtasks"]] == [True]
    assert result["simulated_s"] > 3.0
