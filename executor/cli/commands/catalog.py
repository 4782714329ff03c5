"""`scene2demo scenes`, `assets`, `assets import`: list packaged scenes and models; import a model from files."""

from __future__ import annotations

import json
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from bddl import format as written
from bddl.files import atomic_path
from bddl.terminal import pluralize
from executor.assets.importers.importer import import_asset
from executor.assets.importers.store import as_json
from executor.assets.library import LIBRARY, kind
from executor.assets.parameters import ModelEntry, NumericParameter, Range
from executor.cli.command_options import AssetsOptions, ImportOptions, ScenesOptions
from executor.cli.errors import BAD_INPUT, DONE, BadOption
from executor.cli.inputs import refuse_existing
from executor.cli.output import ERR, print_json, say, tell, tell_notes, tell_warnings
from executor.scenes import library
from executor.scenes.digital_cousins import SceneWithNotes
from executor.scenes.file import complete_scene, load_with_notes
from executor.scenes.generators import families
from executor.scenes.validation import Issue, issues, raise_errors
from executor.sim.render.stage import asset_sheet, render_scene
from executor.system.files import write_json
from oag import Scene
from oag.model.forms import json_schema

PICTURES = (".png", ".jpg", ".jpeg")


def execute(options: ScenesOptions | AssetsOptions | ImportOptions) -> int:
    """List scenes or models; describe, check, draw or write a scene; or import a model; return 0.

    A checked scene with errors makes it 2.

    Raises:
        SceneError, SceneNotFound: There is no such scene, or it is not right; the message lists all errors.
        ImportRefused: The files cannot be used.
        BadOption: A file to write exists, or there is nothing to write into it.
        RendererNotFound: A picture was requested, and nothing can draw one.
    """
    if isinstance(options, ScenesOptions):
        return _scenes(options)
    if isinstance(options, ImportOptions):
        _import(options)
    else:
        _list_models(options)
    return DONE


def _scenes(options: ScenesOptions) -> int:
    if options.schema:
        print_json(json_schema())
    elif options.scene is not None and options.check:
        return _check_scene(options, options.scene)
    elif options.scene is not None:
        _show_scene(options, options.scene)
    else:
        given = {"--out": options.out, "--picture": options.picture, "--check": options.check or None}
        for option, value in given.items():
            if value is not None:
                raise BadOption(option, value, "a scene's name or file before it")
        _list_scenes(options)
    return DONE


def _list_scenes(options: ScenesOptions) -> None:
    """Print the scenes by name."""
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


def _show_scene(options: ScenesOptions, name: str) -> None:
    """Print the content of a scene, and write or draw it where requested."""
    _refuse_outputs(options)
    found = load_with_notes(name)
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


def _check_scene(options: ScenesOptions, name: str) -> int:
    """Print all errors of a scene, else the facts that follow; draw or write it where requested."""
    _refuse_outputs(options)
    found, problems, misread, wrong = _examined(name)
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


def _examined(name: str) -> tuple[SceneWithNotes | None, tuple[str, ...], tuple[str, ...], tuple[Issue, ...]]:
    """Return a scene as far as it can be read, and its findings.

    These are the errors of its file, its reinterpreted values, and the flaws of the scene.
    """
    path = library.file_of(name)
    if path is None or library.holds_cousins(path):
        found = load_with_notes(name)
        return found, (), (), issues(found.scene)
    read = complete_scene(path)
    scene = read.scene or read.rest
    if scene is None:
        return None, read.problems, (), ()
    return SceneWithNotes(scene, ()), read.problems, read.warnings, issues(scene)


def _refuse_outputs(options: ScenesOptions) -> None:
    if options.out is not None:
        refuse_existing(options.out, force=options.force)
    if options.picture is not None:
        if options.picture.suffix.lower() not in PICTURES:
            raise BadOption("--picture", options.picture, f"a file that ends in {', '.join(PICTURES)}")
        refuse_existing(options.picture, force=options.force, option="--picture")


def _draw(options: ScenesOptions, scene: Scene) -> None:
    if options.picture is None:
        return
    picture = render_scene(scene)
    with atomic_path(options.picture) as temporary:
        picture.save(temporary)


def _tell(found: SceneWithNotes, warnings: list[str]) -> None:
    tell_notes(found.notes)
    tell_warnings(warnings)


def _list_models(options: AssetsOptions) -> None:
    """Print each model with what it is and the ranges it varies in."""
    if options.json:
        print_json({"ok": True, "assets": [_described(entry) for entry in LIBRARY.values()]})
    else:
        width = max(len(model) for model in LIBRARY)
        for entry in LIBRARY.values():
            size = f"{entry.length} x {entry.width} x {entry.height} m"
            say(f"{entry.model:{width}}  {entry.category} ({kind(entry).value}, {entry.synset})  {size}")
            if entry.parameters:
                say(f"{'':{width}}  {', '.join(str(parameter) for parameter in entry.parameters)}")
    if options.sheet is not None:
        _draw_models(options.sheet, options.seed)


def _described(entry: ModelEntry) -> dict[str, object]:
    return {
        "model": entry.model,
        "category": entry.category,
        "synset": entry.synset,
        "kind": kind(entry).value,
        "role": kind(entry).role,
        "size": {
            name: _range(span) for name, span in zip("xyz", (entry.length, entry.width, entry.height), strict=True)
        },
        "parameters": [
            {"name": p.name, "low": p.low, "high": p.high, "default": p.default, "whole": p.whole}
            if isinstance(p, NumericParameter)
            else {"name": p.name, "words": list(p.words), "default": p.words[0]}
            for p in entry.parameters
        ],
    }


def _range(span: Range) -> dict[str, object]:
    return {"low": span.low, "high": span.high, "unit": "width" if span.of_width else "m"}


def _draw_models(path: Path, seed: int) -> None:
    picture = asset_sheet([entry.sample(seed) for entry in LIBRARY.values()])
    with atomic_path(path) as temporary:
        picture.save(temporary)
    tell(f"wrote {path}")


def _import(options: ImportOptions) -> None:
    """Import the asset and prints what was found, with the lines that a scene needs."""
    columns = (
        TextColumn("splitting meshes into convex pieces"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=ERR, transient=True, disable=options.json or not ERR.is_terminal) as progress:
        bar = progress.add_task("", total=None)
        imported = import_asset(
            options.source,
            options.name,
            category=options.category,
            height_m=options.height_m,
            side_file=options.side,
            listen=lambda done, count: progress.update(bar, completed=done, total=count),
        )
    described = as_json(imported)
    if options.json:
        print_json({"ok": True, "asset": described})
        return
    size = " x ".join(f"{value:.3f}" for value in imported.stored.asset.extent_m)
    say(f"{described['model']}  {described['category']} ({described['kind']})  {size} m")
    for note in imported.stored.notes:
        say(f"  {note}")
    obj = imported.as_object(f"{described['category']}_0")
    entry = {
        "category": obj.category,
        "model": obj.model,
        "position": list(obj.position),
        "bbox_extent": list(obj.bbox_extent),
        "parameters": dict(obj.parameters),
    }
    say(f'in a scene:\n  "{obj.id}": {json.dumps(entry)}')
