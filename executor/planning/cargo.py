"""What goes along with what moves: the items that a link carries, and what is in the gripper with its cargo.

An item rides where its centre is in or on a region of its carrier. Cargo is taken to be fixed to its carrier: a bowl
is carried upright, so that what lies in it stays where it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from executor.geometry import Array, inverse
from executor.sim.detectors import touching_bodies
from executor.sim.world import World

EDGE_M = 0.01  # What leans over the side of a drawer lies in it.


@dataclass(frozen=True, slots=True)
class Carried:
    """An object in the gripper, and its cargo.

    Attributes:
        object_id: Id of the object between the fingers.
        T_eef_object: (4, 4) its pose in the hand's frame.
        cargo: The ids of the items that ride in or on it, directly or not, with their poses (4, 4) in the hand's frame.
    """

    object_id: str
    T_eef_object: Array
    cargo: tuple[tuple[str, Array], ...] = ()

    @property
    def poses(self) -> tuple[tuple[str, Array], ...]:
        """All that moves with the hand, the held object first: ids, and poses (4, 4) in the hand's frame."""
        return (self.object_id, self.T_eef_object), *self.cargo

    @property
    def ids(self) -> tuple[str, ...]:
        """The ids of all that moves with the hand, the held object first."""
        return tuple(name for name, _ in self.poses)


def carried_by(world: World, object_id: str, T_world_eef: Array) -> Carried:
    """Return what a hand at a pose (4, 4) carries that holds an object where it is now, with the object's cargo."""
    T_eef_world = inverse(T_world_eef)
    cargo = tuple((item, T_eef_world @ world.T_world_link(item)) for item in cargo_of(world, object_id))
    return Carried(object_id, T_eef_world @ world.T_world_link(object_id), cargo)


def cargo_of(world: World, object_id: str) -> tuple[str, ...]:
    """Return the ids of the items that ride in or on an item, directly or on one another."""
    found = {object_id: None}
    waiting = [object_id]
    while waiting:
        carrier = waiting.pop()
        own = [item for item in riders(world, carrier, world.assets[carrier].links[0].name) if item not in found]
        found |= dict.fromkeys(own)
        waiting += own
    return tuple(found)[1:]


def touching_any(world: World, object_ids: tuple[str, ...]) -> tuple[str, ...]:
    """Return the bodies that touch any of some objects, but for those objects."""
    touching = (body for object_id in object_ids for body in touching_bodies(world, object_id))
    return tuple(dict.fromkeys(body for body in touching if body not in object_ids))


def riders(world: World, object_id: str, link: str | None = None) -> tuple[str, ...]:
    """Return the items that a link of an object carries.

    Args:
        link: One of its links; all of its moving links by default.
    """
    asset = world.assets[object_id]
    moving = {joint.child for joint in asset.joints} if link is None else {link}
    found = []
    for region in asset.regions:
        if region.link not in moving:
            continue
        T_link_world = inverse(world.T_world_link(object_id, region.link))
        room = np.array(region.half_extents_m) + EDGE_M
        for item in world.dynamic_ids:
            wide_m = min(world.assets[item].extent_m[:2]) / 2
            if item == object_id or (region.kind == "interior" and wide_m > max(region.half_extents_m[:2])):
                continue  # As a saucer is in no cup that stands on it.
            centre = (T_link_world @ world.T_world_link(item)[:, 3])[:3]
            if bool(np.all(np.abs(centre - np.array(region.center_m)) <= room)):
                found.append(item)
    return tuple(dict.fromkeys(found))
