"""`scene2demo scenes`: the scenes that have names, or one scene: what is in it, what is wrong, how it looks."""

from __future__ import annotations

from pathlib import Path

from bddl import format as written
from executor.cli.errors import BAD_INPUT, DONE, BadOption
from executor.cli.inputs import refuse_existing
from executor.cli.options import ScenesOptions
from executor.cli.output import print_json, say, tell
from executor.machine.files import write_json
from executor.pictures.scene_picture import scene_picture
from executor.scenes import drawn, library
from executor.scenes.cousins import Converted, holds_cousins
from executor.scenes.furnish import furnished
from executor.scenes.plausible import Flaw, flaws, refuse
from oag import Scene
from oag.model.sceneform import json_schema

PICTURES = (".png", ".jpg", ".jpeg")


def execute(options: ScenesOptions) -> int:
    """Lists the scenes, or tells, checks, draws or writes one; returns 0, or 2 for a scene with something wrong.

    Raises:
        SceneError, SceneNotFound: There is no such scene, or it is not right; the message says all that is wrong.
        BadOption: An option wants a scene, or another file.
        RendererNotFound: A picture is wanted, and nothing can draw one.
    """
    if options.schema:
        print_json(json_schema())
        return DONE
    if options.scene is not None:
        return _checked(options, options.scene) if options.check else _show(options, options.scene)
    for option, value in (("--out", options.out), ("--picture", options.picture), ("--check", options.check or None)):
        if value is not None:
            raise BadOption(option, "" if value is True else value, "a scene's name or file before it")
    return _list(options)


def _list(options: ScenesOptions) -> int:
    """Prints the scenes by families."""
    scenes = [library.load(name) for name in library.names()]
    rooms, kitchens = drawn.rooms(), drawn.kitchens()
    if options.json:
        fixed = [
            {"name": scene.name, "objects": {key: thing.category for key, thing in scene.objects.items()}}
            for scene in scenes
        ]
        found = {
            family: [{"name": one.name, "query": one.query} for one in members]
            for family, members in (("rooms", rooms), ("kitchens", kitchens))
        }
        print_json({"ok": True, "scenes": fixed, **found})
        return DONE
    width = max(len(name) for name in (*(scene.name for scene in scenes), *(one.name for one in (*rooms, *kitchens))))
    say("fixed scenes of the paper's tasks")
    for scene in scenes:
        say(f"  {scene.name:{width}}  {', '.join(scene.objects)}")
    say("kitchens drawn from a seed, T1 to T4: t1-SEED with any seed, such as")
    for one in kitchens:
        say(f"  {one.name:{width}}  {one.query}")
    say(f"rooms of households; kitchen01-SEED-a is drawn from another seed than {drawn.USUAL_SEED}")
    for one in rooms:
        say(f"  {one.name:{width}}  {one.query}")
    return DONE


def _show(options: ScenesOptions, name: str) -> int:
    """Prints what a scene has, and writes or draws it where that is wanted."""
    _refuse_outputs(options)
    found = library.converted(name)
    scene, notes = found.scene, found.notes
    wrong = flaws(scene)
    refuse(scene, wrong)
    warnings = [str(flaw) for flaw in wrong]
    _draw(options, scene)
    if options.out is not None:
        write_json(options.out, scene.to_json())
    if options.json:
        print_json({"ok": True, "scene": scene.to_json(), "notes": list(notes), "warnings": warnings})
        return DONE
    _tell(found, warnings)
    width = max((len(key) for key in scene.objects), default=0)
    for key, thing in scene.objects.items():
        size = " x ".join(f"{length:.2f}" for length in thing.extent_m)
        say(f"{key:{width}}  {thing.category} ({thing.model}), {size} m")
    if options.out is not None:
        say(f"scene in {options.out}")
    if options.picture is not None:
        say(f"picture in {options.picture}")
    return DONE


def _checked(options: ScenesOptions, name: str) -> int:
    """Prints all that is wrong with a scene and what follows from it, and draws it where that is wanted."""
    _refuse_outputs(options)
    found, problems, wrong = _examined(name)
    errors = [*problems, *(str(flaw) for flaw in wrong if flaw.error)]
    warnings = [str(flaw) for flaw in wrong if not flaw.error]
    if found is not None:
        _draw(options, found.scene)
        if options.out is not None and not errors:
            write_json(options.out, found.scene.to_json())
    facts = [] if found is None else [written(fact) for fact in found.scene.facts]
    if options.json:
        print_json({"ok": not errors, "errors": errors, "warnings": warnings, "facts": facts})
        return BAD_INPUT if errors else DONE
    if found is not None:
        _tell(found, warnings)
    for error in errors:
        tell(f"error: {error}", style="red")
    if errors:
        say(f"{name}: {len(errors)} {'thing is' if len(errors) == 1 else 'things are'} wrong")
        return BAD_INPUT
    count = 0 if found is None else len(found.scene.objects)
    say(f"{name}: nothing is wrong; {count} objects, and these facts:")
    for fact in facts:
        say(f"  {fact}")
    return DONE


def _examined(name: str) -> tuple[Converted | None, tuple[str, ...], tuple[Flaw, ...]]:
    """Returns a scene as far as there is one, what is wrong in its file, and what is wrong with the scene."""
    if not library.is_file(name) or holds_cousins(Path(name)):
        found = library.converted(name)
        return found, (), flaws(found.scene)
    read = furnished(name)
    scene = read.scene or read.rest
    if scene is None:
        return None, read.problems, ()
    return Converted(scene, ()), read.problems, flaws(scene)


def _refuse_outputs(options: ScenesOptions) -> None:
    if options.out is not None:
        refuse_existing(options.out, force=options.force)
    if options.picture is not None:
        if options.picture.suffix.lower() not in PICTURES:
            raise BadOption("--picture", options.picture, f"a file that ends in {', '.join(PICTURES)}")
        refuse_existing(options.picture, force=options.force, option="--picture")


def _draw(options: ScenesOptions, scene: Scene) -> None:
    """Draws the scene where that is wanted."""
    if options.picture is None:
        return
    picture = scene_picture(scene)
    options.picture.parent.mkdir(parents=True, exist_ok=True)
    picture.save(options.picture)


def _tell(found: Converted, warnings: list[str]) -> None:
    for note in found.notes:
        tell(f"note: {note}")
    for warning in warnings:
        tell(f"warning: {warning}", style="yellow")
