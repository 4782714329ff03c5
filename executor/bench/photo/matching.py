"""Which thing of a reconstruction stands for which thing of a known room."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from executor.photo.inputs.annotations import Sighting
from executor.photo.overlay import shown_things
from executor.photo.pipeline import Result

_LEAST_COMMON = 0.5
"""Of what two masks cover together: as usual for detectors (COCO's AP50)."""


def matched(
    masks: Mapping[str, NDArray[np.bool_]], boxes: Mapping[str, Sighting], result: Result
) -> tuple[dict[str, str], tuple[str, ...]]:
    """Returns true id -> id in the reconstruction, and what is in it that stands for nothing.

    A thing that was made of a box stands for what the box was drawn around. What nobody had boxed stands for the thing
    that it covers in the picture, where the two have half of their pixels in common.

    Args:
        masks: id -> (H, W) pixels of every thing that is seen.
        boxes: id -> the box that was given of it.
        result: The reconstruction.
    """
    made_of = {id(thing.detection): thing.id for thing in result.found.things}
    found = {name: made_of[id(box)] for name, box in boxes.items() if id(box) in made_of}
    guesses = {thing.id: thing.fit.guess for thing in result.found.things}
    shown = shown_things(result.seen, guesses)
    others = [name for name in masks if name not in found]
    free = [(number, key) for number, key in enumerate(guesses) if key not in found.values()]
    common = np.zeros((len(others), len(free)))
    for row, name in enumerate(others):
        for column, (number, _) in enumerate(free):
            own = shown == number
            common[row, column] = (masks[name] & own).sum() / max(1, (masks[name] | own).sum())
    for row, column in zip(*linear_sum_assignment(-common), strict=True):
        if common[row, column] >= _LEAST_COMMON:
            found[others[row]] = free[column][1]
    return found, tuple(key for _, key in free if key not in found.values())
