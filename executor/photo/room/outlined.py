"""A thing that only its box tells of: what the sensor does not see, or what no fit to the depth fills the box of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from executor.assets.parameters import ModelEntry
from executor.geometry import Array
from executor.photo.fitting.fit import by_box
from executor.photo.fitting.hypothesis import as_built, raycaster_of
from executor.photo.fitting.likelihood import Fit
from executor.photo.fitting.starts import foot_of
from executor.photo.geometry.observation import Observation
from executor.photo.inputs.annotations import FLOOR, WALL, Detection
from executor.photo.room.beneath import supports_of
from executor.photo.room.estimate import RoomEstimate
from executor.photo.room.jointly import MOST_STEPS, Jointly
from executor.photo.room.pieces import Piece, library_models, modelled, shapes_of, with_region

_NOTHING: Array = np.zeros((0, 3))


def fit_by_box(room: RoomEstimate, index: int, bottoms_m: Sequence[float] | None, *, rough: bool = False) -> Fit | None:
    """Return a fit of one box among the fits of a room with depth; None where no support is below it.

    Args:
        room: The estimate, which lacks the thing.
        index: Which detection.
        bottoms_m: Heights that it may stand on, the likeliest first; None: the floor, and tops of fits.
        rough: Whether its likeliest start does.
    """
    thing, headings = room.detections[index], room.around(index).near.headings_rad
    view = replace(
        room.observation,
        z_m=np.zeros_like(room.observation.z_m),
        heading_rad=headings[0] if headings else None,
    )
    on = supports_of(view, room.detections)
    # What seems to stand on it tells of its top: it is placed again with it, as without depth.
    carried = [one for one, below in enumerate(on) if below == index]
    known = [one for one in room.fits if one not in carried]
    pieces = [Piece(room.detections[one], room.fits[one].guess.entry, FLOOR) for one in known]
    piece = Piece(thing, entry_of(view, thing), FLOOR)
    heights_m = bottoms_m or room.heights_m(thing, _NOTHING)
    if not heights_m:
        if on[index] == WALL:
            return None
        if on[index] in known:
            piece = replace(piece, on=known.index(on[index]))
            piece = with_region(piece, pieces[piece.on])
    bottom_m = heights_m[0] if heights_m else 0.0
    if piece.on == FLOOR and bottom_m < view.eye_m[2] and foot_of(view, thing.box_px, bottom_m) is None:
        return None
    own = len(known)
    others = (Piece(room.detections[one], entry_of(view, room.detections[one]), own) for one in carried)
    problem = Jointly(view, [*pieces, piece, *(with_region(one, piece) for one in others)])
    for number, one in enumerate(known):
        problem.put(number, room.fits[one].guess)
    problem.base_m[own] = bottom_m
    problem.solve(range(own, len(problem.pieces)), 0 if rough else MOST_STEPS)
    return replace(fit_of(room, index, problem, own), rough=rough)


def entry_of(view: Observation, thing: Detection) -> ModelEntry:
    """Return the first model of what a thing is called, else the first generic shape."""
    return (library_models(thing) or shapes_of(view, thing))[0]


def fit_of(room: RoomEstimate, index: int, problem: Jointly, number: int) -> Fit:
    """Return the fit of a detection by its pose in a problem.

    Args:
        room: The estimate.
        index: Which detection.
        problem: The problem.
        number: Its piece there.
    """
    thing, guess = room.detections[index], problem.pose(number)
    if raycaster_of(guess) is None:
        guess = modelled(problem.view, thing, guess)
    around = replace(room.around(index), observation=problem.view, own=None)
    return by_box(around, thing.box_px, as_built(guess), problem.spread_m(number))
