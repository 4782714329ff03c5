"""The report card of reconstructions: what every column says over all visible things, and over furniture and items."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import fmean, median, pstdev
from typing import Any

from executor.bench.photo.score import FLIP_RAD

Room = Mapping[str, Any]
Row = Mapping[str, Any]

PRINTED = (
    "Digital Cousins as printed, RGB only, its own simulator: 39 things, L2 9.5 cm, 0.08 rad, IoU 0.65, centred 0.74"
)


def card_rows(rooms: Sequence[Room]) -> list[tuple[str, str]]:
    """Returns the lines of the table over some rooms, as names and texts."""
    rows = [("rooms", str(len(rooms)))]
    without = sum("not_photographed" in room for room in rooms)
    rooms = [room for room in rooms if "not_photographed" not in room]
    rows += [("not photographed: no such room, or no place for a camera in it", str(without))] if without else []
    things = [thing for room in rooms for thing in room["things"]]
    rows += _settled(rooms)
    for name, members in (
        ("all", things),
        ("furniture", [thing for thing in things if not thing["item"]]),
        ("items", [thing for thing in things if thing["item"]]),
    ):
        rows += [(f"{name}: {column}", value) for column, value in _columns(members)]
    rows.append(("supports: F1", _f1(rooms)))
    rows.append(("things made of nothing that is there", str(sum(len(room.get("invented", ())) for room in rooms))))
    return rows


def _settled(rooms: Sequence[Room]) -> list[tuple[str, str]]:
    done = [room for room in rooms if "took_s" in room]
    rows = [
        ("no floor or nothing recognised", str(len(rooms) - len(done))),
        ("settled in physics", _share(done, lambda room: bool(room["settled"]))),
    ]
    if done:
        took, cpu = [room["took_s"] for room in done], [room["cpu_s"] for room in done]
        rows.append(("seconds a room", f"{fmean(took):.0f}, of the processor {fmean(cpu):.0f}, at most {max(cpu):.0f}"))
    return rows


def _columns(things: Sequence[Row]) -> list[tuple[str, str]]:
    found = [thing for thing in things if thing["found"]]
    turned = [thing["turned_rad"] for thing in found if thing["turned_rad"] is not None]
    boxed = [thing for thing in things if thing["visible_iou"] is not None]
    return [
        ("visible things", str(len(things))),
        ("recall", _share(things, lambda thing: bool(thing["found"]))),
        ("category", _share(things, lambda thing: bool(thing["category_right"]))),
        ("category of those found", _share(found, lambda thing: bool(thing["category_right"]))),
        ("model", _share(things, lambda thing: bool(thing["model_right"]))),
        ("L2 [cm]", _spread([100.0 * thing["l2_m"] for thing in found], 1)),
        ("orientation [rad]", _spread(turned, 3)),
        ("turned by more than 0.5 rad", _share(turned, lambda value: value > FLIP_RAD)),
        ("box IoU, missed count 0", _spread([thing["iou"] for thing in things], 2)),
        ("box IoU of those found", _spread([thing["iou"] for thing in found], 2)),
        ("centred IoU of those found", _spread([thing["centred_iou"] for thing in found], 2)),
        ("ADD-SB at 5 %", _share(things, lambda thing: bool(thing["add_right"]))),
        ("hinge side", _agreed(things, "hinge_right")),
        ("number of drawers", _agreed(things, "drawers_right")),
        ("open or shut", _agreed(things, "open_right")),
        ("box of the true mask's points: L2 [cm]", _spread([100.0 * thing["visible_l2_m"] for thing in boxed], 1)),
        ("box of the true mask's points: IoU", _spread([thing["visible_iou"] for thing in boxed], 2)),
    ]


def _agreed(things: Sequence[Row], key: str) -> str:
    """Over things of which it can be said; of one that was taken for another model it is wrong."""
    return _share([thing for thing in things if thing[key] is not None], lambda thing: bool(thing[key]))


def _share(members: Iterable[Any], holds: Callable[[Any], bool]) -> str:
    every = list(members)
    good = sum(holds(one) for one in every)
    return f"{100 * good / len(every):.1f} % ({good} of {len(every)})" if every else "none"


def _spread(values: Sequence[float], digits: int) -> str:
    if not values:
        return "none"
    return f"{fmean(values):.{digits}f} ± {pstdev(values):.{digits}f}, median {median(values):.{digits}f}"


def _f1(rooms: Sequence[Room]) -> str:
    both, true, made = (sum(room["supports"][part] for room in rooms if "supports" in room) for part in range(3))
    return f"{2 * both / (true + made):.3f} ({both} right of {true} true and {made} made)" if true + made else "none"
