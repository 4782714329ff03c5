"""Worker process that makes units and writes them to a store: `python -m executor.data.worker`."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from executor.campaign.planning_model import (
    ModelPlan,
    Plan,
    model_failure,
    plan_offline,
    planned_by,
)
from executor.campaign.versions import outcome_version
from executor.data import samples
from executor.data.store import SAMPLES, EpisodeStore
from executor.data.units import DemoUnit
from executor.data.views import RenderedViews, render_unit_views
from executor.data.work import (
    drawn_values,
    make_unit,
    meta_of,
    noise_of,
    physics_of,
    write_corrections,
)
from executor.records import PlanRefused, Rollout, Trajectory
from executor.scenes.pair import NotDrawn
from executor.sim.render.stage import SceneRenderer, shared_renderer
from executor.system.files import plain
from executor.system.workers import check_version, serve
from llm import AnswersRefused, ModelError, QueryError

_KINDS: dict[type[Exception], str] = {
    PlanRefused: "plan-refused",
    NotDrawn: "not-drawn",
    QueryError: "not-planned",
}

Draw = Callable[[DemoUnit, Rollout, Trajectory, Path], RenderedViews]
"""Renders a motion in its rollout's scene into a folder, as the unit's recording requests."""


def run_unit(
    store: EpisodeStore,
    unit: DemoUnit,
    version: str,
    draw: Draw | None = None,
    plan: Plan = plan_offline,
) -> dict[str, Any]:
    """Make a unit, write its folder, and return a short result; a failed rollout is a result, too.

    A unit whose model gave no reply, or for which the campaign's budget allows no request, is not written.

    Args:
        store: Destination.
        unit: The unit.
        version: Hash of the program; it has to be that of this process.
        draw: Renders the pictures of the motion.
        plan: What plans it.

    Raises:
        HandoverRefused: This process runs another version of the program, or finds another scene under the unit's name;
            nothing is written.
        OSError: The folder cannot be written.
    """
    check_version(version, outcome_version())
    began, began_cpu_s = time.perf_counter(), _cpu_s()
    try:
        with store.writing(unit, version) as folder:
            meta = {**_made(unit, folder, draw, plan), **planned_by(plan)}
            meta["wall_s"], meta["cpu_s"] = time.perf_counter() - began, _cpu_s() - began_cpu_s
            store.write(unit, version, meta, folder)
            size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    except ModelError as problem:
        unmade = model_failure(problem)
        return {"ended": unmade["ended"], **unmade["failure"], "bytes": 0, "cpu_s": _cpu_s() - began_cpu_s}
    failure = meta.get("failure") or {}
    words = {"kind": failure.get("kind"), "message": failure.get("message")}
    return {"ended": meta["ended"], **words, "bytes": size, "cpu_s": meta["cpu_s"]}


def _made(unit: DemoUnit, folder: Path, draw: Draw | None, plan: Plan) -> dict[str, Any]:
    """Make a unit, write its motion into its folder, and return its metadata."""
    try:
        made = make_unit(unit, plan)
    except tuple(_KINDS) as problem:
        return {"ended": "failed", "failure": {"kind": _KINDS[type(problem)], "message": str(problem)}}
    except AnswersRefused as refusal:
        return model_failure(refusal)
    meta = {**meta_of(made), "drawn": drawn_values(unit, made.of.graph.scene, made.of.perturbations)}
    if made.story is not None:
        render = None if draw is None else partial(draw, unit, made.rollout)
        meta["corrections"] = write_corrections(folder, made.story, physics_of(unit), noise_of(unit), render)
    if made.rollout.succeeded or unit.recording.failures:
        arrays = samples.columns(made.rollout)
        if draw is not None:
            rendered = draw(unit, made.rollout, made.rollout.trajectory, folder)
            meta["pictures"] = plain(rendered.described)
            arrays |= rendered.poses
        (folder / SAMPLES).write_bytes(samples.packed(arrays))
    return meta


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def draw_motion(
    scene_renderer: SceneRenderer, unit: DemoUnit, rollout: Rollout, motion: Trajectory, folder: Path
) -> RenderedViews:
    """Render a motion in a rollout's scene as its unit's recording requests."""
    return render_unit_views(
        scene_renderer, folder, unit, rollout.scene, rollout.task, motion.time_s, motion.packed_states
    )


def main() -> None:
    """Serve requests until standard input ends."""
    with shared_renderer() as scene_renderer:

        def handle(request: dict[str, Any]) -> dict[str, Any]:
            unit = DemoUnit.from_json(request["unit"])
            draw = partial(draw_motion, scene_renderer()) if unit.recording.views else None
            store, version, plan = EpisodeStore(Path(request["store"])), request["version"], plan_offline
            if unit.model is not None:
                plan = ModelPlan.of(unit.model, store.path, unit.folder(version), request)
            return run_unit(store, unit, version, draw, plan)

        serve(handle)


if __name__ == "__main__":
    main()
