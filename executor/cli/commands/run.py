"""`scene2demo run`: from a sentence to a verified plan, a rollout, a video and a dataset.

Exit code 0 when the task succeeded, 1 when it did not or the plan is not proved, 130 after Ctrl-C.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from bddl.files import read_bounded
from bddl.terminal import pluralize
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.options import (
    READ_SCENE,
    CommonOptions,
    Flag,
    FullSize,
    GoOn,
    JudgeOptions,
    KeepSizes,
    Limit,
    Maybe,
    ModelOptions,
    PhotoInputs,
    Plain,
    Read,
    RepairScene,
    ReplaceResults,
    ResultsFolder,
    RobotName,
    Sentence,
    Size,
    Video,
)
from executor.cli.output import print_json, say, tell, tell_notes, tell_warnings

if TYPE_CHECKING:
    from executor.reports.run_folder import RunFolder
    from executor.rollouts.feasibility import Feasibility
    from executor.rollouts.run_record import RunRecord
    from executor.rollouts.scene_repairs import Judged
    from llm import Image, Proposal
    from llm.structured.conversation import Spending
    from oag import Scene
    from oag.sizes import Sizing


@dataclass(frozen=True)
class Options(CommonOptions):
    """Turn a sentence and a scene, or a photograph of one, into a verified plan, a rollout, a video and a dataset."""

    query: Sentence
    out: ResultsFolder
    scene: Annotated[Maybe[str], READ_SCENE] = None
    """Name of a scene that comes with the package, or a scene's JSON file; without it, --photo is needed."""
    photo: Annotated[Maybe[Path], Read()] = None
    """Instead of --scene: a photograph or a recording that the scene is made of, once; it is kept in OUT/photo."""
    photo_inputs: PhotoInputs = field(default_factory=PhotoInputs)
    asked: ModelOptions = field(default_factory=ModelOptions)
    image: Annotated[tuple[Path, ...], tyro.conf.UseAppendAction] = ()
    """With --model: picture of the scene that the model sees with the query; may be given several times."""
    seed: int = 0
    """Varies the scene and seeds the planning."""
    keep_sizes: KeepSizes = False
    full_size: FullSize = False
    robot: RobotName = None
    repair: RepairScene = None
    anyway: Flag = False
    """Move even where the plan cannot be done, by geometry; without it such a plan is refused before anything moves."""
    evolve: Flag = False
    """Revise the flows that fail, by measurements, or by the model where there is one."""
    limit: Limit = 5
    resume: GoOn = False
    force: ReplaceResults = False
    video: Video = True
    size: Size = (224, 224)
    plain: Plain = False
    record_hz: float = 10.0
    """Recorded samples a second of simulated time."""


LARGEST_PICTURE_BYTES = 20_000_000
"""Largest picture [bytes] that is sent to a model; services take less."""


def execute(options: Options) -> int:
    """Make the scene of a photograph where one is given, and run the whole chain; return the exit code."""
    from executor.cli.commands.photo import scene_of_photograph
    from executor.reports.run_folder import RunFolder

    if options.photo is None:
        return _run(options)
    check(options.scene is None, "--scene", options.scene, "none with --photo, which makes one")
    # Fitting takes a while: refuse an unusable folder before it.
    folder = RunFolder.prepare(options.out, force=options.force)
    scene = scene_of_photograph(options.photo, options.photo_inputs, folder.path / "photo", quiet=options.json)
    return _run(replace(options, scene=str(scene)))


def _run(options: Options) -> int:
    """Run the whole chain and return the exit code; everything finished is on disk when it returns."""
    from executor.cli.evolution_setup import connect_model, report_spending_on_error, spending_of, tell_kept
    from executor.cli.execution import check_limit, check_seed
    from executor.cli.inputs import robot_asked_for
    from executor.reports.run_folder import RunFolder
    from executor.scenes.file import scene_for
    from executor.scenes.validation import require_valid
    from executor.sim.render.frames import check_size
    from llm import propose
    from llm.client.connect import is_replay
    from oag.sizes import Sizing

    check_seed(options.seed)
    # The physics steps at 250 Hz; NaN is in no range.
    check(1.0 <= options.record_hz <= 125.0, "--record-hz", options.record_hz, "a rate from 1 to 125 samples a second")
    check_size(options.size)
    check(options.video or not options.plain, "--plain", "is given", "no --no-video, which leaves nothing to draw")
    check_limit(options.limit)
    images = _pictures(options.image, options.asked.model)
    check(
        not options.asked.models or options.asked.model is not None,
        "--models",
        " ".join(options.asked.models),
        "--model with it",
    )
    alone = not (options.anyway or options.evolve or options.asked.model)
    check(options.repair is None or alone, "--repair", options.repair, "no --anyway, --evolve or --model with it")
    if options.scene is None:
        raise BadOption("--scene", "is missing", "a scene's name or file, or --photo instead")
    scene = scene_for(
        options.query,
        options.scene,
        robot=robot_asked_for(options.robot, full_size=options.full_size),
        listen=tell_notes,
    )
    # Validate the scene before paying for a model call.
    tell_warnings(require_valid(scene))
    sizing = Sizing(options.seed, options.keep_sizes)
    judged = None if options.repair is None else _repair_scene(options, scene, sizing)
    if judged is not None and judged.fixes:
        scene = judged.scene
    if options.asked.model is None:
        propose(options.query, scene, sizing=sizing)  # Raises before a folder is made.
    check(not (options.resume and options.force), "--resume", "", "no --force with it, which starts over")
    # A recording that is replayed is read before its folder is prepared for other results.
    replayed = connect_model(options.asked, None) if is_replay(options.asked.model or "") else None
    folder = RunFolder.prepare(options.out, force=options.force, resume=options.resume)
    tell_kept(folder.kept_aside)
    same = not options.resume or folder.query in (None, options.query)
    check(same, "--resume", options.out, f"the folder of a run of the same sentence, not of {folder.query!r}")
    with folder.filling():
        model = replayed or connect_model(options.asked, folder.exchanges, resume=options.resume)
        spending = spending_of(model, quiet=options.json)
        with report_spending_on_error(spending, quiet=options.json):
            try:
                if spending is None:
                    proposal = propose(options.query, scene, sizing=sizing)
                else:
                    proposal = _propose_with_model(spending, options, scene, folder, images)
                if options.resume:
                    folder.clear()
                record = _prove_and_execute(options, proposal, scene, folder, spending, judged)
            finally:
                if spending is not None and spending.rounds:
                    folder.write_usage(spending.to_json())
    return _finish(record, folder, options)


def _repair_scene(options: Options, scene: Scene, sizing: Sizing) -> Judged | None:
    """Return the nearest scene in which the sentence is feasible, and print the changes; None where none is found."""
    from executor.cli.output import counting
    from executor.rollouts.scene_repairs import repaired
    from executor.scenes.vary import vary
    from llm import propose

    concrete = replace(vary(scene, options.seed), variation={})
    with counting("going through the plan, and through changes of the scene", quiet=options.json):
        judged = repaired(concrete, lambda other: propose(options.query, other, sizing=sizing).task, options.seed)
    if not judged.feasible and not options.json:
        tell(f"no small change of the scene makes it feasible ({judged.reason})", style="yellow")
    return judged if judged.feasible else None


def _command(options: Options) -> str:
    """Return the command line that repeats a run; the scene of a photograph is made again."""
    from executor.cli.execution import typed_command

    return typed_command("run", options, "query", () if options.photo is None else ("scene",))


def _prove_and_execute(
    options: Options,
    proposal: Proposal,
    scene: Scene,
    folder: RunFolder,
    spending: Spending | None,
    judged: Judged | None,
) -> RunRecord:
    """Return the record of a run, with its finished files in the folder.

    Args:
        options: The typed options.
        proposal: The proposal of the offline planner, or of the model.
        scene: The scene.
        folder: The run's folder.
        spending: The proposing model and its usage; None for the offline planner.
        judged: The dry run with the changes of the scene, where these were asked for.
    """
    from executor.cli.execution import results_writer
    from executor.rollouts.run_record import RunRecord
    from oag import compose

    graph = compose(proposal.task, scene=scene)
    report = graph.verify()
    record = RunRecord(
        graph=graph,
        report=report,
        query=options.query,
        proposal=proposal.to_json(),
        notes=(*map(str, judged.fixes if judged is not None else ()), *proposal.notes),
        scene_fixes=judged.fixes if judged is not None else (),
        spending=spending,
        command=_command(options),
    )
    folder.write_plan(record)
    if not report:
        folder.write_report(record, None)
        return record
    _print_plan(record, options)
    # Flows that may be revised are run to learn from.
    if not (options.anyway or options.evolve):
        found = judged.found if judged is not None else None
        found = found or _ask_feasibility(record, options)
        record = replace(record, feasibility=found)
        folder.write_feasibility(found)
        if not found:
            folder.write_report(record, None)
            return record
    with results_writer(options.size, video=options.video, quiet=options.json, plain=options.plain) as studio:
        record = (
            _evolve_plan(record, options, folder)
            if options.evolve
            else folder.write_rollout(_execute_plan(record, options))
        )
        record = studio.finish(record, folder)
    return record


def _ask_feasibility(record: RunRecord, options: Options) -> Feasibility:
    """Return what a dry run says of the plan, and print it."""
    from executor.cli.output import counting
    from executor.rollouts.feasibility import feasible

    with counting("going through the plan by geometry", quiet=options.json):
        found = feasible(record.graph, record.graph.scene, options.seed)
    if not options.json:
        refusal = f"not feasible: {found.reason}" if found.decided else f"not known to be feasible: {found.reason}"
        tell(f"feasible, in {found.cpu_s:.1f} s of CPU time" if found else refusal)
        for detour in found.detours:
            tell(f"note: {detour.reason}", style="yellow")
    return found


def _execute_plan(record: RunRecord, options: Options) -> RunRecord:
    """Execute the plan; Ctrl-C keeps the finished part."""
    from executor.cli.execution import RolloutProgress
    from executor.records import RolloutInterrupted
    from executor.rollouts.rollout import RunConditions, rollout
    from oag import compose

    began = time.perf_counter()
    interrupted = False
    try:
        with RolloutProgress(quiet=options.json) as progress:
            graph = record.graph
            conditions = RunConditions(record_hz=options.record_hz, scene_fixes=record.scene_fixes)
            if record.feasibility is not None:
                conditions = record.feasibility.conditions(conditions)
                graph = compose(record.feasibility.task, scene=graph.scene)
            done = rollout(graph, graph.scene, options.seed, listen=progress, conditions=conditions)
    except RolloutInterrupted as stop:
        done, interrupted = stop.partial, True
    wall = {"planning and physics": time.perf_counter() - began}
    return replace(record, rollout=done, interrupted=interrupted, wall_s=wall)


def _evolve_plan(record: RunRecord, options: Options, folder: RunFolder) -> RunRecord:
    """Return the record of a run whose failing flows were revised; the evolution is in the folder.

    Args:
        record: The proved plan; the model that proposed it, if one did, judges and revises as well.
        options: The typed options.
        folder: The run's folder.
    """
    from executor.cli.evolution_setup import EvolutionSetup
    from executor.cli.execution import RolloutProgress
    from executor.rollouts.evolution_record import EvolutionInterrupted
    from executor.rollouts.rollout import RunConditions

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
                conditions=RunConditions(record_hz=options.record_hz),
            )
        except EvolutionInterrupted as stop:
            evolution, interrupted = stop.partial, True
        moved_s = time.perf_counter() - began
        stopped = "" if evolution.succeeded else judging.stopped
        record = folder.write_evolution(replace(record, stopped=stopped), evolution)
    return replace(record, interrupted=interrupted, wall_s={"planning and physics": moved_s})


def _judge_options(options: Options) -> JudgeOptions:
    """Return the judges' options: the model that plans, with pictures where they are available."""
    from executor.cli.evolution_setup import NO_VIEWS, PICTURES
    from executor.system import vulkan
    from llm.client.connect import recording_of

    model = options.asked.model
    if model is None:
        return JudgeOptions()
    recording, _ = recording_of(model)
    kept = recording is not None and (recording.parent / PICTURES).is_dir()
    if kept or (options.video and vulkan.find_renderer()):
        return JudgeOptions(model=model)
    tell("the model judges by measurements alone: there are no pictures to show it", style="yellow")
    return JudgeOptions(model=model, views=NO_VIEWS)


def _finish(record: RunRecord, folder: RunFolder, options: Options) -> int:
    """Print the end of a run and return its exit code."""
    from executor.cli.evolution_setup import stopped_message
    from executor.cli.execution import print_summary, summary_json

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
    spending: Spending, options: Options, scene: Scene, folder: RunFolder, images: tuple[Image, ...]
) -> Proposal:
    """Return a model's proposal for a run's query; the conversation is in the folder, also on failure."""
    from llm import ModelProposer
    from oag.sizes import Sizing

    sizing = Sizing(options.seed, options.keep_sizes)
    name = options.asked.model or ""
    proposer = ModelProposer(spending.model, name=name, images=images, sizing=sizing, listen=spending.add_round)
    try:
        return proposer.propose(options.query, scene)
    finally:
        # A resumed run keeps its conversation until there is a new one.
        if proposer.conversation is not None and (spending.rounds or not options.resume):
            folder.write_conversation(proposer.conversation.to_json())


def _print_plan(record: RunRecord, options: Options) -> None:
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
    """
    if paths and model is None:
        raise BadOption("--image", paths[0], "--model with it, since only a model looks at pictures")
    return tuple(map(_picture, paths))


def _picture(path: Path) -> Image:
    from llm import Image

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
