"""Reconstruct rooms that are drawn from a seed, and compare them with their exact scenes.

    python -m benchmarks.drawn_rooms --out runs/guard --track B --rooms 40 --seed 94500

B: noisy depth and spoilt boxes. D: boxes, height and tilt of the camera, no depth. S: B with the noise of real sensors.
A run with the same folder goes on where the earlier one ended.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks.drawn_rooms.measure import measure
from benchmarks.drawn_rooms.rooms import HOUSEHOLD, drawn
from benchmarks.drawn_rooms.score import card_rows
from benchmarks.drawn_rooms.tracks import TITLES, MockedDetector
from executor.system.files import write_json


def main() -> None:
    """Measure the rooms of a seed and print their table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--track", choices=list(TITLES), default="B")
    parser.add_argument("--rooms", type=int, default=20, help="of households: 102 of a seed, then of the next one")
    parser.add_argument("--kitchens", type=int, default=0, help="of T1 to T4")
    parser.add_argument("--seed", type=int, default=0, help="of the rooms, the cameras and the noise")
    options = parser.parse_args()
    if min(options.seed, options.rooms, options.kitchens) < 0 or not options.rooms + options.kitchens:
        parser.error("expected --seed, --rooms and --kitchens of at least 0, and at least one room or kitchen")
    options.out.mkdir(parents=True, exist_ok=True)
    rooms = drawn(options.seed, options.rooms, options.kitchens)
    done = list(measure(options.out, rooms, MockedDetector(), _tell, options.track))
    homes = [room for room in done if room["family"] == HOUSEHOLD]
    parts = {"households": homes, "kitchens": [room for room in done if room not in homes]}
    card = card_rows(done)
    named = {name: dict(card_rows(some)) for name, some in parts.items() if some}
    write_json(options.out / "summary.json", {"title": TITLES[options.track], "card": dict(card), **named})
    print(TITLES[options.track])
    for name, value in card:
        print(f"  {name:45} {value}")


def _tell(room: Mapping[str, Any]) -> None:
    things = room["things"]
    found = sum(thing["found"] for thing in things)
    right = sum(thing["model_right"] for thing in things)
    end = room["refused"].splitlines()[0] if room["refused"] else "settled"
    print(f"  {room['room']:28} {found} of {len(things)} found, {right} models right, {end}", flush=True)


if __name__ == "__main__":
    main()
