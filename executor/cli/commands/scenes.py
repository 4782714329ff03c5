"""`scene2demo scenes`: the scenes that come with the package, or what is in one scene and whether it can be so."""

from __future__ import annotations

from executor.cli.errors import DONE, BadOption
from executor.cli.inputs import refuse_existing
from executor.cli.options import ScenesOptions
from executor.cli.output import print_json, say, tell
from executor.machine.files import write_json
from executor.scenes import library
from executor.scenes.plausible import flaws, refuse
from executor.scenes.reading import converted


def execute(options: ScenesOptions) -> int:
    """Prints each scene with its objects, or a scene's objects one by one; returns 0.

    Raises:
        SceneError, SceneNotFound: There is no such scene, or it is not right; the message says all that is wrong.
    """
    if options.scene is not None:
        return _show(options, options.scene)
    if options.out is not None:
        raise BadOption("--out", options.out, "a scene's name or file before it")
    scenes = [library.load(name) for name in library.names()]
    if options.json:
        listed = [
            {"name": scene.name, "objects": {key: thing.category for key, thing in scene.objects.items()}}
            for scene in scenes
        ]
        print_json({"ok": True, "scenes": listed})
        return DONE
    width = max((len(scene.name) for scene in scenes), default=0)
    for scene in scenes:
        say(f"{scene.name:{width}}  {', '.join(scene.objects)}")
    return DONE


def _show(options: ScenesOptions, name: str) -> int:
    """Prints what a scene has, and writes it where that is wanted."""
    if options.out is not None:
        refuse_existing(options.out, force=options.force)
    found = converted(name)
    scene, notes = found.scene, found.notes
    wrong = flaws(scene)
    refuse(scene, wrong)
    warnings = [str(flaw) for flaw in wrong]
    if options.out is not None:
        write_json(options.out, scene.to_json())
    if options.json:
        print_json({"ok": True, "scene": scene.to_json(), "notes": list(notes), "warnings": warnings})
        return DONE
    for note in notes:
        tell(f"note: {note}")
    for warning in warnings:
        tell(f"warning: {warning}", style="yellow")
    width = max((len(key) for key in scene.objects), default=0)
    for key, thing in scene.objects.items():
        size = " x ".join(f"{length:.2f}" for length in thing.extent_m)
        say(f"{key:{width}}  {thing.category} ({thing.model}), {size} m")
    if options.out is not None:
        say(f"scene in {options.out}")
    return DONE
