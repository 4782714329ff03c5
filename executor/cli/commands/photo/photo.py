"""`scene2demo photo`: a photograph becomes a scene that plans are proved and executed in."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from executor.cli.commands.photo.given import read_photograph
from executor.cli.errors import DONE, FAILED, check
from executor.cli.judging import REPLAY, connected, counted_to_the_end, tell_kept
from executor.cli.output import print_json, say, tell
from executor.cli.words.running import PhotoOptions
from executor.machine.files import write_json
from executor.photo.folder import CONVERSATION, EXCHANGES, none_left, prepared, result_json, write_result
from executor.photo.inputs.annotations import Detections, Detector
from executor.photo.inputs.picture import Photograph
from executor.photo.perception.asked import asks
from executor.photo.pipeline import Result, reconstructed
from executor.results.run_folder import kept_aside
from llm import Conversation
from llm.answers.spending import Spending


def execute(options: PhotoOptions) -> int:
    """Reconstructs, writes the results, and returns 0; 1 where physics refuses what was reconstructed.

    Raises:
        PhotoRefused: What is given makes no scene; the message says why.
        ResultsExist, FolderUnusable: The folder.
        ModelError, AnswersRefused: The model that is asked for boxes gives no usable answer.
    """
    check(not (options.resume and options.force), "--resume", "", "no --force with it, which starts over")
    check(not options.resume or options.model is not None, "--resume", "", "--model with it, whose answers are kept")
    spent: list[Spending] = []
    with ExitStack() as counted:
        asked = _asked(options, spent, counted)
        given = read_photograph(options.picture, options.beside, asked)
    # Where a model was asked, the folder has what was said already.
    folder = options.out if options.model is not None else prepared(options.out, force=options.force)
    with none_left(folder):
        result = reconstructed(given, (lambda words: None) if options.json else (lambda words: tell(f"  {words}")))
    write_result(folder, result)
    code = FAILED if result.made.refused else DONE
    if options.json:
        used = {"usage": spent[0].to_json() if spent else None}
        print_json({"ok": code == DONE, "exit_code": code, "folder": str(folder), **used, **result_json(result)})
        return code
    _say(result)
    for spending in spent:
        say(spending.total())
    say(f"results in {folder}: {'scene_refused' if code else 'scene'}.json, photo.json, overlay.png, report.html")
    return code


def _asked(options: PhotoOptions, spent: list[Spending], counted: ExitStack) -> Detector | None:
    """Returns the detector that asks the model that was typed, None when none was; nothing is sent yet.

    Args:
        options: What was typed.
        spent: Where what the model takes is put, once it is asked.
        counted: Tells what it took where that fails.

    Raises:
        ModelError: The model is not known, or its recording cannot be read.
    """
    model = connected(options, None)
    if options.model is None or model is None:
        return None
    name = options.model
    replayed = Path(name.removeprefix(REPLAY)) if name.startswith(REPLAY) else None

    def detect(picture: Photograph) -> Detections:
        """Prepares the folder, since from here on things are paid for; what was given has been found usable."""
        record = options.out / EXCHANGES
        if options.force and replayed is None:
            tell_kept(kept_aside(record))
        kept = record if options.resume else replayed
        folder = prepared(options.out, force=options.force or options.resume, keep=kept)
        live = connected(options, folder / EXCHANGES, resume=options.resume) if replayed is None else None
        asked = live or model
        spending = Spending(asked) if options.json else Spending(asked, lambda line: tell(f"  {line}"))
        spent.append(spending)
        counted.enter_context(counted_to_the_end(spending, quiet=options.json))
        subject = f"what is in {picture.source.name}"
        conversation = Conversation(name, subject, picture.source.stem, listen=spending.hear)
        try:
            return asks(asked, conversation)(picture)
        finally:
            write_json(folder / CONVERSATION, conversation.to_json())

    return detect


def _say(result: Result) -> None:
    width = max(len(thing.id) for thing in result.found.things)
    for thing in result.found.things:
        size = " x ".join(f"{side:.2f}" for side in thing.fit.guess.size_m)
        sure = f"{100 * thing.fit.confidence:.0f} % sure"
        say(f"{thing.id:{width}}  {thing.fit.guess.entry.model}, {size} m, {sure}")
    for one in result.found.unfitted:
        say(f"{one.detection.label or 'thing'}: left out, {one.reason}", style="yellow")
    for other in result.given.left_out:
        say(f"{other.label}: left out, {other.reason}", style="yellow")
    if result.found.unfitted and not result.given.find_more:
        say("what has no box was not searched for; --find-more does")
    for note in result.made.notes:
        say(note)
    for variation in result.varied:
        models = ", ".join(f"{key} as {model}" for key, model in variation.models.items())
        say(f"variation {variation.number}, {models}: {'refused by physics' if variation.made.refused else 'settled'}")
    if result.made.refused:
        say(f"not a scene to work in: {result.made.refused}", style="red")
    else:
        say("settled in physics", style="green")
