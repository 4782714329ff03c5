"""Recovery as data: the motions that failed, with their causes and corrections, in the store and in data sets."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from executor.campaign.versions import outcome_version
from executor.cli.app import run
from executor.data import samples
from executor.data.episode import CORRECTION, DEMONSTRATION
from executor.data.formats.selection import Selection
from executor.data.formats.store_reader import stream_of
from executor.data.generation import series_of
from executor.data.store import SAMPLES, EpisodeStore, NotADataset, StoredEpisode
from executor.data.units import DemoUnit
from executor.data.upkeep import find_flaws
from executor.data.views import POSES, RenderedViews
from executor.data.work import corrected_by
from executor.data.worker import run_unit
from executor.records import Rollout, Trajectory
from executor.rollouts.evolution_record import Evolution, SubtaskStory
from oag.model.actions import flow_from_json
from oag.revision import Attempt, History, Iteration, Revision
from tests.executor.data.conftest import SIZE, film

pytestmark = [pytest.mark.physics, pytest.mark.slow]


def draw(unit: DemoUnit, rollout: Rollout, motion: Trajectory, folder: Path) -> RenderedViews:
    """Stands for the renderer: pictures that brighten."""
    count = len(motion.time_s)
    film(folder / "head.mp4", count, int(motion.subtask[0]))
    poses = {f"{POSES}head": np.tile(np.array([0, 0, 1, 1, 0, 0, 0], np.float32), (count, 1))}
    return RenderedViews({"count": count, "views": {"head": {"size": list(SIZE)}}}, poses)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> EpisodeStore:
    """Return a store with one episode that succeeded after revisions."""
    store = EpisodeStore(tmp_path_factory.mktemp("evolved") / "s")
    wanted = {"seed": 62400, "episodes": 1, "evolve": True, "flows": "paper", "views": ["head"], "size": list(SIZE)}
    wanted |= {"depth": False, "segmentation": False}
    (series,) = series_of({**wanted, "sources": [{"families": ["T4"]}]})
    store.add_requests([series.to_json()])
    (unit,) = series.units()
    run_unit(store, unit, outcome_version(), draw)
    return store


@pytest.fixture(scope="module")
def episode(store: EpisodeStore) -> StoredEpisode:
    (found,) = store.episodes()
    return found


def test_what_failed_is_kept_with_what_was_done_about_it(store: EpisodeStore, episode: StoredEpisode) -> None:
    assert episode.succeeded and episode.corrections and list(find_flaws(store)) == []
    for pair in episode.corrections:
        arrays = episode.motion(pair["samples"])
        assert np.all(arrays["subtask"] == pair["context"]["subtask"])
        # The failed attempt begins where the one that counts begins, or an earlier subtask was revised.
        if pair["revision"]["subtask"] == pair["context"]["subtask"]:
            first, _ = episode.meta["subtasks"][pair["context"]["subtask"]]["span"]
            assert np.array_equal(arrays["robot_qpos"][0], episode.arrays["robot_qpos"][first])
        assert pair["failure"]["kind"] and pair["revision"]["cause"]


def test_a_missing_attempt_is_found(store: EpisodeStore, episode: StoredEpisode, tmp_path: Path) -> None:
    place = episode.path / episode.corrections[0]["samples"]
    kept = place.read_bytes()
    place.unlink()
    try:
        (flaw,) = find_flaws(store)
        assert flaw.episode == episode.name and place.name in flaw.what
    finally:
        place.write_bytes(kept)


def test_a_file_that_a_unit_names_elsewhere_is_refused(episode: StoredEpisode) -> None:
    for name in ("../x.xz", "/x.xz", "a/b.xz", ".."):
        with pytest.raises(NotADataset, match="no file of its folder"):
            episode.motion(name)


@pytest.mark.render
def test_corrections_are_drawn_anew_with_their_episode(
    store: EpisodeStore, episode: StoredEpisode, tmp_path: Path
) -> None:
    out, size = tmp_path / "drawn", ["--views", "wrist", "--size", "64", "48", "--channels", "rgb", "depth"]
    assert run(["dataset", "render", str(store.path), "--out", str(out), *size, "--workers", "1"]) == 0
    (drawn,) = EpisodeStore(out).episodes()
    assert list(find_flaws(EpisodeStore(out))) == []
    assert [pair["samples"] for pair in drawn.corrections] == [pair["samples"] for pair in episode.corrections]
    for before, after in zip(episode.corrections, drawn.corrections, strict=True):
        motion, again = episode.motion(before["samples"]), drawn.motion(after["samples"])
        assert all(np.array_equal(again[name], motion[name]) for name in motion if not name.startswith(POSES))
        assert after["pictures"]["views"].keys() == {"wrist"}
        aside = drawn.path / Path(after["samples"]).stem
        assert {path.name for path in aside.iterdir()} == {"wrist.mp4", "wrist.depth.mkv"}
    stream = stream_of(EpisodeStore(out), ("corrections", "depth"))
    assert stream.found.corrections == len(episode.corrections) and stream.found.views == {"wrist": (64, 48)}
    assert [one.length for one in stream.episodes()] == [
        one.length for one in stream_of(store, ("corrections",)).episodes()
    ]
    (aside / "wrist.depth.mkv").unlink()
    (flaw,) = find_flaws(EpisodeStore(out))
    assert flaw.what == f"{aside.name}/wrist.depth.mkv is missing"


def test_steps_of_a_repeated_attempt_are_told_apart_as_those_of_the_recording_are(episode: StoredEpisode) -> None:
    # By time alone, which an attempt has, the spans are those that the recording of the last attempts says.
    times_s = episode.arrays["time_s"]
    for entry in episode.meta["subtasks"]:
        for step in entry["steps"]:
            rows = np.flatnonzero((step["start_s"] < times_s) & (times_s <= step["end_s"]))
            assert step["span"] == ([int(rows[0]), int(rows[-1]) + 1] if len(rows) else None)
    for pair in episode.corrections:
        count = len(episode.motion(pair["samples"])["time_s"])
        spans = [step["span"] for step in pair["steps"] if step["span"] is not None]
        assert spans and all(0 <= first < end <= count for first, end in spans)
        assert [step["primitive"] for step in pair["steps"]][-1] and pair["steps"][-1]["failure"] is not None


def test_corrections_are_episodes_of_their_own_where_they_are_asked_for(
    store: EpisodeStore, episode: StoredEpisode
) -> None:
    assert stream_of(store).found.corrections == 0
    stream = stream_of(store, ("corrections",))
    told, found = stream.found, list(stream.episodes())
    assert told.corrections == len(episode.corrections) == len(found) - 1 and told.clips == (("head", ""),)
    assert [one.about["kind"] for one in found] == [DEMONSTRATION] + [CORRECTION] * told.corrections
    demonstration = found[0]
    for one, pair in zip(found[1:], episode.corrections, strict=True):
        arrays = samples.unpacked((episode.path / pair["samples"]).read_bytes())
        assert np.array_equal(one.columns["observation.state"][:, :12], arrays["robot_qpos"])
        assert not one.columns["next.reward"].any() and one.columns["next.done"][-1]
        assert set(one.columns["primitive_index"]) - {0}
        name = episode.task.subtasks[pair["context"]["subtask"]].name
        assert one.subtasks == (name.replace("_", " "),)
        first = next(one.clips["head", ""].pictures())
        assert abs(float(first.mean()) - 30 - pair["context"]["subtask"]) <= 2
        about = one.about["correction"]
        assert about["failure"] == pair["failure"] and about["revision"] == pair["revision"] and about["critiques"]
        by = about["corrected_by"]
        assert (by["episode_index"] == demonstration.index) is (pair["corrected_by"] == SAMPLES)
        assert 0 <= by["span"][0] < by["span"][1] <= found[by["episode_index"]].length
        # What was corrected begins where the correction begins.
        if pair["revision"]["subtask"] == pair["context"]["subtask"]:
            start = found[by["episode_index"]].columns["observation.state"][by["span"][0]]
            assert np.array_equal(one.columns["observation.state"][0], start)


def test_a_revision_is_followed_to_the_motion_that_it_led_to() -> None:
    def tried(outcome: Any, number: float, revision: Revision | None = None) -> Iteration:
        failure = None if outcome == "succeeded" else "slipped"
        return Iteration(Attempt(flow_from_json([17, 1, 2, 3, {"7": number}]), outcome, failure=failure), revision)

    def revised(number: float, subtask: int | None = None) -> Revision:
        return Revision(flow_from_json([17, 1, 2, 3, {"7": number}]), "parameters", "Higher.", subtask=subtask)

    # T2 failed because of T1, whose next attempt failed by itself; what T2 tried in between no longer stands.
    blamed = revised(0.2, subtask=0)
    first = [tried("failed", 0.1, blamed), tried("failed", 0.2, revised(0.3)), tried("succeeded", 0.3)]
    second = [tried("failed", 0.1, revised(0.5)), tried("succeeded", 0.5, revised(0.4, subtask=0))]
    second += [tried("failed", 0.1, blamed), tried("failed", 0.1, revised(0.6)), tried("succeeded", 0.6)]
    stories: Any = [
        SubtaskStory(History(index, tuple(tries)), cast("Any", (None,) * len(tries)))
        for index, tries in enumerate((first, second))
    ]
    story = Evolution(cast("Any", None), cast("Any", None), tuple(stories))
    led_to = {
        (k, n): corrected_by(story, k, n) for k, tries in enumerate((first, second)) for n in range(len(tries) - 1)
    }
    assert led_to == {
        (0, 0): "attempt-1-2.xz",
        (0, 1): SAMPLES,
        (1, 0): None,  # It succeeded, and was done anew after T1 was revised.
        (1, 1): None,  # No attempt of T1 followed this one.
        (1, 2): "attempt-1-2.xz",
        (1, 3): SAMPLES,
    }


def test_corrections_of_what_failed_in_the_end_are_there_too(store: EpisodeStore, tmp_path: Path) -> None:
    copied = EpisodeStore(Path(shutil.copytree(store.path, tmp_path / "s")))
    episode = next(copied.demonstrations())
    meta = {**episode.meta, "ended": "failed", "failure": {"kind": "slipped", "message": "it fell"}}
    (episode.path / "unit.json").write_text(json.dumps(meta))
    found = stream_of(copied, ("corrections",)).found
    assert (found.train + found.validation, found.corrections) == (0, len(episode.corrections))
    both = stream_of(copied, ("corrections",), Selection.parse("ended=failed")).found
    assert (both.train + both.validation, both.corrections) == (1, len(episode.corrections))


def test_the_command_has_them(
    store: EpisodeStore, episode: StoredEpisode, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    h5py = pytest.importorskip("h5py")
    out = tmp_path / "out"
    words = ["--format", "robomimic", "--include", "corrections", "--out", str(out)]
    assert run(["dataset", "export", str(store.path), *words]) == 0
    count = len(episode.corrections)
    assert f"{count} failed attempt" in capsys.readouterr().out
    with h5py.File(out / "demonstrations.hdf5") as file:
        names = [name.decode() for name in file["mask/corrections"][:]]
        assert names == [f"demo_{k + 1}" for k in range(count)]
        assert set(file["mask/successful"][:]) == {b"demo_0"}
        assert {*file["mask/train"][:], *file["mask/valid"][:]} == {b"demo_0"}
        about = json.loads(file["data/demo_1/about"].asstr()[()])
        assert about["kind"] == CORRECTION and not file["data/demo_1"].attrs["success"]
