"""Deferred rendering: equal pictures however many processes draw them, and a dead process is replaced."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from executor.records import Rollout
from executor.sim.render.frames import RenderFailed, RenderPool, render
from tests.executor.recordings import invented_rollout, scripted_rollout

pytestmark = [pytest.mark.render, pytest.mark.slow]
SIZE = (64, 48)


@pytest.fixture(scope="module")
def recording() -> Rollout:
    return scripted_rollout("kitchen_t1", seconds=0.6)


@pytest.fixture(scope="module")
def pool() -> Iterator[RenderPool]:
    with RenderPool(2) as made:
        yield made


def test_every_sample_is_drawn_in_every_view(recording: Rollout, pool: RenderPool, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    frames = render(
        recording, tmp_path, size=SIZE, pool=pool, on_progress=lambda done, total: seen.append((done, total))
    )
    assert frames.count == len(recording.trajectory.time_s) == 6
    assert frames.views["global"].shape == (6, 96, 128, 3)
    assert frames.views["head"].shape == frames.views["wrist"].shape == (6, 48, 64, 3)
    for pictures in frames.views.values():
        assert all(picture.std() > 5 for picture in pictures)
    # The robot moves, so its own cameras see something else in the end.
    for view in ("head", "wrist"):
        assert np.abs(frames.views[view][0].astype(int) - frames.views[view][-1]).mean() > 1
    assert seen[-1] == (6, 6)


def test_one_process_draws_the_same_as_two(recording: Rollout, pool: RenderPool, tmp_path: Path) -> None:
    two = render(recording, tmp_path / "two", size=SIZE, pool=pool)
    with RenderPool(1) as single:
        one = render(recording, tmp_path / "one", size=SIZE, pool=single)
    for view in two.views:
        assert np.array_equal(two.views[view], one.views[view])


def test_a_process_that_dies_is_replaced(recording: Rollout, pool: RenderPool, tmp_path: Path) -> None:
    before = render(recording, tmp_path / "before", size=SIZE, pool=pool, views=("head",))
    pool._workers[0].kill()
    after = render(recording, tmp_path / "after", size=SIZE, pool=pool, views=("head",))
    assert np.array_equal(before.views["head"], after.views["head"])


def test_ctrl_c_ends_the_drawing_at_once_and_the_pool_goes_on(
    recording: Rollout, pool: RenderPool, tmp_path: Path
) -> None:
    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        render(recording, tmp_path / "first", size=SIZE, pool=pool, on_progress=stop)
    assert not pool._workers
    assert render(recording, tmp_path / "second", size=SIZE, pool=pool, views=("wrist",)).count == 6


def test_states_of_another_scene_end_in_a_sentence(pool: RenderPool, tmp_path: Path) -> None:
    with pytest.raises(RenderFailed, match="the packed state has 8 bytes"):
        render(invented_rollout(samples=2), tmp_path, size=SIZE, pool=pool, views=("head",))
