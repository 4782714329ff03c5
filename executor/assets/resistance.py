"""What a door or drawer asks of the hand: dry friction, and a refrigerator's gasket over the first degrees.

Both are told as forces at the handle, square to the way it takes, and become torques by the handle's lever: what a
spring balance would read. The friction is the same all the way, whatever the joint carries. (The engine's own friction
coefficient is none: it multiplies the load in the joint: the same 0.3 asks 42 N of one door and 2 N of another.)
A gasket pulls shut with all its force where the door is shut, and with less the farther the handle has come, down to
nothing at `GASKET_REACH_M`.

Source of the ranges: what a spring balance reads at household doors and drawers; 22 N is the most that the ADA's rule
404.2.9 lets an interior door ask. A refrigerator asks for both together.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from executor.assets.model import Asset, Handle, Joint
from executor.assets.parameters import Quantity, number
from oag import SceneObject

HANDLE_FORCE = Quantity("handle_force_n", 15.0, 10.0, 30.0)
GASKET_FORCE = Quantity("gasket_force_n", 10.0, 5.0, 15.0)
MOST_FORCE_N = 200.0
"""What a scene may say of either; far beyond what this robot opens, which then fails by stalling or slipping."""

GASKET_REACH_M = 0.03  # Of the handle's way, where the rubber and its magnet have come loose; some 3 degrees.
_COLD = ("refrigerator", "fridge", "freezer")


def with_resistance(obj: SceneObject, asset: Asset) -> Asset:
    """Returns an asset whose joints resist as the object says; joints that no handle moves stay as they are.

    Args:
        obj: Its parameters `handle_force_n` and `gasket_force_n`, each at each of its handles, are read. By default
            the first is 15 N, and the second 10 N for what is cold and none for anything else.
        asset: The object's geometry.

    Raises:
        AssetError: When one of the parameters is no number from 0 to 200.
    """
    if not asset.handles:
        return asset
    gasket_n = GASKET_FORCE.default if any(word in obj.category.lower() for word in _COLD) else 0.0
    force_n = number(obj, HANDLE_FORCE.name, HANDLE_FORCE.default, 0.0, MOST_FORCE_N)
    gasket_n = number(obj, GASKET_FORCE.name, gasket_n, 0.0, MOST_FORCE_N)
    handle_of = {handle.joint: handle for handle in asset.handles}

    def resisting(joint: Joint) -> Joint:
        if joint.name not in handle_of:
            return joint
        lever = lever_of(joint, handle_of[joint.name])
        return replace(joint, friction=force_n * lever, gasket=gasket_n * lever, gasket_reach=GASKET_REACH_M / lever)

    return replace(asset, joints=tuple(resisting(joint) for joint in asset.joints))


def lever_of(joint: Joint, handle: Handle) -> float:
    """Returns how far a handle moves for a unit of its joint: metres a radian of a hinge, 1 along a slide."""
    if joint.kind == "prismatic":
        return 1.0
    return float(np.linalg.norm(np.cross(joint.axis, handle.position_m)))
