"""The physics engine: empty scenes, time steps, contact distances, poses as matrices, and what touches what.

Without visuals nothing of Vulkan is touched.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from executor.geometry import Array
from executor.machine.extras import load_sapien

GROUND = "ground"
ROBOT = "robot"
TIMESTEP_S = 1 / 250
ORACLE_TIMESTEP_S = 1e-6
CONTACT_OFFSET_M = 0.01
"""How far around a shape contacts are looked for; two shapes see each other from twice this on."""

FURNITURE_CONTACT_OFFSET_M = 0.0005
"""The same of furniture, so that a door sees what it passes from a millimetre on.

The engine keeps contact points, with their directions, until bodies have moved by millimetres: an edge that passes
another closely would still be held off by the face that it was before.
"""

ORACLE_CONTACT_OFFSET_M = 0.02
_SOLVER_ITERATIONS = 20
"""With 15 a grasp of half an apple slipped that holds with 20 or more."""


class RendererMissing(RuntimeError):
    """A world with visuals was asked for where the engine finds nothing to draw with."""

    def __init__(self, problem: str) -> None:
        super().__init__(
            f"a world with visuals needs a Vulkan driver, and SAPIEN says: {problem}. `scene2demo doctor` tells what "
            "is missing; call executor.machine.vulkan.activate() before the first such world. Physics alone needs none "
            "of it."
        )


def empty_scene(*, visual: bool, oracle: bool) -> Any:
    """Returns a `sapien.Scene` without bodies.

    Args:
        visual: Whether it can be drawn.
        oracle: Whether contacts are only read in it, and never solved.

    Raises:
        RendererMissing: When `visual` is true and there is nothing to draw with.
    """
    sapien = load_sapien()

    # These are settings of the process that the next scene takes up; every world sets them, so all are alike.
    sapien.physx.set_scene_config(bounce_threshold=2.0)
    sapien.physx.set_shape_config(contact_offset=ORACLE_CONTACT_OFFSET_M if oracle else CONTACT_OFFSET_M)
    # Contacts are found before they are solved: an oracle, which only reads them, needs no solving.
    iterations = 1 if oracle else _SOLVER_ITERATIONS
    sapien.physx.set_body_config(solver_position_iterations=iterations, solver_velocity_iterations=1)
    if not visual:
        return sapien.Scene([sapien.physx.PhysxCpuSystem()])
    try:
        return sapien.Scene([sapien.physx.PhysxCpuSystem(), sapien.render.RenderSystem()])
    except RuntimeError as problem:
        raise RendererMissing(str(problem)) from problem


def add_ground(sapien_scene: Any) -> Any:
    """Adds the floor at height 0 and returns its body; what cameras see of it is a matter of pictures."""
    ground = sapien_scene.add_ground(0.0, render=False)
    return ground.find_component_by_type(load_sapien().physx.PhysxRigidStaticComponent)


def pose_matrix(pose: Any) -> Array:
    """Returns the (4, 4) of an engine pose, written out: this is asked for at every physics step."""
    w, i, j, k = pose.q.tolist()
    x, y, z = pose.p.tolist()
    s = 2.0 / (w * w + i * i + j * j + k * k)
    return np.array(
        [
            [1 - s * (j * j + k * k), s * (i * j - k * w), s * (i * k + j * w), x],
            [s * (i * j + k * w), 1 - s * (i * i + k * k), s * (j * k - i * w), y],
            [s * (i * k - j * w), s * (j * k + i * w), 1 - s * (i * i + j * j), z],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


@dataclass(frozen=True, slots=True, order=True)
class BodyRef:
    """One rigid body.

    Attributes:
        owner: "robot", "ground" or an object's id.
        link: Link name; the asset's root link for a single body, "ground" for the ground.
    """

    owner: str
    link: str


@dataclass(frozen=True, slots=True)
class Contact:
    """Two bodies that touch or nearly do.

    Attributes:
        a, b: The bodies; the robot's comes first, then by name.
        separation_m: Smallest distance over the contact points; negative where they overlap.
        impulse_ns: Sum of the points' impulse norms over the last step, in newton seconds.
    """

    a: BodyRef
    b: BodyRef
    separation_m: float
    impulse_ns: float


def pairs_nearer(
    engine_contacts: Any, owner_of: Mapping[Any, BodyRef], owners: Container[str], within_m: float
) -> Iterator[tuple[BodyRef, BodyRef, float]]:
    """Yields pairs of bodies that are nearer than a distance, with the gap between them, in the engine's order.

    Args:
        engine_contacts: What the engine's `get_contacts` returns.
        owner_of: The engine's bodies -> what they are.
        owners: Only pairs of which one body's owner is in it.
        within_m: The distance.
    """
    for contact in engine_contacts:
        first, second = contact.bodies
        a, b = owner_of[first], owner_of[second]
        if a.owner in owners or b.owner in owners:
            gap_m = min((point.separation for point in contact.points), default=math.inf)
            if gap_m < within_m:
                yield (a, b, gap_m) if _comes_first(a, b) else (b, a, gap_m)


def contacts_of(
    engine_contacts: Any, owner_of: Mapping[Any, BodyRef], owners: Container[str] | None
) -> tuple[Contact, ...]:
    """Returns the pairs of bodies that have contact points, one contact a pair, sorted.

    Args:
        engine_contacts, owner_of: As for `pairs_nearer`.
        owners: When given, only pairs of which one body's owner is in it.
    """
    found: dict[tuple[int, int], tuple[BodyRef, BodyRef, float, list[float]]] = {}
    for contact in engine_contacts:
        first, second = contact.bodies
        a, b = owner_of[first], owner_of[second]
        if owners is not None and a.owner not in owners and b.owner not in owners:
            continue
        points = contact.points
        if not points:
            continue
        # Identities hash faster than names, and this runs thousands of times a second.
        key = (id(a), id(b)) if id(a) < id(b) else (id(b), id(a))
        _, _, separation, impulses = found.get(key, (a, b, math.inf, []))
        for point in points:
            separation = min(separation, point.separation)
            x, y, z = point.impulse.tolist()
            impulses.append(math.sqrt(x * x + y * y + z * z))
        found[key] = (a, b, separation, impulses)
    # The engine's order of shapes that touch is not always the same; the exactly rounded sum does not depend on it.
    summed = ((a, b, s, math.fsum(i)) for a, b, s, i in found.values())
    ordered = ((a, b, s, i) if _comes_first(a, b) else (b, a, s, i) for a, b, s, i in summed)
    return tuple(Contact(*fields) for fields in sorted(ordered))


def _comes_first(a: BodyRef, b: BodyRef) -> bool:
    return (a.owner != ROBOT, a) <= (b.owner != ROBOT, b)
