"""The contact sheet shows each room in a tile of its own."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.household import TILE_PX, room_sheet
from executor.scenes.generators import household

pytestmark = [pytest.mark.render, pytest.mark.physics, pytest.mark.slow]


def test_a_sheet_has_a_tile_for_each_pair() -> None:
    pairs = [household.pair(13100, index) for index in (48, 78)]
    sheet = room_sheet(pairs, columns=2)
    width, height = TILE_PX
    assert sheet.size[0] == 2 * width and sheet.size[1] > height
    tiles = [np.asarray(sheet)[:height, left : left + width].astype(int) for left in (0, width)]
    assert all(tile.std() > 5.0 for tile in tiles)
    assert np.abs(tiles[0] - tiles[1]).mean() > 5.0
