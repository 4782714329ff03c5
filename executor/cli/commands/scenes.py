"""`scene2demo scenes`: list packaged scenes; describe, check, draw or write a scene."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from bddl.files import atomic_path
from bddl.terminal import pluralize
from executor.cli.errors import BAD_INPUT, DONE, BadOption
from executor.cli.options import READ_SCENE, CommonOptions, DomainFile, Flag, Maybe, ReplaceFile
from executor.cli.output import print_json, say, tell, tell_notes, tell_warnings
from executor.system.files import write_json

if TYPE_CHECKING:
    from executor.scenes.digital_cousins import SceneWithNotes
    from executor.scenes.validation import Issue
    from oag import Scene
    from oag.model.domain import Domain


@dataclass(frozen=True)
class Options(CommonOptions):
    """List the scenes that have names, or tell what is in a scene, whether it can be, and how it looks.

    What cannot be built, lies in another thing, is in mid-air or not where the facts say is an error. A
    scene_k_info.json of Digital Cousins is furnished with models of the library.
    """

    scene: tyro.conf.Positional[Annotated[Maybe[str], READ_SCENE]] = None
    """Name of a scene, a scene's JSON file, or one of Digital Cousins."""
    domain: DomainFile = None
    check: Flag = False
    """Say all that is wrong with the scene, else what stands on or in what in it; the exit code is 2 or 0."""
    picture: Maybe[Path] = None
    """File for a picture of the scene, .png or .jpg; nothing is planned or moved. Needs a renderer."""
    schema: Flag = False
    """Print the JSON schema of scene files, for editors and other programs."""
    out: Maybe[Path] = None
    """File for the scene as this program reads it; its folder is made when absent."""
    force: ReplaceFile = False


PICTURES = (".png", ".jpg", ".jpeg")


def execute(options: Options) -> int:
    """List scenes, or describe, check, draw or write one; return 0, or 2 for a checked scene with errors."""
    from oag.model.forms import json_schema

    if options.schema:
        print_json(json_schema())
    elif options.scene is not None and options.check:
        return _check_scene(options, options.scene)
    elif options.scene is not None:
        _show_scene(options, options.scene)
    else:
        given = {
            "--domain": options.domain,
            "--out": options.out,
            "--picture": options.picture,
            "--check": options.check or None,
        }
        for option, value in given.items():
            if value is not None:
                raise BadOption(option, value, "a scene's name or file before it")
        _list_scenes(options)
    return DONE


def _list_scenes(options: Options) -> None:
    """Print the scenes by families."""
    from executor.scenes import library
    from executor.scenes.generators import families

    scenes = [library.load(name) for name in library.names()]
    rooms, kitchens = families.rooms(), families.kitchens()
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
        return
    width = max(len(name) for name in (*(scene.name for scene in scenes), *(one.name for one in (*rooms, *kitchens))))
    say("fixed scenes of the paper's tasks")
    for scene in scenes:
        say(f"  {scene.name:{width}}  {', '.join(scene.objects)}")
    say("kitchens drawn from a seed, T1 to T4: t1-SEED with any seed, such as")
    for one in kitchens:
        say(f"  {one.name:{width}}  {one.query}")
    say(f"rooms of households; kitchen01-SEED-a is drawn from another seed than {families.USUAL_SEED}")
    for one in rooms:
        say(f"  {one.name:{width}}  {one.query}")


def _show_scene(options: Options, name: str) -> None:
    """Print the content of a scene, and write or draw it where requested."""
    from executor.cli.inputs import domain_in
    from executor.scenes.file import load_with_notes
    from executor.scenes.validation import issues, raise_errors

    _refuse_outputs(options)
    found = load_with_notes(name, domain_in(options.domain))
    scene, wrong = found.scene, issues(found.scene)
    raise_errors(scene, wrong)
    warnings = [str(issue) for issue in wrong]
    _draw(options, scene)
    if options.out is not None:
        write_json(options.out, scene.to_json())
    if options.json:
        print_json({"ok": True, "scene": scene.to_json(), "notes": list(found.notes), "warnings": warnings})
        return
    _tell(found, warnings)
    width = max((len(key) for key in scene.objects), default=0)
    for key, thing in scene.objects.items():
        size = " x ".join(f"{length:.2f}" for length in thing.extent_m)
        say(f"{key:{width}}  {thing.category} ({thing.model}), {size} m")
    if options.out is not None:
        say(f"scene in {options.out}")
    if options.picture is not None:
        say(f"picture in {options.picture}")


def _check_scene(options: Options, name: str) -> int:
    """Print all errors of a scene, else the facts that follow; draw or write it where requested."""
    from bddl import format as written
    from executor.cli.inputs import domain_in

    _refuse_outputs(options)
    found, problems, misread, wrong = _examined(name, domain_in(options.domain))
    errors = [*problems, *(str(issue) for issue in wrong if issue.error)]
    warnings = [*misread, *(str(issue) for issue in wrong if not issue.error)]
    facts = [] if found is None else [written(fact) for fact in found.scene.facts]
    notes = [] if found is None else list(found.notes)
    if options.json:
        print_json({"ok": not errors, "errors": errors, "warnings": warnings, "notes": notes, "facts": facts})
    else:
        if found is not None:
            _tell(found, warnings)
        for error in errors:
            tell(f"error: {error}", style="red")
        if errors or found is None:
            say(f"{name}: {len(errors)} {'thing is' if len(errors) == 1 else 'things are'} wrong")
        else:
            verdict = f"no errors, {pluralize(len(warnings), 'warning')}" if warnings else "nothing is wrong"
            say(f"{name}: {verdict}; {len(found.scene.objects)} objects, and these facts:")
            for fact in facts:
                say(f"  {fact}")
    if found is not None:
        _draw(options, found.scene)
        if options.out is not None and not errors:
            write_json(options.out, found.scene.to_json())
    return BAD_INPUT if errors else DONE


def _examined(
    name: str, domain: Domain
) -> tuple[SceneWithNotes | None, tuple[str, ...], tuple[str, ...], tuple[Issue, ...]]:
    """Return a scene as far as it can be read, and its findings.

    These are the errors of its file, its reinterpreted values, and the flaws of the scene.
    """
    from executor.scenes import library
    from executor.scenes.digital_cousins import SceneWithNotes
    from executor.scenes.file import complete_scene, load_with_notes
    from executor.scenes.validation import issues

    path = library.file_of(name)
    if path is None or library.holds_cousins(path):
        found = load_with_notes(name, domain)
        return found, (), (), issues(found.scene)
    read = complete_scene(path, domain)
    scene = read.scene or read.rest
    if scene is None:
        return None, read.problems, (), ()
    return SceneWithNotes(scene, ()), read.problems, read.warnings, issues(scene)


def _refuse_outputs(options: Options) -> None:
    from executor.cli.inputs import refuse_existing

    if options.out is not None:
        refuse_existing(options.out, force=options.force)
    if options.picture is not None:
        if options.picture.suffix.lower() not in PICTURES:
            raise BadOption("--picture", options.picture, f"a file that ends in {', '.join(PICTURES)}")
        refuse_existing(options.picture, force=options.force, option="--picture")


def _draw(options: Options, scene: Scene) -> None:
    from executor.sim.render.stage import render_scene

    if options.picture is None:
        return
    picture = render_scene(scene)
    with atomic_path(options.picture) as temporary:
        picture.save(temporary)


def _tell(found: SceneWithNotes, warnings: list[str]) -> None:
    tell_notes(found.notes)
    tell_warnings(warnings)
