"""What things tell of each other, where a search for one of them cannot find it.

Two that are each taken for what is seen of the other are fitted together. By sight, what stands on nothing known tells
that something is under it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_fill_holes

from executor.assets.library import LIBRARY
from executor.photo.fitting.starts import stands_on_floor
from executor.photo.inputs.annotations import Sighting
from executor.photo.room.fitter import RIGHT, RoomFitter
from executor.photo.space.appearance import of_one_hue
from executor.photo.space.standing_out import are_alike, box_of
from llm.sight.forms import overlap

OF_ONE_HUE = "of one hue under what has a box"
"""Who found what nobody has put a box around."""

_TOPS = ("table", "coffee_table", "desk", "desk_with_drawers", "nightstand", "shelf", "bottom_cabinet", "countertop")
"""What things are put on."""

_FOOT_PX = 3  # Below a box's end, where its foot may be seen to stand.


def refit_pairs(fitter: RoomFitter, standing: Sequence[int], told: Callable[[str], None]) -> None:
    """Fits two things anew, the first one as if nothing were known of the other, where both cost less so.

    Looked at are those of some things that explain too little of their boxes, which have pixels in common.

    Args:
        fitter: Of the room.
        standing: Numbers of furniture, the largest boxes first.
        told: Is told of each thing.
    """
    room = fitter.room
    for index, other in itertools.combinations(standing, 2):
        if not {index, other} <= room.fits.keys() or max(room.fits[one].explained for one in (index, other)) > RIGHT:
            continue
        if overlap(room.detections[index].box_px, room.detections[other].box_px) == 0.0:
            continue
        with _cheaper_only(fitter, (index, other)):
            room.take(index)
            room.take(other)
            told(fitter.fit(index, [0.0], hidden_by=(other,)))
            told(fitter.fit(other, [0.0], hidden_by=()))


def find_carriers(fitter: RoomFitter, told: Callable[[str], None]) -> None:
    """By sight, fits what things stand on that stand on nothing known: what is of one hue around them is one thing.

    Then those are fitted on it, and all that is seen on it.
    """
    room, carriers = fitter.room, [entry for entry in LIBRARY.values() if entry.category in _TOPS]
    tried: list[NDArray[np.bool_]] = []
    for index in sorted(fitter.on_nothing, key=lambda one: -room.detections[one].area_px):
        piece = of_one_hue(room.seen.rgb, room.detections[index].box_px) if index not in room.fits else None
        if piece is None or any(are_alike(piece, other) for other in tried):
            continue
        tried.append(piece)
        room.detections.append(Sighting("", None, box_of(piece), 0.0, OF_ONE_HUE, provenance="search"))
        carrier = len(room.detections) - 1
        told(fitter.fit_anything(carrier, entries=carriers))
        if carrier not in room.fits:
            continue
        told(fitter.sharpen(carrier))
        around = binary_fill_holes(piece)
        for other, detection in enumerate(room.detections[: room.boxed]):
            if not stands_on_floor(detection) and _has_foot_in(detection, around):
                told(fitter.fit(other, None, hidden_by=()))


@contextmanager
def _cheaper_only(fitter: RoomFitter, indices: Sequence[int]) -> Iterator[None]:
    """Puts fits back where the block has made them cost no less, all of them together."""
    before = {index: fitter.room.fits[index] for index in indices}
    cost = sum(map(fitter.cost, indices))
    yield
    if not sum(map(fitter.cost, indices)) < cost:
        for index, fit in before.items():
            fitter.room.keep(index, fit)


def _has_foot_in(detection: Sighting, piece: NDArray[np.bool_]) -> bool:
    """Whether a box ends in a piece of the picture (H, W)."""
    x0, _, x1, y1 = detection.box_px
    height, width = piece.shape
    column = min(width - 1, round((x0 + x1) / 2))
    return bool(piece[min(height - 1, max(0, round(y1) - 1)) : round(y1) + _FOOT_PX, column].any())
