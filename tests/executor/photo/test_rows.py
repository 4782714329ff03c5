"""A row of furniture is taken apart where heights, fronts or colours differ; what stands on it is no part of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from executor.assets.library import LIBRARY
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.starts import flat_among, large_enough
from executor.photo.geometry.observation import Observation
from executor.photo.geometry.residuals import LEAST_PX, VisibilityCheck, split_row
from executor.photo.output import visible_owners
from tests.executor.photo.test_fit import TABLE, seen_from_above

LEFT = PoseHypothesis(LIBRARY["cabinet_one_door"], 2.2, 0.4, 0.0, 0.0, (0.6, 0.6, 0.8))
RIGHT = replace(LEFT, y_m=-0.2)
MICROWAVE = PoseHypothesis(LIBRARY["microwave_side_hinge"], 2.2, 0.4, 0.0, 0.8, (0.35, 0.45, 0.28))
GREY, WHITE = (170, 178, 176), (190, 188, 182)


def row(
    *guesses: PoseHypothesis, colours: tuple[tuple[int, int, int], ...]
) -> tuple[Observation, list[NDArray[np.bool_]]]:
    """Return a picture of some things, each of one colour, and where each of them is."""
    seen, _ = seen_from_above(*guesses)
    shown = visible_owners(seen, {str(number): one for number, one in enumerate(guesses)})
    rgb = np.array([*colours, (90, 90, 90)], dtype=np.uint8)[shown]
    return replace(seen, rgb=rgb), [shown == number for number in range(len(guesses))]


def parts_of(seen: Observation, things: list[NDArray[np.bool_]]) -> list[NDArray[np.bool_]]:
    return [one for one in split_row(np.any(things, axis=0) & seen.measured, seen, ()) if one.sum() >= LEAST_PX]


def common(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> float:
    return float((first & second).sum() / (first | second).sum())


@pytest.mark.parametrize(
    ("right", "colours"),
    [
        (RIGHT, (GREY, WHITE)),
        (replace(RIGHT, size_m=(0.6, 0.6, 0.86)), (GREY, GREY)),
        (replace(RIGHT, x_m=2.12), (GREY, GREY)),
    ],
    ids=["colour", "height", "front"],
)
def test_neighbours_that_differ_are_parted(right: PoseHypothesis, colours: tuple[tuple[int, int, int], ...]) -> None:
    seen, things = row(LEFT, right, colours=colours)
    parts = parts_of(seen, things)
    assert len(parts) == 2
    assert all(max(common(thing, part) for part in parts) > 0.9 for thing in things)


def test_neighbours_that_are_alike_are_one_piece() -> None:
    seen, things = row(LEFT, RIGHT, colours=(GREY, GREY))
    assert len(parts_of(seen, things)) == 1


def test_what_stands_on_a_row_is_a_part_of_its_own() -> None:
    seen, things = row(LEFT, RIGHT, MICROWAVE, colours=(GREY, GREY, (60, 60, 60)))
    upon, below = parts_of(seen, things)
    assert common(upon, things[2]) > 0.85
    assert common(below, things[0] | things[1]) > 0.85


def test_of_a_table_before_the_camera_a_corner_is_enough_and_of_a_wall_it_is_not() -> None:
    seen, _ = seen_from_above(TABLE)
    top = seen.points_m[..., 2] > TABLE.size_m[2] - 0.1
    shown = top & (visible_owners(seen, {"table": TABLE}) == 0)
    depth_m = np.where(shown, seen.z_m, np.inf)
    far_beyond = TABLE.corners_m() * [1.0, 20.0, 1.0]
    nothing = np.full(seen.z_m.shape, np.inf)
    claim = VisibilityCheck.of(seen, depth_m, nothing, far_beyond)
    assert claim.visible_share < 0.25 and claim.is_borne_out(60)
    upright = replace(seen, rays=seen.rays[..., [0, 2, 1]])
    assert not VisibilityCheck.of(upright, depth_m, nothing, far_beyond).is_borne_out(60)


def test_what_stands_on_a_table_does_not_make_it_too_high_for_one_and_a_bed_may_lack_its_head() -> None:
    rng = np.random.default_rng(0)
    top = np.column_stack([rng.uniform(1.5, 2.2, 900), rng.uniform(-0.5, 0.5, 900), np.full(900, 0.7)])
    bottle = top[:100] * [0.1, 0.1, 1.0] + [1.6, 0.0, 0.25]
    models = {entry.model for entry in large_enough(np.vstack([top, bottle]), [0.0])}
    assert "table_four_legs" in models and "bed_single" in models
    low = top * [1.5, 1.0, 0.0] + [0.0, 0.0, 0.45]
    assert "bed_single" in {entry.model for entry in large_enough(low, [0.0])}
    few = large_enough(top[:5], [0.0])
    assert few == flat_among(LIBRARY.values()) and {"plate", "book_lying"} <= {entry.model for entry in few}
