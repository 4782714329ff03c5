"""The resistance of doors and drawers.

Doors and drawers resist with dry friction, and refrigerators with a gasket over the first degrees. Both are given as
forces at the handle, perpendicular to its path, as a spring balance would read. The handle's lever turns them into
joint torques. The friction is constant over the whole range, whatever the joint carries. The engine's own friction
coefficient is zero, because it multiplies the load in the joint: the same 0.3 asks 42 N of one door and 2 N of another.
A gasket pulls with its full force where the door is shut. The force fades to zero at `GASKET_REACH_M` of the handle's
path.

Source of the ranges: readings of a spring balance at household doors and drawers; 22 N is the maximum that the ADA's
rule 404.2.9 allows for an interior door. A refrigerator resists with friction and gasket together.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from executor.assets.model import Asset, Handle, Joint
from executor.assets.parameters import NumericParameter, number
from oag import SceneObject

HANDLE_FORCE = NumericParameter("handle_force_n", 15.0, 10.0, 30.0)
GASKET_FORCE = NumericParameter("gasket_force_n", 10.0, 5.0, 15.0)
MOST_FORCE_N = 200.0
"""Largest force of either in a scene; this robot cannot open that, and fails by stalling or slipping."""

GASKET_REACH_M = 0.03  # Handle travel at which rubber and magnet have come loose; some 3 degrees.
_HAS_GASKET = ("refrigerator", "fridge", "freezer")


def with_resistance(obj: SceneObject, asset: Asset) -> Asset:
    """Return an asset with the joint resistance that an object specifies; joints without a handle stay as they are.

    Args:
        obj: Its parameters `handle_force_n` and `gasket_force_n` [N] apply to each of its handles. By default the
            friction is 15 N, and the gasket 10 N for refrigerators and freezers, and 0 for others.
        asset: The object's geometry.

    Raises:
        AssetError: One of the parameters is not a number from 0 to 200.
    """
    if not asset.handles:
        return asset
    gasket_n = GASKET_FORCE.default if any(word in obj.category.lower() for word in _HAS_GASKET) else 0.0
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
    """Return a handle's travel per unit of its joint: [m/rad] for a hinge, 1 for a slide."""
    if joint.kind == "prismatic":
        return 1.0
    return float(np.linalg.norm(np.cross(joint.axis, handle.position_m)))
