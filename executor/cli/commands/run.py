"""`scene2demo run`: from a sentence to a verified plan, a rollout, a video and a dataset.

Exit code 0 when the task succeeded, 1 when it did not or the plan is not proved, 130 after Ctrl-C.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from bddl.files import read_bounded
from bddl.terminal import pluralize
from executor.cli.command_options import JudgeOptions, RunOptions
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.evolution_setup import (
    NO_VIEWS,
    PICTURES,
    REPLAY,
    EvolutionSetup,
    connect_model,
    report_spending_on_error,
    spending_of,
    stopped_message,
    tell_kept,
)
from executor.cli.execution import check_limit, check_seed, command_line, results_writer
from executor.cli.output import print_json, say, tell, tell_notes, tell_warnings
from executor.cli.rollout_display import RolloutProgress, print_summary, summary_json
from executor.records import RolloutInterrupted
from executor.reports.run_folder import RunFolder
from executor.rollouts.evolution_record import EvolutionInterrupted
from executor.rollouts.rollout import Conditions, rollout
from executor.rollouts.run_record import RunRecord
from executor.scenes.file import scene_for
from executor.scenes.validation import require_valid
from executor.sim.render.frames import check_size
from executor.system import vulkan
from llm import Image, ModelProposer, Proposal, propose
from llm.structured.conversation import Spending
from oag import Scene, compose
from oag.sizes import Sizing

LARGEST_PICTURE_BYTES = 20_000_000
"""Largest picture [bytes] that is sent to a model; services take less."""


def execute(options: RunOptions) -> int:
    """Run the whole chain and return the exit code; everything finished is on disk when it returns."""
    check_seed(options.seed)
    # The physics steps at 250 Hz; NaN is in no range.
    check(1.0 <= options.record_hz <= 125.0, "--record-hz", options.record_hz, "a rate from 1 to 125 samples a second")
    check_size(options.size)
    check_limit(options.limit)
    remembers = options.memory is not None and not options.evolve
    check(not remembers, "--memory", options.memory, "--evolve beside it, since only revisions are remembered")
    images = _pictures(options.image, options.model)
    if options.scene is None:
        raise BadOption("--scene", "is missing", "a scene's name or file, or --photo instead")
    scene = scene_for(options.query, options.scene, full_size=options.full_size, listen=tell_notes)
    # Validate the scene before paying for a model call.
    tell_warnings(require_valid(scene))
    sizing = Sizing(options.seed, options.keep_sizes)
    if options.model is None:
        propose(options.query, scene, sizing=sizing)  # Raises before a folder is made.
    check(not (options.resume and options.force), "--resume", "", "no --force with it, which starts over")
    # A recording that is replayed is read before its folder is prepared for other results.
    replayed = connect_model(options, None) if (options.model or "").startswith(REPLAY) else None
    folder = RunFolder.prepare(options.out, force=options.force, resume=options.resume)
    tell_kept(folder.kept_aside)
    same = not options.resume or folder.query in (None, options.query)
    check(same, "--resume", options.out, f"the folder of a run of the same sentence, not of {folder.query!r}")
    with folder.filling():
        model = replayed or connect_model(options, folder.exchanges, resume=options.resume)
        spending = spending_of(model, quiet=options.json)
        with report_spending_on_error(spending, quiet=options.json):
            if spending is None:
                proposal = propose(options.query, scene, sizing=sizing)
            else:
                proposal = _propose_with_model(spending, options, scene, folder, images)
            if options.resume:
                folder.clear()
            record = _prove_and_execute(options, proposal, scene, folder, spending)
    return _finish(record, folder, options)


def _prove_and_execute(
    options: RunOptions, proposal: Proposal, scene: Scene, folder: RunFolder, spending: Spending | None
) -> RunRecord:
    """Return the record of a run, with its finished files in the folder.

    Args:
        options: The typed options.
        proposal: The proposal of the offline planner, or of the model.
        scene: The scene.
        folder: The run's folder.
        spending: The proposing model and its usage; None for the offline planner.
    """
    graph = compose(proposal.task, scene=scene)
    report = graph.verify()
    record = RunRecord(
        graph=graph,
        report=report,
        query=options.query,
        proposal=proposal.to_json(),
        notes=proposal.notes,
        spending=spending,
        command=command_line(
            "run",
            options.query,
            scene=options.scene if options.photo is None else None,
            photo=options.photo,
            **({} if options.photo is None else asdict(options.photo_inputs)),
            seed=options.seed,
            out=options.out,
            model=options.model,
            image=[] if options.model is None else list(options.image),
            keep_sizes=options.keep_sizes,
            full_size=options.full_size,
            evolve=options.evolve,
            limit=options.limit if options.evolve else None,
            memory=options.memory,
            no_video=not options.video,
            size=None if options.size == RunOptions.size else options.size,
            record_hz=None if options.record_hz == RunOptions.record_hz else f"{options.record_hz:g}",
        ),
    )
    folder.write_plan(record)
    if not report:
        folder.write_report(record, None)
        return record
    _print_plan(record, options)
    with results_writer(options) as studio:
        record = (
            _evolve_plan(record, options, folder)
            if options.evolve
            else folder.write_rollout(_execute_plan(record, options))
        )
        record = studio.finish(record, folder)
    return record


def _execute_plan(record: RunRecord, options: RunOptions) -> RunRecord:
    """Execute the plan; Ctrl-C keeps the finished part."""
    began = time.perf_counter()
    interrupted = False
    try:
        with RolloutProgress(quiet=options.json) as progress:
            done = rollout(
                record.graph,
                record.graph.scene,
                options.seed,
                listen=progress,
                conditions=Conditions(record_hz=options.record_hz),
            )
    except RolloutInterrupted as stop:
        done, interrupted = stop.partial, True
    wall = {"planning and physics": time.perf_counter() - began}
    return replace(record, rollout=done, interrupted=interrupted, wall_s=wall)


def _evolve_plan(record: RunRecord, options: RunOptions, folder: RunFolder) -> RunRecord:
    """Return the record of a run whose failing flows were revised; the evolution is in the folder.

    Args:
        record: The proved plan; the model that proposed it, if one did, judges and revises as well.
        options: The typed options.
        folder: The run's folder.
    """
    began = time.perf_counter()
    interrupted = False
    with (
        EvolutionSetup(
            _judge_options(options), folder.path, spending=record.spending, pictures=options.video
        ) as judging,
        RolloutProgress(quiet=options.json) as progress,
    ):
        try:
            evolution = judging.evolve(
                record.graph,
                seed=options.seed,
                limit=options.limit,
                listen=progress,
                conditions=Conditions(record_hz=options.record_hz),
            )
        except EvolutionInterrupted as stop:
            evolution, interrupted = stop.partial, True
        moved_s = time.perf_counter() - began
        stopped = "" if evolution.succeeded else judging.stopped
        record = folder.write_evolution(replace(record, stopped=stopped), evolution)
    return replace(record, interrupted=interrupted, wall_s={"planning and physics": moved_s})


def _judge_options(options: RunOptions) -> JudgeOptions:
    """Return the judges' options: the model that plans, with pictures where they are available."""
    model = options.model
    if model is None:
        return JudgeOptions(memory=options.memory)
    kept = model.startswith(REPLAY) and (Path(model.removeprefix(REPLAY)).parent / PICTURES).is_dir()
    if kept or (options.video and vulkan.find_renderer()):
        return JudgeOptions(model=model, memory=options.memory)
    tell("the model judges by measurements alone: there are no pictures to show it", style="yellow")
    return JudgeOptions(model=model, memory=options.memory, views=NO_VIEWS)


def _finish(record: RunRecord, folder: RunFolder, options: RunOptions) -> int:
    """Print the end of a run and return its exit code."""
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
    elif record.stopped:
        tell(f"scene2demo: {stopped_message(record.stopped)}", style="red")
    return code


def _propose_with_model(
    spending: Spending, options: RunOptions, scene: Scene, folder: RunFolder, images: tuple[Image, ...]
) -> Proposal:
    """Return a model's proposal for a run's query; the conversation is in the folder, also on failure.

    Raises:
        QueryError: The query is not understood, or cannot be done in the scene.
        ModelError: The model did not reply, or the budget is spent.
        AnswersRefused: None of the model's answers held.
    """
    sizing = Sizing(options.seed, options.keep_sizes)
    name = options.model or ""
    proposer = ModelProposer(spending.model, name=name, images=images, sizing=sizing, listen=spending.add_round)
    try:
        return proposer.propose(options.query, scene)
    finally:
        # A resumed run keeps its conversation until there is a new one.
        if proposer.conversation is not None and (spending.rounds or not options.resume):
            folder.write_conversation(proposer.conversation.to_json())


def _print_plan(record: RunRecord, options: RunOptions) -> None:
    if options.json:
        return
    tell_notes(record.notes)
    task, steps = pluralize(len(record.graph.task.subtasks), "subtask"), pluralize(len(record.graph.nodes), "step")
    tell(f"{record.report.verdict.value.lower()}: {task}, {steps}")


def _pictures(paths: Sequence[Path], model: str | None) -> tuple[Image, ...]:
    """Return the pictures of the scene for module 1.

    Args:
        paths: As typed after `--image`.
        model: The model that looks at them.

    Raises:
        BadOption: There is no model, or a file cannot be read, is too large, or is no picture that models take.
        PhotoRefused: One is broken, or has too many pixels.
    """
    if paths and model is None:
        raise BadOption("--image", paths[0], "--model beside it, since only a model looks at pictures")
    return tuple(map(_picture, paths))


def _picture(path: Path) -> Image:
    try:
        data = read_bounded(path, LARGEST_PICTURE_BYTES)
    except OSError as error:
        raise BadOption("--image", path, f"a picture's file ({error.strerror or error})") from None
    kind = _media_type(data)
    if kind is None:
        raise BadOption("--image", path, "a picture in PNG, JPEG, WebP or GIF")
    picture = Image(data, kind)
    if (problem := picture.problem()) is not None:
        raise BadOption("--image", path, f"a picture that a model can look at, and {problem}")
    return picture


def _media_type(data: bytes) -> str | None:
    """Return the kind of picture that the first bytes announce, None for another kind of file."""
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return "image/png"
    if data.startswith(b"\xff\xd8\xff"):
        return "image/jpeg"
    if data.startswith((b"GIF87a", b"GIF89a")):
        return "image/gif"
    return "image/webp" if data[:4] == b"RIFF" and data[8:12] == b"WEBP" else None
