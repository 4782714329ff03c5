"""A scene with what is asked of it: the unit that benchmarks, generators and data sets work with."""

from __future__ import annotations

import re
from dataclasses import dataclass

from oag import Scene, Task

_ID = re.compile(r"[A-Za-z0-9-]+")


@dataclass(frozen=True, slots=True)
class ScenePair:
    """One scene-task pair, ready to be rolled out.

    Attributes:
        id: Unique, fit to name files: letters, digits and dashes, such as "T1-014000".
        family: The paper's name of the benchmark it belongs to, "T1" to "T6".
        query: What a person would type.
        scene: Concrete: nothing left to vary, sizes adjusted for the gripper, settled in physics.
        task: Planned offline for the query; its flows leave numbers open for the geometric planner.
    """

    id: str
    family: str
    query: str
    scene: Scene
    task: Task

    def __post_init__(self) -> None:
        if not _ID.fullmatch(self.id):
            raise ValueError(f"the id {self.id!r} cannot name a file; expected letters, digits and dashes")
