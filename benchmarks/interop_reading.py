"""Reads exported data sets with the libraries that people train with, and prints what they got as JSON.

Runs in an environment of its own (`benchmarks.interop` makes it), where nothing of this project is installed.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

os.environ["HF_HUB_OFFLINE"] = "1"
STEPS, BATCH = 50, 16
_NUMBERS = ("eef_pos", "eef_quat", "gripper_opening", "environment_state", "primitive", "object", "joints")


def read_lerobot(folder: Path) -> dict[str, Any]:
    import torch
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    ahead = {"action": [k / 10 for k in range(8)]}
    data = LeRobotDataset("scene2demo/interop", root=folder)
    rows = [data[k] for k in range(len(data))]
    names = [name for name, told in data.meta.features.items() if told["dtype"] not in ("video", "image")]
    names = [name for name in names if name.startswith(("observation.", "action", "next.", "primitive"))]
    columns = {name: torch.stack([row[name] for row in rows]).numpy().astype("f4") for name in names}
    chunks = LeRobotDataset("scene2demo/interop", root=folder, delta_timestamps=ahead)
    torch.manual_seed(0)
    numbers = len(columns["observation.state"][0]) + len(columns["observation.environment_state"][0])
    policy = torch.nn.Sequential(torch.nn.Linear(numbers, 64), torch.nn.GELU(), torch.nn.Linear(64, 80))
    optimiser = torch.optim.Adam(policy.parameters(), 1e-3)
    losses = []
    for batch in _batches(chunks):
        seen = torch.cat([batch["observation.state"], batch["observation.environment_state"]], 1)
        wanted, there = batch["action"].flatten(1), ~batch["action_is_pad"]
        loss = ((policy(seen) - wanted) ** 2).view(len(seen), 8, 10)[there].mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    pictures = {key: list(rows[0][key].shape) for key in data.meta.camera_keys}
    return {
        **_told(columns),
        "episodes": data.num_episodes,
        "task": rows[0]["task"],
        "pictures": pictures,
        "loss_first_last": _ends(losses),
        "quantiles": sorted(data.meta.stats["action"]),
    }


def read_robomimic(folder: Path) -> dict[str, Any]:
    import h5py
    import numpy as np

    with h5py.File(folder / "demonstrations.hdf5") as file:
        names = [name.decode() for name in file["mask/all"][:]]
        demos = [file["data"][name] for name in names]
        columns = {
            "action": np.concatenate([demo["actions_hand"][:] for demo in demos]),
            "action.joint_target": np.concatenate([demo["actions_absolute"][:] for demo in demos]),
            "observation.environment_state": np.concatenate([demo["obs/environment_state"][:] for demo in demos]),
            "observation.object_poses": np.concatenate([demo["obs/object"][:] for demo in demos]),
            "observation.point_cloud": np.concatenate([demo["obs/point_cloud"][:] for demo in demos]),
        }
        told = {**_told(columns), "episodes": len(names), "total": int(file["data"].attrs["total"])}
    return {**told, **robomimic_steps(folder)}


def read_zarr(folder: Path) -> dict[str, Any]:
    import zarr

    # As Diffusion Policy's and DP3's replay buffers open it.
    root = zarr.open(str(folder), mode="r")
    names = {f"observation.{name}": name for name in ("state", "velocity", "object_poses", "point_cloud")}
    names |= {"action": "action", "action.joint_target": "joint_target", "next.reward": "reward"}
    columns = {name: root["data"][ours][:] for name, ours in names.items()}
    ends = root["meta"]["episode_ends"][:]
    rows = [len(values) for _, values in root["data"].arrays()]
    told = {"episodes": len(ends), "whole": set(rows) == {int(ends[-1])}, "zarr": zarr.__version__}
    return {**_told(columns), **told, **dp3_steps(folder)}


def _told(columns: dict[str, Any]) -> dict[str, Any]:
    digests = {name: hashlib.sha256(values.astype("<f4").tobytes()).hexdigest() for name, values in columns.items()}
    return {"rows": len(next(iter(columns.values()))), "digests": digests}


def robomimic_steps(folder: Path) -> dict[str, Any]:
    """Return what robomimic's behaviour cloning makes of a file: its version, demonstrations, first and last loss."""
    if find_spec("robomimic") is None:
        return {}
    import robomimic
    import torch
    from robomimic.algo import algo_factory
    from robomimic.config import config_factory
    from robomimic.utils import file_utils, obs_utils, train_utils

    path = str(folder / "demonstrations.hdf5")
    config = config_factory("bc")
    with config.values_unlocked():
        config.train.data = [{"path": path}]
        config.train.hdf5_filter_key = "train"
        config.train.dataset_keys = ["actions", "rewards", "dones"]
        config.observation.modalities.obs.low_dim = list(_NUMBERS)
    obs_utils.initialize_obs_utils_with_config(config)
    shapes = file_utils.get_shape_metadata_from_dataset(
        dataset_config={"path": path}, action_keys=config.train.action_keys, all_obs_keys=config.all_obs_keys
    )
    data, _ = train_utils.load_data_for_training(config, obs_keys=shapes["all_obs_keys"])
    torch.manual_seed(0)
    model = algo_factory(
        algo_name="bc",
        config=config,
        obs_key_shapes=shapes["all_shapes"],
        ac_dim=shapes["ac_dim"],
        device=torch.device("cpu"),
    )
    model.set_train()
    losses = []
    for batch in _batches(data):
        ready = model.postprocess_batch_for_training(
            model.process_batch_for_training(batch), obs_normalization_stats=None
        )
        losses.append(float(model.log_info(model.train_on_batch(ready, epoch=0))["Loss"]))
    return {"trainer": robomimic.__version__, "demonstrations": data.n_demos, "loss_first_last": _ends(losses)}


def dp3_steps(folder: Path) -> dict[str, Any]:
    """Return what a small policy on points makes of DP3's own data set class: episodes, first and last loss."""
    if find_spec("diffusion_policy_3d") is None:
        return {}
    import torch
    from diffusion_policy_3d.dataset.metaworld_dataset import MetaworldDataset

    data = MetaworldDataset(str(folder), horizon=16, pad_before=1, pad_after=7)
    scale = data.get_normalizer()
    torch.manual_seed(0)
    seen = len(data[0]["obs"]["agent_pos"][0])
    points = torch.nn.Sequential(torch.nn.Linear(3, 64), torch.nn.LayerNorm(64), torch.nn.ReLU())
    policy = torch.nn.Sequential(torch.nn.Linear(64 + seen, 128), torch.nn.GELU(), torch.nn.Linear(128, 160))
    optimiser = torch.optim.Adam([*points.parameters(), *policy.parameters()], 1e-3)
    losses = []
    for batch in _batches(data):
        there, wanted = scale.normalize(batch["obs"]), scale["action"].normalize(batch["action"])
        # As DP3's policy does without colours: the first three numbers of a point.
        felt = points(there["point_cloud"][:, 0, :, :3]).amax(1)
        loss = ((policy(torch.cat([felt, there["agent_pos"][:, 0]], 1)).view(-1, 16, 10) - wanted) ** 2).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    return {"buffer_episodes": data.replay_buffer.n_episodes, "loss_first_last": _ends(losses)}


def _batches(data: Any) -> Iterator[Any]:
    """Yield as many batches as there are steps."""
    import torch

    done = 0
    while done < STEPS:
        for batch in torch.utils.data.DataLoader(data, batch_size=BATCH, shuffle=True):
            if done == STEPS:
                return
            yield batch
            done += 1


def _ends(losses: list[float]) -> list[float]:
    """Return the mean of the first five and of the last five."""
    return [sum(part) / len(part) for part in (losses[:5], losses[-5:])]


if __name__ == "__main__":
    read = {"lerobot": read_lerobot, "robomimic": read_robomimic, "zarr": read_zarr}
    print(json.dumps({kind: reader(Path(sys.argv[1]) / kind) for kind, reader in read.items()}))
