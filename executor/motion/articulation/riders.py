"""What lies in a drawer: it goes along when the drawer moves."""

from __future__ import annotations

import numpy as np

from executor.geometry import inverse
from executor.world.world import World

EDGE_M = 0.01


def riders(world: World, object_id: str, link: str | None = None) -> tuple[str, ...]:
    """Returns the items that lie where a moving link of an object carries them.

    Args:
        world: Where things are.
        object_id: The object.
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
            centre = (T_link_world @ world.T_world_link(item)[:, 3])[:3]
            if bool(np.all(np.abs(centre - np.array(region.center_m)) <= room)):
                found.append(item)
    return tuple(dict.fromkeys(found))
