"""Render the pictures of a store again from its states into another store: other views, sizes and looks.

Nothing is simulated. An episode keeps its motion, commands and outcome; only its unit's recording changes. The other
store's episodes equal generated ones, and equal requests give equal bytes. Also the worker process that renders:
`python -m executor.data.rerender`.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from executor.campaign.engine import UNIT_LIMIT_S, Campaign
from executor.data import samples
from executor.data.generation import EpisodeCallback, Tally, generate
from executor.data.store import SAMPLES, EpisodeStore, StoredEpisode
from executor.data.units import DemoSeries, DemoUnit, View
from executor.data.views import POSES, render_unit_views
from executor.sim.render.stage import SceneRenderer, shared_renderer
from executor.system.files import plain
from executor.system.workers import serve

WORKER = "executor.data.rerender"
LOOKS = ("surfaces", "lights", "cameras")
"""Axes of variation that affect pictures only."""

_OF_THE_UNIT = ("schema", "id", "name", "version", "unit", "pictures")  # Keys of `unit.json` that are rewritten.


@dataclass(frozen=True, slots=True)
class RerenderSettings:
    """New look of episodes.

    Attributes:
        views, size, depth, segmentation, home: As in `Recording`.
        vary: Axes of `LOOKS` that are drawn.
        look: Number of the look.
    """

    views: tuple[View, ...]
    size: tuple[int, int]
    depth: bool
    segmentation: bool
    home: bool = True
    vary: tuple[str, ...] = ()
    look: int = 0

    def of(self, unit: DemoUnit) -> DemoUnit:
        """Return the unit with this look.

        Raises:
            ValueError: There is no such unit: a view is named twice, or a size cannot be rendered.
        """
        pictured = {name: getattr(self, name) for name in ("views", "size", "depth", "segmentation", "home")}
        recording = replace(unit.recording, **pictured)
        variation = replace(unit.variation, **{axis: axis in self.vary for axis in LOOKS}, look=self.look)
        return DemoUnit.from_json(replace(unit, recording=recording, variation=variation).to_json())


def plan_rerender(
    source: EpisodeStore, out: EpisodeStore, wanted: RerenderSettings
) -> list[tuple[StoredEpisode, DemoUnit]]:
    """Record the requests, and return the episodes that are still to be rendered, each with its new unit.

    Args:
        source: Source store; episodes without motion are copied, so that the yield stays the same.
        out: Destination; it is created when absent, and existing episodes stay.
        wanted: The new look.

    Raises:
        NotADataset: One of the stores, or an episode, is unreadable.
        OSError: The folder cannot be written.
    """
    asked = [DemoSeries.from_json(request) for request in source.requests()]
    out.add_requests([replace(series, first=wanted.of(series.first)).to_json() for series in asked])
    left = []
    for episode in source.episodes():
        unit, version = wanted.of(DemoUnit.from_json(episode.meta["unit"])), str(episode.meta["version"])
        there = out.read(unit, version)
        if there is not None and (there.cut_off or there.meta["ended"] != episode.meta["ended"]):
            shutil.rmtree(there.path)  # Its rendering process had died, or it was copied in part.
            there = None
        if there is None:
            left.append((episode, unit))
    return left


def rerender(
    out: EpisodeStore,
    left: Sequence[tuple[StoredEpisode, DemoUnit]],
    workers: int,
    on_progress: EpisodeCallback,
    *,
    limit_s: float = UNIT_LIMIT_S,
) -> None:
    """Render episodes into a store; each is complete before it is reported.

    Args:
        out: Destination.
        left: Episodes to render, from `plan_rerender`.
        workers: Number of processes.
        on_progress: Called with every unit and its ending: "drawn", "crashed", "timed-out" or "error".
        limit_s: Maximum wall time of an episode [s].

    Raises:
        WorkersUnusable, OSError, KeyboardInterrupt: As for `generate`; finished episodes are kept.
    """
    paths = {(unit, str(episode.meta["version"])): str(episode.path) for episode, unit in left}
    campaign = Campaign(out, WORKER, workers, limit_s, lambda *job: {"episode": paths[job]})
    generate(campaign, sorted(paths, key=lambda job: job[1]), on_progress, Tally())


def rerender_unit(
    episode: StoredEpisode, out: EpisodeStore, unit: DemoUnit, scene_renderer: Callable[[], SceneRenderer]
) -> dict[str, Any]:
    """Render an episode into another store, and return its cost.

    Args:
        episode: The episode.
        out: Destination.
        unit: Its new unit.
        scene_renderer: Gives the renderer.

    Raises:
        NotADataset: The episode is unreadable.
        OSError: The folder cannot be written.
    """
    began, version = time.process_time(), str(episode.meta["version"])
    meta = {name: value for name, value in episode.meta.items() if name not in _OF_THE_UNIT}
    with out.writing(unit, version) as folder:

        def draw_motion(file: str, aside: Path) -> dict[str, Any]:
            """Render one of the episode's motions, write its samples, and return the pictures' description."""
            arrays = {name: array for name, array in episode.motion(file).items() if not name.startswith(POSES)}
            states = [state.tobytes() for state in arrays["packed_states"]]
            aside.mkdir(exist_ok=True)
            rendered = render_unit_views(
                scene_renderer(), aside, unit, episode.scene, episode.task, arrays["time_s"], states
            )
            (folder / file).write_bytes(samples.packed({**arrays, **rendered.poses}))
            return dict(plain(rendered.described))

        if episode.corrections:
            meta["corrections"] = [
                {
                    **correction,
                    "pictures": draw_motion(correction["samples"], folder / Path(correction["samples"]).stem),
                }
                for correction in episode.corrections
            ]
        if episode.has_samples:
            meta["pictures"] = draw_motion(SAMPLES, folder)
        out.write(unit, version, meta, folder)
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    return {"ended": "drawn", "bytes": size, "cpu_s": time.process_time() - began}


def main() -> None:
    """Serve requests until standard input ends."""
    with shared_renderer() as scene_renderer:

        def handle(request: dict[str, Any]) -> dict[str, Any]:
            path = Path(request["episode"])
            episode = EpisodeStore(path.parent.parent).episode(path.name)
            return rerender_unit(
                episode, EpisodeStore(Path(request["store"])), DemoUnit.from_json(request["unit"]), scene_renderer
            )

        serve(handle)


if __name__ == "__main__":
    main()
