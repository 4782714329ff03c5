"""What goes along with what moves: the items that a link carries, and what is in the gripper with its cargo.

Cargo of an item is what rests on nothing else. It is taken to be fixed to its carrier, which is kept upright.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from executor.assets.asset_geometry import bounds
from executor.geometry import Array, inverse
from executor.sim.detectors import links_touching, touching_bodies
from executor.sim.engine import ROBOT
from executor.sim.world import World

OUT_BY_M = 0.02  # What is outside is so far beyond the front: ten times what the robot is off its path.
HELD = "held object"
"""Name of what is in the gripper, its cargo included, as what moves."""

EDGE_M = 0.01  # What leans over the side of a drawer lies in it.


@dataclass(frozen=True, slots=True)
class Carried:
    """An object in the gripper, and its cargo.

    Attributes:
        object_id: Id of the object between the fingers.
        T_eef_object: (4, 4) its pose in the hand's frame.
        cargo: The ids of its cargo, with their poses (4, 4) in the hand's frame.
        upward: (3,) the direction in the hand's frame that points up where the carrier is upright; None without cargo.
    """

    object_id: str
    T_eef_object: Array
    cargo: tuple[tuple[str, Array], ...] = ()
    upward: Array | None = None

    @property
    def poses(self) -> tuple[tuple[str, Array], ...]:
        """All that moves with the hand, the held object first: ids, and poses (4, 4) in the hand's frame."""
        return (self.object_id, self.T_eef_object), *self.cargo

    @property
    def ids(self) -> tuple[str, ...]:
        """The ids of all that moves with the hand, the held object first."""
        return tuple(name for name, _ in self.poses)


def carried_by(
    world: World, object_id: str, T_world_eef: Array, cargo: tuple[str, ...] = (), upward: Array | None = None
) -> Carried:
    """Return what a hand carries that holds an object where it is now.

    Args:
        world: Where things are.
        object_id: The object between the fingers.
        T_world_eef: (4, 4) pose of the hand.
        cargo: The ids of the object's cargo (`cargo_of`).
        upward: (3,) the direction in the hand's frame that pointed up when the object was taken; by default now.
    """
    T_eef_world = inverse(T_world_eef)
    poses = tuple((item, T_eef_world @ world.T_world_link(item)) for item in cargo)
    if cargo and upward is None:
        upward = T_world_eef[2, :3]
    return Carried(object_id, T_eef_world @ world.T_world_link(object_id), poses, upward)


def is_outside(world: World, carried: Carried, within: str, T_world_eef: Array) -> bool:
    """Return whether the middle of what a hand carries is outside of all interiors of an object.

    Args:
        within: The object's id; its joints are where they are now.
        T_world_eef: (4, 4) pose of the hand.
    """
    asset, T = world.assets[carried.object_id], T_world_eef @ carried.T_eef_object
    middle = T[:3, 3] + np.mean(bounds(asset, T[:3, :3]), axis=0)
    for region in world.assets[within].regions:
        local = (inverse(world.T_world_link(within, region.link)) @ np.array([*middle, 1.0]))[:3]
        off = np.abs(local - np.array(region.center_m))
        if region.kind == "interior" and (off < np.array(region.half_extents_m) + OUT_BY_M).all():
            return False
    return True


def cargo_of(world: World, object_id: str) -> tuple[str, ...]:
    """Return the ids of an item's cargo: of the items that rest on it and on one another, and on nothing else.

    Contacts decide, and not regions: what stands on the board above is over a carton as well, and of two plates one in
    the other each has its centre in the other's region.

    Args:
        world: At rest; a restored one has to have made a step.
        object_id: The carrier.
    """
    touching = {object_id: touching_bodies(world, object_id)}
    waiting = [object_id]
    while waiting:
        for body in touching[waiting.pop()]:
            if body in world.dynamic_ids and body not in touching:
                touching[body] = touching_bodies(world, body)
                waiting.append(body)
    alone = set(touching)
    while elsewhere := {item for item in alone - {object_id} if not {*touching[item]} <= alone | {ROBOT}}:
        alone -= elsewhere
    return tuple(item for item in world.dynamic_ids if item in alone and item != object_id)


def touching_any(world: World, object_ids: tuple[str, ...]) -> tuple[str, ...]:
    """Return the bodies that touch any of some objects, but for those objects."""
    touching = (body for object_id in object_ids for body in touching_bodies(world, object_id))
    return tuple(dict.fromkeys(body for body in touching if body not in object_ids))


def riders(world: World, object_id: str, link: str | None = None) -> tuple[str, ...]:
    """Return the items that a moving link of an object carries.

    Args:
        link: One of its moving links; all of them by default.
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
            if region.kind == "interior" and wide_m > max(region.half_extents_m[:2]):
                continue  # As a saucer is in no cup that stands on it.
            centre = (T_link_world @ world.T_world_link(item)[:, 3])[:3]
            off = np.abs(centre - np.array(region.center_m)) - room
            # What stands in a drawer goes along however far it stands out.
            stands_out = region.opens_upward and centre[2] > region.center_m[2]
            if bool(np.all(off <= 0.0)) or (
                stands_out and bool(np.all(off[:2] <= 0.0)) and region.link in links_touching(world, item, object_id)
            ):
                found.append(item)
    return tuple(dict.fromkeys(found))
