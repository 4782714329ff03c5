"""The viewer's page, and what it asks for: a table with the details of episodes, in the page or from its server."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any
from urllib.parse import quote

from executor.reports.html import render
from executor.system.files import plain
from executor.view.records import EpisodeDetail, EpisodeRow, Listing, NothingToView

_KINDS = {
    "rollout.json": "a run",
    "dataset.json": "a store",
    "bench.json": "a benchmark",
    "evaluation.json": "an evaluation",
    "meta/scene2demo.json": "an exported LeRobot data set",
}
"""The file by which each kind of folder is known -> the kind."""


def listing_of(path: Path) -> Listing:
    """Return what a folder holds, by the file that each kind of folder has.

    Raises:
        NothingToView: It holds nothing that the viewer reads.
    """
    known = next((file for file in _KINDS if (path / file).is_file()), None)
    if known is None and next(path.glob("seed_*/rollout.json"), None) is not None:
        known = "rollout.json"
    # Modules are imported where they are needed: benchmarks bring all generators of scenes.
    match known:
        case "rollout.json" | "dataset.json":
            from executor.view import stores

            return stores.RunListing(path) if known == "rollout.json" else stores.StoreListing(path)
        case "bench.json":
            from executor.view.benchmarks import BenchListing

            return BenchListing(path)
        case "evaluation.json" | "meta/scene2demo.json":
            from executor.view import policies

            return policies.EvaluationListing(path) if known == "evaluation.json" else policies.SetListing(path)
    expected = ", ".join(f"{file} ({kind})" for file, kind in _KINDS.items())
    raise NothingToView(f"{path} has nothing to view: expected a folder with {expected}, or a scene's name or file")


def viewer_page(listing: Listing, rows: Sequence[EpisodeRow], details: Mapping[str, object] | None = None) -> str:
    """Return the page.

    Args:
        listing: What is shown.
        rows: Its table.
        details: Episode -> what `detail_json` gives; None where a server gives them.
    """
    table = [[getattr(row, name) for name in COLUMNS] for row in rows]
    data = {
        "columns": COLUMNS,
        "rows": plain(table),
        "details": details,
        "command": listing.selection_command,
    }
    title = f"{listing.path.absolute().name}: {listing.kind}"
    return render("view.html", title=title, kind=listing.kind, path=str(listing.path), data=script_json(data))


COLUMNS = tuple(EpisodeRow.__dataclass_fields__)


def script_json(data: object) -> str:
    """Return data as JSON that cannot end the script element which it stands in."""
    return json.dumps(plain(data), separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def detail_json(detail: EpisodeDetail, link: Callable[[Path], str]) -> dict[str, Any]:
    """Return an episode's details as the page reads them.

    Args:
        detail: The episode.
        link: Returns the link to one of its files.
    """
    shown = {name: value for name, value in asdict(detail).items() if name not in ("clips", "files", "plots", "scene")}
    clips = [
        {"name": clip.name, "src": link(clip.file), "speed": clip.speed, "begin_s": clip.begin_s}
        for clip in detail.clips
    ]
    found = plain(
        {
            **shown,
            "clips": clips,
            "files": [[file.name, link(file)] for file in detail.files],
            "plots": None if detail.plots is None else detail.plots.to_json(),
            "scene": detail.scene is not None,
        }
    )
    assert isinstance(found, dict)
    return found


def link_from(page: Path) -> Callable[[Path], str]:
    """Return what links files from a page in the file system."""
    folder = page.absolute().parent
    return lambda file: quote(os.path.relpath(file.absolute(), folder))
