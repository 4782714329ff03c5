"""Pictures, video, data set and report of a run: drawn, encoded and written."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path

from executor.machine.extras import MissingExtra, require
from executor.machine.vulkan import RendererNotFound
from executor.pictures.frames import Frames
from executor.pictures.render import RenderFailed, RenderPool, render
from executor.pictures.video import VideoFailed, write_video
from executor.records.captions import captions_of
from executor.records.rollout import Rollout
from executor.results.run_folder import RunFolder
from executor.results.run_record import RunRecord

Counting = Callable[[str], AbstractContextManager[Callable[[int, int], None]]]
"""Given what is done, such as "drawing pictures", a context with what is told how many of how many are done."""


@dataclass
class Studio:
    """Draws, encodes and writes the results of a run; its workers warm up while the physics runs.

    Attributes:
        wanted: Whether pictures and a video are.
        size: Width and height of the robot's views; the overview is drawn twice as large.
        counting: Shows how far a part of the work is.
        tell: Told in a sentence what is left out.
        problem: Why there are no pictures; empty while nothing speaks against them.
    """

    wanted: bool
    size: tuple[int, int]
    counting: Counting
    tell: Callable[[str], None]
    problem: str = ""
    _pool: RenderPool | None = None
    _wall_s: dict[str, float] = field(default_factory=dict)

    def __enter__(self) -> Studio:
        if not self.wanted:
            self.problem = "switched off with --no-video"
            return self
        try:
            require("av", "data")
            self._pool = RenderPool()
            self._pool.start()
        except (RendererNotFound, MissingExtra) as missing:
            self.problem = str(missing)
        return self

    def __exit__(self, *exception: object) -> None:
        if self._pool is not None:
            self._pool.close()

    def finish(self, record: RunRecord, folder: RunFolder) -> RunRecord:
        """Returns the record with what was drawn, after writing video, data set and report."""
        rollout = record.rollout
        if rollout is None:
            return record
        with tempfile.TemporaryDirectory(prefix="scene2demo-") as scratch:
            try:
                frames = None if record.interrupted else self._draw(rollout, Path(scratch), folder)
            except KeyboardInterrupt:
                frames, record = None, replace(record, interrupted=True)
            if record.interrupted and not self.problem:
                self.problem = "the run was interrupted"
            words = self.problem or (frames.renderer if frames is not None else "")
            began = time.perf_counter()
            try:
                folder.write_episode(rollout, frames, record.query or "")
            except MissingExtra as missing:
                self.tell(f"no dataset: {missing}")
            wall_s = {**record.wall_s, **self._wall_s, "dataset": time.perf_counter() - began}
            record = replace(record, pictures=words, wall_s=wall_s)
            folder.write_report(record, frames)
        return record

    def _draw(self, rollout: Rollout, scratch: Path, folder: RunFolder) -> Frames | None:
        if self._pool is None or len(rollout.trajectory.time_s) == 0:
            return None
        began = time.perf_counter()
        try:
            with self.counting("drawing pictures") as listen:
                frames = render(rollout, scratch, size=self.size, listen=listen, pool=self._pool)
            self._wall_s["pictures"] = time.perf_counter() - began
            began = time.perf_counter()
            with self.counting("encoding the video") as listen:
                write_video(folder.video, frames, captions_of(rollout), rate_hz=rollout.record_hz, listen=listen)
            self._wall_s["video"] = time.perf_counter() - began
        except (RenderFailed, VideoFailed) as problem:
            # What the robot did stands without pictures; the sentence goes into report and summary.
            self.problem = str(problem)
            return None
        return frames
