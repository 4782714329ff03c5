"""The viewer's page, and what it asks for: a table with the details of episodes, in the page or from its server."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from executor.reports.episode import EpisodeRow
from executor.reports.html import REPORT, render, script_json
from executor.view.records import Listing, NothingToView

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
    if (path / REPORT).is_file():
        raise NothingToView(f"{path} has no episode, since nothing was executed; its page is {path / REPORT}")
    expected = ", ".join(f"{file} ({kind})" for file, kind in _KINDS.items())
    raise NothingToView(f"{path} has nothing to view: expected a folder with {expected}, or a scene's name or file")


def viewer_page(listing: Listing, rows: Sequence[EpisodeRow], details: Mapping[str, str] | None = None) -> str:
    """Return the page.

    Args:
        listing: What is shown.
        rows: Its table.
        details: Episode -> its section; None where a server gives them.
    """
    table = [[getattr(row, name) for name in COLUMNS] for row in rows]
    data = {
        "columns": COLUMNS,
        "rows": table,
        "details": details,
        "command": listing.selection_command,
    }
    title = f"{listing.path.absolute().name}: {listing.kind}"
    return render("view.html", title=title, kind=listing.kind, path=str(listing.path), data=script_json(data))


COLUMNS = tuple(EpisodeRow.__dataclass_fields__)


def link_from(page: Path) -> Callable[[Path], str]:
    """Return what links files from a page in the file system."""
    folder = page.absolute().parent
    return lambda file: quote(os.path.relpath(file.absolute(), folder))
