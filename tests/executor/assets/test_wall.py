"""Walls: solid, fixtures, and nothing that the robot handles."""

from __future__ import annotations

import pytest

import llm
from executor.assets.library import asset_for
from executor.assets.parameters import AssetError
from executor.scenes.long_horizon import draw
from oag import Kind
from tests.executor.helpers import scene_object


def test_a_wall_is_a_solid_fixture() -> None:
    wall = scene_object("wall", (0.08, 3.0, 2.0))
    asset = asset_for(wall)
    assert wall.kind is Kind.SUPPORT
    assert (asset.motion, asset.handles, asset.regions) == ("static", (), ())
    assert sum(shape.collides for link in asset.links for shape in link.shapes) == 1
    with pytest.raises(AssetError, match=r"its y extent is 0\.100 m"):
        asset_for(scene_object("wall", (0.08, 0.1, 2.0)))


@pytest.mark.parametrize("query", ["open the wall", "pick up the wall", "put the glass on the wall"])
def test_nothing_is_planned_with_a_wall(query: str) -> None:
    with pytest.raises(llm.QueryError):
        llm.propose(query, draw("T1", 12000).scene)
