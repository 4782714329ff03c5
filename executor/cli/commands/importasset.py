"""`scene2demo assets import`: somebody's files become a model that scenes can name."""

from __future__ import annotations

import json

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from executor.assets.imports.importer import import_asset
from executor.assets.imports.stored import as_json
from executor.cli.options.stock import ImportAsset
from executor.cli.terminal.errors import DONE
from executor.cli.terminal.output import ERR, print_json, say


def execute(options: ImportAsset) -> int:
    """Imports the asset and prints what was found, with the lines that a scene needs; returns 0."""
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
