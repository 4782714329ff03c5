"""`scene2demo run --evolve`: the plan is executed, and flows that fail are revised before the task goes on."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

from executor.cli.options.evolution import Judged
from executor.cli.options.running import Run
from executor.cli.terminal.output import tell
from executor.cli.terminal.progress import RolloutProgress
from executor.cli.work.attempt_frames import attempt_frames
from executor.cli.work.judging import NO_VIEWS, PICTURES, REPLAY, Judging
from executor.evolution.evolve import evolve
from executor.evolution.record import EvolutionInterrupted
from executor.machine import vulkan
from executor.results.run_folder import RunFolder
from executor.results.run_record import RunRecord
from llm import Metered


def evolved(record: RunRecord, options: Run, folder: RunFolder, model: Metered | None) -> RunRecord:
    """Returns the record of a run whose failing flows were revised; how is in the folder.

    Args:
        record: The proved plan.
        options: What was typed.
        folder: The run's folder.
        model: Who proposed the plan, and judges and revises as well; None for measurements.
    """
    began = time.perf_counter()
    scene, interrupted = record.graph.scene, False
    with (
        Judging(_judged(options), folder.path, force=options.force, model=model) as judging,
        attempt_frames(judging.frames, wanted=options.video) as frames,
        RolloutProgress(quiet=options.json) as progress,
    ):
        inspector, supervisor = judging.judges(record.graph.task.name, scene)
        try:
            evolution = evolve(
                record.graph,
                scene,
                options.seed,
                inspector=inspector,
                supervisor=supervisor,
                limit=options.limit,
                listen=progress,
                record_hz=options.record_hz,
                frames=frames,
            )
            judging.learn(evolution)
        except EvolutionInterrupted as stop:
            evolution, interrupted = stop.partial, True
        moved_s = time.perf_counter() - began
        record = folder.write_evolution(record, evolution)
    return replace(record, interrupted=interrupted, wall_s={"planning and physics": moved_s})


def _judged(options: Run) -> Judged:
    """Returns who judges: the model that plans, with pictures where there are any to be had."""
    model = options.model
    if model is None:
        return Judged(memory=options.memory)
    kept = model.startswith(REPLAY) and (Path(model.removeprefix(REPLAY)).parent / PICTURES).is_dir()
    if kept or (options.video and vulkan.find_renderer()):
        return Judged(model=model, memory=options.memory)
    tell("the model judges by measurements alone: there are no pictures to show it", style="yellow")
    return Judged(model=model, memory=options.memory, views=NO_VIEWS)
