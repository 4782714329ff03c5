"""Files of a reconstruction.

scene.json          the scene with the provenance of its values; absent if physics refuses it
scene_refused.json  a scene that physics refuses, for inspection
scene_1.json        the room with the second best models, scene_2.json with the third; absent if nothing else fits or
                    physics refuses it, and photo.json says which
photo.json          every intermediate number: camera, floor, walls, fits and their alternatives
overlay.png         photograph, outlines of the fits and drawn scene side by side
things.json         a line a thing: name, support and size, to be corrected for `photo --again`
report.html         a page with all of it
boxes.json          the boxes and names that a detector or a model found, to be corrected and given back by --boxes
conversation.json   the exchange with a model that was asked for boxes; exchanges.jsonl is the recording that replays it
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType

import numpy as np
from PIL import Image

import bddl
from executor.photo.drawing import cut, draw_outlines, side_by_side, visible_owners
from executor.photo.errors import PhotoRefused
from executor.photo.inputs.annotations import OWN_SUPPORTS
from executor.photo.pipeline import PhotoInput, PhotoResult
from executor.photo.room.reconstruct import FittedThing
from executor.photo.scene import COUNT, RoomVariation, provenance
from executor.reports.html import jpeg, render
from executor.reports.run_folder import FolderUnusable, ResultsExist
from executor.system.files import json_text, plain, read_json, write_json, write_text
from oag import Scene, SceneObject
from oag.model.symbols import Kind

SIZE_DIGITS = 3
"""Of sizes in the file of things: millimetres."""


_ABOVE_M = 0.01  # What hangs ends so far above the floor: more than physics lets things sink.


def stands_on(result: PhotoResult) -> dict[str, str]:
    """Return id -> id of what an object stands on or in, else `floor`, or `wall` if it hangs; none without a scene."""
    scene = result.made.scene
    if scene is None:
        return {}
    beneath = _beneath(scene)
    own = {thing.id: "wall" if _hangs(thing, scene.objects[thing.id]) else "floor" for thing in result.found.things}
    return {key: beneath.get(key, room) for key, room in own.items()}


def _hangs(thing: FittedThing, obj: SceneObject) -> bool:
    """Return whether an object of a scene is on a wall: fixed there, or furniture that was fitted above the floor."""
    above_m = obj.position[2] - obj.extent_m[2] / 2
    return obj.fixed or (thing.fit.hangs and obj.kind is not Kind.ITEM and above_m > _ABOVE_M)


def things_text(result: PhotoResult, inputs: Mapping[str, object]) -> str:
    """Return the JSON of the things, a line each, with what was typed."""
    supports = stands_on(result)
    entries: list[dict[str, object]] = [
        {
            "id": thing.id,
            "label": thing.detection.label,
            "on": supports.get(thing.id),
            "size_m": [round(side, SIZE_DIGITS) for side in thing.fit.guess.size_m],
            "box": list(thing.detection.box_px),
        }
        for thing in result.found.things
    ]
    entries += [{"label": one.detection.label, "box": list(one.detection.box_px)} for one in result.found.unfitted]
    lines = ",\n".join(f"  {json.dumps(plain(entry), ensure_ascii=False)}" for entry in entries)
    head = json_text(dict(inputs)).replace("\n", "\n  ")
    return f"""{{\n  "inputs": {head},\n  "things": [\n{lines}\n  ]\n}}\n"""


def _beneath(scene: Scene) -> dict[str, str]:
    literals = (literal for fact in scene.facts for literal in bddl.literals(fact) or ())
    return {
        literal.atom.args[0]: literal.atom.args[1]
        for literal in literals
        if literal.value and literal.atom.predicate in ("ontop", "inside")
    }


_SURE = 0.7  # A right fit to a box that is 3 % off has about 0.8.


def photo_page(result: PhotoResult) -> str:
    """Return the report of a reconstruction as a self-contained page."""
    guesses = result.found.guesses
    picture = draw_outlines(result.observation.rgb, visible_owners(result.observation, guesses))
    return render(
        "photo.html",
        result=result,
        picture=jpeg(side_by_side(result.observation, result.found, result.made.scene)),
        noise_mm=None if result.given.depth is None else 1000 * float(result.observation.noise.sigma_m(np.array(2.0))),
        left_out=[
            *(f"{one.detection.label or 'thing'}: {one.reason}" for one in result.found.unfitted),
            *(f"{one.label}: {one.reason}" for one in result.given.left_out),
        ],
        things=[(thing, jpeg(cut(picture, thing.detection.box_px))) for thing in result.found.things],
        least_sure=_SURE,
        degrees=math.degrees,
        took=", ".join(f"{step} {seconds:.1f} s" for step, seconds in result.took_s.items()),
        variations=[_variation(one) for one in result.varied],
    )


def _variation(one: RoomVariation) -> str:
    models = ", ".join(f"{key} as {model}" for key, model in one.models.items())
    ending = f"physics refuses it: {one.made.refused}" if one.made.refused else f"scene_{one.number}.json"
    return f"{models}: {ending}"


SCHEMA = "scene2demo-photo/1"
_VARIED = tuple(f"scene_{number}.json" for number in range(1, COUNT + 1))
EXCHANGES, CONVERSATION = "exchanges.jsonl", "conversation.json"
BOXES, THINGS = "boxes.json", "things.json"
_PERHAPS = ("scene.json", "scene_refused.json", *_VARIED, THINGS)
"""What not every result has; of an earlier one it is stale."""
FILES = (*_PERHAPS, "photo.json", "overlay.png", "report.html", BOXES, EXCHANGES, CONVERSATION)


def prepared(path: Path, *, force: bool) -> Path:
    """Return the folder, created if absent; `write_result` replaces earlier results in it, which takes `force`.

    Args:
        path: The folder.
        force: Whether earlier results may be replaced.

    Raises:
        ResultsExist: It has results, and `force` is not given.
        FolderUnusable: It cannot be created.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FolderUnusable(path, error.strerror or str(error)) from error
    found = [name for name in FILES if (path / name).exists()]
    if found and not force:
        raise ResultsExist(path, found)
    return path


@contextmanager
def remove_empty_folder(folder: Path) -> Iterator[None]:
    """Remove the empty folder of a photograph that is refused, or interrupted, before anything was written."""
    try:
        yield
    except (PhotoRefused, KeyboardInterrupt):
        if not any(folder.iterdir()):
            folder.rmdir()
        raise


def reusable_scene(folder: Path, given: PhotoInput) -> Path | None:
    """Return the scene of a folder if it was made of the same input and physics did not refuse it."""
    try:
        made_of = read_json(folder / "photo.json")
    except (OSError, ValueError):
        return None
    scene = folder / "scene.json"
    same = isinstance(made_of, dict) and made_of.get("given_sha256") == given.sha256
    whole = same and not made_of.get("interrupted") and not made_of.get("refused")
    return scene if whole and scene.is_file() else None


def write_boxes(folder: Path, given: PhotoInput) -> None:
    """Write what a detector found as a file of boxes; what a person gave is theirs, and stays as it is."""
    found = [one for one in given.detections if one.provenance == "detector"]
    # A table that the depth shows is no detection; boxes that a person corrected are not written over.
    if not found or any(one.provenance == "person" for one in given.detections):
        return
    things = [{"label": one.label, "box": list(one.box_px), "score": one.score} for one in found]
    left_out = [{"label": one.label, "box": list(one.box_px), "reason": one.reason} for one in given.left_out]
    size_px = list(given.picture.size_px)
    write_json(folder / BOXES, {"source": found[0].source, "size_px": size_px, "things": things, "left_out": left_out})


def write_first(folder: Path, result: PhotoResult) -> list[str]:
    """Write a first scene and its picture, and return the names of the files; an earlier result stays as it is."""
    if (folder / "photo.json").exists():
        return []
    _write_overlay(folder, result)
    if result.made.scene is None or result.made.refused:
        return ["overlay.png"]
    write_json(folder / "scene.json", result.made.scene.to_json())
    return ["scene.json", "overlay.png"]


def _write_overlay(folder: Path, result: PhotoResult) -> None:
    picture = side_by_side(result.observation, result.found, result.made.scene)
    Image.fromarray(picture).save(folder / "overlay.png")


def write_result(folder: Path, result: PhotoResult, inputs: Mapping[str, object] = MappingProxyType({})) -> None:
    """Write all files of a reconstruction over earlier ones, and remove what it does not have.

    Args:
        folder: The folder.
        result: The reconstruction.
        inputs: What was typed, for `photo --again`; empty writes no file of things to be corrected.
    """
    written = write_fits(folder, result, inputs)
    for one in result.varied:
        if one.made.scene is not None and not one.made.refused:
            written.append(write_json(folder / f"scene_{one.number}.json", one.made.scene.to_json()).name)
    _write_overlay(folder, result)
    write_text(folder / "report.html", photo_page(result))
    for name in _PERHAPS:
        if name not in written:
            (folder / name).unlink(missing_ok=True)


def write_fits(folder: Path, result: PhotoResult, inputs: Mapping[str, object]) -> list[str]:
    """Write the scene and what `photo --again` goes on from, and return the names of the files.

    Args:
        folder, result, inputs: As for `write_result`.
    """
    contents = {}
    if result.made.scene is not None:
        origin = provenance(result.found, result.made, result.floor.source)
        name = "scene_refused.json" if result.made.refused else "scene.json"
        contents[name] = json_text({**result.made.scene.to_json(), "provenance": origin}) + "\n"
    contents["photo.json"] = json_text(result_json(result)) + "\n"
    if inputs:
        contents[THINGS] = things_text(result, inputs)
    for name, text in contents.items():
        write_text(folder / name, text)
    return list(contents)


def result_json(result: PhotoResult) -> dict[str, object]:
    """Return every number of a reconstruction as plain data."""
    return {
        "schema": SCHEMA,
        "given_sha256": result.given.sha256,
        "interrupted": result.found.interrupted,
        "picture": {"file": result.given.picture.source.name, "size_px": list(result.given.picture.size_px)},
        "depth": None
        if result.given.depth is None
        else {
            "source": result.given.depth.source,
            "guessed": result.given.depth.depth_distortion > 0.0,
            "noise": result.observation.noise.to_json(),
        },
        "camera": result.given.camera.to_json(),
        "floor": result.floor.to_json(),
        "walls": [wall.to_json() for wall in result.found.walls],
        "things": {thing.id: _thing_json(thing, result) for thing in result.found.things},
        "left_out": [
            *(
                {
                    "label": one.detection.label,
                    "box_px": list(one.detection.box_px),
                    "cause": one.cause.name.lower(),
                    "reason": one.reason,
                }
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


def _given_support(thing: FittedThing, result: PhotoResult) -> str | None:
    """Return the id of the support that the detection names."""
    on = thing.detection.on
    if on is None or on < 0:
        return next((name for name, own in OWN_SUPPORTS.items() if own == on), None)
    beneath = result.given.detections[on]
    return next((other.id for other in result.found.things if other.detection is beneath), None)


def _thing_json(thing: FittedThing, result: PhotoResult) -> dict[str, object]:
    fit, guess = thing.fit, thing.fit.guess
    return {
        "box_px": list(thing.detection.box_px),
        "label": thing.detection.label,
        "label_source": thing.detection.source,
        "label_provenance": thing.detection.provenance,
        "score": thing.detection.score,
        "mask_pixels": None if thing.detection.mask is None else int(thing.detection.mask.sum()),
        "given": {
            "doors": thing.detection.doors,
            "drawers": thing.detection.drawers,
            "on": _given_support(thing, result),
            "size_m": None if thing.detection.size_m is None else list(thing.detection.size_m),
        },
        "stands_on": stands_on(result).get(thing.id),
        "fit": guess.to_json(),
        "cost": fit.cost,
        "rough": fit.rough,
        "assumed": fit.assumed,
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
        "residual_m": fit.residual_m if math.isfinite(fit.residual_m) else None,
        "spread_m": {"place": fit.spread_m[0], "side": fit.spread_m[1]},
        "pixels": fit.pixels,
        "colour_srgb": fit.colour,
        "settled_m": result.made.settled_m.get(thing.id),
        "alternatives": [
            {"model": one.guess.entry.model, "cost_more": one.cost - fit.cost, "fit": one.guess.to_json()}
            for one in fit.alternatives
        ],
    }
