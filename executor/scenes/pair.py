"""A scene with what is asked of it: the unit that benchmarks, generators and data sets work with."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import llm
from bddl.syntax.errors import Portable
from executor.assets.parameters import AssetError
from executor.scenes.rooms import NoRoom, Room
from executor.scenes.rooms.room import Draws, Stray
from executor.scenes.settle import Unsettled, settle
from oag import Scene, SceneObject, Task

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
        strays: Target's id -> how it differs from what its seed alone gives.
    """

    id: str
    family: str
    query: str
    scene: Scene
    task: Task
    strays: Mapping[str, Stray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not _ID.fullmatch(self.id):
            raise ValueError(f"the id {self.id!r} cannot name a file; expected letters, digits and dashes")


@dataclass(frozen=True, slots=True)
class Changes:
    """How what is drawn differs from what a seed alone gives; all of it before sizes are adjusted to the gripper.

    Attributes:
        targets: Draws how targets stray; None where they do not.
        laid_out: What is done to a layout, given what was planned in it; None for nothing.
    """

    targets: Draws | None = None
    laid_out: Callable[[Scene, Task], Scene] | None = None

    def stray(self, attempt: int) -> Callable[[SceneObject], Stray] | None:
        """Returns what draws how a target of a layout differs; each layout that is tried draws its own."""
        draws = self.targets
        return None if draws is None else lambda thing: Stray.drawn(thing, draws, attempt)


UNCHANGED = Changes()


class Misplanned(ValueError):
    """The planner understood a query otherwise than its layout means it."""


class NotDrawn(Portable, RuntimeError):
    """None of the layouts that were drawn for a pair holds; `reasons` has why each was given up."""

    def __init__(self, pair_id: str, reasons: list[str]) -> None:
        super().__init__(f"{pair_id}: none of {len(reasons)} layouts holds; the last one: {reasons[-1]}")
        self.reasons = tuple(reasons)


def first_that_holds(
    pair_id: str,
    family: str,
    query: str,
    layout: Callable[[int], Room],
    *,
    most_tries: int,
    plan: Callable[[str, Scene], Task],
    robot_scale: float,
    changes: Changes = UNCHANGED,
) -> ScenePair:
    """Returns the pair of the first layout in which everything fits and that physics bears out.

    What the query's plan takes hold of is scaled to the gripper first (the paper's module 4), as far as `plan` says.

    Args:
        pair_id, family, query: As in the pair.
        layout: The number of the try -> the room before sizes are adjusted and physics has settled it.
        most_tries: After how many layouts to give up.
        plan: The query and a scene -> the task.
        robot_scale: Of the robot.
        changes: How it differs from what its seed alone gives; `layout` has seen to the targets.

    Raises:
        NotDrawn: No layout holds.
    """
    reasons: list[str] = []
    for number in range(most_tries):
        try:
            room = layout(number)
            drawn = room.scene().with_robot(robot_scale)
            if changes.laid_out is not None:
                drawn = changes.laid_out(drawn, plan(query, drawn))
            scene = settle(drawn.with_scales(plan(query, drawn).scales))
            return ScenePair(pair_id, family, query, scene, plan(query, scene), room.strays)
        except (NoRoom, Unsettled, Misplanned, AssetError, llm.QueryError) as reason:
            reasons.append(str(reason))
    raise NotDrawn(pair_id, reasons)
