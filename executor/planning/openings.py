"""Choose which handles of a thing are for opening or closing it: by what is open, and by what a later subtask needs.

The purpose of an opening decides which door or drawer of several; closing takes every one that stands open.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

from bddl import Atom, atoms
from executor.assets.asset_geometry import joint_transform
from executor.assets.model import Handle, Joint, Region
from executor.geometry import Array, inverse
from executor.planning.articulation import end_fractions, joints_at
from executor.planning.grasps import item_goals
from executor.planning.place_lookahead import PlacementLookahead
from executor.planning.planner import Planner
from executor.sim.detectors import read
from executor.sim.engine import ROBOT
from executor.sim.world import World
from oag import Action, SimpleTask
from oag.primitives.table import OPEN_FRACTION

ROOM_M = 0.01
"""How much an interior has to be larger than what is put into it."""


Serves = Callable[[Handle], bool]


def gripped_handle(world: World, object_id: str) -> Handle | None:
    """Return the handle whose link the fingers touch, or None."""
    links = {
        contact.b.link
        for contact in world.contacts({object_id})
        if contact.a.owner == ROBOT and contact.a.link in world.model.finger_links and contact.b.owner == object_id
    }
    return next((handle for handle in world.assets[object_id].handles if handle.link in links), None)


def handle_of(world: World, object_id: str, joint: str) -> Handle | None:
    """Return the handle that moves a joint, or None."""
    return next((handle for handle in world.assets[object_id].handles if handle.joint == joint), None)


def open_joints(world: World, object_id: str) -> tuple[Joint, ...]:
    """Return the joints that the detector of `open` counts as open, the widest first."""
    fractions = {j: j.fraction(world.joint_position(object_id, j.name)) for j in world.assets[object_id].doors}
    found = [joint for joint, fraction in fractions.items() if fraction > OPEN_FRACTION]
    return tuple(sorted(found, key=lambda joint: -fractions[joint]))


def handles_to_close(world: World, object_id: str) -> tuple[Handle, ...]:
    """Return the handles of the open joints, the widest first; all handles where no joint is open."""
    known = world.assets[object_id].handles
    found = [handle_of(world, object_id, joint.name) for joint in open_joints(world, object_id)]
    return tuple(handle for handle in found if handle is not None) or known


def handles_to_open(world: World, object_id: str, later: Iterable[SimpleTask]) -> tuple[Handle, ...]:
    """Return the handles that may be opened, the best one first.

    An item that a later subtask takes and that lies inside decides: only its door or drawer will do. Else an item that
    a later subtask puts inside decides: doors of interiors that it fits into. Else every handle will do, the largest
    door first.

    Args:
        later: The subtasks that come after.
    """
    asset = world.assets[object_id]
    joints = _joints_of_use(world, object_id, tuple(later))
    wanted = [h for joint in joints for h in asset.handles if h.joint == joint]
    return tuple(dict.fromkeys(wanted)) or asset.handles


def _joints_of_use(world: World, object_id: str, later: tuple[SimpleTask, ...]) -> list[str]:
    regions = [r for r in world.assets[object_id].regions if r.kind == "interior" and r.joint is not None]
    for subtask in later:
        item = subtask.target
        if item not in world.dynamic_ids:
            continue
        lies = read(Atom("inside", (item, object_id)), world)
        if lies.value:
            return [str(r.joint) for r in regions if r.name == lies.measurements.region]
        if any(atom.predicate == "inside" and atom.args == (item, object_id) for atom in atoms(subtask.goal)):
            return [str(r.joint) for r in regions if _fits(world, item, r)]
    return []


def _fits(world: World, item: str, region: Region) -> bool:
    x, y, z = (extent / 2 + ROOM_M for extent in world.assets[item].extent_m)
    room_x, room_y, room_z = region.half_extents_m
    return min(x, y) <= min(room_x, room_y) and max(x, y) <= max(room_x, room_y) and z <= room_z


@dataclass(frozen=True)
class Purpose:
    """The purpose of an opening: an item that a later subtask puts inside.

    Attributes:
        planner: Synchronised with the world.
        world: Where things are.
        object_id: What is opened.
        action: ARTICULATE_OPEN, filled or not.
        item: What a later subtask puts inside; None where none does.
        here: (B,) where the base stands.
    """

    planner: Planner
    world: World
    object_id: str
    action: Action
    item: str | None
    here: Array
    _known: dict[str, bool] = field(default_factory=dict)

    def serves(self, handle: Handle) -> bool:
        """Return whether the item could be put behind a handle; true for all doors, and without an item."""
        if handle.joint not in self._known:
            self._known[handle.joint] = self._serves(handle)
        return self._known[handle.joint]

    def _serves(self, handle: Handle) -> bool:
        drawer = [region for region in self._interiors(handle) if region.opens_upward]
        if self.item is None or not drawer:
            return True
        world, joint = self.world, self.world.assets[self.object_id].joint(handle.joint)
        now = world.joint_position(self.object_id, joint.name)
        then = joint.position(end_fractions(self.planner.robot, self.action, joint, joint.fraction(now))[0])
        T_root = world.T_world_link(self.object_id, joint.parent)
        slid = T_root @ joint_transform(joint, then) @ inverse(T_root @ joint_transform(joint, now))
        goals = item_goals(world.model.hand, world.assets[self.item], world.T_world_link(self.item))
        lookahead = PlacementLookahead(self.planner, world, self.item, goals, self.object_id, drawer, self.here, slid)
        with joints_at(self.planner, {(self.object_id, joint.name): then}):
            return not goals or lookahead.allows_any_placement()

    def _interiors(self, handle: Handle) -> list[Region]:
        regions = self.world.assets[self.object_id].regions
        return [region for region in regions if region.kind == "interior" and region.joint == handle.joint]


def first_item_put_inside(world: World, object_id: str, later: Iterable[SimpleTask]) -> str | None:
    """Return the first item that a later subtask puts inside an object, or None."""
    for subtask in later:
        wanted = any(a.predicate == "inside" and a.args == (subtask.target, object_id) for a in atoms(subtask.goal))
        if wanted and subtask.target in world.dynamic_ids:
            return subtask.target
    return None
