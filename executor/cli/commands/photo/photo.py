"""`scene2demo photo`: a photograph with depth becomes a scene that plans are proved and executed in."""

from __future__ import annotations

from executor.cli.commands.photo.given import read_photograph
from executor.cli.errors import DONE, FAILED
from executor.cli.output import print_json, say, tell
from executor.cli.words.running import PhotoOptions
from executor.photo.folder import prepared, result_json, write_result
from executor.photo.pipeline import Result, reconstructed


def execute(options: PhotoOptions) -> int:
    """Reconstructs, writes the results, and returns 0; 1 where physics refuses what was reconstructed.

    Raises:
        PhotoRefused: What is given makes no scene; the message says why.
        ResultsExist, FolderUnusable: The folder.
    """
    given = read_photograph(options.picture, options.beside)
    folder = prepared(options.out, force=options.force)
    result = reconstructed(given, (lambda words: None) if options.json else (lambda words: tell(f"  {words}")))
    write_result(folder, result)
    code = FAILED if result.made.refused else DONE
    if options.json:
        print_json({"ok": code == DONE, "exit_code": code, "folder": str(folder), **result_json(result)})
        return code
    _say(result)
    say(f"results in {folder}: {'scene_refused' if code else 'scene'}.json, photo.json, overlay.png, report.html")
    return code


def _say(result: Result) -> None:
    width = max(len(thing.id) for thing in result.found.things)
    for thing in result.found.things:
        size = " x ".join(f"{side:.2f}" for side in thing.fit.guess.size_m)
        sure = f"{100 * thing.fit.confidence:.0f} % sure"
        say(f"{thing.id:{width}}  {thing.fit.guess.entry.model}, {size} m, {sure}")
    for one in result.found.unfitted:
        say(f"{one.detection.label or 'thing'}: left out, {one.reason}", style="yellow")
    for note in result.made.notes:
        say(note)
    for variation in result.varied:
        models = ", ".join(f"{key} as {model}" for key, model in variation.models.items())
        say(f"variation {variation.number}, {models}: {'refused by physics' if variation.made.refused else 'settled'}")
    if result.made.refused:
        say(f"not a scene to work in: {result.made.refused}", style="red")
    else:
        say("settled in physics", style="green")
