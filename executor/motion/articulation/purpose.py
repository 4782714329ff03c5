"""Whether a drawer would do for what a later subtask puts inside.

A level hand gets in behind a door. Into a drawer it comes from above, at a pitch at which not everything can be held:
what stands in a deep drawer is below its front, and the forearm of a level hand is not. Better to know before pulling.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from bddl import atoms
from executor.assets.model import Handle, Region
from executor.assets.transforms import joint_transform
from executor.geometry import Array, inverse
from executor.motion.articulation.asked import end_fractions
from executor.motion.articulation.work import joints_at
from executor.motion.grasping.grasps import item_goals
from executor.motion.placing.onward import Onward
from executor.motion.placing.place import MOST_CANDIDATES
from executor.motion.planning.planner import Planner
from executor.world.world import World
from oag import Action, SimpleTask

_UPWARD = 0.5

Serves = Callable[[Handle], bool]


@dataclass(frozen=True)
class Purpose:
    """What an opening is for: an item that is to be put inside.

    Attributes:
        planner: Synchronised with the world.
        world: Where things are.
        object_id: What is opened.
        action: ARTICULATE_OPEN, filled or not.
        item: What a later subtask puts inside; None where none does.
        here: (3,) where the base stands.
    """

    planner: Planner
    world: World
    object_id: str
    action: Action
    item: str | None
    here: Array
    _known: dict[str, bool] = field(default_factory=dict)

    def serves(self, handle: Handle) -> bool:
        """Decides whether the item could be put behind a handle; true for all doors, and where nothing is to be."""
        if handle.joint not in self._known:
            self._known[handle.joint] = self._serves(handle)
        return self._known[handle.joint]

    def _serves(self, handle: Handle) -> bool:
        drawer = [region for region in self._interiors(handle) if region.opening[2] > _UPWARD]
        if self.item is None or not drawer:
            return True
        world, joint = self.world, self.world.assets[self.object_id].joint(handle.joint)
        now = world.joint_position(self.object_id, joint.name)
        then = joint.position(end_fractions(self.action, joint, joint.fraction(now))[0])
        T_root = world.T_world_link(self.object_id, joint.parent)
        slid = T_root @ joint_transform(joint, then) @ inverse(T_root @ joint_transform(joint, now))
        goals = item_goals(world.assets[self.item], world.T_world_link(self.item))
        onward = Onward(self.planner, world, self.item, goals, self.object_id, drawer, self.here, slid, MOST_CANDIDATES)
        with joints_at(self.planner, {(self.object_id, joint.name): then}):
            return not goals or onward.leads_anywhere()

    def _interiors(self, handle: Handle) -> list[Region]:
        regions = self.world.assets[self.object_id].regions
        return [region for region in regions if region.kind == "interior" and region.joint == handle.joint]


def put_inside(world: World, object_id: str, later: Iterable[SimpleTask]) -> str | None:
    """Returns the first item that a later subtask puts inside an object, or None."""
    for subtask in later:
        wanted = any(a.predicate == "inside" and a.args == (subtask.target, object_id) for a in atoms(subtask.goal))
        if wanted and subtask.target in world.dynamic_ids:
            return subtask.target
    return None
