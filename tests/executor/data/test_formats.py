"""What a store is folded into: the same bytes from the same episodes, and the samples again from every format."""

from __future__ import annotations

import json
import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from executor.assets.model import Handle
from executor.data.episode import CLOUD, Episode
from executor.data.formats.export import FORMATS, ExportExists, Format, open_set, write_set
from executor.data.formats.selection import NothingToExport
from executor.data.formats.statistics import QUANTILES, IntensityHistogram
from executor.data.formats.store_reader import is_for_validation, stream_of
from executor.data.formats.table import EpisodeStream
from executor.data.state_readers import ENVIRONMENT, CloudReader, StateReader, named_objects
from executor.data.store import EpisodeStore, NotADataset, StoredEpisode
from executor.data.views import DEPTH, SEGMENTATION, pictures
from executor.envs.hand_control import Elbow, HandFollower
from executor.geometry import inverse, quaternions_last
from executor.sim.robot.description import BASE_LINK, robot_urdf
from executor.sim.robot.kinematics import ArmChain
from executor.sim.world import World
from oag.model.robots import PAPER_ROBOT
from tests.executor.data.conftest import numbers
from tests.executor.helpers import MakeWorld

h5py = pytest.importorskip("h5py")
parquet = pytest.importorskip("pyarrow.parquet")
pytest.importorskip("av")

pytestmark = pytest.mark.physics
PICTURE = "observation.images.head"


@pytest.fixture(scope="module")
def stream(filmed_store: EpisodeStore) -> EpisodeStream:
    return folded_once(filmed_store)


def folded_once(store: EpisodeStore) -> EpisodeStream:
    found = stream_of(store, ("depth", "segmentation"))
    kept = list(found.episodes())
    return EpisodeStream(found.found, lambda: iter(kept), found.page)


@pytest.fixture(scope="module")
def episodes(stream: EpisodeStream) -> list[Episode]:
    return list(stream.episodes())


@pytest.fixture(scope="module")
def exported(stream: EpisodeStream, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a data set of each format."""
    out = tmp_path_factory.mktemp("exported")
    for kind in FORMATS:
        write_set(stream, kind, out / kind)
    return out


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def source(store: EpisodeStore, episode: Episode) -> StoredEpisode:
    return store.episode(f"{episode.about['name']}-{episode.about['id'][:8]}")


@pytest.mark.slow
def test_the_same_episodes_give_the_same_bytes(filmed_store: EpisodeStore, exported: Path, tmp_path: Path) -> None:
    other = EpisodeStore(tmp_path / "another")
    other.add_requests(filmed_store.requests())
    (other.path / "units").mkdir()
    for path in sorted((filmed_store.path / "units").iterdir(), reverse=True):
        shutil.copytree(path, other.path / "units" / path.name)
    stream = folded_once(other)
    for kind in FORMATS:
        write_set(stream, kind, tmp_path / kind)
    assert files(tmp_path / "zarr") and all(files(tmp_path / kind) == files(exported / kind) for kind in FORMATS)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["another", *sorted(FORMATS)]


def test_rows_are_the_samples(filmed_store: EpisodeStore, episodes: list[Episode]) -> None:
    assert len(episodes) == 4
    for episode in episodes:
        stored, rows = source(filmed_store, episode), episode.columns
        arrays = stored.arrays
        assert {len(values) for values in rows.values()} == {len(arrays["time_s"])}
        assert np.array_equal(rows["observation.state"][:, :12], arrays["robot_qpos"])
        assert np.array_equal(rows["action.joint_target"][:-1], arrays["robot_target"][1:])
        assert np.array_equal(np.float32(episode.about["first_target"]), arrays["robot_target"][0])
        assert np.array_equal(rows["subtask_index"], arrays["subtask"])
        assert rows["next.reward"].sum() == pytest.approx(1.0) and rows["next.reward"][-1] > 0
        assert np.flatnonzero(rows["next.done"]).tolist() == [episode.length - 1]
        assert set(rows["primitive_index"]) >= {1, 2, 3}
        assert not rows["primitive_index"][arrays["step"] == -1].any()
        assert episode.subtasks[rows["subtask_index"][0]] == episode.subtasks[0]
        assert not rows["action"][-1, :6].any()


def test_objects_and_joints_are_all_there_in_the_order_that_is_told(
    filmed_store: EpisodeStore, episodes: list[Episode]
) -> None:
    for episode in episodes:
        stored, about = source(filmed_store, episode), episode.about
        poses = episode.columns["observation.object_poses"]
        for k, name in enumerate(about["object_ids"]):
            recorded = stored.arrays["object_poses"][:, stored.meta["object_ids"].index(name)]
            assert np.array_equal(poses[:, 7 * k : 7 * k + 7], quaternions_last(recorded))
        assert not poses[:, 7 * len(about["object_ids"]) :].any()
        joints = episode.columns["observation.joint_positions"]
        with World(stored.scene) as world:
            world.unpack(stored.arrays["packed_states"][-1].tobytes())
            there = [world.joint_position(*name.split("/")) for name in about["joint_names"]]
        assert joints[-1, : len(there)] == pytest.approx(there, abs=1e-6) and not joints[:, len(there) :].any()


def test_quaternions_are_x_y_z_w_and_say_the_same(filmed_store: EpisodeStore, episodes: list[Episode]) -> None:
    for episode in episodes:
        hand, arrays = episode.columns["observation.state"][:, 12:19], source(filmed_store, episode).arrays
        assert (hand[:, 6] >= 0).all()
        same = np.abs((hand[:, [6, 3, 4, 5]] * arrays["eef_pose"][:, 3:]).sum(axis=1))
        assert same == pytest.approx(1.0, abs=1e-5)
        assert np.array_equal(episode.columns["observation.camera_pose_head"], hand[::-1])
    turned = quaternions_last(np.array([1.0, 2.0, 3.0, -0.5, 0.5, -0.5, 0.5], np.float32))
    assert turned.tolist() == [1.0, 2.0, 3.0, -0.5, 0.5, -0.5, 0.5]


def test_rows_are_what_the_environment_tells_a_policy(made_store: EpisodeStore) -> None:
    for episode in stream_of(made_store, ("point_cloud",)).episodes():
        stored = source(made_store, episode)
        with World(stored.scene) as world:
            reader = StateReader(world, stored.task)
            cloud = CloudReader(world, named_objects(stored.task, world.assets), stored.meta["unit"]["seed"])
            for k in range(0, episode.length, 9):
                world.unpack(stored.arrays["packed_states"][k].tobytes())
                assert reader.agent() == pytest.approx(episode.columns["observation.state"][k], abs=1e-5)
                assert np.array_equal(reader.environment(), episode.columns["observation.environment_state"][k])
                assert np.array_equal(cloud.read(), episode.columns[CLOUD][k])
                assert all(points_at(handle, world, cloud.read()) >= 30 for handle in opened(stored, world))
        first = episode.about["things"][0]
        assert first == stored.meta["task"]["sub_tasks"][0]["target"]
        if first in stored.meta["object_ids"]:
            poses = stored.arrays["object_poses"][:, stored.meta["object_ids"].index(first)]
            found = episode.columns["observation.environment_state"][:, 1:8]
            assert found == pytest.approx(quaternions_last(poses), abs=1e-5)


def opened(stored: StoredEpisode, world: World) -> list[tuple[str, Handle]]:
    """Return the handles of what an episode opens or shuts."""
    targets = {part.target for part in stored.task.subtasks}
    return [(name, handle) for name in targets & set(world.assets) for handle in world.assets[name].handles]


def points_at(handle: tuple[str, Handle], world: World, cloud: np.ndarray) -> int:
    """Return how many of a cloud's points are within 5 cm of the middle part of a handle's bar."""
    name, bar = handle
    T = inverse(world.T_world_link("robot")) @ world.T_world_link(name, bar.link)
    middle_m = T[:3, :3] @ np.asarray(bar.position_m) + T[:3, 3]
    away_m = np.linalg.norm(cloud[:, :3] - middle_m, axis=1)
    return int((away_m <= bar.length_m / 2.0 + 0.05).sum())


def test_hand_actions_lead_to_the_commanded_targets(
    filmed_store: EpisodeStore, episodes: list[Episode], make_world: MakeWorld
) -> None:
    chain = ArmChain(robot_urdf(visual=False), BASE_LINK, PAPER_ROBOT.tip_link)
    for episode in (episodes[0], episodes[-1]):
        told = source(filmed_store, episode)
        targets, elbow = told.arrays["robot_target"].astype(float), Elbow(make_world(told.scene))
        for k in range(0, episode.length - 1, 7):
            follower = HandFollower(PAPER_ROBOT, targets[k], 0.1, elbow)
            again = follower.joint_target(targets[k], episode.columns["action"][k])
            T_again, T_wanted = chain.forward(np.stack([again[3:10], targets[k + 1, 3:10]]))
            off = inverse(T_wanted) @ T_again
            assert np.abs(off[:3, 3]).max() < 2e-4 and np.abs(off[:3, :3] - np.eye(3)).max() < 2e-3
            assert again[:3] == pytest.approx(targets[k + 1, :3], abs=1e-5)
            # Fingers that press are told to go beyond shut.
            assert again[10:] == pytest.approx(targets[k + 1, 10:], abs=1e-5)
        assert np.abs(episode.columns["action"][:, 6]).max() <= 1.0 + 1e-6


def test_the_split_follows_from_the_id_alone(stream: EpisodeStream, episodes: list[Episode]) -> None:
    assert sum(is_for_validation(f"{k * 2654435761 % 2**32:08x}00000000") for k in range(2000)) == pytest.approx(
        200, abs=40
    )
    for part, numbers_of_part in stream.found.splits.items():
        for index in numbers_of_part:
            about = episodes[index].about
            assert about["validation"] == is_for_validation(about["id"]) == (part == "validation")
    assert stream.found.count == len(episodes) == 4


@pytest.mark.parametrize("kind", ["lerobot", "lerobot-v2.1"])
def test_lerobot_has_the_rows_again(exported: Path, episodes: list[Episode], kind: str) -> None:
    folder = exported / kind
    info = json.loads((folder / "meta/info.json").read_text())
    assert info["total_episodes"] == 4 and info["total_frames"] == sum(one.length for one in episodes)
    at, earlier = 0, Counter[str]()
    for episode in episodes:
        if kind == "lerobot":
            file = parquet.ParquetFile(folder / "data/chunk-000/file-000.parquet")
            assert file.num_row_groups == 4
            table = file.read_row_group(episode.index)
        else:
            table = parquet.ParquetFile(folder / f"data/chunk-000/episode_{episode.index:06d}.parquet").read()
        for name, rows in episode.columns.items():
            if name != "subtask_index":
                assert np.array_equal(np.stack(table[name].to_numpy()), rows), name
        assert table["index"].to_pylist() == list(range(at, at + episode.length))
        assert table["timestamp"].to_numpy() == pytest.approx(np.arange(episode.length) / 10)
        at += episode.length
        texts = {"lerobot": lambda: parquet.read_table(folder / "meta/tasks.parquet")["task"].to_pylist()}
        # Of two episodes of a sentence the first has it, and the other one says the same in other words.
        sentence = (episode.task, *episode.about["paraphrases"])[earlier[episode.task]]
        earlier[episode.task] += 1
        if kind in texts:
            assert texts[kind]()[table["task_index"][0].as_py()] == sentence
            assert len(set(table["task_index"].to_pylist())) == 1
        else:
            lines = (folder / "meta/episodes.jsonl").read_text().splitlines()
            assert json.loads(lines[episode.index])["tasks"] == [sentence]
    assert set(earlier.values()) == {2} and info["total_tasks"] == 4
    assert set(table.column_names) | {PICTURE} == set(info["features"])
    assert len(set(info["features"]["observation.environment_state"]["names"])) == ENVIRONMENT
    assert info["features"]["observation.depth.head"]["info"] == {"is_depth_map": True, "depth_unit": "mm"}


@pytest.mark.parametrize("kind", ["lerobot", "lerobot-v2.1"])
def test_a_room_of_one_joint_has_a_number_a_row(stream: EpisodeStream, tmp_path: Path, kind: Format) -> None:
    name = "observation.joint_positions"
    only = [replace(one, columns={**one.columns, name: one.columns[name][:, :1]}) for one in stream.episodes()]
    write_set(EpisodeStream(replace(stream.found, joints=1), lambda: iter(only), stream.page), kind, tmp_path / "set")
    schema = parquet.read_schema(sorted((tmp_path / "set/data").rglob("*.parquet"))[0])
    # LeRobot reads what has the shape (1,) as a number, and refuses lists.
    assert str(schema.field(name).type) == "float"
    again = list(open_set(tmp_path / "set", ()).episodes())
    for one, read in zip(only, again, strict=True):
        assert np.array_equal(one.columns[name], read.columns[name])


def test_the_parts_that_are_told_are_those_of_the_columns(exported: Path) -> None:
    folder = exported / "lerobot-v2.1"
    told = json.loads((folder / "meta/modality.json").read_text())
    features = json.loads((folder / "meta/info.json").read_text())["features"]
    assert told["video"]["head"]["original_key"] in features
    for part, first in (("hand_quaternion", "hand_qx"), ("base", "base_x")):
        said = told["state"][part]
        assert features[said["original_key"]]["names"][said["start"]].endswith(first.removeprefix("base_"))
    for column in ("action", "action.joint_target"):
        spans = [(one["start"], one["end"]) for one in told["action"].values() if one["original_key"] == column]
        assert [place for span in spans for place in range(*span)] == list(range(features[column]["shape"][0]))


def test_lerobot_finds_each_episodes_pictures_in_one_video(exported: Path, episodes: list[Episode]) -> None:
    folder = exported / "lerobot"
    lines = parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    tones = [int(picture.mean().round()) for picture in pictures(folder / f"videos/{PICTURE}/chunk-000/file-000.mp4")]
    assert len(tones) == sum(episode.length for episode in episodes)
    for line, episode in zip(lines, episodes, strict=True):
        begins = round(line[f"videos/{PICTURE}/from_timestamp"] * 10)
        assert round(line[f"videos/{PICTURE}/to_timestamp"] * 10) == begins + episode.length
        first = episode.about["unit"]["seed"] % 7
        wanted = 30 + (first + np.arange(episode.length)) % 200
        assert np.abs(np.array(tones[begins : begins + episode.length]) - wanted).max() <= 2
        assert line["dataset_to_index"] - line["dataset_from_index"] == episode.length


def test_statistics_are_those_of_numpy(exported: Path, episodes: list[Episode]) -> None:
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
        for kind in ("robomimic", "zarr"):
            assert json.loads((exported / kind / "statistics.json").read_text())[name] == told
    assert np.shape(stats[PICTURE]["mean"]) == (3, 1, 1) and 0.1 < stats[PICTURE]["mean"][0][0][0] < 0.9
    depth = np.stack([numbers(row, DEPTH) for row in range(0, episodes[0].length, episodes[0].length // 20)])
    line = parquet.read_table(exported / "lerobot/meta/episodes/chunk-000/file-000.parquet").to_pylist()[0]
    assert line["stats/observation.depth.head/mean"][0][0][0] == pytest.approx(depth.mean())


def test_tones_count_as_numpy_does() -> None:
    picture = np.random.default_rng(0).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    tones = IntensityHistogram()
    tones.add(picture)
    found, flat = tones.statistics(), picture.reshape(-1, 3) / 255
    assert found["mean"].ravel() == pytest.approx(flat.mean(0)) and found["std"].ravel() == pytest.approx(flat.std(0))
    assert found["min"].ravel() == pytest.approx(flat.min(0)) and found["max"].ravel() == pytest.approx(flat.max(0))
    assert found["q50"].ravel() == pytest.approx(np.quantile(flat, 0.5, axis=0, method="inverted_cdf"), abs=0.005)


def test_robomimic_has_the_samples_again(
    filmed_store: EpisodeStore, exported: Path, stream: EpisodeStream, episodes: list[Episode]
) -> None:
    with h5py.File(exported / "robomimic/demonstrations.hdf5") as file:
        assert file["data"].attrs["total"] == sum(episode.length - 1 for episode in episodes)
        assert len(file["mask/train"]) == stream.found.train and len(file["mask/valid"]) == stream.found.validation
        for episode in episodes:
            demo, rows, stored = file[f"data/demo_{episode.index}"], episode.columns, source(filmed_store, episode)
            assert np.array_equal(demo["actions_hand"][:], rows["action"][:-1])
            assert np.array_equal(demo["actions_absolute"][:], rows["action.joint_target"][:-1])
            assert np.array_equal(demo["obs/robot_qpos"][:], rows["observation.state"][:-1, :12])
            assert np.array_equal(demo["next_obs/eef_quat"][:], rows["observation.state"][1:, 15:19])
            assert np.array_equal(demo["obs/environment_state"][:], rows["observation.environment_state"][:-1])
            assert demo["time_s"][:] == pytest.approx(stored.arrays["time_s"])
            assert np.array_equal(demo["step"][:], stored.arrays["step"])
            first = stored.meta["object_ids"][0]
            recorded = quaternions_last(stored.arrays["object_poses"][:, 0])
            assert np.array_equal(demo[f"object_poses/{first}"][:], recorded)
            assert demo["obs/head_image"].shape == (episode.length - 1, 48, 64, 3)
            assert np.array_equal(demo["last_obs/head_depth"][0, :, :, 0], numbers(episode.length - 1, DEPTH))
            assert not demo["obs/head_image"].is_virtual
            assert demo.attrs["state_hash"] == stored.meta["state_hash"]


def test_zarr_has_the_rows_again(exported: Path, episodes: list[Episode]) -> None:
    zarr = pytest.importorskip("zarr")
    root = zarr.open_group(str(exported / "zarr"), mode="r")
    ends = root["meta/episode_ends"][:]
    assert ends.tolist() == np.cumsum([episode.length for episode in episodes]).tolist()
    for name in ("observation.state", "observation.environment_state", "action", "next.done", "primitive_index"):
        rows = np.concatenate([episode.columns[name] for episode in episodes])
        read = root["data"][name.rpartition(".")[2]][:]
        assert np.array_equal(read, rows) and read.dtype == rows.dtype
    assert root["data/head_image"].shape == (ends[-1], 48, 64, 3)
    last = 30 + (episodes[-1].about["unit"]["seed"] % 7 + episodes[-1].length - 1) % 200
    assert abs(float(root["data/head_image"][-1].mean()) - last) <= 2
    segments = np.stack([numbers(row, SEGMENTATION) for row in range(episodes[0].length)])
    assert np.array_equal(root["data/head_segmentation"][: episodes[0].length], segments)


def test_pictures_that_not_all_have_are_never_left_out(filmed_store: EpisodeStore, tmp_path: Path) -> None:
    store = EpisodeStore(tmp_path / "s")
    shutil.copytree(filmed_store.path, store.path)
    assert stream_of(store).found.clips == (("head", ""),)
    next((store.path / "units").glob("*/head.depth.mkv")).unlink()
    with pytest.raises(NothingToExport, match="have no depth"):
        stream_of(store, ("depth", "segmentation"))
    assert stream_of(store, ("segmentation",)).found.channels == (SEGMENTATION,)
    next((store.path / "units").glob("*/head.mp4")).unlink()
    with pytest.raises(NothingToExport, match=r"3 have head, 1 have none"):
        stream_of(store, ("segmentation",))


def test_nothing_is_exported_of_failures_and_of_two_rates(made_store: EpisodeStore, tmp_path: Path) -> None:
    store = EpisodeStore(tmp_path / "s")
    shutil.copytree(made_store.path, store.path)
    first, second = sorted((store.path / "units").iterdir())
    meta = json.loads((second / "unit.json").read_text())
    (second / "unit.json").write_text(json.dumps({**meta, "record_hz": 20.0}))
    with pytest.raises(NothingToExport, match=r"episodes of 10, 20\.8333 samples a second"):
        stream_of(store)
    (second / "unit.json").write_text(json.dumps({**meta, "ended": "failed"}))
    assert stream_of(store).found.count == 1
    (first / "samples.xz").unlink()
    with pytest.raises(NothingToExport, match="no success with samples"):
        stream_of(store)


def test_what_is_there_stays_unless_it_is_to_be_replaced(made_store: EpisodeStore, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out/mine").write_text("kept")
    with pytest.raises(ExportExists, match="--force"):
        write_set(stream_of(made_store), "zarr", tmp_path / "out")
    assert (tmp_path / "out/mine").read_text() == "kept"
    write_set(stream_of(made_store), "zarr", tmp_path / "out", overwrite=True)
    assert not (tmp_path / "out/mine").exists() and (tmp_path / "out/README.md").exists()


def test_samples_of_another_unit_are_not_exported(filmed_store: EpisodeStore, tmp_path: Path) -> None:
    shutil.copytree(filmed_store.path, tmp_path / "s")
    copied = EpisodeStore.open(tmp_path / "s")
    first, *_, last = copied.episodes()
    assert first.meta["samples"] != last.meta["samples"]
    shutil.copy(last.path / "samples.xz", first.path / "samples.xz")
    with pytest.raises(NotADataset, match=r"unit\.json says"):
        list(stream_of(copied, ()).episodes())
