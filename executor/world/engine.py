"""How the physics engine is set up: empty scenes, time steps, contact distances, and poses as matrices.

Without visuals nothing of Vulkan is touched.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from executor.geometry import Array
from executor.machine.extras import load_sapien

TIMESTEP_S = 1 / 250
ORACLE_TIMESTEP_S = 1e-6
CONTACT_OFFSET_M = 0.01
"""How far around a shape contacts are looked for; two shapes see each other from twice this on."""

ORACLE_CONTACT_OFFSET_M = 0.02
_SOLVER_ITERATIONS = 15
_FLOOR_COLOR = (0.42, 0.40, 0.37, 1.0)


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


def add_ground(sapien_scene: Any, *, visual: bool) -> Any:
    """Adds the floor at height 0 and returns its body."""
    sapien = load_sapien()

    material = None
    if visual:
        look = {"roughness": 0.9, "specular": 0.1}
        material = sapien.render.RenderMaterial(base_color=list(_FLOOR_COLOR), **look)
    ground = sapien_scene.add_ground(0.0, render=visual, render_material=material)
    return ground.find_component_by_type(sapien.physx.PhysxRigidStaticComponent)


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
