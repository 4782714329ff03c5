"""Reads exported data sets with the libraries that people train with, and prints what they got as JSON.

Runs in an environment of its own (`benchmarks.interop` makes it), where nothing of this project is installed.
"""

from __future__ import annotations

import hashlib
import json
import os
import sys
from pathlib import Path
from typing import Any

os.environ["HF_HUB_OFFLINE"] = "1"
STEPS = 50


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
    batches = torch.utils.data.DataLoader(chunks, batch_size=16, shuffle=True)
    stream = iter(batches)
    for _ in range(STEPS):
        batch = next(stream, None)
        if batch is None:
            stream = iter(batches)
            batch = next(stream)
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
        "loss_first_last": [losses[0], losses[-1]],
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
        return {**_told(columns), "episodes": len(names), "total": int(file["data"].attrs["total"])}


def read_zarr(folder: Path) -> dict[str, Any]:
    import zarr

    # As Diffusion Policy's and DP3's replay buffers open it.
    root = zarr.open(str(folder), mode="r")
    names = {f"observation.{name}": name for name in ("state", "velocity", "object_poses", "point_cloud")}
    names |= {"action": "action", "action.joint_target": "joint_target", "next.reward": "reward"}
    columns = {name: root["data"][ours][:] for name, ours in names.items()}
    ends = root["meta"]["episode_ends"][:]
    rows = [len(values) for _, values in root["data"].arrays()]
    return {**_told(columns), "episodes": len(ends), "whole": set(rows) == {int(ends[-1])}, "zarr": zarr.__version__}


def _told(columns: dict[str, Any]) -> dict[str, Any]:
    digests = {name: hashlib.sha256(values.astype("<f4").tobytes()).hexdigest() for name, values in columns.items()}
    return {"rows": len(next(iter(columns.values()))), "digests": digests}


if __name__ == "__main__":
    read = {"lerobot": read_lerobot, "robomimic": read_robomimic, "zarr": read_zarr}
    print(json.dumps({kind: reader(Path(sys.argv[1]) / kind) for kind, reader in read.items()}))
