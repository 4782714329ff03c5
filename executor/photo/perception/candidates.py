"""From what a detector writes down to things of the library: named, inside the picture, each of them once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from executor.photo.inputs.annotations import FLOOR, LEAST_PX, Detections, LeftOut, Sighting, category_named
from executor.scenes.cousins.likeness import FLAT, Unlike
from llm.sight.forms import Box, overlap

SAME = 0.7
"""Overlap from which two boxes are of one thing, whatever it is called: what is on furniture fills less of it."""


@dataclass(frozen=True)
class FoundBox:
    """One box as a detector wrote it.

    Attributes:
        label: Its name, in the detector's own words.
        box_px: x0, y0, x1, y1, which may reach over the picture's border.
        score: 0 to 1.
        doors, drawers: How many it is told to have, or None.
        on: Index among the candidates of what it is told to stand on, FLOOR, or None.
    """

    label: str
    box_px: Box
    score: float = 1.0
    doors: int | None = None
    drawers: int | None = None
    on: int | None = None


def unlike(label: str) -> str | None:
    """Returns why the library has nothing for a label, with near names; None where it has something."""
    try:
        category_named(label)
    except Unlike as reason:
        return str(reason)
    return None


def sorted_out(candidates: Sequence[FoundBox], size_px: tuple[int, int], source: str) -> Detections:
    """Returns what of a detector's boxes a scene can be made of, and what else there was.

    Of boxes that overlap nearly whole the surest one stays, the first among equals; what hangs flat is left out.

    Args:
        candidates: The boxes.
        size_px: Width and height of the picture.
        source: Who found them, for people.
    """
    width, height = size_px
    kept: dict[int, Sighting] = {}
    left_out = []
    for index in sorted(range(len(candidates)), key=lambda index: -candidates[index].score):
        one = candidates[index]
        x0, y0 = max(0.0, one.box_px[0]), max(0.0, one.box_px[1])
        box = (x0, y0, min(float(width), one.box_px[2]), min(float(height), one.box_px[3]))
        if min(box[2] - box[0], box[3] - box[1]) < LEAST_PX or one.label.lower() in FLAT:
            continue
        reason = unlike(one.label)
        if reason is not None:
            left_out.append(LeftOut(one.label, box, reason))
        elif all(overlap(box, other.box_px) < SAME for other in kept.values()):
            category = category_named(one.label)
            kept[index] = Sighting(
                one.label,
                category,
                box,
                one.score,
                source,
                doors=one.doors,
                drawers=one.drawers,
                provenance="detector",
            )
    places = {index: place for place, index in enumerate(sorted(kept))}
    places[FLOOR] = FLOOR
    things = []
    for index in sorted(kept):
        on = candidates[index].on
        things.append(replace(kept[index], on=None if on is None else places.get(on)))
    return Detections(tuple(things), tuple(left_out))
