"""What varies from episode to episode beyond layout, assets, places and the robot's start: each axis by itself.

What is drawn follows from the unit's seed and the axis alone, so that switching one axis on moves no other.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field, StrictBool, StrictFloat, StrictInt


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
