"""`scene2demo assets import`: make a model for scenes of a URDF, a PartNet-Mobility folder or a mesh."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from executor.cli.errors import DONE
from executor.cli.options import CommonOptions, Maybe, Read
from executor.cli.output import ERR, counting, print_json, say


@dataclass(frozen=True)
class Options(CommonOptions):
    """Make a model for scenes of a URDF, a PartNet-Mobility folder or a mesh, and tell what a robot can do with it."""

    source: tyro.conf.Positional[Annotated[Path, Read()]]
    """A .urdf file, a folder with mobility.urdf, or an OBJ, STL, PLY, glTF or DAE mesh."""
    name: Maybe[str] = None
    """Its name; scenes say imported/NAME. By default that of the source."""
    category: Maybe[str] = None
    """What it is, such as cabinet or mug; by default what the files say, else its name."""
    height_m: Maybe[float] = None
    """Its height in metres; by default the files' lengths are metres."""
    side: Maybe[Path] = None
    """JSON file with what overrules inference; by default affordances.json in the source's folder."""


def execute(options: Options) -> int:
    """Import the asset, print what was found and the lines that a scene needs; return 0."""

    from executor.assets.importers.importer import import_asset
    from executor.assets.importers.store import as_json

    quiet = options.json or not ERR.is_terminal
    with counting("splitting meshes into convex pieces", quiet=quiet) as on_progress:
        imported = import_asset(
            options.source,
            options.name,
            category=options.category,
            height_m=options.height_m,
            side_file=options.side,
            on_progress=on_progress,
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
