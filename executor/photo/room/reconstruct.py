"""The whole room: furniture first, each piece among those found before it, then again among all; then what is on it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from executor.photo.fitting.body import Guess
from executor.photo.fitting.likelihood import Fit
from executor.photo.fitting.prior import CARRIED
from executor.photo.fitting.starts import stands_on_floor
from executor.photo.inputs.annotations import Sighting
from executor.photo.room.fitter import RIGHT, RoomFitter
from executor.photo.room.known import KnownRoom
from executor.photo.room.together import find_carriers, refit_pairs
from executor.photo.space.observation import Observation
from executor.photo.space.walls import Wall


@dataclass(frozen=True)
class FittedThing:
    """One thing of the reconstruction.

    Attributes:
        id: Its name in the scene.
        detection: The box and name that it comes from.
        fit: What explains it.
        boxed: Whether somebody has drawn its box.
    """

    id: str
    detection: Sighting
    fit: Fit
    boxed: bool = True


@dataclass(frozen=True)
class Unfitted:
    """A box of which no thing was made, and why."""

    detection: Sighting
    reason: str


@dataclass(frozen=True)
class FittedRoom:
    """What a picture's room is made of.

    Attributes:
        things: In the order of their boxes.
        unfitted: What was left out.
        walls: The walls.
    """

    things: tuple[FittedThing, ...]
    unfitted: tuple[Unfitted, ...]
    walls: tuple[Wall, ...]

    @property
    def guesses(self) -> dict[str, Guess]:
        """id -> what a thing is taken for."""
        return {thing.id: thing.fit.guess for thing in self.things}

    def without(self, thing: FittedThing, reason: str) -> FittedRoom:
        """Returns the room without one thing, and why."""
        rest = tuple(one for one in self.things if one is not thing)
        return replace(self, things=rest, unfitted=(*self.unfitted, Unfitted(thing.detection, reason)))


def reconstruct(
    seen: Observation,
    detections: Sequence[Sighting],
    walls: tuple[Wall, ...],
    told: Callable[[str], None] = lambda words: None,
    scale_share: float = 0.0,
    *,
    find_more: bool = False,
) -> FittedRoom:
    """Returns the things of a picture, fitted by models of the library.

    Args:
        seen: The picture in the level frame.
        detections: Boxes with names; a box without one is fitted by every model.
        walls: The walls.
        told: Is told of each thing when it is fitted for good.
        scale_share: How exactly the picture's scale is known, as a share, where there is no depth.
        find_more: Whether things are looked for that nobody has put a box around: with depth those that stand out of
            it, and without what carries those with boxes. In depths that are bent more stands out than is there, so
            that these are searched where there is no box at all.
    """
    room = KnownRoom(seen, walls, detections, scale_share)
    fitter = RoomFitter(room)
    boxes = range(len(detections))
    standing = [index for index in boxes if stands_on_floor(detections[index])]
    carried = [index for index in boxes if index not in standing]
    # What is near hides what is far, and is large in the picture.
    standing.sort(key=lambda index: -detections[index].area_px)
    carried.sort(key=lambda index: (detections[index].category not in CARRIED, -detections[index].area_px))
    _fit_furniture(fitter, standing, carried, told)
    for index in carried:
        told(fitter.fit(index, None, hidden_by=carried))
    if find_more and not seen.is_exact:
        find_carriers(fitter, told)
    _doubt_names(fitter, told)
    if find_more and seen.has_depth and (seen.is_exact or not detections):
        _fit_unboxed(fitter, carried, told)
    _look_again(fitter, standing, told)
    _judge(fitter, told)
    return _result(room)


def _fit_furniture(
    fitter: RoomFitter, standing: Sequence[int], carried: Sequence[int], told: Callable[[str], None]
) -> None:
    """Fits what stands on the floor: alone, then among the others, then as a room of which pieces agree."""
    room = fitter.room
    is_exact = room.seen.is_exact
    boxes = range(room.boxed)
    for index in standing:
        fitter.fit(index, [0.0], hidden_by=boxes)
    # They are as large as what they stand on, and hide it.
    for index in (one for one in carried if is_exact and room.detections[one].category in CARRIED):
        fitter.fit(index, None, hidden_by=boxes)
    if is_exact:
        room.look_for_walls()
    for index in standing:
        told(fitter.fit(index, [0.0], hidden_by=carried))
    for index in sorted(standing, key=room.unlikeliness, reverse=True):
        told(fitter.shake(index))
    for index in standing:
        if fitter.is_unlikely(index, RIGHT):
            told(fitter.fit_again(index, hidden_by=carried))
    if is_exact:
        refit_pairs(fitter, standing, told)
    room.straighten()
    for index in standing:
        told(fitter.sharpen(index))


def _doubt_names(fitter: RoomFitter, told: Callable[[str], None]) -> None:
    """Fits by other names what explains its box better so, or hardly explains it at all."""
    room = fitter.room
    boxes = range(room.boxed)
    for index in boxes:
        # What hardly explains its box has sides that are of no use for others.
        if not room.is_doubtful(index):
            told(fitter.rename(index))
    # Where two stand in each other, the one that explains less is the wrong one.
    for index in sorted(boxes, key=room.doubt, reverse=True):
        if room.is_doubtful(index):
            told(fitter.fit_anything(index))


def _fit_unboxed(fitter: RoomFitter, carried: Sequence[int], told: Callable[[str], None]) -> None:
    """Fits what depths show and nobody has put a box around, then what may stand on that."""
    room = fitter.room
    fitter.discover(told)
    for index in range(room.boxed):
        if index not in room.fits and not fitter.adopt(index):
            told(fitter.fit(index, None, hidden_by=carried))
        if room.is_doubtful(index):
            told(fitter.fit_anything(index))


def _look_again(fitter: RoomFitter, standing: Sequence[int], told: Callable[[str], None]) -> None:
    """Searches on for each thing among all that is known in the end, and leaves out what cannot be."""
    room = fitter.room
    if not room.seen.has_depth:
        _put_down(fitter, told)
    for index in sorted(room.fits, key=room.unlikeliness, reverse=True):
        told(fitter.shake(index))
    for index in standing:
        if fitter.is_unlikely(index):
            told(fitter.fit_again(index, hidden_by=()))
    for index in standing:
        told(fitter.sharpen(index))
    room.leave_out_what_is_inside()
    _put_down(fitter, told)


def _judge(fitter: RoomFitter, told: Callable[[str], None]) -> None:
    """Leave out what is no success after all: outside its box, or of hardly any of its pixels."""
    room = fitter.room
    room.leave_out_what_is_outside_its_box()
    for index, in_box in room.in_boxes().items():
        told(fitter.judge(index, in_box))


def _put_down(fitter: RoomFitter, told: Callable[[str], None]) -> None:
    """Fits anew what stands on nothing any more."""
    room = fitter.room
    for index in list(room.fits):
        if room.is_in_air(index):
            told(fitter.fit(index, None, hidden_by=()))


def _result(room: KnownRoom) -> FittedRoom:
    """What was found, with names."""
    counts: Counter[str] = Counter()
    things, unfitted = [], []
    for index, detection in enumerate(room.detections):
        fit = room.fits.get(index)
        if fit is None:
            unfitted.append(Unfitted(detection, room.reasons[index]))
            continue
        name = detection.name_as(fit.guess.entry)
        things.append(FittedThing(f"{name}_{counts[name]}", detection, fit, index < room.boxed))
        counts[name] += 1
    return FittedRoom(tuple(things), tuple(unfitted), room.walls)
