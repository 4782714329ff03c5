"""Scene-task pairs: the unit of benchmarks, generators and data sets, drawn until a layout holds in physics."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import llm
from bddl.errors import Scene2DemoError
from executor.assets.parameters import AssetError
from executor.scenes.room import Draws, NoRoom, Perturbation, Room
from executor.scenes.validation import Unsettled, settle
from oag import Scene, SceneObject, Task
from oag.model.robots import PAPER_ROBOT

_ID = re.compile(r"[A-Za-z0-9-]+")


@dataclass(frozen=True, slots=True)
class ScenePair:
    """One scene-task pair, ready for rollout.

    Attributes:
        id: Unique, usable as a file name: letters, digits and dashes, such as "T1-014000".
        family: The paper's name of the benchmark it belongs to, "T1" to "T6".
        query: The sentence that a person would type.
        scene: Concrete: nothing left to vary, sizes adjusted for the gripper, settled in physics.
        task: Planned offline for the query; its flows leave numbers open for the geometric planner.
        perturbations: Target's id -> its perturbation.
    """

    id: str
    family: str
    query: str
    scene: Scene
    task: Task
    perturbations: Mapping[str, Perturbation] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not _ID.fullmatch(self.id):
            raise ValueError(f"the id {self.id!r} cannot name a file; expected letters, digits and dashes")


@dataclass(frozen=True, slots=True)
class LayoutChanges:
    """Changes to a layout beyond its seed, all applied before sizes are adjusted to the gripper.

    Attributes:
        targets: Generators for the perturbation of targets; None for no perturbation.
        laid_out: Changes a layout, given its planned task; None for no change.
    """

    targets: Draws | None = None
    laid_out: Callable[[Scene, Task], Scene] | None = None

    def draw_perturbation(self, attempt: int) -> Callable[[SceneObject], Perturbation] | None:
        """Return the function that draws a target's perturbation; each layout that is tried draws its own."""
        draws = self.targets
        return None if draws is None else lambda thing: Perturbation.drawn(thing, draws, attempt)


UNCHANGED = LayoutChanges()


class Misplanned(ValueError):
    """The planner understood a query otherwise than its layout intends."""


class NotDrawn(Scene2DemoError):
    """None of the layouts drawn for a pair holds; `reasons` has the reason for each."""

    exit_code = 1

    def __init__(self, pair_id: str, reasons: list[str]) -> None:
        super().__init__(f"{pair_id}: none of {len(reasons)} layouts holds; the last one: {reasons[-1]}")
        self.reasons = tuple(reasons)


def draw_first_valid(
    pair_id: str,
    family: str,
    query: str,
    layout: Callable[[int], Room],
    *,
    most_tries: int,
    plan: Callable[[str, Scene], Task],
    robot: str = PAPER_ROBOT.name,
    changes: LayoutChanges = UNCHANGED,
) -> ScenePair:
    """Return the pair of the first layout in which everything fits and that holds in physics.

    Objects that the query's plan grasps are scaled to the gripper first (the paper's module 4), as `plan` decides.

    Args:
        pair_id, family, query: As in the pair.
        layout: Number of the attempt -> the room, before sizes are adjusted and physics has settled it.
        plan: The query and a scene -> the task.
        changes: Changes beyond the seed; `layout` has applied those to the targets.

    Raises:
        NotDrawn: No layout holds.
    """
    reasons: list[str] = []
    for number in range(most_tries):
        try:
            room = layout(number)
            drawn = room.scene().with_robot(robot)
            if changes.laid_out is not None:
                drawn = changes.laid_out(drawn, plan(query, drawn))
            scene = settle(drawn.with_scales(plan(query, drawn).scales))
            return ScenePair(pair_id, family, query, scene, plan(query, scene), room.perturbations)
        except (NoRoom, Unsettled, Misplanned, AssetError, llm.QueryError) as reason:
            reasons.append(str(reason))
    raise NotDrawn(pair_id, reasons)
