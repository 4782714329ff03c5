"""Arrays of pictures: sizes of views, and averaging down."""

from __future__ import annotations

import numpy as np
import pytest

from executor.sim.render.frames import BadPictureSize, Frames, check_size, shrink, view_size


def test_shrinking_averages_whole_blocks() -> None:
    picture = np.zeros((1, 4, 4, 3), np.uint8)
    picture[0, :2, :2] = [[[10, 0, 0], [20, 0, 0]], [[30, 0, 0], [40, 0, 0]]]
    small = shrink(picture, 2)
    assert small.shape == (1, 2, 2, 3)
    assert small[0, 0, 0].tolist() == [25, 0, 0]
    assert not small[0, 1, 1].any()


def test_the_overview_is_twice_as_large_and_the_dataset_gets_one_size() -> None:
    sizes = {view: view_size(view, (64, 32)) for view in ("global", "head")}
    views = {view: np.full((2, height, width, 3), 9, np.uint8) for view, (width, height) in sizes.items()}
    frames = Frames(views, (64, 32))
    assert frames.views["global"].shape == (2, 64, 128, 3)
    assert frames.at_size("global").shape == frames.at_size("head").shape == (2, 32, 64, 3)
    assert (frames.at_size("global") == 9).all()
    assert frames.count == 2


@pytest.mark.parametrize("size", [(0, 0), (31, 64), (33, 33), (64, 4096), (-64, 64)])
def test_impossible_sizes_are_refused(size: tuple[int, int]) -> None:
    with pytest.raises(BadPictureSize, match="even numbers from 32 to 2048"):
        check_size(size)
