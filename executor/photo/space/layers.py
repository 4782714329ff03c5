"""What all that is known looks like together: floor and walls, and the things before them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from executor.geometry import Array
from executor.photo.inputs.annotations import Sighting
from executor.photo.space.observation import Observation, is_hidden
from executor.photo.space.walls import Wall, depth_of_empty, seen_anew

_AS_FITTED_M = 0.05  # Off what was fitted roughly, pixels are of it.

Look = tuple[Array, NDArray[np.int32]]
"""(H, W) a thing's depth, infinite beside it, and which of its faces is seen, from 0."""


@dataclass
class Layers:
    """The looks of what is known.

    Attributes:
        seen: The picture.
        walls: The walls.
        looks: By thing.
    """

    seen: Observation
    walls: tuple[Wall, ...]
    looks: dict[int, Look] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._empty = depth_of_empty(self.seen, self.walls)

    def look_for_walls(self, left: Sequence[Sighting]) -> None:
        """Looks for walls in boxes, too, now that it is known which of their pixels are of things.

        Args:
            left: Boxes of things that have no look yet.
        """
        depth_m, face = self.together()
        fitted = (face > len(self.walls)) & (np.abs(self.seen.z_m - depth_m) < _AS_FITTED_M + 3 * self.seen.bent_m)
        self.walls = seen_anew(self.walls, self.seen, left, fitted)
        self._empty = depth_of_empty(self.seen, self.walls)

    def visible(self) -> dict[int, NDArray[np.bool_]]:
        """Return by thing (H, W) where it is visible: nearest of all, and nothing nearer was measured there."""
        nearest, owner = self._empty[0].copy(), np.full(self.seen.z_m.shape, -1)
        for index, (own_m, _) in self.looks.items():
            nearer = own_m < nearest
            nearest[nearer], owner[nearer] = own_m[nearer], index
        owner[is_hidden(self.seen, nearest)] = -1
        return {index: owner == index for index in self.looks}

    def together(self, besides: int | None = None) -> Look:
        """Returns the depth of all besides one, and of which face it is: 0 the floor, then walls, then things."""
        depth, face = self._empty[0].copy(), self._empty[1].copy()
        first = 1 + len(self.walls)
        for index, (own_m, own_face) in self.looks.items():
            if index == besides:
                continue
            nearer = own_m < depth
            shown = own_face[nearer]
            depth[nearer], face[nearer] = own_m[nearer], first + shown
            first += int(shown.max(initial=-1)) + 1
        return depth, face
