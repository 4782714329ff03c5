"""`scene2demo view`: look at runs, stores, benchmarks, evaluations, exported sets and scenes in a browser."""

from __future__ import annotations

import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from executor.cli.errors import DONE, BadOption
from executor.cli.options import CommonOptions, Flag, Maybe, ReplaceFile
from executor.cli.output import print_json, say, tell

if TYPE_CHECKING:
    from executor.view.records import Listing

MOST_IN_A_PAGE = 200
"""Episodes whose details fit into one file; a server gives any number."""


@dataclass(frozen=True)
class Options(CommonOptions):
    """Open a page of what was made: a table of episodes, and of each its videos, steps, proof and curves.

    A small server on this machine gives the page until Ctrl-C; nothing is asked of any other. A scene is shown in 3-D.
    """

    what: tyro.conf.Positional[
        Annotated[
            str,
            tyro.conf.arg(
                metavar="FOLDER|SCENE",
                help="Folder of a run, a store, a benchmark, an evaluation or an exported LeRobot data set; or a "
                "scene's name or JSON file.",
                help_behavior_hint="(required)",
            ),
        ]
    ]
    out: Maybe[Path] = None
    """Write the page into this HTML file instead; videos are linked from where they lie."""
    force: ReplaceFile = False
    port: int = 0
    """Port of the server; 0 takes any that is free."""
    no_open: Flag = False
    """Print the address, and open no browser."""


def execute(options: Options) -> int:
    """Serve a page until Ctrl-C, or write it; return 0."""
    from executor.cli.inputs import refuse_existing

    if not 0 <= options.port <= 65535:
        raise BadOption("--port", options.port, "0 to 65535")
    folder = Path(options.what)
    if options.out is not None:
        refuse_existing(options.out, force=options.force)
        _write(options.out, _page_of_scene(options.what) if not folder.is_dir() else _page_of(folder, options.out))
        if options.json:
            print_json({"ok": True, "page": str(options.out)})
        else:
            tell(f"written: {options.out}")
        return DONE
    _serve(options, folder)
    return DONE


def _write(path: Path, page: str) -> None:
    from executor.system.files import write_text

    write_text(path, page)


def _page_of_scene(name: str) -> str:
    from executor.scenes.file import load_with_notes
    from executor.view.scene_view import scene_page

    return scene_page(load_with_notes(name).scene)


def _page_of(folder: Path, out: Path) -> str:
    from executor.view.page import detail_json, link_from, listing_of, viewer_page

    listing = listing_of(folder)
    rows = listing.rows()
    if len(rows) > MOST_IN_A_PAGE:
        expected = (
            f"no --out for {len(rows)} episodes, of which a server gives any number: a file holds {MOST_IN_A_PAGE}"
        )
        raise BadOption("--out", out, expected)
    link = link_from(out)
    return viewer_page(listing, rows, {row.name: detail_json(listing.detail(row.name), link) for row in rows})


def _serve(options: Options, folder: Path) -> None:
    from executor.view.server import ViewServer

    listing: Listing | None = None
    pages: dict[str, Callable[[], str]] = {}
    if folder.is_dir():
        from executor.view.page import listing_of, viewer_page

        listing = listing_of(folder)
        rows = listing.rows()
        page = viewer_page(listing, rows)
        what = f"{listing.kind} with {len(rows)} {'episode' if len(rows) == 1 else 'episodes'}"
    else:
        page, what = _page_of_scene(options.what), "scene"
    pages["/"] = lambda: page
    try:
        server = ViewServer(pages, listing, options.port)
    except OSError as problem:
        raise BadOption("--port", options.port, f"a port that is free ({problem.strerror})") from problem
    with server:
        if options.json:
            print_json({"ok": True, "kind": what, "address": server.address})
        else:
            say(f"{what}: {server.address} (Ctrl-C ends it)")
        if not options.no_open:
            webbrowser.open(server.address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            return
