"""`scene2demo bench photo`: reconstructions from photographs of known rooms, compared with what they are."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.table import Table

from executor.bench.photo.card import PRINTED, TITLES, card_rows
from executor.bench.photo.measure import measure
from executor.bench.photo.sensor import Detector
from executor.cli.errors import DONE, check
from executor.cli.output import OUT, print_json, say, tell
from executor.cli.words.running import BenchPhotoOptions
from executor.machine.files import write_json
from executor.scenes import household


def execute(options: BenchPhotoOptions) -> int:
    """Measures, prints the report card, and returns 0 when every room is done; rooms that are done are kept."""
    most = household.COUNT
    check(options.seed >= 0, "--seed", options.seed, "a whole number from 0")
    check(1 <= options.rooms <= most, "--rooms", options.rooms, f"1 to {most}")
    options.out.mkdir(parents=True, exist_ok=True)
    told = (lambda room: None) if options.json else _tell
    rooms = list(measure(options.out, options.seed, options.rooms, Detector(), told, options.track))
    title = TITLES[options.track]
    rows = card_rows(rooms)
    write_json(options.out / "summary.json", {"title": title, "card": dict(rows), "seed": options.seed})
    if options.json:
        print_json({"ok": True, "title": title, "card": dict(rows), "rooms": [room["room"] for room in rooms]})
        return DONE
    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left", show_header=False)
    for name, value in rows:
        table.add_row(name, value)
    OUT.print(table)
    say(f"beside it: {PRINTED}")
    return DONE


def _tell(room: Mapping[str, Any]) -> None:
    things = room["things"]
    found = [thing for thing in things if thing["found"]]
    right = sum(thing["model_right"] for thing in things)
    end = room["refused"].splitlines()[0] if room["refused"] else "settled"
    tell(f"  {room['room']:28} {len(found)} of {len(things)} found, {right} models right, {end}")
