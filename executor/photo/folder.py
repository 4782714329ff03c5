"""The files of a reconstruction.

scene.json          the scene, with where its values come from; absent where physics refuses it
scene_refused.json  the same of a scene that physics refuses, for looking at it
scene_0_info.json   the scene in the form of Digital Cousins, scene_0_graph.json what stands on what in it
scene_1.json        the room with the second best models, scene_2.json with the third, each with _info and _graph as
                    well; absent where nothing else fits or physics refuses it, and photo.json says which
photo.json          every number on the way: camera, floor, walls, fits and their alternatives
overlay.png         the photograph with the outlines of what was fitted
report.html         all of it to read
conversation.json   where a model was asked for boxes: what was said; exchanges.jsonl is the recording that replays it
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image

from executor.machine.files import read_json, write_json, write_text
from executor.photo.cousins import cousins_files, cousins_json
from executor.photo.inputs.annotations import FLOOR
from executor.photo.overlay import outlined, shown_things
from executor.photo.pipeline import Given, Result
from executor.photo.refusal import PhotoRefused
from executor.photo.report import photo_page
from executor.photo.room.reconstruct import FittedThing
from executor.photo.scene import MadeScene, provenance
from executor.photo.variations import COUNT
from executor.results.run_folder import FolderUnusable, ResultsExist

SCHEMA = "scene2demo-photo/1"
_VARIED = tuple(f"scene_{number}.json" for number in range(1, COUNT + 1))
_COUSINS = tuple(name for number in range(COUNT + 1) for name in cousins_files(number))
EXCHANGES, CONVERSATION = "exchanges.jsonl", "conversation.json"
FILES = (
    "scene.json",
    "scene_refused.json",
    *_VARIED,
    *_COUSINS,
    "photo.json",
    "overlay.png",
    "report.html",
    EXCHANGES,
    CONVERSATION,
)


def prepared(path: Path, *, force: bool, keep: Path | None = None) -> Path:
    """Returns the folder, made when absent; earlier results in it are removed only with `force`.

    Args:
        path: The folder.
        force: Whether earlier results may be removed.
        keep: A file that stays all the same: the recording that is replayed, or gone on with.

    Raises:
        ResultsExist: It has results, and `force` is not given.
        FolderUnusable: It cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FolderUnusable(path, error.strerror or str(error)) from error
    found = [name for name in FILES if (path / name).exists()]
    if found and not force:
        raise ResultsExist(path, found)
    for name in found:
        if keep is None or (path / name).resolve() != keep.resolve():
            (path / name).unlink()
    return path


@contextmanager
def none_left(folder: Path) -> Iterator[None]:
    """Where a photograph is refused before anything was written, its empty folder goes."""
    try:
        yield
    except PhotoRefused:
        if not any(folder.iterdir()):
            folder.rmdir()
        raise


def kept_scene(folder: Path, given: Given) -> Path | None:
    """Returns the scene of a folder where it was made of the same input, and physics did not refuse it."""
    try:
        made_of = read_json(folder / "photo.json")
    except (OSError, ValueError):
        return None
    scene = folder / "scene.json"
    same = isinstance(made_of, dict) and made_of.get("given_sha256") == given.sha256
    return scene if same and scene.is_file() else None


def write_result(folder: Path, result: Result) -> None:
    """Writes all files of a reconstruction."""
    if result.made.scene is not None:
        name = "scene_refused.json" if result.made.refused else "scene.json"
        written = {
            **result.made.scene.to_json(),
            "provenance": provenance(result.found, result.made, result.floor.source),
        }
        write_json(folder / name, written)
        _write_cousins(folder, result, 0, result.made)
    for one in result.varied:
        if one.made.scene is not None and not one.made.refused:
            write_json(folder / f"scene_{one.number}.json", one.made.scene.to_json())
            _write_cousins(folder, result, one.number, one.made)
    write_json(folder / "photo.json", result_json(result))
    guesses = {thing.id: thing.fit.guess for thing in result.found.things}
    Image.fromarray(outlined(result.seen, shown_things(result.seen, guesses))).save(folder / "overlay.png")
    write_text(folder / "report.html", photo_page(result))


def _write_cousins(folder: Path, result: Result, number: int, made: MadeScene) -> None:
    if made.scene is not None:
        for file, content in zip(cousins_files(number), cousins_json(made.scene, result.seen), strict=True):
            write_json(folder / file, content)


def result_json(result: Result) -> dict[str, object]:
    """Returns every number of a reconstruction as plain data."""
    return {
        "schema": SCHEMA,
        "given_sha256": result.given.sha256,
        "picture": {"file": result.given.picture.source.name, "size_px": list(result.given.picture.size_px)},
        "depth": None
        if result.given.depth is None
        else {"source": result.given.depth.source, "noise": result.seen.noise.to_json()},
        "camera": result.given.camera.to_json(),
        "floor": result.floor.to_json(),
        "walls": [wall.to_json() for wall in result.found.walls],
        "things": {thing.id: _thing_json(thing, result) for thing in result.found.things},
        "left_out": [
            *(
                {"label": one.detection.label, "box_px": list(one.detection.box_px), "reason": one.reason}
                for one in result.found.unfitted
            ),
            *({"label": one.label, "box_px": list(one.box_px), "reason": one.reason} for one in result.given.left_out),
        ],
        "refused": result.made.refused,
        "variations": [
            {"scene": f"scene_{one.number}.json", "models": dict(one.models), "refused": one.made.refused}
            for one in result.varied
        ],
        "doubts": list(result.given.doubts),
        "notes": list(result.made.notes),
        "took_s": dict(result.took_s),
    }


def _told_on(thing: FittedThing, result: Result) -> str | None:
    """The id of what a thing was told to stand on."""
    on = thing.detection.on
    if on is None or on == FLOOR:
        return None if on is None else "floor"
    beneath = result.given.detections[on]
    return next((other.id for other in result.found.things if other.detection is beneath), None)


def _thing_json(thing: FittedThing, result: Result) -> dict[str, object]:
    fit, guess = thing.fit, thing.fit.guess
    return {
        "box_px": list(thing.detection.box_px),
        "label": thing.detection.label,
        "label_source": thing.detection.source,
        "label_provenance": thing.detection.provenance,
        "score": thing.detection.score,
        "told": {"doors": thing.detection.doors, "drawers": thing.detection.drawers, "on": _told_on(thing, result)},
        "model": guess.entry.model,
        "position_m": list(guess.as_object().position),
        "yaw_rad": guess.yaw_rad,
        "size_m": list(guess.size_m),
        "parameters": dict(guess.parameters),
        "confidence": fit.confidence,
        "likelier": fit.likelier,
        "in_box": fit.in_box,
        "placed": fit.placed,
        "explained": fit.explained,
        "residual_m": fit.residual_m if result.seen.has_depth else None,
        "spread_m": fit.spread_m,
        "pixels": fit.pixels,
        "colour_srgb": fit.colour,
        "settled_m": result.made.settled_m.get(thing.id),
        "alternatives": [
            {"model": one.guess.entry.model, "cost_more": one.cost - fit.cost} for one in fit.alternatives
        ],
    }
