"""The video decodes to one picture a sample, plays from its beginning, and never lies there half written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from executor.records import Caption, action_text, captions_of, number_text
from executor.sim.render.frames import Composer, Frames, write_video
from tests.executor.recordings import invented_rollout

av = pytest.importorskip("av")


def pictures(count: int, size: tuple[int, int] = (64, 48)) -> Frames:
    """Return three views of plain grey that gets lighter."""
    width, height = size
    tones = np.linspace(20, 220, count).astype(np.uint8)[:, None, None, None]
    views = {
        name: np.broadcast_to(tones, (count, height * k, width * k, 3)).copy()
        for name, k in (("global", 2), ("head", 1), ("wrist", 1))
    }
    return Frames(views, size, "invented")


def captions(count: int) -> tuple[Caption, ...]:
    return tuple(Caption("1/2  open refrigerator", f"step {k}", k / 10, (k + 1) / count) for k in range(count))


def test_it_decodes_to_one_picture_a_sample(tmp_path: Path) -> None:
    path = write_video(tmp_path / "v.mp4", pictures(23), captions(23), rate_hz=10.0, speed=2.0)
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        decoded = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert stream.codec_context.name == "h264"
        assert float(stream.average_rate) == pytest.approx(20.0)
    assert len(decoded) == 23
    height, width, _ = decoded[0].shape
    assert (width, height) == Composer(pictures(1)).size
    assert decoded[-1][100:140, 20:60].mean() > decoded[0][100:140, 20:60].mean() + 100


def test_players_find_the_index_before_the_pictures(tmp_path: Path) -> None:
    content = write_video(tmp_path / "v.mp4", pictures(3), captions(3)).read_bytes()
    assert 0 < content.index(b"moov") < content.index(b"mdat")


def test_a_failure_leaves_no_file(tmp_path: Path) -> None:
    def stop(done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_video(tmp_path / "v.mp4", pictures(3), captions(3), on_progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_captions_and_pictures_must_match(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="one caption for each of 3 pictures, got 2"):
        write_video(tmp_path / "v.mp4", pictures(3), captions(2))


def test_a_caption_changes_the_bar_and_a_long_one_stays_inside() -> None:
    composer = Composer(pictures(1))
    empty = composer.compose(0, Caption("", "", 0.0, 0.0))
    long = composer.compose(0, Caption("x" * 400, "y" * 400, 12.3, 0.5))
    assert empty.shape == long.shape
    assert (empty != long).any(axis=(1, 2)).nonzero()[0].max() < 56
    assert (long[:50, -4:] == long[0, 0]).all()


def test_views_without_an_overview_stand_side_by_side() -> None:
    both = pictures(1).views
    composer = Composer(Frames({"head": both["head"], "wrist": both["wrist"]}, (64, 48)))
    assert composer.size == (128, 48 + 56)


def test_captions_say_subtask_step_and_number() -> None:
    made = captions_of(invented_rollout())
    assert made[0].title == "1/2  open refrigerator"
    assert made[0].detail == "step 1 of 7: NAVIGATE_TO_TARGET"
    assert made[30].detail == "step 5 of 7: ARTICULATE_OPEN 0 0.85"
    assert made[-1].progress == 1.0


@pytest.mark.parametrize(
    ("action", "words"),
    [(3, "GRASP"), ({"7": 0.123456}, "GRASP 0.1235"), ({"4": [0, 0.7]}, "GRASP 0 0.7"), ({"13": None}, "GRASP")],
)
def test_actions_in_words(action: object, words: str) -> None:
    assert action_text("GRASP", action) == words


@pytest.mark.parametrize(("value", "words"), [(-1.7e-8, "0"), (0.00012345, "0.0001234"), (3, "3"), (True, "True")])
def test_numbers_in_words(value: object, words: str) -> None:
    assert number_text(value) == words
