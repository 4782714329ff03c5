"""`scene2demo run`: from a sentence to a verified plan, a rollout, a video and a dataset."""

from __future__ import annotations

import shlex
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path

from bddl.visible import counted
from executor.cli.options.bad_option import BadOption
from executor.cli.options.inputs import check_rate, check_seed
from executor.cli.options.running import Run
from executor.cli.terminal.counting import counting
from executor.cli.terminal.errors import DONE, FAILED, INTERRUPTED
from executor.cli.terminal.output import print_json, say, tell, tell_notes
from executor.cli.terminal.progress import RolloutProgress
from executor.cli.terminal.summary import print_summary, summary_json
from executor.cli.work.picture_files import scene_pictures
from executor.cli.work.proposing import connected, propose_by_model
from executor.cli.work.run_evolved import evolved
from executor.machine.extras import MissingExtra, require
from executor.machine.vulkan import RendererNotFound
from executor.pictures.frames import Frames
from executor.pictures.render import RenderFailed, RenderPool, check_size, render
from executor.pictures.video import VideoFailed, write_video
from executor.records.captions import captions_of
from executor.records.rollout import Rollout, RolloutInterrupted
from executor.results.run_folder import RunFolder
from executor.results.run_record import RunRecord
from executor.rollouts.running import rollout
from executor.scenes.library import load_scene
from executor.scenes.plausible import require_buildable
from llm import Image, Proposal, propose
from oag import Scene, compose


def execute(options: Run) -> int:
    """Runs the whole chain and returns the exit code; everything that stands is on disk when it returns."""
    check_seed(options.seed)
    check_rate(options.record_hz)
    check_size(options.size)
    if options.limit < 0:
        raise BadOption("--limit", options.limit, "0 or more")
    if options.memory is not None and not options.evolve:
        raise BadOption("--memory", options.memory, "--evolve beside it, since only revisions are remembered")
    images = scene_pictures(options.image, options.model)
    scene = load_scene(options.scene)
    # A model would be paid for a plan with things that nobody can build.
    require_buildable(scene)
    # What the offline planner cannot plan is said before a folder is made; a model's words go into the folder.
    planned = propose(options.query, scene) if options.model is None else None
    folder = RunFolder.prepare(options.out, force=options.force)
    with folder.filling():
        record = _executed(options, planned, scene, folder, images)
    return _finish(record, folder, options)


def _executed(
    options: Run, planned: Proposal | None, scene: Scene, folder: RunFolder, images: tuple[Image, ...]
) -> RunRecord:
    """Returns what came of a run, when everything that stands is in its folder.

    Args:
        options: What was typed.
        planned: The offline planner's proposal; None where a model is asked.
        scene: Where it is.
        folder: The run's folder.
        images: Pictures of the scene, for a model.
    """
    model = connected(options, folder)
    proposal = planned
    if model is not None and proposal is None:
        proposal = propose_by_model(options, model, scene, folder, images)
    if proposal is None:
        raise RuntimeError("neither the offline planner nor a model was asked")
    graph = compose(proposal.task, scene=scene)
    report = graph.verify()
    record = RunRecord(
        graph=graph,
        report=report,
        query=options.query,
        proposal=proposal.to_json(),
        notes=proposal.notes,
        command=_command(options),
    )
    folder.write_plan(record)
    if not report:
        folder.write_report(record, None)
        return record
    _say_plan(record, options)
    with Studio(options) as studio:
        record = evolved(record, options, folder, model) if options.evolve else _move(record, options)
        if record.rollout is not None:
            folder.write_rollout(record.rollout)
            record = studio.picture(record, folder)
    return record


def _move(record: RunRecord, options: Run) -> RunRecord:
    """Executes the plan; Ctrl-C leaves the part that was done."""
    began = time.perf_counter()
    interrupted = False
    try:
        with RolloutProgress(quiet=options.json) as progress:
            done = rollout(record.graph, record.graph.scene, options.seed, listen=progress, record_hz=options.record_hz)
    except RolloutInterrupted as stop:
        done, interrupted = stop.partial, True
    wall = {"planning and physics": time.perf_counter() - began}
    return replace(record, rollout=done, interrupted=interrupted, wall_s=wall)


@dataclass
class Studio:
    """Draws, encodes and writes what a run leaves to look at; its workers warm up while the physics runs."""

    options: Run
    pool: RenderPool | None = None
    problem: str = ""
    wall_s: dict[str, float] = field(default_factory=dict)

    def __enter__(self) -> Studio:
        if not self.options.video:
            self.problem = "switched off with --no-video"
            return self
        try:
            require("av", "data")
            self.pool = RenderPool()
            self.pool.start()
        except (RendererNotFound, MissingExtra) as missing:
            self.problem = str(missing)
        return self

    def __exit__(self, *exception: object) -> None:
        if self.pool is not None:
            self.pool.close()

    def picture(self, record: RunRecord, folder: RunFolder) -> RunRecord:
        """Returns the record with what was drawn, after writing video, dataset and report."""
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
            record = replace(record, pictures=words, wall_s={**record.wall_s, **self.wall_s})
            began = time.perf_counter()
            try:
                folder.write_episode(rollout, frames)
            except MissingExtra as missing:
                tell(f"no dataset: {missing}", style="yellow")
            record = replace(record, wall_s={**record.wall_s, "dataset": time.perf_counter() - began})
            folder.write_report(record, frames)
        return record

    def _draw(self, rollout: Rollout, scratch: Path, folder: RunFolder) -> Frames | None:
        if self.pool is None or len(rollout.trajectory.time_s) == 0:
            return None
        quiet = self.options.json
        began = time.perf_counter()
        try:
            with counting("drawing pictures", quiet=quiet) as listen:
                frames = render(rollout, scratch, size=self.options.size, listen=listen, pool=self.pool)
            self.wall_s["pictures"] = time.perf_counter() - began
            began = time.perf_counter()
            with counting("encoding the video", quiet=quiet) as listen:
                captions = captions_of(rollout)
                write_video(folder.video, frames, captions, rate_hz=self.options.record_hz, listen=listen)
            self.wall_s["video"] = time.perf_counter() - began
        except (RenderFailed, VideoFailed) as problem:
            # What the robot did stands without pictures; the sentence goes into report and summary.
            self.problem = str(problem)
            return None
        return frames


def _finish(record: RunRecord, folder: RunFolder, options: Run) -> int:
    """Prints the end of a run and returns its exit code."""
    code = DONE if record.outcome == "succeeded" else INTERRUPTED if record.interrupted else FAILED
    if options.json:
        print_json({**summary_json(record, folder), "exit_code": code})
        return code
    if not record.report:
        say(str(record.report))
        say("")
    print_summary(record, folder)
    if record.interrupted:
        tell("scene2demo: interrupted; what was finished is in the folder", style="yellow")
    return code


def _say_plan(record: RunRecord, options: Run) -> None:
    if options.json:
        return
    tell_notes(record.notes)
    task, steps = counted(len(record.graph.task.subtasks), "subtask"), counted(len(record.graph.nodes), "step")
    tell(f"{record.report.verdict.value.lower()}: {task}, {steps}")


def _command(options: Run) -> str:
    """Returns the command line that repeats a run."""
    words = ["scene2demo", "run", options.query, "--scene", options.scene, "--seed", str(options.seed)]
    words += ["--out", str(options.out)]
    if options.model is not None:
        words += ["--model", options.model]
        words += [word for path in options.image for word in ("--image", str(path))]
    if options.evolve:
        words += ["--evolve", "--limit", str(options.limit)]
    if options.memory is not None:
        words += ["--memory", str(options.memory)]
    if not options.video:
        words.append("--no-video")
    if options.size != Run.size:
        words += ["--size", *map(str, options.size)]
    if options.record_hz != Run.record_hz:
        words += ["--record-hz", f"{options.record_hz:g}"]
    return shlex.join(words)
