"""Loads exported data sets with the libraries that people train with, in an environment of its own, and compares.

    python -m benchmarks.interop [--store STORE] [--python PYTHON] [--interpreter PYTHON3.12] [--beside DIR...]
                                 [--out FILE]

Without a store, two short demonstrations are generated. Without `--python`, lerobot (which needs Python 3.12), h5py,
zarr 2 and this package are installed into `.venv-interop`. LeRobot's own commands work on it as well: `lerobot-train`
trains a small ACT for 50 steps, and `lerobot-eval` lets that act in our environment, and films it. robomimic 0.5 and
DP3 are on no index: `--beside` names checkouts of them, whose own loaders then take 50 steps too, in a Python that has
what they import. Exit code 1 says that something was read otherwise than it was written, or that nothing was learned
from it.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from executor.cli.app import run
from executor.data.formats.export import Format, write_set
from executor.data.formats.store_reader import stream_of
from executor.data.formats.table import Extra
from executor.data.store import EpisodeStore
from executor.system.files import read_json, write_json
from executor.system.vulkan import activate

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT = ROOT / ".venv-interop"
READER = Path(__file__).with_name("interop_reading.py")
WANTED = ("lerobot[dataset,training]==0.6.1", "h5py>=3.11,<4", "zarr>=2.18,<3", "numcodecs<0.16", f"{ROOT}[sim,gym]")
KINDS: tuple[Format, ...] = ("lerobot", "robomimic", "zarr")
TRAINED_STEPS = 50
ACTED_STEPS = 20
_IS_RECENT = "import sys; sys.exit(sys.version_info < (3, 12))"
_WEIGHTS = Path("checkpoints", "last", "pretrained_model")
_DRIVERS = ("VK_DRIVER_FILES", "VK_ICD_FILENAMES")
INCLUDE: tuple[Extra, ...] = ("depth", "segmentation", "point_cloud")


def main() -> int:
    """Exports, reads, compares; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.interop", description=__doc__.split("\n")[0])
    parser.add_argument("--store", type=Path, help="what to export; by default two demonstrations, made first")
    parser.add_argument("--python", type=Path, help="a Python that has lerobot, h5py, zarr 2 and scene2demo[sim,gym]")
    parser.add_argument("--interpreter", default="python3.12", help="a Python 3.12 that makes such an environment")
    parser.add_argument("--beside", type=Path, nargs="*", default=[], help="checkouts of robomimic and of DP3")
    parser.add_argument("--out", type=Path, help="where the figures go, as JSON")
    options = parser.parse_args()
    python = options.python or _environment(options.interpreter)
    with TemporaryDirectory() as name:
        folder = Path(name)
        store = options.store or _made(folder / "store")
        for kind in KINDS:
            write_set(stream_of(EpisodeStore.open(store), INCLUDE), kind, folder / kind)
        quiet = {**os.environ, "HF_HUB_OFFLINE": "1", "HF_HOME": str(folder / "home")}
        quiet["PYTHONPATH"] = os.pathsep.join(str(path.resolve()) for path in options.beside)
        done = subprocess.run([python, READER, folder], check=True, stdout=subprocess.PIPE, env=quiet)
        read = json.loads(done.stdout.splitlines()[-1])
        activate()
        told = {**quiet, **{name: os.environ[name] for name in _DRIVERS if name in os.environ}, "PYTHONPATH": str(ROOT)}
        unable = _trained(python, folder / "lerobot", folder / "trained", told)
        unable = unable or _acted(python, folder / "trained", folder / "acted", told)
        wrong = [words for kind in KINDS for words in _compared(EpisodeStore(store), kind, read[kind])]
    if unable:
        wrong.append(unable)
    for kind in KINDS:
        first, last = read[kind].get("loss_first_last", (1.0, 0.0))
        if not last < first:
            wrong.append(f"{kind}: 50 steps of training took the loss from {first:.4f} to {last:.4f}")
    if options.out:
        write_json(options.out, {"ok": not wrong, "wrong": wrong, "read": read})
    good = f"{read['lerobot']['rows']} rows of {read['lerobot']['episodes']} episodes, all as written; "
    stock = f"lerobot-train took {TRAINED_STEPS} steps, and lerobot-eval {ACTED_STEPS}"
    print("\n".join(wrong) or good + stock)
    return 1 if wrong else 0


def _compared(store: EpisodeStore, kind: Format, read: dict[str, Any]) -> list[str]:
    """Return what was read otherwise than it was written."""
    episodes = list(stream_of(store, INCLUDE).episodes())
    wrong = []
    for name, digest in read["digests"].items():
        # A demonstration of robomimic's has transitions: one fewer than rows.
        rows = [one.columns[name][:-1] if kind == "robomimic" else one.columns[name] for one in episodes]
        if hashlib.sha256(np.concatenate(rows).astype("<f4").tobytes()).hexdigest() != digest:
            wrong.append(f"{kind}: {name} is read otherwise than it was written")
    if read["episodes"] != len(episodes):
        wrong.append(f"{kind}: {read['episodes']} episodes are read, {len(episodes)} were written")
    return wrong


def _trained(python: Path, data: Path, out: Path, environment: dict[str, str]) -> str:
    """Has LeRobot's own command train a small policy of its own; returns what went wrong, empty when nothing did."""
    told = {
        "dataset.repo_id": "scene2demo/interop",
        "dataset.root": data,
        "policy.type": "act",
        "policy.push_to_hub": "false",
        "policy.device": "cpu",
        **{"policy.dim_model": 64, "policy.n_heads": 2, "policy.dim_feedforward": 128},
        **{"policy.chunk_size": 8, "policy.n_action_steps": 8},
        **{"steps": TRAINED_STEPS, "save_freq": TRAINED_STEPS, "batch_size": 8, "num_workers": 0},
        "output_dir": out,
    }
    return _stock(python, "lerobot-train", told, out / _WEIGHTS / "model.safetensors", environment)


def _acted(python: Path, trained: Path, out: Path, environment: dict[str, str]) -> str:
    """Has LeRobot's own command let that policy act in our environment; returns what went wrong, as `_trained`."""
    told = {
        **{"env.discover_packages_path": "executor.envs", "env.type": "scene2demo", "env.task": "T5-v0"},
        **{"env.action_mode": "paper", "env.episode_length": ACTED_STEPS},
        **{"policy.path": trained / _WEIGHTS, "policy.device": "cpu"},
        **{"eval.n_episodes": 1, "eval.batch_size": 1},
        "output_dir": out,
    }
    return _stock(python, "lerobot-eval", told, out / "eval_info.json", environment)


def _stock(python: Path, command: str, told: dict[str, object], result: Path, environment: dict[str, str]) -> str:
    words = [f"--{name}={value}" for name, value in told.items()]
    done = subprocess.run(
        [python.with_name(command), *words], check=False, capture_output=True, text=True, env=environment
    )
    if done.returncode == 0 and result.is_file():
        return ""
    return f"{command}: exit code {done.returncode}, no {result.name}: {' / '.join(done.stderr.splitlines()[-3:])}"


def _made(folder: Path) -> Path:
    if run(["generate", "T5", "T6", "--episodes", "1", "--seed", "62900", "--workers", "1", "--out", str(folder)]):
        raise RuntimeError("the demonstrations could not be made")
    return folder


def _environment(interpreter: str) -> Path:
    python, has = ENVIRONMENT / "bin" / "python", ENVIRONMENT / "has.json"
    if not has.exists() or read_json(has) != list(WANTED):
        # One that is found may yet be a stand-in of a version manager that runs nothing.
        found = shutil.which(interpreter)
        if not found or subprocess.run([found, "-c", _IS_RECENT], check=False, capture_output=True).returncode:
            raise SystemExit(
                f"{interpreter} is no Python from 3.12 on that runs, which lerobot needs; name one with --interpreter "
                "(make interop INTERPRETER=...)"
            )
        print(f"[interop] installing {' '.join(WANTED)} into {ENVIRONMENT}", file=sys.stderr)
        subprocess.run([interpreter, "-m", "venv", ENVIRONMENT], check=True)
        subprocess.run([python, "-m", "pip", "install", "--quiet", *WANTED], check=True)
        write_json(has, list(WANTED))
    return python


if __name__ == "__main__":
    sys.exit(main())
