"""`scene2demo photo`: reconstruct a scene, in which plans are proved and executed, from a photograph.

`run --photo` uses `scene_of_photograph` for the scene of its run.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from bddl.terminal import pluralize
from executor.cli.errors import DONE, FAILED, INTERRUPTED, BadOption, check
from executor.cli.options import (
    CommonOptions,
    GoOn,
    Maybe,
    ModelOptions,
    PhotoInputs,
    Read,
    ReplaceResults,
    option_help,
)
from executor.cli.output import print_json, say, tell, tell_progress
from executor.system.files import write_json

if TYPE_CHECKING:
    from executor.photo.fitting.likelihood import Fit
    from executor.photo.inputs.annotations import Detections, Detector
    from executor.photo.inputs.depth import DepthSource
    from executor.photo.inputs.picture import Photograph
    from executor.photo.pipeline import PhotoInput, PhotoResult
    from llm.structured.conversation import Spending


@dataclass(frozen=True, kw_only=True)
class FinderOptions(ModelOptions):
    """A model that finds things in place of boxes."""

    model: Maybe[str] = None
    """Instead of --boxes: vision-language model that finds and names things, such as openai:gpt-5.2 or replay:FILE."""


@dataclass(frozen=True)
class Options(CommonOptions):
    """Reconstruct a room from a photograph, best with depth, as a scene of the library's models.

    What is seen in each box is explained by a model that is posed, sized and opened until its depths and colours are
    those of the picture. Exit code 1 means that physics refuses what came out, 2 that what was given cannot be used.
    """

    picture: tyro.conf.Positional[Annotated[Maybe[Path], Read()]] = None
    """The picture (PNG, JPEG or another usual form), or a recording of Record3D (.r3d)."""
    out: Annotated[Maybe[Path], option_help("Folder for the results.")] = None
    again: Maybe[Path] = None
    """In place of a picture: folder of an earlier reconstruction. What was corrected in its things.json (a name, what a
    thing is on, a size) and what was not fitted before Ctrl-C is fitted; all else stays."""
    photo_inputs: PhotoInputs = field(default_factory=PhotoInputs)
    asked: FinderOptions = field(default_factory=FinderOptions)
    resume: GoOn = False
    force: ReplaceResults = False


def read_photograph(picture: Path, inputs: PhotoInputs, asked: Detector | None = None) -> PhotoInput:
    """Read a photograph and its files.

    Args:
        picture: The picture, or a recording.
        inputs: Files and values typed with it.
        asked: The model that is asked for boxes, where there is one.
    """
    from executor.photo.inputs.picture import CameraFacts
    from executor.photo.networks.masks import box_masks
    from executor.photo.pipeline import AuxiliaryInputs, read_inputs

    check(inputs.depth_kind is None or inputs.depth is not None, "--depth-kind", inputs.depth_kind, "--depth with it")
    return read_inputs(
        picture,
        AuxiliaryInputs(
            _detector(picture, inputs, asked),
            _depth(inputs),
            inputs.camera,
            inputs.frame,
            CameraFacts(inputs.tilt, inputs.roll, inputs.camera_height_m, inputs.depth_kind),
            None if inputs.mask_model is None else box_masks(inputs.mask_model),
        ),
    )


def _detector(picture: Path, inputs: PhotoInputs, asked: Detector | None) -> Detector | None:
    from executor.photo.inputs.annotations import boxes_in
    from executor.photo.networks.detect import detector_in

    boxes, folder, least = inputs.boxes, inputs.detector, inputs.least_score
    sources = [one for one in (boxes, folder, asked) if one is not None]
    check(len(sources) < 2, "--boxes", boxes or folder, "one of --boxes, --detector and --model, not two")
    check(least is None or folder is not None, "--least-score", least, "--detector with it")
    check(least is None or 0.0 <= least <= 1.0, "--least-score", least, "a number from 0 to 1")
    names = wanted_names(inputs)
    check(names is None or boxes is None, "--names", inputs.names, "--detector or --model with it, not --boxes")
    check(names is None or len(sources) == 1, "--names", inputs.names, "--detector or --model with it")
    if folder is not None:
        return detector_in(folder, least, names)
    return asked if boxes is None else boxes_in(boxes, picture.name)


def wanted_names(inputs: PhotoInputs) -> list[str] | None:
    """Return the names that a detector looks for; None where none were typed."""
    if inputs.names is None:
        return None
    names = [name for part in inputs.names.split(",") if (name := " ".join(part.lower().replace("_", " ").split()))]
    check(len(names) > 0, "--names", inputs.names, "names with commas between them, such as 'mug, bowl'")
    return list(dict.fromkeys(names))


def _depth(inputs: PhotoInputs) -> DepthSource | None:
    from executor.photo.inputs.depth import depth_in
    from executor.photo.networks.depth import guessed_depth

    unit_m = inputs.depth_unit_m
    check(unit_m is None or 1e-6 <= unit_m <= 10.0, "--depth-unit-m", unit_m, "metres, such as 0.001 or 0.0002")
    twice = inputs.depth is not None and inputs.depth_model is not None
    check(not twice, "--depth-model", inputs.depth_model, "one of --depth and --depth-model, not both")
    if inputs.depth_model is not None:
        return guessed_depth(inputs.depth_model)
    return None if inputs.depth is None else depth_in(inputs.depth, unit_m)


def scene_of_photograph(picture: Path, inputs: PhotoInputs, folder: Path, *, quiet: bool) -> Path:
    """Return the scene file of a photograph; an earlier reconstruction of the same input is reused.

    Args:
        picture: The picture, or a recording.
        inputs: Files and values typed with it.
        folder: Folder of the reconstruction.
        quiet: Whether to print no progress.

    Raises:
        KeyboardInterrupt: Ctrl-C; what is fitted by then is in the folder.
    """
    from executor.photo.errors import RoomRefused
    from executor.photo.output import prepared, reusable_scene

    given = read_photograph(picture, inputs)
    kept = reusable_scene(folder, given)
    if kept is not None:
        return kept
    prepared(folder, force=True)
    result = _reconstructed(folder, given, typed(picture, inputs), {}, quiet=quiet)
    if result.found.interrupted:
        raise KeyboardInterrupt(_go_on(folder, result))
    if result.made.refused:
        raise RoomRefused(picture, result.made.refused, folder)
    return folder / "scene.json"


def typed(picture: Path, inputs: PhotoInputs) -> dict[str, Any]:
    """Return what was typed as plain data, which `photo --again` reads; paths are absolute."""
    words = {name: value for name, value in asdict(inputs).items() if value is not None}
    camera = inputs.camera
    if camera is not None and Path(camera).is_file():
        words["camera"] = Path(camera)
    paths = {"picture": picture, **words}
    return {key: str(value.resolve()) if isinstance(value, Path) else value for key, value in paths.items()}


def _reconstructed(
    folder: Path, given: PhotoInput, words: Mapping[str, Any], kept: Mapping[int, Fit], *, quiet: bool
) -> PhotoResult:
    """Return the reconstruction of an input, with all files of it in the folder; a first scene is there in seconds."""
    from executor.photo.output import remove_empty_folder, write_boxes, write_first, write_fits, write_result
    from executor.photo.pipeline import reconstruct_scene

    tell_step = tell_progress(quiet)

    def show_first(result: PhotoResult) -> None:
        if files := write_first(folder, result):
            took = f"after {result.took_s['first scene']:.0f} s"
            fits = pluralize(len(result.found.things), "rough fit")
            tell_step(f"first scene of {fits} {took}, in {folder}: {' and '.join(files)}")

    def keep_fits(result: PhotoResult) -> None:
        write_fits(folder, result, words)

    with remove_empty_folder(folder):
        write_boxes(folder, given)
        result = reconstruct_scene(given, tell_step, on_first=show_first, on_fitted=keep_fits, kept=kept)
    write_result(folder, result, words)
    return result


def _go_on(folder: Path, result: PhotoResult) -> str:
    from executor.photo.errors import LostCause

    things = result.found.things
    rough = sum(thing.fit.rough for thing in things)
    fitted, late = len(things) - rough, sum(one.cause is LostCause.NO_TIME for one in result.found.unfitted)
    rest = f", {rough} roughly" if late else ", the others roughly" if rough else ""
    kept = f"{fitted} of {pluralize(len(things) + late, 'thing')} fitted{rest}"
    has = "the fits" if result.made.scene is None else "the scene"
    return f"interrupted; {folder} has {has} so far, {kept}. Go on by: scene2demo photo --again {folder}"


def execute(options: Options) -> int:
    """Reconstruct, write the results, and return 0; 1 where physics refuses the reconstruction, 130 after Ctrl-C."""
    from executor.photo.output import prepared, result_json

    check(not (options.resume and options.force), "--resume", "", "no --force with it, which starts over")
    check(
        not options.resume or options.asked.model is not None, "--resume", "", "--model with it, whose answers are kept"
    )
    spent: list[Spending] = []
    kept: Mapping[int, Fit] = {}
    if options.again is not None:
        given, words, kept, folder = _corrected(options, options.again)
    else:
        picture, out = options.picture, options.out
        if picture is None:
            raise BadOption("PATH", "is missing", "a picture, or --again with the folder of an earlier reconstruction")
        if out is None:
            raise BadOption("--out", "is missing", "a folder for the results")
        with ExitStack() as counted:
            given = read_photograph(picture, options.photo_inputs, _asked(options, out, spent, counted))
        # Where a model was asked, the folder has the conversation already.
        folder = out if options.asked.model is not None else prepared(out, force=options.force)
        words = typed(picture, options.photo_inputs)
    result = _reconstructed(folder, given, words, kept, quiet=options.json)
    code = INTERRUPTED if result.found.interrupted else FAILED if result.made.refused else DONE
    if options.json:
        used = {"usage": spent[0].to_json() if spent else None}
        print_json({"ok": code == DONE, "exit_code": code, "folder": str(folder), **used, **result_json(result)})
        return code
    _print_result(result)
    for spending in spent:
        say(spending.total())
    scene = "scene_refused" if result.made.refused else "scene"
    say(f"results in {folder}: {scene}.json, things.json, photo.json, overlay.png, report.html")
    if result.found.interrupted:
        tell(f"scene2demo: {_go_on(folder, result)}")
    else:
        say(f"correct names, supports or sizes in {folder / 'things.json'}, then: scene2demo photo --again {folder}")
    return code


def _corrected(options: Options, folder: Path) -> tuple[PhotoInput, Mapping[str, Any], Mapping[int, Fit], Path]:
    """Return the input of an earlier reconstruction as people corrected it, what was typed, kept fits, the folder."""
    from pydantic import TypeAdapter, ValidationError

    from executor.photo.again import read_earlier
    from executor.photo.errors import PhotoRefused
    from executor.photo.output import THINGS, prepared

    none_else = options.picture is None and options.asked.model is None and options.photo_inputs == PhotoInputs()
    check(none_else, "--again", folder, "nothing else with it but --out: the folder knows what was typed")
    earlier = read_earlier(folder)
    try:
        inputs = TypeAdapter(PhotoInputs).validate_python(dict(earlier.inputs))
    except ValidationError as error:
        first = error.errors()[0]
        where, found = "/".join(map(str, ("inputs", *first["loc"][:1]))), first["input"]
        raise PhotoRefused("again", folder / THINGS, f"{where} is {found!r}", first["msg"]) from error
    inputs = replace(inputs, boxes=None, detector=None, least_score=None, names=None)
    given = read_photograph(Path(earlier.inputs["picture"]), inputs, earlier.detect)
    out = options.out or folder
    prepared(out, force=options.force or out.resolve() == folder.resolve())
    return replace(given, origin_sha256=earlier.given_sha256), earlier.inputs, earlier.kept, out


def _asked(options: Options, out: Path, spent: list[Spending], counted: ExitStack) -> Detector | None:
    """Return the detector that asks the typed model, None without one; nothing is sent yet.

    Args:
        options: The typed options.
        out: Folder of the results.
        spent: Receives the model's usage, once it is asked.
        counted: Prints the usage on failure.
    """
    from executor.cli.evolution_setup import connect_model, report_spending_on_error, tell_kept
    from executor.photo.output import CONVERSATION, EXCHANGES, prepared
    from executor.photo.perception import model_detector
    from executor.reports.run_folder import kept_aside
    from llm import Conversation
    from llm.client.connect import is_replay, recording_of
    from llm.structured.conversation import Spending

    model = connect_model(options.asked, None)
    if options.asked.model is None or model is None:
        return None
    name, names = options.asked.model, wanted_names(options.photo_inputs)
    replayed = recording_of(name)[0] if is_replay(name) else None

    def detect(picture: Photograph) -> Detections:
        """Prepare the folder, since requests cost from here on; the inputs have been found usable."""
        record = out / EXCHANGES
        if options.force and replayed is None:
            tell_kept(kept_aside(record))
        folder = prepared(out, force=options.force or options.resume)
        live = connect_model(options.asked, folder / EXCHANGES, resume=options.resume) if replayed is None else None
        asked = live or model
        spending = Spending(asked, tell_progress(options.json))
        spent.append(spending)
        counted.enter_context(report_spending_on_error(spending, quiet=options.json))
        subject = f"what is in {picture.source.name}"
        conversation = Conversation(name, subject, picture.source.stem, listen=spending.add_round)
        try:
            return model_detector(asked, conversation, names)(picture)
        finally:
            write_json(folder / CONVERSATION, conversation.to_json())

    return detect


def _print_result(result: PhotoResult) -> None:
    from executor.photo.output import stands_on

    supports = stands_on(result)
    width = max(len(thing.id) for thing in result.found.things)
    for thing in result.found.things:
        size = " x ".join(f"{side:.2f}" for side in thing.fit.guess.size_m)
        spread = f"+- {100 * thing.fit.spread_m[1]:.0f} cm"
        on = f", on {supports[thing.id]}" if thing.id in supports else ""
        sure = f"{100 * thing.fit.in_box:.0f} % of its box, {100 * thing.fit.confidence:.0f} % sure"
        sure = "roughly" if thing.fit.rough else sure
        say(f"{thing.id:{width}}  {thing.fit.guess.entry.model}, {size} m {spread}{on}; {sure}")
    for one in result.found.unfitted:
        say(f"{one.detection.label or 'thing'}: left out, {one.reason}", style="yellow")
    for other in result.given.left_out:
        say(f"{other.label}: left out, {other.reason}", style="yellow")
    for note in result.made.notes:
        say(note)
    for variation in result.varied:
        models = ", ".join(f"{key} as {model}" for key, model in variation.models.items())
        say(f"variation {variation.number}, {models}: {'refused by physics' if variation.made.refused else 'settled'}")
    if result.made.refused:
        say(f"not a scene to work in: {result.made.refused}", style="red")
    else:
        say("settled in physics", style="green")
