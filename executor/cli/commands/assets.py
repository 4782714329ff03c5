"""`scene2demo assets` lists the models of the library; `assets import` makes one of somebody's files."""

from __future__ import annotations

import json
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from bddl.files import temporary_beside
from executor.assets.imports.importer import import_asset
from executor.assets.imports.stored import as_json
from executor.assets.library import LIBRARY, kind
from executor.assets.parameters import ModelEntry, Quantity, Range
from executor.cli.errors import DONE
from executor.cli.options import AssetsOptions, ImportOptions
from executor.cli.output import ERR, print_json, say, tell
from executor.pictures.sheet import asset_sheet


def execute(options: AssetsOptions | ImportOptions) -> int:
    """Lists the models, or imports one; returns 0."""
    return _import(options) if isinstance(options, ImportOptions) else _list(options)


def _list(options: AssetsOptions) -> int:
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
        _draw(options.sheet, options.seed)
    return DONE


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


def _draw(path: Path, seed: int) -> None:
    picture = asset_sheet([entry.sample(seed) for entry in LIBRARY.values()])
    with temporary_beside(path) as temporary:
        picture.save(temporary)
    tell(f"wrote {path}")


def _import(options: ImportOptions) -> int:
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
        return DONE
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
    return DONE
