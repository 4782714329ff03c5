"""Fit the whole room: furniture one by one, again among all others, then the things on it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from executor.photo.errors import LostCause
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.likelihood import Fit
from executor.photo.fitting.starts import stands_on_floor
from executor.photo.geometry.observation import Observation
from executor.photo.geometry.walls import Wall
from executor.photo.inputs.annotations import Detection
from executor.photo.room.estimate import RoomEstimate
from executor.photo.room.fitter import RoomFitter


@dataclass(frozen=True)
class FittedThing:
    """One object of the reconstruction.

    Attributes:
        id: Its id in the scene.
        detection: Its detection.
        fit: Its fit.
    """

    id: str
    detection: Detection
    fit: Fit


@dataclass(frozen=True)
class Unfitted:
    """A detection that is not in the room, and why.

    Attributes:
        detection: The detection.
        cause: The kind of reason.
        detail: What is known beyond that, for people.
    """

    detection: Detection
    cause: LostCause
    detail: str = ""

    @property
    def reason(self) -> str:
        """The reason, for people."""
        return f"{self.cause.value}: {self.detail}" if self.detail else self.cause.value


@dataclass(frozen=True)
class FittedRoom:
    """The fitted room of a picture.

    Attributes:
        things: In the order of their boxes.
        unfitted: Detections that were left out.
        walls: The walls.
    """

    things: tuple[FittedThing, ...]
    unfitted: tuple[Unfitted, ...]
    walls: tuple[Wall, ...]

    @property
    def guesses(self) -> dict[str, PoseHypothesis]:
        """id -> pose hypothesis."""
        return {thing.id: thing.fit.guess for thing in self.things}

    def without(self, thing: FittedThing, cause: LostCause, detail: str) -> FittedRoom:
        """Remove one object from the room, with a reason."""
        rest = tuple(one for one in self.things if one is not thing)
        return replace(self, things=rest, unfitted=(*self.unfitted, Unfitted(thing.detection, cause, detail)))


def reconstruct(
    observation: Observation,
    detections: Sequence[Detection],
    walls: tuple[Wall, ...],
    on_progress: Callable[[str], None] = lambda words: None,
    scale_share: float = 0.0,
) -> FittedRoom:
    """Fit the objects of a picture by models of the library, or by generic shapes.

    Args:
        observation: The picture in the level frame.
        detections: Boxes with labels.
        walls: The walls.
        on_progress: Called for each object when it is finally fitted.
        scale_share: Relative uncertainty of the picture's scale, without depth.
    """
    room = RoomEstimate(observation, walls, detections, scale_share)
    fitter = RoomFitter(room)
    boxes = range(len(detections))
    # Near objects hide far ones, and are large in the picture.
    by_size = sorted(boxes, key=lambda index: -detections[index].area_px)
    standing = [index for index in by_size if stands_on_floor(detections[index])]
    # What carries another thing ends below it in the picture.
    carried = [index for index in boxes if index not in standing]
    carried.sort(key=lambda index: -detections[index].box_px[3])
    for index in standing:
        fitter.fit(index, [0.0], hidden_by=boxes)
    if observation.has_depth:
        room.look_for_walls()
    for index in standing:
        on_progress(fitter.fit(index, [0.0], hidden_by=carried))
    for index in carried:
        on_progress(fitter.fit(index, None, hidden_by=carried))
    for index in by_size:
        on_progress(fitter.judge(index))
    return _result(room)


def _result(room: RoomEstimate) -> FittedRoom:
    """Name the fitted objects."""
    counts: Counter[str] = Counter()
    things, unfitted = [], []
    for index, detection in enumerate(room.detections):
        fit = room.fits.get(index)
        if fit is None:
            unfitted.append(Unfitted(detection, room.lost[index]))
            continue
        name = detection.name_as(fit.guess.entry, min(fit.guess.size_m[:2]))
        things.append(FittedThing(f"{name}_{counts[name]}", detection, fit))
        counts[name] += 1
    return FittedRoom(tuple(things), tuple(unfitted), room.walls)
