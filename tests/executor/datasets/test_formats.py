"""What a store is folded into: the same bytes from the same episodes, and the samples again from every format."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from executor.datasets.footage import pictures
from executor.datasets.formats.export import FORMATS, ExportExists, Format, export
from executor.datasets.formats.fold import (
    FoldedEpisode,
    NothingToExport,
    Survey,
    fold,
    folded,
    is_for_validation,
    survey,
)
from executor.datasets.formats.observations import ENVIRONMENT, StateReader
from executor.datasets.formats.statistics import QUANTILES, Tones
from executor.datasets.store import EpisodeStore
from executor.envs.following import HandFollower
from executor.geometry import inverse, quaternions_last
from executor.robot.description import BASE_LINK, TCP_LINK, robot_urdf
from executor.robot.tracking import ArmChain
from executor.world.world import World

h5py = pytest.importorskip("h5py")
parquet = pytest.importorskip("pyarrow.parquet")
pytest.importorskip("av")

pytestmark = pytest.mark.physics
PICTURE = "observation.images.head"


@pytest.fixture(scope="module")
def found(filmed_store: EpisodeStore) -> Survey:
    return survey(filmed_store)


@pytest.fixture(scope="module")
def episodes(filmed_store: EpisodeStore, found: Survey) -> list[FoldedEpisode]:
    return list(folded(filmed_store, found))


@pytest.fixture(scope="module")
def exported(filmed_store: EpisodeStore, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Returns a folder with a data set of each format."""
    out = tmp_path_factory.mktemp("exported")
    for kind in FORMATS:
        export(filmed_store, kind, out / kind)
    return out


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("kind", FORMATS)
def test_the_same_episodes_give_the_same_bytes(
    filmed_store: EpisodeStore, exported: Path, kind: Format, tmp_path: Path
) -> None:
    other = EpisodeStore(tmp_path / "another")
    other.add_requests(filmed_store.requests())
    (other.path / "units").mkdir()
    for path in sorted((filmed_store.path / "units").iterdir(), reverse=True):
        shutil.copytree(path, other.path / "units" / path.name)
    export(other, kind, tmp_path / "out")
    assert files(tmp_path / "out") == files(exported / kind)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["another", "out"]


def test_rows_are_the_samples(episodes: list[FoldedEpisode]) -> None:
    assert len(episodes) == 12
    for episode in episodes:
        arrays, rows = episode.source.arrays, episode.columns
        assert {len(values) for values in rows.values()} == {len(arrays["time_s"])}
        assert np.array_equal(rows["observation.state"][:, :12], arrays["robot_qpos"])
        assert np.array_equal(rows["action.joint_target"][:-1], arrays["robot_target"][1:])
        assert rows["next.reward"].sum() == pytest.approx(1.0) and rows["next.reward"][-1] > 0
        assert np.flatnonzero(rows["next.done"]).tolist() == [episode.length - 1]
        assert set(rows["primitive_index"]) >= {1, 2, 3}
        assert episode.subtasks[rows["subtask_index"][0]] == episode.subtasks[0]


def test_quaternions_are_x_y_z_w_and_say_the_same(episodes: list[FoldedEpisode]) -> None:
    for episode in episodes:
        hand, arrays = episode.columns["observation.state"][:, 12:19], episode.source.arrays
        assert (hand[:, 6] >= 0).all()
        same = np.abs((hand[:, [6, 3, 4, 5]] * arrays["eef_pose"][:, 3:]).sum(axis=1))
        assert same == pytest.approx(1.0, abs=1e-5)
        assert np.array_equal(episode.columns["observation.camera_pose_head"], hand[::-1])
    turned = quaternions_last(np.array([1.0, 2.0, 3.0, -0.5, 0.5, -0.5, 0.5], np.float32))
    assert turned.tolist() == [1.0, 2.0, 3.0, -0.5, 0.5, -0.5, 0.5]


def test_rows_are_what_the_environment_tells_a_policy(episodes: list[FoldedEpisode]) -> None:
    for episode in (episodes[0], episodes[-1]):
        source = episode.source
        with World(source.scene) as world:
            reader = StateReader(world, source.task)
            for k in range(0, episode.length, 9):
                world.unpack(source.arrays["packed_states"][k].tobytes())
                assert reader.agent() == pytest.approx(episode.columns["observation.state"][k], abs=1e-5)
                assert np.array_equal(reader.environment(), episode.columns["observation.environment_state"][k])
        first = episode.about["things"][0]
        assert first == source.meta["task"]["sub_tasks"][0]["target"]
        if first in source.meta["object_ids"]:
            poses = source.arrays["object_poses"][:, source.meta["object_ids"].index(first)]
            found = episode.columns["observation.environment_state"][:, 1:8]
            assert found == pytest.approx(quaternions_last(poses), abs=1e-5)


def test_hand_actions_lead_to_the_commanded_targets(episodes: list[FoldedEpisode]) -> None:
    chain = ArmChain(robot_urdf(visual=False), BASE_LINK, TCP_LINK)
    for episode in (episodes[0], episodes[-1]):
        targets = episode.source.arrays["robot_target"].astype(float)
        for k in range(0, episode.length - 1, 7):
            again = HandFollower(targets[k], 0.1).joint_target(targets[k], episode.columns["action"][k])
            T_again, T_wanted = chain.forward(np.stack([again[3:10], targets[k + 1, 3:10]]))
            off = inverse(T_wanted) @ T_again
            assert np.abs(off[:3, 3]).max() < 2e-4 and np.abs(off[:3, :3] - np.eye(3)).max() < 2e-3
            assert again[:3] == pytest.approx(targets[k + 1, :3], abs=1e-5)
            # Fingers that press are told to go beyond shut, which the limits of their joints cut off.
            assert again[10:] == pytest.approx(np.maximum(targets[k + 1, 10:], 0.0), abs=1e-5)
        assert np.abs(episode.columns["action"][:, 6]).max() <= 1.0 + 1e-6


def test_the_split_follows_from_the_id_alone(filmed_store: EpisodeStore, found: Survey) -> None:
    assert sum(is_for_validation(f"{k * 2654435761 % 2**32:08x}00000000") for k in range(2000)) == pytest.approx(
        200, abs=40
    )
    by_name = {episode.name: str(episode.meta["id"]) for episode in filmed_store.episodes()}
    assert set(found.names) == set(by_name)
    assert all(is_for_validation(by_name[name]) for name in found.validation)
    assert not any(is_for_validation(by_name[name]) for name in found.train)


@pytest.mark.parametrize("kind", ["lerobot", "lerobot-v2.1"])
def test_lerobot_has_the_rows_again(exported: Path, episodes: list[FoldedEpisode], kind: str) -> None:
    folder = exported / kind
    info = json.loads((folder / "meta/info.json").read_text())
    assert info["total_episodes"] == 12 and info["total_frames"] == sum(one.length for one in episodes)
    at = 0
    for episode in episodes:
        if kind == "lerobot":
            file = parquet.ParquetFile(folder / "data/chunk-000/file-000.parquet")
            assert file.num_row_groups == 12
            table = file.read_row_group(episode.index)
        else:
            table = parquet.read_table(folder / f"data/chunk-000/episode_{episode.index:06d}.parquet")
        for name, rows in episode.columns.items():
            if name != "subtask_index":
                assert np.array_equal(np.stack(table[name].to_numpy()), rows), name
        assert table["index"].to_pylist() == list(range(at, at + episode.length))
        assert table["timestamp"].to_numpy() == pytest.approx(np.arange(episode.length) / 10)
        at += episode.length
        texts = {"lerobot": lambda: parquet.read_table(folder / "meta/tasks.parquet")["task"].to_pylist()}
        if kind in texts:
            assert texts[kind]()[table["task_index"][0].as_py()] == episode.task
    assert set(table.column_names) | {PICTURE} == set(info["features"])
    assert len(set(info["features"]["observation.environment_state"]["names"])) == ENVIRONMENT


def test_lerobot_finds_each_episodes_pictures_in_one_video(exported: Path, episodes: list[FoldedEpisode]) -> None:
    folder = exported / "lerobot"
    lines = parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    tones = [int(picture.mean().round()) for picture in pictures(folder / f"videos/{PICTURE}/chunk-000/file-000.mp4")]
    assert len(tones) == sum(episode.length for episode in episodes)
    for line, episode in zip(lines, episodes, strict=True):
        begins = round(line[f"videos/{PICTURE}/from_timestamp"] * 10)
        assert round(line[f"videos/{PICTURE}/to_timestamp"] * 10) == begins + episode.length
        first = episode.source.meta["unit"]["seed"] % 7
        wanted = 30 + (first + np.arange(episode.length)) % 200
        assert np.abs(np.array(tones[begins : begins + episode.length]) - wanted).max() <= 2
        assert line["dataset_to_index"] - line["dataset_from_index"] == episode.length


def test_statistics_are_those_of_numpy(exported: Path, episodes: list[FoldedEpisode]) -> None:
    stats = json.loads((exported / "lerobot/meta/stats.json").read_text())
    for name in ("action", "observation.state", "next.reward"):
        rows = np.concatenate([episode.columns[name] for episode in episodes]).astype(float)
        rows = rows.reshape(len(rows), -1)
        told = stats[name]
        assert told["count"] == [len(rows)]
        for what, values in (("min", rows.min(0)), ("max", rows.max(0)), ("mean", rows.mean(0)), ("std", rows.std(0))):
            assert told[what] == pytest.approx(values.tolist(), abs=1e-9)
        for q in QUANTILES:
            assert told[f"q{round(100 * q):02d}"] == pytest.approx(np.quantile(rows, q, axis=0).tolist(), abs=1e-9)
    assert np.shape(stats[PICTURE]["mean"]) == (3, 1, 1) and 0.1 < stats[PICTURE]["mean"][0][0][0] < 0.9


def test_tones_count_as_numpy_does() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    tones = Tones()
    tones.add(picture)
    found, flat = tones.statistics(), picture.reshape(-1, 3) / 255
    assert found["mean"].ravel() == pytest.approx(flat.mean(0)) and found["std"].ravel() == pytest.approx(flat.std(0))
    assert found["min"].ravel() == pytest.approx(flat.min(0)) and found["max"].ravel() == pytest.approx(flat.max(0))
    assert found["q50"].ravel() == pytest.approx(np.quantile(flat, 0.5, axis=0, method="inverted_cdf"), abs=0.005)


def test_robomimic_has_the_samples_again(exported: Path, episodes: list[FoldedEpisode], found: Survey) -> None:
    with h5py.File(exported / "robomimic/demonstrations.hdf5") as file:
        assert file["data"].attrs["total"] == sum(episode.length - 1 for episode in episodes)
        assert len(file["mask/train"]) == len(found.train) and len(file["mask/valid"]) == len(found.validation)
        for episode in episodes:
            demo, rows = file[f"data/demo_{episode.index}"], episode.columns
            assert np.array_equal(demo["actions_hand"][:], rows["action"][:-1])
            assert np.array_equal(demo["actions_absolute"][:], rows["action.joint_target"][:-1])
            assert np.array_equal(demo["obs/robot_qpos"][:], rows["observation.state"][:-1, :12])
            assert np.array_equal(demo["next_obs/eef_quat"][:], rows["observation.state"][1:, 15:19])
            assert np.array_equal(demo["obs/environment_state"][:], rows["observation.environment_state"][:-1])
            assert demo["obs/head_image"].shape == (episode.length - 1, 48, 64, 3)
            assert not demo["obs/head_image"].is_virtual
            assert demo.attrs["state_hash"] == episode.source.meta["state_hash"]


def test_zarr_has_the_rows_again(exported: Path, episodes: list[FoldedEpisode]) -> None:
    zarr = pytest.importorskip("zarr")
    root = zarr.open_group(str(exported / "zarr"), mode="r")
    ends = root["meta/episode_ends"][:]
    assert ends.tolist() == np.cumsum([episode.length for episode in episodes]).tolist()
    for name in ("observation.state", "observation.environment_state", "action", "next.done", "primitive_index"):
        rows = np.concatenate([episode.columns[name] for episode in episodes])
        read = root["data"][name.rpartition(".")[2]][:]
        assert np.array_equal(read, rows) and read.dtype == rows.dtype
    assert root["data/head_image"].shape == (ends[-1], 48, 64, 3)
    last = 30 + (episodes[-1].source.meta["unit"]["seed"] % 7 + episodes[-1].length - 1) % 200
    assert abs(float(root["data/head_image"][-1].mean()) - last) <= 2


def test_views_that_not_all_have_are_left_out(filmed_store: EpisodeStore, tmp_path: Path) -> None:
    store = EpisodeStore(tmp_path / "s")
    shutil.copytree(filmed_store.path, store.path)
    next((store.path / "units").glob("*/head.mp4")).unlink()
    assert survey(store).views == {}


def test_nothing_is_exported_of_failures_and_of_two_rates(made_store: EpisodeStore, tmp_path: Path) -> None:
    store = EpisodeStore(tmp_path / "s")
    shutil.copytree(made_store.path, store.path)
    first, second = sorted((store.path / "units").iterdir())
    meta = json.loads((second / "unit.json").read_text())
    (second / "unit.json").write_text(json.dumps({**meta, "record_hz": 20.0}))
    with pytest.raises(NothingToExport, match=r"episodes of 10, 20\.8333 samples a second"):
        export(store, "zarr", tmp_path / "out")
    (second / "unit.json").write_text(json.dumps({**meta, "ended": "failed"}))
    assert survey(store).names == (first.name,)
    (first / "samples.xz").unlink()
    with pytest.raises(NothingToExport, match="no success with samples"):
        export(store, "zarr", tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["s"]


def test_what_is_there_stays_unless_it_is_to_be_replaced(made_store: EpisodeStore, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out/mine").write_text("kept")
    with pytest.raises(ExportExists, match="--force"):
        export(made_store, "zarr", tmp_path / "out")
    assert (tmp_path / "out/mine").read_text() == "kept"
    export(made_store, "zarr", tmp_path / "out", replace=True)
    assert not (tmp_path / "out/mine").exists() and (tmp_path / "out/README.md").exists()


def test_one_episode_is_folded_by_itself(filmed_store: EpisodeStore, found: Survey, episodes: list) -> None:
    alone = fold(filmed_store.episode(found.names[3]), 3, found)
    assert all(np.array_equal(alone.columns[name], rows) for name, rows in episodes[3].columns.items())
