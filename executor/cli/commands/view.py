"""`scene2demo view`: look at runs, stores, benchmarks, evaluations, exported sets and scenes in a browser."""

from __future__ import annotations

import webbrowser
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from bddl.terminal import pluralize
from executor.cli.errors import DONE, BadOption, check
from executor.cli.options import CommonOptions, Flag, Maybe, ReplaceFile
from executor.cli.output import counting, print_json, say, tell

if TYPE_CHECKING:
    from executor.reports.episode import EpisodeDetail, EpisodeRow
    from executor.view.records import Listing

MOST_IN_A_PAGE = 200
"""Episodes whose details fit into one file; a server gives any number."""
MOST_IN_A_RECORDING = 20


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
    """Write the page into this HTML file instead; videos are linked from where they lie. With --rerun: the recording,
    FILE.rrd."""
    force: ReplaceFile = False
    episode: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    """With --out or --rerun: an episode to show, by its name in the table; may be given several times."""
    rerun: Flag = False
    """Open a recording in Rerun instead of a page, with videos, curves, steps and the scene (extra `rerun`)."""
    port: int = 0
    """Port of the server; 0 takes any that is free."""
    no_open: Flag = False
    """Print the address, and open no browser."""


def execute(options: Options) -> int:
    """Serve a page until Ctrl-C, or write it or a recording; return 0."""
    from executor.cli.inputs import refuse_existing

    if not 0 <= options.port <= 65535:
        raise BadOption("--port", options.port, "0 to 65535")
    folder = Path(options.what)
    check(
        folder.is_dir() or not options.rerun, "--rerun", options.what, "a folder with episodes, which a scene has not"
    )
    served = options.out is None and not options.rerun
    check(not (served and options.episode), "--episode", " ".join(options.episode), "--out or --rerun with it")
    if served:
        _serve(options, folder)
        return DONE
    if options.out is not None:
        refuse_existing(options.out, force=options.force)
    if options.rerun:
        _record(options, folder)
    else:
        assert options.out is not None
        _write(options.out, _page_of(options, folder, options.out) if folder.is_dir() else _page_of_scene(options.what))
    if options.json:
        key = "recording" if options.rerun else "page"
        print_json({"ok": True, key: None if options.out is None else str(options.out)})
    elif options.out is not None:
        tell(f"written: {options.out}")
    return DONE


def _record(options: Options, folder: Path) -> None:
    from executor.system.extras import require
    from executor.view.page import listing_of
    from executor.view.recording import EXTRA, record

    require("rerun", EXTRA)
    listing = listing_of(folder)
    rows = _chosen(options, listing, MOST_IN_A_RECORDING, "recording")
    with counting("writing the recording", quiet=options.json) as show:

        def detail(number: int, name: str) -> EpisodeDetail:
            show(number, len(rows))
            return listing.detail(name)

        record((detail(number, row.name) for number, row in enumerate(rows)), options.out)


def _chosen(options: Options, listing: Listing, most: int, what: str) -> Sequence[EpisodeRow]:
    """Return the rows of the episodes that are asked for.

    Args:
        options: The typed options.
        listing: What is shown.
        most: How many there may be.
        what: What holds no more of them.
    """
    rows = listing.rows()
    names = {row.name: row for row in rows}
    for name in options.episode:
        check(name in names, "--episode", name, f"one of {listing.path}, such as {', '.join(list(names)[:3])}")
    rows = [names[name] for name in dict.fromkeys(options.episode)] or rows
    expected = f"at most {most} episodes for a {what}: choose some by --episode NAME"
    check(len(rows) <= most, str(listing.path), f"has {len(rows)}", expected)
    return rows


def _write(path: Path, page: str) -> None:
    from executor.system.files import write_text

    write_text(path, page)


def _page_of_scene(name: str) -> str:
    from executor.scenes.file import load_with_notes
    from executor.view.scene_view import scene_page

    return scene_page(load_with_notes(name).scene)


def _page_of(options: Options, folder: Path, out: Path) -> str:
    from executor.reports.episode import episode_section
    from executor.view.page import link_from, listing_of, viewer_page

    listing = listing_of(folder)
    rows = _chosen(options, listing, MOST_IN_A_PAGE, "file, where a server gives any number")
    link = link_from(out)
    return viewer_page(listing, rows, {row.name: episode_section(listing.detail(row.name), link) for row in rows})


def _serve(options: Options, folder: Path) -> None:
    from executor.view.server import ViewServer

    listing: Listing | None = None
    if folder.is_dir():
        from executor.view.page import listing_of, viewer_page

        listing = listing_of(folder)
        rows = listing.rows()
        page = viewer_page(listing, rows)
        what = f"{listing.kind} with {pluralize(len(rows), 'episode')}"
    else:
        page, what = _page_of_scene(options.what), "scene"
    try:
        server = ViewServer({"/": lambda: page}, listing, options.port)
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
