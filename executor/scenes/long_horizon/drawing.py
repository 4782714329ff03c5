"""From a family and a seed to a settled scene with its task."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

import llm
from executor.assets.parameters import AssetError
from executor.scenes.long_horizon.refrigerators import apple_kitchen, glass_kitchen
from executor.scenes.long_horizon.supports import bowl_kitchen, cup_kitchen
from executor.scenes.pair import ScenePair
from executor.scenes.rooms import NoRoom, Room
from executor.scenes.settle import Unsettled, settle
from oag import Scene

QUERIES: Mapping[str, str] = MappingProxyType(
    {
        "T1": "put the glass into the refrigerator",
        "T2": "put the apple into the refrigerator",
        "T3": "put the apple into the bowl",
        "T4": "put the cup on the table",
    }
)
FAMILIES = tuple(QUERIES)
_LAYOUTS: Mapping[str, Callable[[Room], None]] = MappingProxyType(
    {"T1": glass_kitchen, "T2": apple_kitchen, "T3": bowl_kitchen, "T4": cup_kitchen}
)
_TRIES = 60
_DEPTH_M, _WIDTH_M = (3.0, 3.6), (3.4, 4.2)


class NoScene(RuntimeError):
    """No layout that holds was found for a seed; `reasons` are those of the layouts that were given up."""

    def __init__(self, family: str, seed: int, reasons: tuple[str, ...]) -> None:
        super().__init__(f"{family}, seed {seed}: none of {len(reasons)} layouts holds; the last one: {reasons[-1]}")
        self.reasons = reasons


def draw(family: str, seed: int) -> ScenePair:
    """Returns the scene and the task that a seed stands for; equal seeds give equal ones.

    A layout in which something does not fit, or that physics does not bear out, is drawn anew from the same seed.
    Nothing that the robot can or cannot do has a say in this.

    Args:
        family: "T1", "T2", "T3" or "T4".
        seed: Any integer from 0.

    Raises:
        ValueError: There is no such family.
        NoScene: No layout held, after many tries.
    """
    if family not in QUERIES:
        raise ValueError(f"there is no family {family!r}; the long-horizon families are {', '.join(FAMILIES)}")
    query, reasons = QUERIES[family], []
    for attempt in range(_TRIES):
        rng = np.random.default_rng([seed, FAMILIES.index(family), attempt])
        name = f"{family.lower()}_{seed:06d}"
        room = Room(name, "kitchen", rng, float(rng.uniform(*_DEPTH_M)), float(rng.uniform(*_WIDTH_M)))
        try:
            _LAYOUTS[family](room)
            scene = settle(fitted(room.scene(), query))
        except (NoRoom, Unsettled, AssetError) as reason:
            reasons.append(str(reason))
            continue
        return ScenePair(f"{family}-{seed:06d}", family, query, scene, llm.propose(query, scene).task)
    raise NoScene(family, seed, tuple(reasons))


def fitted(scene: Scene, query: str) -> Scene:
    """Returns the scene with what the query's plan takes hold of scaled to the gripper (the paper's module 4)."""
    return scene.with_scales(llm.propose(query, scene).task.scales)
