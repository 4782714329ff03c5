"""The tree search finds ways through gaps, never through walls, and shortening keeps them free."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from executor.geometry import Array
from executor.planning.paths import connect, shorten

WALL_X = (0.45, 0.55)


def _free(gap: tuple[float, float] | None, a: Array, b: Array) -> bool:
    points = a + (b - a) * np.linspace(0.0, 1.0, 200)[:, None]
    inside_wall = (points[:, 0] > WALL_X[0]) & (points[:, 0] < WALL_X[1])
    if gap is not None:
        inside_wall &= ~((points[:, 1] > gap[0]) & (points[:, 1] < gap[1]))
    return not inside_wall.any()


def _search(gap: tuple[float, float] | None, seed: int) -> list[Array] | None:
    rng = np.random.default_rng(seed)
    return connect(
        np.array([0.1, 0.1]),
        np.array([0.9, 0.1]),
        edge_is_free=lambda a, b: _free(gap, a, b),
        sample=lambda: rng.uniform(0.0, 1.0, 2),
        weights=np.ones(2),
        step=0.2,
        iterations=400,
    )


@pytest.mark.parametrize("seed", range(10))
def test_it_finds_the_gap_in_a_wall(seed: int) -> None:
    gap = (0.7, 0.85)
    way = _search(gap, seed)
    assert way is not None
    np.testing.assert_array_equal(way[0], [0.1, 0.1])
    np.testing.assert_array_equal(way[-1], [0.9, 0.1])
    short = shorten(way, edge_is_free=lambda a, b: _free(gap, a, b), rng=np.random.default_rng(seed), attempts=60)
    for path in (way, short):
        assert all(_free(gap, a, b) for a, b in itertools.pairwise(path))

    def length(path: list[Array]) -> float:
        return float(sum(np.linalg.norm(b - a) for a, b in itertools.pairwise(path)))

    assert length(short) <= length(way) + 1e-9


def test_it_gives_up_at_a_closed_wall() -> None:
    assert _search(None, 0) is None


def test_a_free_straight_line_is_taken_as_it_is() -> None:
    way = connect(
        np.zeros(2),
        np.ones(2),
        edge_is_free=lambda a, b: True,
        sample=lambda: np.zeros(2),
        weights=np.ones(2),
        step=0.1,
        iterations=1,
    )
    assert way is not None and len(way) == 2
