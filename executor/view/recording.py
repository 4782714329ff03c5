"""Episodes as a recording of Rerun: videos, curves, steps, the scene and the base's path on one time axis.

episode/NAME/videos/VIEW     each frame at the time that it shows
episode/NAME/curves/PLOT/..  the curves of the viewer's page
episode/NAME/steps           when each step began, and why it failed
episode/NAME/scene           the scene at the start, z up, with the path of the base on its floor
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from bddl.files import atomic_path
from executor.reports.episode import Clip, EpisodeDetail
from executor.system.extras import require
from executor.view.scene_view import scene_meshes

EXTRA = "rerun"
TIMELINE = "time"
_FLOOR_M = 0.01  # The path is drawn above the floor.


def record(details: Iterable[EpisodeDetail], path: Path | None = None) -> None:
    """Write episodes into a recording, or open one in Rerun's own viewer on this machine.

    Args:
        details: The episodes.
        path: The file to write; None opens the viewer.

    Raises:
        MissingExtra: Rerun is not installed.
    """
    rerun = require("rerun", EXTRA)
    recording = rerun.RecordingStream("scene2demo")
    with nullcontext() if path is None else atomic_path(path) as file:
        if file is None:
            recording.spawn()
        else:
            recording.save(str(file))
        for detail in details:
            _record_episode(rerun, recording, detail)
        recording.flush()
        recording.disconnect()


def _record_episode(rerun: Any, recording: Any, detail: EpisodeDetail) -> None:
    root = f"episode/{rerun.escape_entity_path_part(detail.row.name)}"
    for clip in detail.clips:
        _record_clip(rerun, recording, f"{root}/videos/{rerun.escape_entity_path_part(clip.name)}", clip, detail)
    for part in detail.subtasks:
        for step in part.steps:
            at = step.start_s if step.start_s is not None else step.end_s
            if at is None:
                continue
            recording.set_time(TIMELINE, duration=at)
            words = f"{part.name}: {step.text}"
            failed = "" if step.failure is None else f" failed ({step.failure[0]}): {step.failure[1]}"
            recording.log(f"{root}/steps", rerun.TextLog(words + failed, level="ERROR" if failed else "INFO"))
    recording.reset_time()
    if detail.scene is not None:
        recording.log(f"{root}/scene", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        glb = scene_meshes(detail.scene).export(file_type="glb", unitize_normals=True)
        recording.log(f"{root}/scene/things", rerun.Asset3D(contents=glb, media_type="model/gltf-binary"), static=True)
    if detail.plots is None:
        return
    times = np.asarray(detail.plots.time_s, float)
    for plot in detail.plots.plots:
        for name, line in plot.lines.items():
            values = np.array([np.nan if value is None else value for value in line])
            shown = np.isfinite(values)
            recording.send_columns(
                f"{root}/curves/{rerun.escape_entity_path_part(f'{plot.name} [{plot.unit}]')}/"
                f"{rerun.escape_entity_path_part(name)}",
                indexes=[rerun.TimeColumn(TIMELINE, duration=times[shown])],
                columns=rerun.Scalars.columns(scalars=values[shown]),
            )
    base_m = np.column_stack([np.asarray(detail.plots.base_m), np.full(len(times), _FLOOR_M)])
    recording.log(f"{root}/scene/path", rerun.LineStrips3D([base_m]), static=True)
    recording.send_columns(
        f"{root}/scene/base",
        indexes=[rerun.TimeColumn(TIMELINE, duration=times)],
        columns=rerun.Points3D.columns(positions=base_m),
    )


def _record_clip(rerun: Any, recording: Any, entity: str, clip: Clip, detail: EpisodeDetail) -> None:
    video = rerun.AssetVideo(path=str(clip.file))
    recording.log(entity, video, static=True)
    frames_ns = np.asarray(video.read_frame_timestamps_nanos())
    times_s = (1e-9 * frames_ns - clip.begin_s) * clip.speed
    # A file of a data set has other episodes as well.
    own = (times_s > -1e-6) & (times_s <= detail.duration_s + 1e-6)
    recording.send_columns(
        entity,
        indexes=[rerun.TimeColumn(TIMELINE, duration=np.maximum(times_s[own], 0.0))],
        columns=rerun.VideoFrameReference.columns_nanos(frames_ns[own]),
    )
