"""`scene2demo bench photo`: reconstructions of real pictures or drawn rooms, compared with what is known of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from executor.cli.errors import DONE, check
from executor.cli.options import CommonOptions, Flag, Maybe, ResultsFolder, RobotName
from executor.cli.output import OUT, print_json, say, tell
from executor.system.files import write_json


@dataclass(frozen=True)
class Options(CommonOptions):
    """Measure how good reconstructions from photographs are, on real pictures or on rooms that are known.

    With --pictures: each picture is reconstructed with the boxes and names that a person gave it, and each of its
    sentences is planned and executed in its scene. Otherwise rooms are drawn from a seed and seen by a camera. Each
    track gives the reconstruction other inputs. Its title says which inputs come from the simulator. Goes on where an
    earlier run with the same folder ended.
    """

    out: ResultsFolder
    pictures: Maybe[Path] = None
    """Folder of real pictures, which `python -m benchmarks.pictures.fetch` fills; in place of drawn rooms."""
    annotations: Path = Path("benchmarks/pictures")
    """With --pictures: folder with pictures.toml, and annotations/ID.json of each picture."""
    half: Maybe[Literal["tuning", "judging"]] = None
    """With --pictures: one half; by default both."""
    only: Maybe[tuple[str, ...]] = None
    """With --pictures: ids of some pictures; by default all."""
    limit_s: float = 300.0
    """With --pictures: most CPU seconds of a picture and its sentences."""
    robot: RobotName = None
    rooms: int = 20
    """How many rooms of households: 102 of a seed, then of the next one."""
    kitchens: int = 0
    """How many kitchens of T1 to T4 as well."""
    seed: int = 0
    """Of the rooms, the cameras and the noise."""
    track: Literal["A", "B", "D", "E", "F", "G", "S"] = "B"
    """A: clean depth, the simulator's masks (an upper bound). B: noisy depth and spoilt boxes.
    D: boxes and the camera's height, no depth. E: the same with depth as bent as a network's. F: noisy depth and what
    --detector finds. G: B with foreign shapes. S: B with the depth noise of real sensors."""
    detector: Maybe[Path] = None
    """Of track F: folder with a detector's weights (docs/photo.md says which)."""
    transfer: Flag = False
    """Plan in the reconstructions and execute in the true rooms, with and without self-evolution."""


def execute(options: Options) -> int:
    """Measure, print the report card, and return 0 when all is measured; what is finished is kept."""
    if options.pictures is not None:
        return _execute_pictures(options, options.pictures)
    stray = next((name for name in ("half", "only", "robot") if getattr(options, name)), "")
    check(not stray, f"--{stray.replace('_', '-')}", getattr(options, stray, ""), "--pictures with it")
    return _execute_rooms(options)


def _execute_pictures(options: Options, folder: Path) -> int:
    """Measure real pictures and print their tables."""
    from executor.bench.photo.picture_score import causes, picture_rows, sections
    from executor.bench.photo.pictures import measure_pictures, read_pictures

    check(not options.transfer, "--transfer", "", "no --pictures with it, of which the true rooms are not known")
    check(options.detector is None, "--detector", options.detector, "no --pictures with it, which have boxes")
    check(1.0 <= options.limit_s <= 1e6, "--limit-s", options.limit_s, "seconds from 1 to 1000000")
    chosen = read_pictures(options.annotations, folder, options.half, options.only or ())
    options.out.mkdir(parents=True, exist_ok=True)
    on_picture = _silent if options.json else _tell_picture
    done = list(measure_pictures(options.out, chosen, on_picture, limit_s=options.limit_s, robot=options.robot or ""))
    parts: dict[str, dict[str, Any]] = {
        name: {"card": dict(picture_rows(some)), **causes(some)} for name, some in sections(done).items()
    }
    write_json(options.out / "summary.json", {"pictures": len(done), "sections": parts})
    if options.json:
        print_json({"ok": True, "sections": parts, "pictures": [one.name for one in chosen]})
        return DONE
    for name, part in parts.items():
        _print_table(name, part["card"].items())
        for subject, counts in part.items():
            if counts and subject != "card":
                say(f"{subject} that failed: " + "; ".join(f"{count} {cause}" for cause, count in counts.items()))
    return DONE


def _print_table(title: str, rows: Iterable[tuple[str, str]]) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.markup import escape
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, title=title, title_justify="left", show_header=False)
    for name, value in rows:
        table.add_row(escape(name), escape(value))
    OUT.print(table)


def _execute_rooms(options: Options) -> int:
    """Measure drawn rooms and print their table."""
    from executor.bench.photo.measure import CAMERA, measure, transfer, transfer_rows
    from executor.bench.photo.rooms import HOUSEHOLD, MOST_ROOMS, drawn
    from executor.bench.photo.score import PRINTED, card_rows
    from executor.bench.photo.tracks import TITLES, MockedDetector
    from executor.photo.networks.detect import detector_in

    check(options.seed >= 0, "--seed", options.seed, "a whole number from 0")
    check(0 <= options.rooms <= MOST_ROOMS, "--rooms", options.rooms, f"0 to {MOST_ROOMS}")
    check(0 <= options.kitchens <= MOST_ROOMS, "--kitchens", options.kitchens, f"0 to {MOST_ROOMS}")
    check(options.rooms + options.kitchens > 0, "--rooms", options.rooms, "at least 1, or --kitchens with it")
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
        footnote = f"for comparison: {PRINTED}"
        homes = [room for room in done if room["family"] == HOUSEHOLD]
        parts = {"households": homes, "kitchens": [room for room in done if room not in homes]}
        summary |= {name: dict(card_rows(some)) for name, some in parts.items() if some}
    write_json(options.out / "summary.json", {"title": title, "card": dict(rows), **summary})
    if options.json:
        print_json({"ok": True, "title": title, "card": dict(rows), "rooms": [room.name for room in rooms]})
        return DONE
    _print_table(title, rows)
    if footnote:
        say(footnote)
    return DONE


def _silent(room: Mapping[str, Any]) -> None:
    pass


def _tell_picture(picture: Mapping[str, Any]) -> None:
    things, sentences = picture["things"], picture["sentences"]
    named, asked = sum(one["named"] for one in things), sum(one["as_asked"] for one in sentences)
    end = picture["refused"].splitlines()[0] if picture["refused"] else f"{asked} of {len(sentences)} sentences done"
    tell(f"  {picture['picture']:20} {named} of {len(things)} labels kept, {end}, {picture['cpu_s']:.0f} s")


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
