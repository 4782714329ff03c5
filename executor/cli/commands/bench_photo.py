"""`scene2demo bench photo`: reconstructions from photographs of known rooms, compared with the rooms themselves."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from executor.cli.errors import DONE, check
from executor.cli.options import CommonOptions, Flag, Maybe, ResultsFolder
from executor.cli.output import OUT, print_json, say, tell
from executor.system.files import write_json


@dataclass(frozen=True)
class Options(CommonOptions):
    """Measure how good reconstructions from photographs are, on rooms that are known.

    Rooms are drawn from a seed and seen by a camera. Each track gives the reconstruction other inputs. Its title says
    which inputs come from the simulator. Goes on where an earlier run with the same folder ended.
    """

    out: ResultsFolder
    rooms: int = 20
    """How many rooms of households: 102 of a seed, then of the next one."""
    kitchens: int = 0
    """How many kitchens of T1 to T4 beside them."""
    seed: int = 0
    """Of the rooms, the cameras and the noise."""
    track: Literal["A", "B", "C", "D", "E", "F", "G"] = "B"
    """A: clean depth, the simulator's masks (an upper bound). B: noisy depth and spoilt boxes. C: noisy depth alone.
    D: boxes and the camera's height, no depth. E: the same with depth as bent as a network's. F: noisy depth and what
    --detector finds. G: B with foreign shapes."""
    detector: Maybe[Path] = None
    """Of track F: folder with a detector's weights (docs/photo.md says which)."""
    transfer: Flag = False
    """Plan in the reconstructions and execute in the true rooms, with and without self-evolution."""


def execute(options: Options) -> int:
    """Measure, print the report card, and return 0 when every room is done; finished rooms are kept."""
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    from executor.bench.photo.measure import CAMERA, measure, transfer, transfer_rows
    from executor.bench.photo.rooms import HOUSEHOLD, MOST_ROOMS, drawn
    from executor.bench.photo.score import PRINTED, card_rows
    from executor.bench.photo.tracks import TITLES, MockedDetector
    from executor.photo.perception import detector_in

    check(options.seed >= 0, "--seed", options.seed, "a whole number from 0")
    check(0 <= options.rooms <= MOST_ROOMS, "--rooms", options.rooms, f"0 to {MOST_ROOMS}")
    check(0 <= options.kitchens <= MOST_ROOMS, "--kitchens", options.kitchens, f"0 to {MOST_ROOMS}")
    check(options.rooms + options.kitchens > 0, "--rooms", options.rooms, "at least 1, or --kitchens beside it")
    check(not options.transfer or options.track != "G", "--track", options.track, "one with a query's own things")
    same = (options.track == "F") == (options.detector is not None) and not (options.track == "F" and options.transfer)
    check(same, "--detector", options.detector, "a folder with --track F, which measures rooms; none otherwise")
    detect = None if options.detector is None else detector_in(options.detector)
    options.out.mkdir(parents=True, exist_ok=True)
    rooms, detector = drawn(options.seed, options.rooms, options.kitchens), MockedDetector()
    summary: dict[str, Any] = {"seed": options.seed, "rooms": options.rooms, "kitchens": options.kitchens}
    if options.transfer:
        done = list(transfer(options.out, rooms, detector, _silent if options.json else _tell_pair, options.track))
        rows, title = transfer_rows(done), f"transfer of plans, {TITLES[options.track]}; {CAMERA}"
        footnote = ""
    else:
        done = list(measure(options.out, rooms, detector, _silent if options.json else _tell, options.track, detect))
        rows, title = card_rows(done), TITLES[options.track]
        footnote = f"beside it: {PRINTED}"
        homes = [room for room in done if room["family"] == HOUSEHOLD]
        parts = {"households": homes, "kitchens": [room for room in done if room not in homes]}
        summary |= {name: dict(card_rows(some)) for name, some in parts.items() if some}
    write_json(options.out / "summary.json", {"title": title, "card": dict(rows), **summary})
    if options.json:
        print_json({"ok": True, "title": title, "card": dict(rows), "rooms": [room.name for room in rooms]})
        return DONE
    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left", show_header=False)
    for name, value in rows:
        table.add_row(escape(name), escape(value))
    OUT.print(table)
    if footnote:
        say(footnote)
    return DONE


def _silent(room: Mapping[str, Any]) -> None:
    pass


def _tell_pair(unit: Mapping[str, Any]) -> None:
    if "not_drawn" in unit:
        tell(f"  {unit['pair']:28} {unit['not_drawn'].splitlines()[0]}")
        return
    end = "succeeded" if unit["transferred"] else f"{unit['stage']}: {unit['why'].splitlines()[0]}"
    after = ", succeeded when revised" if unit["evolved"] and not unit["transferred"] else ""
    straight = "" if unit["in_true_room"]["succeeded"] else "; failed in the true room as well"
    tell(f"  {unit['pair']:28} {end}{after}{straight}")


def _tell(room: Mapping[str, Any]) -> None:
    things = room["things"]
    found = [thing for thing in things if thing["found"]]
    right = sum(thing["model_right"] for thing in things)
    end = room["refused"].splitlines()[0] if room["refused"] else "settled"
    tell(f"  {room['room']:28} {len(found)} of {len(things)} found, {right} models right, {end}")
