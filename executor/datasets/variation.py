"""What varies from episode to episode beyond layout, assets, places and the robot's start: each axis by itself.

What is drawn follows from the unit's seed and the axis alone, so that switching one axis on moves no other.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field, StrictBool, StrictFloat, StrictInt

from executor.robot.description import FINGER_FRICTION
from executor.world.physics import Physics


@dataclass(frozen=True, slots=True)
class Variation:
    """Which axes vary.

    Attributes:
        target: The target's scale by up to 0.10 either way and its heading by up to 15 degrees (the paper's domain
            randomisation), drawn before sizes are adjusted to the gripper.
        surfaces: Colours and textures of furniture, walls, floor and things.
        lights: Direction, colour and strength of lights, and what surrounds the room.
        cameras: Poses and opening angles of the cameras, within what their mounts allow.
        distractors: Most things added to the scene that the task has nothing to do with.
        physics: Mass and friction of things.
        noise_m: Standard deviation of the noise in what the hand is told (m); what is recorded as action is without.
    """

    target: StrictBool = False
    surfaces: StrictBool = False
    lights: StrictBool = False
    cameras: StrictBool = False
    distractors: Annotated[StrictInt, Field(ge=0, le=8)] = 0
    physics: StrictBool = False
    noise_m: Annotated[StrictFloat | StrictInt, Field(ge=0, le=0.05)] = 0


def drawn_physics(rng: np.random.Generator) -> Physics:
    """Returns physics in which things are heavier or lighter, more or less slippery, and doors stiffer or looser."""

    def factor(most: float) -> float:
        return float(math.exp(rng.uniform(-math.log(most), math.log(most))))

    # Wider than weights and surfaces of one kind of thing in households, narrower than what a grip cannot hold.
    return Physics(
        item_mass=factor(1.5),
        item_friction=factor(1.2),
        finger_friction=FINGER_FRICTION * factor(1.15),
        joint_friction=factor(1.4),
        damping=factor(1.4),
    )
