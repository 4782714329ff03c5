"""Pictures of what is in a store, drawn anew from its states into another store: other views, sizes and looks.

Nothing is simulated. An episode keeps its motion, its commands and how it ended; its unit says how it is looked at now,
so that the other store's episodes are as if they had been generated so, and equal requests give equal bytes. Also the
process that draws them, one after the other: `python -m executor.datasets.upkeep.redraw`.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from executor.datasets import samples
from executor.datasets.footage import POSES, film_unit
from executor.datasets.generate import UNIT_LIMIT_S, Tally, Told, generate
from executor.datasets.store import SAMPLES, EpisodeStore, StoredEpisode
from executor.datasets.units import DemoSeries, DemoUnit, View
from executor.machine.files import plain
from executor.machine.workers.process import serve
from executor.pictures.stage import Draughtsman, kept_draughtsman

WORKER = "executor.datasets.upkeep.redraw"
LOOKS = ("surfaces", "lights", "cameras")
"""The axes of variation that pictures alone have."""

_OF_THE_UNIT = ("schema", "id", "name", "version", "unit", "pictures")  # Of `unit.json`: written anew.


@dataclass(frozen=True, slots=True)
class Redrawing:
    """How episodes are to be looked at.

    Attributes:
        views, size, depth, segmentation: As `Recording` has them.
        vary: Which of `LOOKS` are drawn.
        look: For which of the looks.
    """

    views: tuple[View, ...]
    size: tuple[int, int]
    depth: bool
    segmentation: bool
    vary: tuple[str, ...] = ()
    look: int = 0

    def of(self, unit: DemoUnit) -> DemoUnit:
        """Returns the unit that is the same but for how it is looked at.

        Raises:
            ValueError: There is no such unit: a view is named twice, or a size cannot be drawn.
        """
        recording = replace(
            unit.recording, views=self.views, size=self.size, depth=self.depth, segmentation=self.segmentation
        )
        variation = replace(unit.variation, **{axis: axis in self.vary for axis in LOOKS}, look=self.look)
        return DemoUnit.from_json(replace(unit, recording=recording, variation=variation).to_json())


def asked_for(source: EpisodeStore, out: EpisodeStore, wanted: Redrawing) -> list[tuple[StoredEpisode, DemoUnit]]:
    """Writes down what is asked for, and returns the episodes that are still to be drawn, each with its new unit.

    Args:
        source: Where episodes come from; those without motion are copied, so that the yield stays what it was.
        out: Where they go; it is made when absent, and what is there already stays.
        wanted: How they are to be looked at.

    Raises:
        NotADataset: One of them is none, or an episode cannot be read.
        OSError: The folder cannot be written.
    """
    asked = [DemoSeries.from_json(request) for request in source.requests()]
    out.add_requests([replace(series, first=wanted.of(series.first)).to_json() for series in asked])
    left = []
    for episode in source.episodes():
        unit, version = wanted.of(DemoUnit.from_json(episode.meta["unit"])), str(episode.meta["version"])
        there = out.read(unit, version)
        if there is not None and there.meta["ended"] != episode.meta["ended"]:
            shutil.rmtree(there.path)  # The process that drew it had died.
            there = None
        if there is None:
            left.append((episode, unit))
    return left


def redraw(
    out: EpisodeStore,
    left: Sequence[tuple[StoredEpisode, DemoUnit]],
    workers: int,
    told: Told,
    *,
    limit_s: float = UNIT_LIMIT_S,
) -> None:
    """Draws episodes into a store; each is there, whole, before it is told of.

    Args:
        out: Where they go.
        left: What to draw, as `asked_for` returns it.
        workers: How many processes.
        told: Called with every unit and how its drawing ended: "drawn", or "crashed", "timed-out" or "error".
        limit_s: Wall time that an episode may take.

    Raises:
        WorkersUnusable, OSError, KeyboardInterrupt: As for `generate`; what had been finished is kept.
    """
    versions = [str(episode.meta["version"]) for episode, _ in left]
    paths = {unit.id(version): str(episode.path) for (episode, unit), version in zip(left, versions, strict=True)}
    for one in sorted(set(versions)):

        def more(unit: DemoUnit, version: str = one) -> Mapping[str, Any]:
            return {"episode": paths[unit.id(version)]}

        units = [unit for (_, unit), version in zip(left, versions, strict=True) if version == one]
        generate(out, units, one, workers, told, tally=Tally(), limit_s=limit_s, worker=WORKER, more=more)


def run_unit(
    episode: StoredEpisode, out: EpisodeStore, unit: DemoUnit, draughtsman: Callable[[], Draughtsman]
) -> dict[str, Any]:
    """Draws an episode into another store, and returns what it cost.

    Args:
        episode: What to draw.
        out: Where it goes.
        unit: What it is there.
        draughtsman: Gives what draws.

    Raises:
        NotADataset: The episode cannot be read.
        OSError: The folder cannot be written.
    """
    began, version = time.process_time(), str(episode.meta["version"])
    meta = {name: value for name, value in episode.meta.items() if name not in _OF_THE_UNIT}
    with out.writing(unit, version) as folder:

        def drawn(file: str, aside: Path) -> dict[str, Any]:
            """Draws one of the episode's motions, writes its samples, and returns what is said of the pictures."""
            arrays = {name: array for name, array in episode.motion(file).items() if not name.startswith(POSES)}
            states = [state.tobytes() for state in arrays["packed_states"]]
            aside.mkdir(exist_ok=True)
            filmed = film_unit(draughtsman(), aside, unit, episode.scene, episode.task, arrays["time_s"], states)
            (folder / file).write_bytes(samples.packed({**arrays, **filmed.poses}))
            return dict(plain(filmed.described))

        if episode.corrections:
            meta["corrections"] = [
                {**told, "pictures": drawn(told["samples"], folder / Path(told["samples"]).stem)}
                for told in episode.corrections
            ]
        if episode.has_samples:
            meta["pictures"] = drawn(SAMPLES, folder)
        out.write(unit, version, meta, folder)
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return {"ended": "drawn", "bytes": size, "cpu_s": time.process_time() - began}


def main() -> None:
    """Serves requests until standard input ends."""
    with kept_draughtsman() as draughtsman:

        def handle(request: dict[str, Any]) -> dict[str, Any]:
            path = Path(request["episode"])
            episode = EpisodeStore(path.parent.parent).episode(path.name)
            return run_unit(
                episode, EpisodeStore(Path(request["store"])), DemoUnit.from_json(request["unit"]), draughtsman
            )

        serve(handle)


if __name__ == "__main__":
    main()
