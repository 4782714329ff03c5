"""What each track of the benchmark gives a reconstruction, and what of that is taken from the simulator."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from executor.bench.photo.sensor import MockedDetector, exact_boxes, mocked_boxes, mono_like, noisy
from executor.bench.photo.truth import Shot
from executor.photo.inputs.annotations import Detector, Sighting
from executor.photo.inputs.camera import Intrinsics
from executor.photo.inputs.depth import BEND_SHARE, Depth
from executor.photo.inputs.picture import Exif, Photograph
from executor.photo.pipeline import Given
from executor.photo.space.floor import observe
from executor.photo.space.level import find_upright, flat_observation, levelled_by_height
from executor.photo.space.rescale import observe_by_height

Track = Literal["A", "B", "C", "D", "E", "F", "G"]
TITLES: Mapping[Track, str] = MappingProxyType(
    {
        "A": "track A, an upper bound: clean depth, masks and names, all of it taken from the simulator",
        "B": "track B: noisy depth, and a mocked detector: the simulator's own boxes and names, spoilt",
        "C": "track C: noisy depth, and neither boxes nor names nor masks; of the simulator, picture and camera alone",
        "D": "track D: no depth, the camera's height known, and a mocked detector: the simulator's own boxes, spoilt",
        "E": "track E: the simulator's depth, bent, blurred and of wrong scale, which stands in for a network's; the "
        "camera's height known; a mocked detector: the simulator's own boxes, spoilt",
        "F": "track F: noisy depth, and boxes and names by a detector that looked at the drawn picture; of the "
        "simulator, picture and camera alone",
        "G": "track G: things of foreign shapes in the place of all items, photographed as for a task, noisy "
        "depth, and the simulator's own boxes, spoilt, without names; only the foreign things count",
    }
)
"""Track -> what its table is called."""

_CLEAN = "taken from the simulator as it is"
_NOISY = "drawn from the simulator, with the noise of a depth camera"
_MONO = "drawn from the simulator, bent, blurred and of wrong scale like a network's"


@dataclass(frozen=True)
class TrackInput:
    """What a reconstruction is given of a shot.

    Attributes:
        given: All that it sees.
        boxes: id -> the box in it that is of this thing.
    """

    given: Given
    boxes: Mapping[str, Sighting]


def input_of(
    track: Track,
    name: str,
    shot: Shot,
    categories: Mapping[str, str],
    detector: MockedDetector,
    rng: np.random.Generator,
    detect: Detector | None = None,
) -> TrackInput:
    """Returns what a track gives of a shot.

    Args:
        track: Which one.
        name: Of the scene that is made.
        shot: The known room and its picture.
        categories: id -> what it is, of every thing that is seen.
        detector: The quality of the mocked detector.
        rng: What chance is drawn from.
        detect: Of track F, the detector.

    Raises:
        PhotoRefused: The track has to level the picture by its lines or its floor, and cannot.
    """
    masks = shot.visible()
    words = {name: shot.scene.objects[name].category for name in masks}
    boxes = _boxes(track, masks, categories, words, detector, rng)
    camera = Intrinsics(shot.K[0, 0], shot.K[1, 1], shot.K[0, 2], shot.K[1, 2], "taken from the simulator")
    picture = Photograph(Path(name), shot.rgb, Exif(None, None, ""))
    height_m = float(shot.T_world_camera[2, 3])
    if track == "A":
        depth = Depth(shot.depth_m, _CLEAN)
        seen, floor = observe(picture, depth, camera)
    elif track == "E":
        guessed = Depth(mono_like(shot.depth_m, rng), _MONO, bend_share=BEND_SHARE)
        depth, seen, floor = observe_by_height(picture, guessed, camera, height_m)
    elif track != "D":
        depth = Depth(noisy(shot.depth_m, rng), _NOISY)
        seen, floor = observe(picture, depth, camera)
    else:
        depth, floor = None, levelled_by_height(find_upright(picture, camera), height_m)
        seen = flat_observation(picture, camera, floor)
    detections = tuple(boxes.values()) if detect is None else detect(picture).things
    # What the mocked detector misses is there to be found; a track is of all that a picture shows.
    return TrackInput(Given(name, picture, depth, camera, detections, seen, floor, find_more=True), boxes)


def _boxes(
    track: Track,
    masks: Mapping[str, NDArray[np.bool_]],
    categories: Mapping[str, str],
    words: Mapping[str, str],
    detector: MockedDetector,
    rng: np.random.Generator,
) -> dict[str, Sighting]:
    if track in ("C", "F"):
        return {}
    if track == "G":
        return mocked_boxes(masks, dict.fromkeys(masks, ""), replace(detector, misnamed=0.0), rng)
    boxes = exact_boxes(masks, categories) if track == "A" else mocked_boxes(masks, categories, detector, rng)
    # Whoever names a thing rightly calls it what it is called in its room, such as a dresser.
    return {
        name: replace(box, label=words[name]) if box.category == categories[name] else box
        for name, box in boxes.items()
    }
