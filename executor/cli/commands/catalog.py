"""`scene2demo scenes` and `assets`: what comes with the package; `assets import` makes a model of somebody's files."""

from __future__ import annotations

import json
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from bddl.files import temporary_beside
from executor.assets.imports.importer import import_asset
from executor.assets.imports.stored import as_json
from executor.assets.library import LIBRARY, kind
from executor.assets.parameters import ModelEntry, Quantity, Range
from executor.cli.errors import DONE, BadOption
from executor.cli.inputs import refuse_existing
from executor.cli.options import AssetsOptions, ImportOptions, ScenesOptions
from executor.cli.output import ERR, print_json, say, tell, tell_notes
from executor.machine.files import write_json
from executor.pictures.sheet import asset_sheet
from executor.scenes import library
from executor.scenes.plausible import flaws, refuse
from executor.scenes.reading import converted


def execute(options: ScenesOptions | AssetsOptions | ImportOptions) -> int:
    """Lists scenes or models, shows a scene, or imports a model; returns 0.

    Raises:
        SceneError, SceneNotFound: There is no such scene, or it is not right; the message says all that is wrong.
        ImportRefused: The files cannot be used.
        BadOption: A file to write exists, or there is nothing to write into it.
    """
    if isinstance(options, ImportOptions):
        _import(options)
    elif isinstance(options, AssetsOptions):
        _list_models(options)
    elif options.scene is not None:
        _show_scene(options, options.scene)
    elif options.out is not None:
        raise BadOption("--out", options.out, "a scene's name or file before it")
    else:
        _list_scenes(options)
    return DONE


def _list_scenes(options: ScenesOptions) -> None:
    scenes = [library.load(name) for name in library.names()]
    if options.json:
        listed = [
            {"name": scene.name, "objects": {key: thing.category for key, thing in scene.objects.items()}}
            for scene in scenes
        ]
        print_json({"ok": True, "scenes": listed})
        return
    width = max(len(scene.name) for scene in scenes)
    for scene in scenes:
        say(f"{scene.name:{width}}  {', '.join(scene.objects)}")


def _show_scene(options: ScenesOptions, name: str) -> None:
    """Prints what a scene has, and writes it where that is wanted."""
    if options.out is not None:
        refuse_existing(options.out, force=options.force)
    found = converted(name)
    scene, wrong = found.scene, flaws(found.scene)
    refuse(scene, wrong)
    warnings = [str(flaw) for flaw in wrong]
    if options.out is not None:
        write_json(options.out, scene.to_json())
    if options.json:
        print_json({"ok": True, "scene": scene.to_json(), "notes": list(found.notes), "warnings": warnings})
        return
    tell_notes(found.notes)
    for warning in warnings:
        tell(f"warning: {warning}", style="yellow")
    width = max((len(key) for key in scene.objects), default=0)
    for key, thing in scene.objects.items():
        size = " x ".join(f"{length:.2f}" for length in thing.extent_m)
        say(f"{key:{width}}  {thing.category} ({thing.model}), {size} m")
    if options.out is not None:
        say(f"scene in {options.out}")


def _list_models(options: AssetsOptions) -> None:
    """Prints each model with what it is and the ranges it varies in."""
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
            if isinstance(p, Quantity)
            else {"name": p.name, "words": list(p.words), "default": p.words[0]}
            for p in entry.parameters
        ],
    }


def _range(span: Range) -> dict[str, object]:
    return {"low": span.low, "high": span.high, "unit": "width" if span.of_width else "m"}


def _draw_models(path: Path, seed: int) -> None:
    picture = asset_sheet([entry.sample(seed) for entry in LIBRARY.values()])
    with temporary_beside(path) as temporary:
        picture.save(temporary)
    tell(f"wrote {path}")


def _import(options: ImportOptions) -> None:
    """Imports the asset and prints what was found, with the lines that a scene needs."""
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
