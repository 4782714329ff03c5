"""The episode's columns, and the HDF5 file that robomimic's readers open."""

from __future__ import annotations

import json
import re
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from executor.data.episode import Episode, EpisodeTooShort
from executor.data.formats.robomimic import action_names, action_rates, normalised_actions, write_robomimic
from executor.records import Rollout
from executor.scenes import library
from executor.sim.render.cameras import VIEWS, cameras_for, intrinsic_matrix
from executor.sim.render.frames import Frames
from executor.sim.render.stage import SceneRenderer
from executor.sim.robot.actions import joint_limits
from oag.model.robots import PAPER_ROBOT
from tests.executor.recordings import invented_rollout, scripted_rollout

h5py = pytest.importorskip("h5py")
PRODUCT = Path(__file__).resolve().parents[3]


def frames_of(count: int) -> Frames:
    """Return pictures that carry their own index as brightness."""
    tones = np.arange(count, dtype=np.uint8)[:, None, None, None]
    views = {
        "global": np.broadcast_to(tones, (count, 64, 64, 3)).copy(),
        "head": np.broadcast_to(tones, (count, 32, 32, 3)).copy(),
    }
    return Frames(views, (32, 32))


@pytest.fixture(scope="module")
def episode() -> Episode:
    rollout = invented_rollout()
    return Episode.from_rollout(rollout, frames_of(len(rollout.trajectory.time_s)))


@pytest.fixture(scope="module")
def path(episode: Episode, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_robomimic(tmp_path_factory.mktemp("data") / "episode.hdf5", [episode])


def test_one_place_opens_files_to_write_them() -> None:
    """Others would die with the process on a full disk, or leave a half of a file."""
    packages = (
        path for name in ("bddl", "oag", "llm", "executor", "scripts") for path in (PRODUCT / name).rglob("*.py")
    )
    writes = re.compile(r"""h5py\.File\([^)]*["'](w|a|x|r\+)""")
    assert [path.name for path in packages if writes.search(path.read_text())] == ["robomimic.py"]


def actions_of(rollout: Rollout) -> NDArray[np.float32]:
    """Return a rollout's normalised actions, at 10 samples a second."""
    motion = rollout.trajectory
    opening_m = float(joint_limits(rollout.scene.robot.model)[-1, 1])
    return normalised_actions(motion.robot_qpos, motion.robot_target[1:], action_rates(PAPER_ROBOT) / 10.0, opening_m)


def test_actions_are_normalised_and_give_the_targets_back(path: Path) -> None:
    motion = invented_rollout().trajectory
    with h5py.File(path) as file:
        demo = file["data/demo_0"]
        actions, scale, targets = demo["actions"][:], demo.attrs["action_scale"], demo["actions_absolute"][:]
    assert actions.shape == (len(motion.time_s) - 1, len(action_names(PAPER_ROBOT))) and np.abs(actions).max() < 1.0
    assert np.array_equal(actions, actions_of(invented_rollout())) and np.array_equal(targets, motion.robot_target[1:])
    moves = actions[:, :10] * scale
    now = motion.robot_qpos[:-1]
    cosine, sine = np.cos(now[:, 2]), np.sin(now[:, 2])
    x = now[:, 0] + cosine * moves[:, 0] - sine * moves[:, 1]
    y = now[:, 1] + sine * moves[:, 0] + cosine * moves[:, 1]
    assert x == pytest.approx(targets[:, 0], abs=1e-5) and y == pytest.approx(targets[:, 1], abs=1e-5)
    assert now[:, 2:10] + moves[:, 2:] == pytest.approx(targets[:, 2:10], abs=1e-5)


def test_the_gripper_is_one_when_open_and_minus_one_when_shut() -> None:
    rollout = invented_rollout()
    opening = rollout.trajectory.robot_target[1:, 10:].mean(axis=1)
    assert actions_of(rollout)[:, 10] == pytest.approx(np.clip(opening / 0.028 * 2 - 1, -1, 1), abs=1e-5)


@pytest.mark.parametrize(("robot", "opening_m"), [("paper", 0.028), ("panda", 0.04)])
def test_the_grippers_range_is_the_robots(robot: str, opening_m: float, tmp_path: Path) -> None:
    rollout = invented_rollout()
    targets_m = np.linspace(0.0, opening_m, len(rollout.trajectory.time_s) - 1)
    rollout.trajectory.robot_target[1:, 10:] = targets_m[:, None]
    episode = Episode.from_rollout(replace(rollout, scene=rollout.scene.with_robot(robot)))
    with h5py.File(write_robomimic(tmp_path / "e.hdf5", [episode])) as file:
        assert file["data/demo_0/actions"][:, 10] == pytest.approx(np.linspace(-1.0, 1.0, len(targets_m)), abs=1e-5)


def test_too_fast_a_command_is_clipped() -> None:
    rollout = invented_rollout()
    rollout.trajectory.robot_target[5, 0] += 50.0
    # Forward and, seen from the turned base, sideways.
    assert np.count_nonzero(np.abs(actions_of(rollout)) == 1.0) == 2


def test_spans_cover_the_recording_in_order(episode: Episode) -> None:
    first, second = episode.about["subtasks"]
    assert [first["name"], second["name"]] == ["open_refrigerator", "pick_up_glass"]
    assert first["span"] == [0, second["span"][0]] and second["span"][1] == episode.length
    assert first["steps"][4]["action"] == {"4": [0.0, 0.85]}


@pytest.mark.parametrize("samples", [0, 1])
def test_a_recording_without_a_transition_is_no_episode(samples: int) -> None:
    with pytest.raises(EpisodeTooShort, match=f"at least 2 recorded samples, this recording has {samples}"):
        Episode.from_rollout(invented_rollout(samples=samples))


def test_the_file_has_what_robomimic_reads(path: Path, episode: Episode) -> None:
    with h5py.File(path) as file:
        assert file["data"].attrs["total"] == episode.length - 1
        # Its trainer reads these two of every file; an environment of this file's own does not exist, so none is named.
        environment = json.loads(file["data"].attrs["env_args"])
        assert environment == {"type": 2, "env_kwargs": {}}
        # Its reader takes every name under data/ for a demonstration: int(name[5:]).
        assert [int(name[5:]) for name in file["data"]] == [0]
        demo = file["data/demo_0"]
        length = demo.attrs["num_samples"]
        assert length == episode.length - 1
        for name in ("actions", "states", "rewards", "dones", "actions_absolute"):
            assert len(demo[name]) == length
        for group in ("obs", "next_obs"):
            assert all(len(values) == length for values in demo[group].values())
        pictures = {"global_image", "head_image"}
        assert set(demo["obs"]) == set(demo["next_obs"]) | pictures and set(demo["last_obs"]) == pictures
        assert demo["rewards"][-1] == 1.0 and demo["rewards"][:].sum() == 1.0
        assert demo["dones"][-1] == 1 and demo["dones"][:].sum() == 1
        assert file["mask/successful"][:].tolist() == [b"demo_0"]


def test_next_observations_are_one_sample_later(path: Path) -> None:
    with h5py.File(path) as file:
        demo = file["data/demo_0"]
        for name in demo["next_obs"]:
            assert np.array_equal(demo["obs"][name][1:], demo["next_obs"][name][:-1])
        images = demo["obs/global_image"]
        assert images.dtype == np.uint8 and images.shape == (demo.attrs["num_samples"], 32, 32, 3)
        assert images[7].mean() == 7 and demo["last_obs/head_image"][0].mean() == demo.attrs["num_samples"]


def test_numbers_and_pictures_are_compressed_and_there_once(path: Path) -> None:
    kept: dict[str, tuple[int, int, str | None]] = {}

    def look(name: str, found: object) -> None:
        if isinstance(found, h5py.Dataset):
            kept[name] = found.nbytes, found.id.get_storage_size(), found.compression

    with h5py.File(path) as file:
        file["data/demo_0"].visititems(look)
        length = file["data/demo_0"].attrs["num_samples"]
    large = {name: found for name, found in kept.items() if found[0] > 4096}
    assert {"states", "datagen_info/eef_pose", "obs/head_image"} <= set(large)
    assert all(compression == "gzip" for _, _, compression in large.values())
    assert sum(stored for _, stored, _ in large.values()) < 0.2 * sum(plain for plain, _, _ in large.values())
    images = sum(plain for name, (plain, _, _) in kept.items() if name.endswith("_image"))
    assert images == 2 * (length + 1) * 32 * 32 * 3


def test_sentence_paraphrases_and_cameras_are_there(tmp_path: Path) -> None:
    rollout = invented_rollout()
    frames = frames_of(len(rollout.trajectory.time_s))
    query = "put the glass into the refrigerator"
    path = write_robomimic(tmp_path / "e.hdf5", [Episode.from_rollout(rollout, frames, query)])
    with h5py.File(path) as file:
        demo = file["data/demo_0"]
        assert demo.attrs["query"] == query
        others = json.loads(demo.attrs["paraphrases"])
        assert len(others) > 2 and query not in others
        cameras = json.loads(demo.attrs["cameras"])
        assert set(cameras) == {"global", "head"} and cameras["global"]["mount"] is None
        assert np.array(cameras["head"]["T_mount_camera"]).shape == (4, 4)
        for camera in cameras.values():
            focal = 16.0 / np.tan(camera["fov_y_rad"] / 2.0)
            assert camera["size"] == [32, 32]
            assert np.allclose(camera["intrinsics"], [[focal, 0, 16], [0, focal, 16], [0, 0, 1]])


@pytest.mark.render
def test_intrinsics_are_those_that_pictures_are_drawn_with() -> None:
    scene = library.load("kitchen_t1")
    cameras = cameras_for(scene, VIEWS, aspect=64 / 48)
    with (
        closing(SceneRenderer()) as scene_renderer,
        scene_renderer.stage(scene, cameras, dict.fromkeys(VIEWS, (64, 48))) as stage,
    ):
        for camera in cameras:
            assert np.allclose(stage.intrinsics(camera.name), intrinsic_matrix(camera, (64, 48)), atol=1e-3)


def test_demonstrations_of_two_files_keep_their_pictures_when_they_are_merged(path: Path, tmp_path: Path) -> None:
    rollout = invented_rollout(samples=25)
    count = len(rollout.trajectory.time_s)
    other = Frames({view: 255 - pictures for view, pictures in frames_of(count).views.items()}, (32, 32))
    second = write_robomimic(tmp_path / "second.hdf5", [Episode.from_rollout(rollout, other)])
    merged = tmp_path / "merged.hdf5"
    with h5py.File(merged, "w") as out:
        for index, source in enumerate((path, second)):
            with h5py.File(source) as file:
                file.copy("data/demo_0", out.require_group("data"), f"demo_{index}")
    with h5py.File(merged) as out:
        for index, source in enumerate((path, second)):
            with h5py.File(source) as file:
                for name in ("obs/global_image", "obs/head_image", "last_obs/global_image", "last_obs/head_image"):
                    own, copied = file[f"data/demo_0/{name}"], out[f"data/demo_{index}/{name}"]
                    assert not copied.is_virtual and copied.shape == own.shape
                    assert np.array_equal(copied[:], own[:])
        assert out["data/demo_0/obs/global_image"][3].mean() == 3
        assert out["data/demo_1/obs/global_image"][3].mean() == 252


def test_texts_and_states_are_there_for_people_and_replay(path: Path, episode: Episode) -> None:
    with h5py.File(path) as file:
        demo = file["data/demo_0"]
        spans = json.loads(demo.attrs["subtasks"])
        assert spans[1]["goal"] == "(not (ontop glass_0 table_0))" and spans[1]["succeeded"] is True
        assert json.loads(demo.attrs["scene"])["name"] == "kitchen_t1"
        (scaled,) = json.loads(demo.attrs["scaled"])
        assert (scaled["object_id"], scaled["factors"]) == ("glass_0", [0.71] * 3)
        assert json.loads(demo.attrs["scene"])["objects"]["glass_0"]["scale"] == [0.71] * 3
        assert demo.attrs["state_hash"] == episode.about["state_hash"]
        assert bytes(demo["packed_states"][3]) == invented_rollout().trajectory.packed_states[3]
        assert demo["datagen_info/eef_pose"].shape[1:] == (4, 4)
        signal = demo["datagen_info/subtask_term_signals/1_open_refrigerator"][:]
        assert signal[0] == 0 and signal[-1] == 1


def test_a_failed_episode_earns_nothing(tmp_path: Path) -> None:
    path = write_robomimic(tmp_path / "failed.hdf5", [Episode.from_rollout(invented_rollout(failed=True))])
    with h5py.File(path) as file:
        assert not file["data/demo_0"].attrs["success"] and not file["data/demo_0/rewards"][:].any()
        assert len(file["mask/successful"]) == 0
        assert "global_image" not in file["data/demo_0/obs"]


@pytest.mark.physics
def test_a_recording_of_the_physics_fits_in(tmp_path: Path) -> None:
    episode = Episode.from_rollout(scripted_rollout("kitchen_t3", seconds=0.5))
    assert episode.about["object_ids"] == ["apple_0", "bowl_0"]
    with h5py.File(write_robomimic(tmp_path / "e.hdf5", [episode])) as file:
        assert file["data/demo_0/obs/object"].shape == (4, 14)
        assert len(json.loads(file["data/demo_0/states"].attrs["columns"])) == 2 + len(episode.about["joint_names"]) + 2


def test_no_episodes_make_no_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="at least one episode"):
        write_robomimic(tmp_path / "none.hdf5", [])
    assert list(tmp_path.iterdir()) == []
