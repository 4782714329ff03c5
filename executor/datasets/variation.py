"""What varies from episode to episode beyond layout, assets, places and the robot's start: each axis by itself.

What is drawn follows from the unit's origin (family or sentence), its seed and the axis alone, so that switching one
axis on moves no other.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field, StrictBool, StrictFloat, StrictInt

from executor.robot.description import FINGER_FRICTION
from executor.scenes.rooms.room import Draws, Stray
from executor.scenes.vary import LARGEST_SEED
from executor.world.physics import Physics
from oag import Scene, Task


@dataclass(frozen=True, slots=True)
class Variation:
    """Which axes vary.

    Attributes:
        target: Size, by up to 0.10 either way, and heading, by up to 15 degrees, of the items that are taken and of
            the furniture that is opened or shut (the paper's domain randomisation), drawn before sizes are adjusted
            to the gripper.
        surfaces: Colours and textures of furniture, walls, floor and things.
        lights: Direction, colour and strength of lights, and what surrounds the room.
        cameras: Poses and opening angles of the cameras, within what their mounts allow.
        distractors: Most things added to the scene that the task has nothing to do with.
        physics: Mass and friction of things.
        look: Which of the looks that surfaces, lights and cameras are drawn for; the same motion can have several.
        noise_m: Standard deviation of the noise in what the hand is told (m); what is recorded as action is without.
    """

    target: StrictBool = False
    surfaces: StrictBool = False
    lights: StrictBool = False
    cameras: StrictBool = False
    distractors: Annotated[StrictInt, Field(ge=0, le=8)] = 0
    physics: StrictBool = False
    noise_m: Annotated[StrictFloat | StrictInt, Field(ge=0, le=0.05)] = 0
    look: Annotated[StrictInt, Field(ge=0, le=LARGEST_SEED)] = 0


UNVARIED = Variation()


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


def strayed(scene: Scene, task: Task, draws: Draws) -> dict[str, Stray]:
    """Returns how each target of a task differs from what a scene of one's own has."""
    targets = dict.fromkeys(part.target for part in task.subtasks)
    return {name: Stray.drawn(scene[name], draws) for name in targets}


def with_strays(scene: Scene, strays: Mapping[str, Stray]) -> Scene:
    """Returns the scene with other targets, their bottoms where they were."""
    others = {name: stray.standing(scene[name]) for name, stray in strays.items()}
    return replace(scene, objects={**scene.objects, **others})
