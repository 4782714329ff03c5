"""`scene2demo run`: from a sentence to a verified plan, a rollout, a video and a dataset.

Returns 0 when the task succeeded, 1 when it did not or the plan is not proved, 130 after Ctrl-C.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

from bddl.files import read_bounded
from bddl.visible import counted
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.executing import check_limit, check_seed, command_line, studio_for
from executor.cli.judging import (
    NO_VIEWS,
    PICTURES,
    REPLAY,
    Judging,
    connected,
    counted_to_the_end,
    spending_of,
    stopped_words,
    tell_kept,
)
from executor.cli.output import print_json, say, tell, tell_notes, tell_warnings
from executor.cli.progress import RolloutProgress
from executor.cli.summary import print_summary, summary_json
from executor.cli.words.running import JudgeOptions, RunOptions
from executor.evolution.record import EvolutionInterrupted
from executor.machine import vulkan
from executor.pictures.render import check_size
from executor.records.rollout import RolloutInterrupted
from executor.results.run_folder import RunFolder
from executor.results.run_record import RunRecord
from executor.rollouts.running import rollout
from executor.scenes.plausible import require_possible
from executor.scenes.reading import scene_for
from llm import Image, ModelProposer, Proposal, propose
from llm.answers.spending import Spending
from oag import Scene, compose
from oag.task.sizes import Sizing

LARGEST_PICTURE_BYTES = 20_000_000
"""Of a picture that a model is shown; services take less."""


def execute(options: RunOptions) -> int:
    """Runs the whole chain and returns the exit code; everything that stands is on disk when it returns."""
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
    # A model would be paid for a plan with things that nobody can build.
    tell_warnings(require_possible(scene))
    sizing = Sizing(options.seed, options.keep_sizes)
    if options.model is None:
        propose(options.query, scene, sizing=sizing)  # What it cannot plan is said before a folder is made.
    check(not (options.resume and options.force), "--resume", "", "no --force with it, which starts over")
    # A recording that is replayed is read before its folder is prepared for other results.
    replayed = connected(options, None) if (options.model or "").startswith(REPLAY) else None
    folder = RunFolder.prepare(options.out, force=options.force, resume=options.resume)
    tell_kept(folder.kept_aside)
    same = not options.resume or folder.query in (None, options.query)
    check(same, "--resume", options.out, f"the folder of a run of the same sentence, not of {folder.query!r}")
    with folder.filling():
        model = replayed or connected(options, folder.exchanges, resume=options.resume)
        spending = spending_of(model, quiet=options.json)
        with counted_to_the_end(spending, quiet=options.json):
            if spending is None:
                proposal = propose(options.query, scene, sizing=sizing)
            else:
                proposal = _proposed_by(spending, options, scene, folder, images)
            if options.resume:
                folder.clear()
            record = _executed(options, proposal, scene, folder, spending)
    return _finish(record, folder, options)


def _executed(
    options: RunOptions, proposal: Proposal, scene: Scene, folder: RunFolder, spending: Spending | None
) -> RunRecord:
    """Returns the record of a run, when everything that stands is in its folder.

    Args:
        options: What was typed.
        proposal: What the offline planner, or the model, proposed.
        scene: Where it is.
        folder: The run's folder.
        spending: Who proposed it, and what it took; None for the offline planner.
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
            **({} if options.photo is None else asdict(options.beside)),
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
    _say_plan(record, options)
    with studio_for(options) as studio:
        record = _evolved(record, options, folder) if options.evolve else folder.write_rollout(_moved(record, options))
        record = studio.finish(record, folder)
    return record


def _moved(record: RunRecord, options: RunOptions) -> RunRecord:
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


def _evolved(record: RunRecord, options: RunOptions, folder: RunFolder) -> RunRecord:
    """Returns the record of a run whose failing flows were revised; how is in the folder.

    Args:
        record: The proved plan; the model that proposed it, if one did, judges and revises as well.
        options: What was typed.
        folder: The run's folder.
    """
    began = time.perf_counter()
    interrupted = False
    with (
        Judging(_judged(options), folder.path, spending=record.spending, pictures=options.video) as judging,
        RolloutProgress(quiet=options.json) as progress,
    ):
        try:
            evolution = judging.evolve(
                record.graph, seed=options.seed, limit=options.limit, listen=progress, record_hz=options.record_hz
            )
        except EvolutionInterrupted as stop:
            evolution, interrupted = stop.partial, True
        moved_s = time.perf_counter() - began
        stopped = "" if evolution.succeeded else judging.stopped
        record = folder.write_evolution(replace(record, stopped=stopped), evolution)
    return replace(record, interrupted=interrupted, wall_s={"planning and physics": moved_s})


def _judged(options: RunOptions) -> JudgeOptions:
    """Returns who judges: the model that plans, with pictures where there are any to be had."""
    model = options.model
    if model is None:
        return JudgeOptions(memory=options.memory)
    kept = model.startswith(REPLAY) and (Path(model.removeprefix(REPLAY)).parent / PICTURES).is_dir()
    if kept or (options.video and vulkan.find_renderer()):
        return JudgeOptions(model=model, memory=options.memory)
    tell("the model judges by measurements alone: there are no pictures to show it", style="yellow")
    return JudgeOptions(model=model, memory=options.memory, views=NO_VIEWS)


def _finish(record: RunRecord, folder: RunFolder, options: RunOptions) -> int:
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
    elif record.stopped:
        tell(f"scene2demo: {stopped_words(record.stopped)}", style="red")
    return code


def _proposed_by(
    spending: Spending, options: RunOptions, scene: Scene, folder: RunFolder, images: tuple[Image, ...]
) -> Proposal:
    """Returns a model's proposal for a run's query; what it was asked and answered is in the folder, also on failure.

    Raises:
        QueryError: The query is not understood, or cannot be done in the scene.
        ModelError: The model did not reply, or the budget is spent.
        AnswersRefused: None of the model's answers held.
    """
    sizing = Sizing(options.seed, options.keep_sizes)
    name = options.model or ""
    proposer = ModelProposer(spending.model, name=name, images=images, sizing=sizing, listen=spending.hear)
    try:
        return proposer.propose(options.query, scene)
    finally:
        # What is gone on with keeps its record until there is a new one.
        if proposer.conversation is not None and (spending.rounds or not options.resume):
            folder.write_conversation(proposer.conversation.to_json())


def _say_plan(record: RunRecord, options: RunOptions) -> None:
    if options.json:
        return
    tell_notes(record.notes)
    task, steps = counted(len(record.graph.task.subtasks), "subtask"), counted(len(record.graph.nodes), "step")
    tell(f"{record.report.verdict.value.lower()}: {task}, {steps}")


def _pictures(paths: Sequence[Path], model: str | None) -> tuple[Image, ...]:
    """Returns the pictures of the scene that module 1 is shown.

    Args:
        paths: As they were typed after `--image`.
        model: Who looks at them.

    Raises:
        BadOption: Nobody looks at them, or a file cannot be read, is too large, or is no picture that models take.
        PhotoRefused: One is broken, or has too many pixels.
    """
    if paths and model is None:
        raise BadOption("--image", paths[0], "--model beside it, since only a model looks at pictures")
    return tuple(map(_picture, paths))


def _picture(path: Path) -> Image:
    """Returns one picture."""
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
    """Returns what kind of picture the first bytes announce, None for another kind of file."""
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return "image/png"
    if data.startswith(b"\xff\xd8\xff"):
        return "image/jpeg"
    if data.startswith((b"GIF87a", b"GIF89a")):
        return "image/gif"
    return "image/webp" if data[:4] == b"RIFF" and data[8:12] == b"WEBP" else None
