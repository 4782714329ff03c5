"""What varies from episode to episode beyond layout, assets, places and the robot's start: each axis by itself.

What is drawn follows from the unit's origin (family or sentence), its seed and the axis alone, so that switching one
axis on moves no other.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field, StrictBool, StrictFloat, StrictInt

from executor.geometry import pose_vector, rotation_z, transform_from_quaternion
from executor.robot.description import FINGER_FRICTION
from executor.scenes.vary import LARGEST_SEED
from executor.world.physics import Physics
from oag import Scene, Task
from oag.model.categories import Kind


@dataclass(frozen=True, slots=True)
class Variation:
    """Which axes vary.

    Attributes:
        target: Size, by up to 0.10 either way, and heading, by up to 15 degrees, of the items that are taken, and in
            a scene of one's own of the furniture that is opened or shut (the paper's domain randomisation), drawn
            before sizes are adjusted to the gripper.
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


Draws = Callable[[str], np.random.Generator]
"""Name of an axis, or of a part of one -> what draws it."""

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


def strayed(scene: Scene, task: Task, draws: Draws, *, furniture: bool) -> dict[str, Stray]:
    """Returns what is drawn for each target of a task.

    Args:
        scene: Where they are.
        task: Whose targets they are.
        draws: Draws them.
        furniture: Whether that of a task strays too; in rooms that are drawn it keeps its place in its row.
    """
    targets = dict.fromkeys(part.target for part in task.subtasks)
    found = {}
    for name in targets:
        item = scene[name].kind is Kind.ITEM
        if not (item or furniture):
            continue
        rng = draws(f"target {name}")
        wider, *others = (round(float(value), 4) for value in rng.uniform(1 - _SCALE, 1 + _SCALE, 2 if item else 3))
        deeper, higher = (wider, *others) if item else others
        found[name] = Stray(wider, deeper, higher, round(float(rng.uniform(-_YAW_RAD, _YAW_RAD)), 4))
    return found


def with_strayed_targets(scene: Scene, task: Task, draws: Draws, *, furniture: bool) -> Scene:
    """Returns the scene with other targets, their bottoms where they were; the arguments are those of `strayed`."""
    objects = dict(scene.objects)
    for name, stray in strayed(scene, task, draws, furniture=furniture).items():
        thing = objects[name]
        T = transform_from_quaternion(thing.position, thing.orientation)
        T[:3, 3] += T[:3, 2] * (stray.higher - 1.0) * thing.extent_m[2] / 2
        T[:3, :3] = rotation_z(stray.turned_rad)[:3, :3] @ T[:3, :3]
        x, y, z, *turn = (float(value) for value in pose_vector(T))
        a, b, c = thing.scale
        objects[name] = replace(
            thing,
            position=(x, y, z),
            orientation=(turn[0], turn[1], turn[2], turn[3]),
            scale=(a * stray.wider, b * stray.deeper, c * stray.higher),
        )
    return replace(scene, objects=objects)
