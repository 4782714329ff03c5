"""Variations of a reconstructed room: every thing as the second or third best model that explains it.

Source: the paper has three variations of each reconstruction, of the three assets that match best; the first of them is
the reconstruction itself.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from executor.photo.room.reconstruct import FittedRoom
from executor.photo.scene import MadeScene, made_of

COUNT = 2
"""Beside the reconstruction itself."""

_HEIGHT_M = 0.10  # Between tops of models that explain the same thing.


@dataclass(frozen=True)
class RoomVariation:
    """One variation.

    Attributes:
        number: 1 for the second best models, 2 for the third.
        models: id -> model, of the things that another model was taken for.
        made: What became of it.
    """

    number: int
    models: Mapping[str, str]
    made: MadeScene


def variations_of(found: FittedRoom, name: str) -> tuple[RoomVariation, ...]:
    """Returns the variations of a room in which any thing has another model; physics may refuse some.

    Args:
        found: The fits; a thing with fewer alternatives keeps the last of them.
        name: Of the scene.
    """
    varied: list[RoomVariation] = []
    for number in range(1, COUNT + 1):
        guesses, models = {}, {}
        for thing in found.things:
            ranked = (thing.fit.guess, *(one.guess for one in thing.fit.alternatives))
            guesses[thing.id] = ranked[min(number, len(ranked) - 1)]
            if guesses[thing.id] is not thing.fit.guess:
                models[thing.id] = guesses[thing.id].entry.model
        if models and all(models != other.models for other in varied):
            made = made_of(found, guesses, f"{name}_{number}", same_height_m=_HEIGHT_M)
            varied.append(RoomVariation(number, models, made))
    return tuple(varied)
