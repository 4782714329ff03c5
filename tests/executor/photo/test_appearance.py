"""What a picture's colours say of where a thing ends."""

from __future__ import annotations

import numpy as np
import pytest

from executor.photo.fitting.evidence import Edges, distance_to_surroundings
from executor.photo.geometry.observation import edge_strength

GREY, RED = (120, 120, 120), (200, 40, 40)
BOX_PX = (30.0, 20.0, 70.0, 60.0)


def picture() -> np.ndarray:
    """A red square on grey, 100 x 80."""
    rgb = np.full((80, 100, 3), GREY, dtype=np.uint8)
    rgb[20:60, 30:70] = RED
    return rgb


def test_colours_that_are_seen_beside_a_box_are_likelier_left_to_others() -> None:
    grey, red = distance_to_surroundings(picture(), BOX_PX, np.array([GREY, RED]) / 255.0)
    assert grey < 0.05 < 0.2 < red


def test_beside_a_box_that_is_the_whole_picture_nothing_is_seen() -> None:
    assert np.isinf(distance_to_surroundings(picture(), (0.0, 0.0, 100.0, 80.0), np.array([GREY]) / 255.0)).all()


@pytest.mark.parametrize("step", [1, 2, 3])
def test_an_outline_costs_least_where_the_picture_has_edges(step: int) -> None:
    rows, columns = (axis.ravel() for axis in np.mgrid[10:70:step, 20:80:step])
    edges = Edges.between(edge_strength(picture()), rows, columns, step)

    def cost(left: int) -> float:
        own = (rows >= 20) & (rows < 60) & (columns >= left) & (columns < left + 40)
        return edges.border_cost(own.astype(np.int64))

    costs = {left: cost(left) for left in range(22, 39)}
    # A pixel beside it counts as there, and between pixels that are compared nobody knows.
    assert abs(min(costs, key=costs.__getitem__) - 30) <= step + 1
    assert cost(30) < 0.0 < cost(22)
    assert cost(30) < cost(38)


def test_in_a_picture_of_one_colour_no_outline_is_better_than_none() -> None:
    plain = np.full((80, 100, 3), GREY, dtype=np.uint8)
    rows, columns = (axis.ravel() for axis in np.mgrid[10:70:2, 20:80:2])
    edges = Edges.between(edge_strength(plain), rows, columns, 2)
    assert edges.border_cost(np.zeros(len(rows), dtype=np.int64)) == 0.0
    assert edges.border_cost((columns < 50).astype(np.int64)) > 0.0
