"""A room without depth: what stands on what by boxes and names, then all places and sizes at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from executor.assets.families.generic import SHELF
from executor.photo.errors import LostCause
from executor.photo.fitting.likelihood import Fit
from executor.photo.inputs.annotations import FLOOR, WALL
from executor.photo.room.beneath import ends_above_horizon, supports_of
from executor.photo.room.estimate import RoomEstimate
from executor.photo.room.fitter import as_named, hung_models
from executor.photo.room.hanging import hung
from executor.photo.room.jointly import MOST_STEPS, Jointly
from executor.photo.room.outlined import entry_of, fit_of
from executor.photo.room.pieces import Piece, on_boards, with_region


def fit_without_depth(
    room: RoomEstimate,
    kept: Mapping[int, Fit],
    on_progress: Callable[[str], None],
    *,
    rough: bool = False,
    begun: Jointly | None = None,
) -> Jointly:
    """Fit every thing of a picture without depth; return the problem that is solved.

    Args:
        room: The estimate, with the fits that stay; it gets the others.
        kept: index -> fit that stays.
        on_progress: Called with a sentence about each step.
        rough: Whether each thing alone does, without all of them at once.
        begun: The same problem as it was solved roughly: nothing is started twice.
    """
    view, things = room.observation, room.detections
    on = supports_of(view, things)
    for index, thing in enumerate(things):
        if on[index] == FLOOR and ends_above_horizon(view, things, index):
            on[index] = WALL if hung_models(thing) else FLOOR
            if on[index] == FLOOR and index not in kept:
                room.lost[index] = LostCause.STANDS
    on = [FLOOR if below in room.lost else below for below in on]
    room.on.update({index: below for index, below in enumerate(on) if below >= 0})
    pieces = [Piece(thing, entry_of(view, thing), on[index]) for index, thing in enumerate(things)]
    pieces = [with_region(piece, pieces[piece.on]) if piece.on >= 0 else piece for piece in pieces]
    pieces = on_boards(view, pieces)
    problem = Jointly(view, pieces)
    if begun is not None:
        problem.go_on(begun)
    for index, fit in kept.items():
        problem.put(index, fit.guess)
    roots = [_root(on, index) for index in range(len(things))]
    standing = [index for index in range(len(things)) if on[roots[index]] != WALL and index not in kept]
    standing = [index for index in standing if index not in room.lost]
    on_progress(f"fitting {len(standing)} things at once")
    problem.solve(standing, 0 if rough else MOST_STEPS)
    for index in standing:
        room.add_fit(index, fit_of(room, index, problem, index))
    hanging = [index for index in range(len(things)) if on[index] == WALL and index not in kept]
    for index in hanging:
        on_progress(f"fitting: {things[index].label or 'thing'} on a wall")
        on_wall = hung(room, index, room.around(index), WALL)
        if on_wall is None:
            # Its box looks beside every wall.
            problem.pieces[index] = replace(problem.pieces[index], on=FLOOR)
            continue
        if pieces[index].entry.model == SHELF:
            on_wall = replace(on_wall, guess=replace(on_wall.guess, entry=pieces[index].entry, parameters=()))
        room.add_fit(index, on_wall)
        problem.put(index, on_wall.guess)
    rest = [index for index in range(len(things)) if index not in room.fits and index not in room.lost]
    if rest:
        problem.solve(rest, 0 if rough else MOST_STEPS)
        for index in rest:
            room.add_fit(index, fit_of(room, index, problem, index))
    for index in hanging:
        if pieces[index].entry.model == SHELF and index in room.fits:
            shelf = room.fits[index]
            room.remove_fit(index)
            room.add_fit(index, replace(shelf, guess=replace(problem.pose(index), fixed=shelf.guess.fixed)))
    for index in range(len(things)):
        if index in room.fits and index not in kept:
            found = as_named(room.fits[index], things[index])
            room.remove_fit(index)
            room.add_fit(index, found)
            room.fits[index] = replace(found, in_box=room.in_box(index), rough=rough)
    return problem


def _root(on: Sequence[int], index: int) -> int:
    while on[index] >= 0:
        index = on[index]
    return index
