"""Kitchen units that go together: cabinets, counters and appliances under one worktop, of one height and depth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from executor.assets.library import entry
from executor.scenes.rooms.room import Room
from oag import SceneObject

CABINETS = ("cabinet_one_door", "cabinet_two_doors", "cabinet_drawers", "cabinet_drawers_doors")
UNITS = (*CABINETS, "counter_plain")
COOKERS = ("oven_bottom_hinge", "dishwasher_bottom_hinge")
COOKER_LEAST_M = 0.80


@dataclass(frozen=True, slots=True)
class Units:
    """What the units of one kitchen have in common.

    Attributes:
        height_m: Of their tops above the floor.
        depth_m: From their backs to the front of their handles.
    """

    height_m: float
    depth_m: float

    @classmethod
    def drawn(cls, room: Room, height_m: tuple[float, float] = (0.72, 0.86)) -> Units:
        """Returns the units of a kitchen, their height drawn from a range."""
        rng = room.rng
        return cls(round(float(rng.uniform(*height_m)), 3), round(float(rng.uniform(0.60, 0.65)), 3))

    @property
    def models(self) -> tuple[str, ...]:
        """The models that can be of this height."""
        return (*UNITS, *COOKERS) if self.height_m >= COOKER_LEAST_M else UNITS

    def draw(
        self,
        room: Room,
        model: str,
        object_id: str | None = None,
        *,
        width_m: tuple[float, float] | None = None,
        parameters: Mapping[str, object] | None = None,
    ) -> SceneObject:
        """Returns a unit of a model, not yet placed.

        Args:
            room: Where it will stand.
            model: One of `models`.
            object_id: Its id, as for `Room.draw`.
            width_m: A narrower range of widths than the model's own.
            parameters: As for `Room.draw`.
        """
        extent = {"x": self.depth_m, "z": self.height_m}
        if width_m is not None:
            low, high = max(width_m[0], entry(model).width.low), min(width_m[1], entry(model).width.high)
            extent["y"] = round(float(room.rng.uniform(low, max(low, high))), 3)
        return room.draw(model, object_id, extent_m=extent, parameters=parameters)
