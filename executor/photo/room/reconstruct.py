"""Fit the whole room: furniture one by one, again among all others, then the things on it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType

import numpy as np

from executor.photo.errors import LostCause
from executor.photo.fitting.evidence import HUES
from executor.photo.fitting.hypothesis import PoseHypothesis
from executor.photo.fitting.likelihood import Fit
from executor.photo.geometry.observation import Observation
from executor.photo.geometry.walls import Wall
from executor.photo.inputs.annotations import Detection
from executor.photo.room.blind import fit_without_depth
from executor.photo.room.estimate import RoomEstimate
from executor.photo.room.feet import apparent_supports, feet_on_boards, feet_on_furniture
from executor.photo.room.fitter import RoomFitter
from executor.photo.room.jointly import Jointly
from executor.photo.separation import Fill
from llm.vision import overlap

_PATTERN, _SHADE, _MORE = 0.05, 0.3, 2.0
"""Share of a hue in what is visible of a thing, share of another colour, which may be a shadow; times that of any other
thing of its name."""


@dataclass(frozen=True)
class FittedThing:
    """One object of the reconstruction.

    Attributes:
        id: Its id in the scene.
        detection: Its detection.
        fit: Its fit.
        colours: Name of a colour -> its share of what is visible of it.
    """

    id: str
    detection: Detection
    fit: Fit
    colours: Mapping[str, float] = field(default_factory=dict)


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
        interrupted: Whether Ctrl-C ended it: fits may be rough or absent, and variations are left out.
        view: The picture; None where nothing is compared with it.
        on: id -> id of what carries it, where boxes and names tell.
    """

    things: tuple[FittedThing, ...]
    unfitted: tuple[Unfitted, ...]
    walls: tuple[Wall, ...]
    interrupted: bool = False
    view: Observation | None = field(default=None, repr=False)
    on: Mapping[str, str] = field(default_factory=dict)

    @property
    def guesses(self) -> dict[str, PoseHypothesis]:
        """id -> pose hypothesis."""
        return {thing.id: thing.fit.guess for thing in self.things}

    @property
    def fills(self) -> dict[str, Fill]:
        """id -> how well a hypothesis fills its box."""
        if self.view is None:
            return {}
        return {thing.id: partial(_filled, self.view, thing.detection.box_px) for thing in self.things}

    def without(self, thing: FittedThing, cause: LostCause, detail: str) -> FittedRoom:
        """Remove one object from the room, with a reason."""
        rest = tuple(one for one in self.things if one is not thing)
        return replace(self, things=rest, unfitted=(*self.unfitted, Unfitted(thing.detection, cause, detail)))


@dataclass(frozen=True)
class Listener:
    """Receives what is known while a room is fitted.

    Attributes:
        on_progress: Called with sentences.
        on_first: Called once, within seconds, with a room of rough fits; None where nobody needs it.
    """

    on_progress: Callable[[str], None] = lambda words: None
    on_first: Callable[[FittedRoom], None] | None = None


SILENT = Listener()


def reconstruct(
    observation: Observation,
    detections: Sequence[Detection],
    walls: tuple[Wall, ...],
    listener: Listener = SILENT,
    scale_share: float = 0.0,
    kept: Mapping[int, Fit] = MappingProxyType({}),
) -> FittedRoom:
    """Fit the objects of a picture by models of the library, or by generic shapes.

    After Ctrl-C it returns what is fitted by then, if the listener takes rough fits; the other objects are rough.

    Args:
        observation: The picture in the level frame.
        detections: Boxes with labels.
        walls: The walls.
        listener: Receives progress.
        scale_share: Relative uncertainty of the picture's scale, without depth.
        kept: index of a detection -> its fit, which stays as it is.
    """
    room = _Reconstruction(observation, detections, walls, scale_share, kept, listener.on_progress)
    try:
        if listener.on_first is not None:
            first = room.with_rough_fits()
            if first.interrupted:
                return first
            listener.on_first(first)
        return room.fitted()
    except KeyboardInterrupt:
        if listener.on_first is None:
            raise
        return replace(room.with_rough_fits(), interrupted=True)


class _Reconstruction:
    """A room that is being fitted, each object in its turn."""

    def __init__(
        self,
        observation: Observation,
        detections: Sequence[Detection],
        walls: tuple[Wall, ...],
        scale_share: float,
        kept: Mapping[int, Fit],
        on_progress: Callable[[str], None],
    ) -> None:
        on = apparent_supports(observation, detections) if observation.has_depth else []
        feet_m = feet_on_furniture(observation, detections, on)
        boards_m = feet_on_boards(observation, detections, on)
        self._new = partial(RoomEstimate, observation, walls, detections, scale_share, feet_m, on, boards_m)
        self._on_progress, self._found = on_progress, dict(kept)
        self._room = self._new()
        self._begun: Jointly | None = None
        for index, fit in kept.items():
            self._room.add_fit(index, fit)
        boxes = range(len(detections))
        # Near objects hide far ones, and are large in the picture.
        by_size = sorted(boxes, key=lambda index: -detections[index].area_px)
        self._all = [index for index in by_size if index not in kept]
        self._standing = [index for index in self._all if self._room.is_on_floor(index)]
        # What carries another thing ends below it in the picture.
        carried = [index for index in boxes if index in self._all and index not in self._standing]
        self._carried = sorted(carried, key=lambda index: -detections[index].box_px[3])

    def fitted(self) -> FittedRoom:
        """Fit the furniture, again among all others, then the things on it; compare each with its box in the end."""
        if not self._room.observation.has_depth:
            fit_without_depth(self._room, self._found, self._on_progress, begun=self._begun)
            for index in self._all:
                self._keep(index)
            return _result(self._room)
        room, fitter = self._room, RoomFitter(self._room)
        boxes = range(len(room.detections))
        for index in self._standing:
            self._announce(index, "first look")
            fitter.fit(index, [0.0], hidden_by=boxes)
            self._keep(index)
        room.look_for_walls()
        for index in (*self._standing, *self._carried):
            self._announce(index, "fitting")
            self._on_progress(fitter.fit(index, [0.0] if index in self._standing else None, hidden_by=self._carried))
            self._keep(index)
        for index in self._all:
            fitter.judge(index)
            self._keep(index)
        return _result(room)

    def with_rough_fits(self) -> FittedRoom:
        """Return the room with the fits so far, and rough ones of all others, or of those before Ctrl-C."""
        room = self._new()
        fitter = RoomFitter(room)
        for index, fit in self._found.items():
            room.add_fit(index, fit)
        rough = [index for index in (*self._standing, *self._carried) if index not in self._found]
        try:
            if not room.observation.has_depth:
                self._begun = fit_without_depth(room, self._found, self._on_progress, rough=True, begun=self._begun)
                return _result(room)
            for index in rough:
                fitter.fit_roughly(index, [0.0] if index in self._standing else None)
        except KeyboardInterrupt:
            for index in rough:
                if index not in room.fits:
                    room.lost.setdefault(index, LostCause.NO_TIME)
            return replace(_result(room), interrupted=True)
        return _result(room)

    def _announce(self, index: int, what: str) -> None:
        turn = (*self._standing, *self._carried).index(index) + 1
        self._on_progress(f"{what}: {self._room.detections[index].label or 'thing'}, {turn} of {len(self._all)}")

    def _keep(self, index: int) -> None:
        if index in self._room.fits:
            self._found[index] = self._room.fits[index]


def _result(room: RoomEstimate) -> FittedRoom:
    """Name the fitted objects, with the colour before a name that tells it from others of that name."""
    labels = [one.label for one in room.detections]
    called = {
        index: room.detections[index].name_as(fit.guess.entry, min(fit.guess.size_m[:2]), labels)
        for index, fit in room.fits.items()
    }
    coloured: dict[int, str] = {}
    for name in {*called.values()}:
        alike = [index for index, own in called.items() if own == name]
        coloured |= _distinguished(room, alike) if len(alike) > 1 else {alike[0]: ""}
    counts: Counter[str] = Counter()
    things, unfitted, ids = [], [], dict[int, str]()
    for index, detection in enumerate(room.detections):
        fit = room.fits.get(index)
        if fit is None:
            unfitted.append(Unfitted(detection, room.lost[index]))
            continue
        name = f"{coloured[index]}{called[index]}"
        ids[index] = f"{name}_{counts[name]}"
        things.append(FittedThing(ids[index], detection, fit, room.colours(index)))
        counts[name] += 1
    on = {ids[one]: ids[below] for one, below in room.on.items() if one in ids and below in ids}
    return FittedRoom(tuple(things), tuple(unfitted), room.walls, view=room.observation, on=on)


def _filled(view: Observation, box_px: tuple[float, float, float, float], guess: PoseHypothesis) -> float:
    """Return the IoU of a box with the outline of a hypothesis."""
    low, high = view.bounds_px(guess.outline_m())
    bounds = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    return overlap(bounds, box_px) if np.isfinite(bounds).all() else 0.0


def _distinguished(room: RoomEstimate, alike: Sequence[int]) -> dict[int, str]:
    """Return the beginnings of the names of things of one name: a colour of which one shows clearly more than the rest.

    A white bowl with a blue rim is the blue one beside a white one, and a dull mug with red flowers the red one.
    """
    shares = {index: room.colours(index) for index in alike}
    words: dict[int, str] = {}
    for index, own in shares.items():
        others = [shares[other] for other in alike if other != index]
        rest = {colour: max(one.get(colour, 0.0) for one in others) for colour in own}
        least = {colour: _PATTERN if colour in HUES else _SHADE for colour in own}
        clear = {colour: share for colour, share in own.items() if share > max(least[colour], _MORE * rest[colour])}
        words[index] = max(clear, key=clear.__getitem__, default="")
    most = {index: max(shares[index], key=shares[index].__getitem__) for index in alike if not words[index]}
    for index, colour in most.items():
        if [*most.values(), *words.values()].count(colour) == 1:
            words[index] = colour
    return {index: f"{word}_" if word else "" for index, word in words.items()}
