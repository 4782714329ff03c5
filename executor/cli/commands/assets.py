"""`scene2demo assets`: list the models that scenes can name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bddl.files import atomic_path
from executor.cli.errors import DONE
from executor.cli.options import CommonOptions, Maybe
from executor.cli.output import print_json, say, tell

if TYPE_CHECKING:
    from executor.assets.parameters import ModelEntry, Range


@dataclass(frozen=True)
class Options(CommonOptions):
    """List the models that a scene's objects can name, with their ranges."""

    sheet: Maybe[Path] = None
    """File for a picture of all of them, one variation each; needs a renderer."""
    seed: int = 0
    """Which variation the picture shows."""


def execute(options: Options) -> int:
    """Print each model with what it is and the ranges it varies in; return 0."""
    from executor.assets.library import LIBRARY, kind

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
    return DONE


def _described(entry: ModelEntry) -> dict[str, object]:
    from executor.assets.library import kind
    from executor.assets.parameters import NumericParameter

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
    from executor.assets.library import LIBRARY
    from executor.sim.render.stage import asset_sheet

    picture = asset_sheet([entry.sample(seed) for entry in LIBRARY.values()])
    with atomic_path(path) as temporary:
        picture.save(temporary)
    tell(f"wrote {path}")
