"""Targets that are not as they were laid out: of another size, and turned (the paper's domain randomisation)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from executor.geometry import pose_vector, rotation_z, transform_from_quaternion
from oag import SceneObject
from oag.model.categories import Kind

Draws = Callable[[str], np.random.Generator]
"""Name of what is drawn -> what draws it."""

_SCALE, _YAW_RAD = 0.10, math.pi / 12  # The paper's.


@dataclass(frozen=True, slots=True)
class Stray:
    """How a target differs from what it was laid out as.

    Attributes:
        wider, deeper, higher: Factors of its sides along its own x, y and z; an item's first two are one number, since
            round things stay round.
        turned_rad: By how much it is turned where it stands.
    """

    wider: float
    deeper: float
    higher: float
    turned_rad: float

    @classmethod
    def drawn(cls, thing: SceneObject, draws: Draws, attempt: int = 0) -> Self:
        """Returns what is drawn for a target.

        Args:
            thing: The target.
            draws: Draws it, by the target's name.
            attempt: Number of the layout that it is drawn for, where several are tried.
        """
        rng = draws(f"target {thing.id} {attempt}" if attempt else f"target {thing.id}")
        item = thing.kind is Kind.ITEM
        wider, *others = (round(float(value), 4) for value in rng.uniform(1 - _SCALE, 1 + _SCALE, 2 if item else 3))
        deeper, higher = (wider, *others) if item else others
        return cls(wider, deeper, higher, round(float(rng.uniform(-_YAW_RAD, _YAW_RAD)), 4))

    def sized(self, thing: SceneObject) -> SceneObject:
        """Returns a target in its other size, the middle of its box where it was."""
        a, b, c = thing.scale
        return replace(thing, scale=(a * self.wider, b * self.deeper, c * self.higher))

    def standing(self, thing: SceneObject) -> SceneObject:
        """Returns a target in its other size and turned, its bottom where it was."""
        T = transform_from_quaternion(thing.position, thing.orientation)
        T[:3, 3] += T[:3, 2] * (self.higher - 1.0) * thing.extent_m[2] / 2
        T[:3, :3] = rotation_z(self.turned_rad)[:3, :3] @ T[:3, :3]
        x, y, z, w, i, j, k = (float(value) for value in pose_vector(T))
        return replace(self.sized(thing), position=(x, y, z), orientation=(w, i, j, k))
