"""A store with two demonstrations that physics made, once a session."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from executor.campaign.versions import outcome_version
from executor.data import samples
from executor.data.generation import series_of
from executor.data.store import SAMPLES, EpisodeStore
from executor.data.units import DemoUnit, Recording
from executor.data.views import DEPTH, SEGMENTATION, footage_path, video_encoder
from executor.data.worker import run_unit

# One opens something, one picks something up: seconds each.
SIZE = (64, 48)
PLAN = {"seed": 62990, "episodes": 1, "sources": [{"families": ["T5", "T6"]}]}


@pytest.fixture(scope="session")
def made_store(tmp_path_factory: pytest.TempPathFactory) -> EpisodeStore:
    """Return the store; tests that change one copy it first."""
    store, series = EpisodeStore(tmp_path_factory.mktemp("store") / "s"), series_of(PLAN)
    store.add_requests([one.to_json() for one in series])
    for one in series:
        for unit in one.units():
            run_unit(store, unit, outcome_version())
    return store


@pytest.fixture(scope="session")
def filmed_store(made_store: EpisodeStore, tmp_path_factory: pytest.TempPathFactory) -> EpisodeStore:
    """Return a store of four episodes: the two of physics under two seeds each, with videos that brighten.

    Velocities and the hash of states tell the seeds apart, since what has the same states is the same demonstration.
    Depth and segmentation of row i are numbers that follow from i.
    """
    store = EpisodeStore(tmp_path_factory.mktemp("filmed") / "s")
    store.add_requests(made_store.requests())
    for episode in made_store.episodes():
        unit = DemoUnit.from_json(episode.meta["unit"])
        for seed in range(62990, 62992):
            other = replace(unit, seed=seed, recording=Recording(views=("head",), size=SIZE))
            meta = {name: value for name, value in episode.meta.items() if name not in ("id", "name", "schema")}
            with store.writing(other, "v") as folder:
                own = {"robot_qvel": episode.arrays["robot_qvel"] + np.float32(1e-4 * (seed - 62990))}
                own["camera_pose_head"] = episode.arrays["eef_pose"][::-1]
                (folder / SAMPLES).write_bytes(samples.packed({**episode.arrays, **own}))
                meta["state_hash"] = f"{seed}{meta['state_hash'][5:]}"
                meta["pictures"] = {"views": {"head": {"size": list(SIZE)}}}
                film(folder / "head.mp4", int(meta["samples"]), seed % 7)
                for kind in (DEPTH, SEGMENTATION):
                    with video_encoder(footage_path(folder, "head", kind), SIZE, Fraction(10)) as track:
                        for row in range(int(meta["samples"])):
                            track.add(numbers(row, kind))
                store.write(other, "v", {**meta, "version": "v", "unit": other.to_json()}, folder)
    return store


def film(path: Path, count: int, first: int) -> None:
    """Write a video whose picture i is evenly 30 + (first + i) % 200 bright."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w", options={"fflags": "+bitexact"}) as container:
        stream = container.add_stream("libx264", rate=10)
        stream.width, stream.height = SIZE
        stream.pix_fmt, stream.options = "yuv420p", {"crf": "10", "preset": "veryfast", "g": "2", "bf": "0"}
        stream.codec_context.thread_count = 1
        for k in range(count):
            picture = np.full((SIZE[1], SIZE[0], 3), 30 + (first + k) % 200, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, format="rgb24")))
        container.mux(stream.encode())


def numbers(row: int, kind: str) -> np.ndarray:
    """Return the picture of a row: millimetres up to 25 m, or numbers of 40 bodies."""
    places = np.arange(SIZE[0] * SIZE[1], dtype=np.uint16).reshape(SIZE[1], SIZE[0])
    return (row * 31 + places * 7) % 25000 if kind == DEPTH else (row + places // 200) % 40


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return where a new store may go."""
    return tmp_path / "d"
