"""`scene2demo assets`: the models of the library."""

from __future__ import annotations

from pathlib import Path

from executor.assets.library import LIBRARY, kind
from executor.assets.parameters import Entry, Quantity, Span
from executor.cli.options.stock import Assets
from executor.cli.terminal.errors import DONE
from executor.cli.terminal.output import print_json, say, tell
from executor.machine.files import temporary_beside
from executor.pictures.sheet import asset_sheet


def execute(options: Assets) -> int:
    """Prints each model with what it is and the ranges it varies in; returns 0."""
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


def _described(entry: Entry) -> dict[str, object]:
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


def _range(span: Span) -> dict[str, object]:
    return {"low": span.low, "high": span.high, "unit": "width" if span.of_width else "m"}


def _draw(path: Path, seed: int) -> None:
    picture = asset_sheet([entry.sample(seed) for entry in LIBRARY.values()])
    with temporary_beside(path) as temporary:
        picture.save(temporary)
    tell(f"wrote {path}")
