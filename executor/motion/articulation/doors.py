"""Which door or drawer of several: what opening is for decides, and closing takes each that stands open."""

from __future__ import annotations

from collections.abc import Iterable

from bddl import Atom, atoms
from executor.assets.model import Handle, Joint, Region
from executor.robot.description import FINGER_LINKS
from executor.world.detectors import read
from executor.world.engine import ROBOT
from executor.world.world import World
from oag import SimpleTask
from oag.table.library import OPEN_FRACTION

ROOM_M = 0.01
"""How much an interior has to be larger than what is put into it."""


def gripped_handle(world: World, object_id: str) -> Handle | None:
    """Returns the handle whose link the fingers touch, or None."""
    links = {
        contact.b.link
        for contact in world.contacts({object_id})
        if contact.a.owner == ROBOT and contact.a.link in FINGER_LINKS and contact.b.owner == object_id
    }
    return next((handle for handle in world.assets[object_id].handles if handle.link in links), None)


def handle_of(world: World, object_id: str, joint: str) -> Handle | None:
    """Returns the handle that moves a joint, or None."""
    return next((handle for handle in world.assets[object_id].handles if handle.joint == joint), None)


def standing_open(world: World, object_id: str) -> tuple[Joint, ...]:
    """Returns the joints that are open as the detector of `open` understands it, the widest first."""
    fractions = {j: j.fraction(world.joint_position(object_id, j.name)) for j in world.assets[object_id].joints}
    found = [joint for joint, fraction in fractions.items() if fraction > OPEN_FRACTION]
    return tuple(sorted(found, key=lambda joint: -fractions[joint]))


def handles_to_close(world: World, object_id: str) -> tuple[Handle, ...]:
    """Returns the handles of what stands open, the widest first; of everything where nothing does."""
    known = world.assets[object_id].handles
    found = [handle_of(world, object_id, joint.name) for joint in standing_open(world, object_id)]
    return tuple(handle for handle in found if handle is not None) or known


def handles_to_open(world: World, object_id: str, later: Iterable[SimpleTask]) -> tuple[Handle, ...]:
    """Returns the handles that may be opened, the one that serves best first.

    An item that a later subtask takes and that lies inside decides: its door or drawer alone will do. Else an item that
    a later subtask puts inside does: doors of interiors that it fits into. Else every handle will do, the largest door
    first.

    Args:
        world: Where things are.
        object_id: The articulated object.
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
            return [str(r.joint) for r in regions if r.name == lies.measurements["region"]]
        if any(atom.predicate == "inside" and atom.args == (item, object_id) for atom in atoms(subtask.goal)):
            return [str(r.joint) for r in regions if _fits(world, item, r)]
    return []


def _fits(world: World, item: str, region: Region) -> bool:
    x, y, z = (extent / 2 + ROOM_M for extent in world.assets[item].extent_m)
    room_x, room_y, room_z = region.half_extents_m
    return min(x, y) <= min(room_x, room_y) and max(x, y) <= max(room_x, room_y) and z <= room_z
