"""Hand poses at a bar that is tilted against its panel, for motions in which the hand does not keep still."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.model import Asset, Handle, Vector
from executor.geometry import Array, heading_of, transform
from executor.motion.articulation.push import panel_of
from executor.motion.grasping.grasps import PITCH_COST
from executor.motion.stances.candidates import HandGoal
from executor.robot.description import GRIPPER_OPENING_M

LEVEL_TILTS_DEG = (50.0, 35.0, 65.0, 20.0, 0.0)
"""Above the panel's normal, for level bars: from 50 degrees on, the door of an oven can come all the way down."""

UPRIGHT_TILTS_DEG = (0.0, 20.0, -20.0, 40.0, -40.0)
EDGE_TILTS_DEG = (10.0, 0.0, 20.0, -10.0)
EDGE_CLEARANCE_M = 0.012
EDGE_DEPTH_M = 0.012
END_ROOM_M = 0.05
ASIDE_M = 0.06


def edge_of(asset: Asset, handle: Handle) -> Handle | None:
    """Returns the panel's free edge as something to hold, where the gripper is wide enough for it; else None."""
    panel = panel_of(asset, handle, inner=False)
    if panel is None or panel.thickness_m > GRIPPER_OPENING_M - EDGE_CLEARANCE_M:
        return None
    edge = panel.center_m - panel.thickness_m / 2 * panel.normal + (panel.half_m[0] - EDGE_DEPTH_M) * panel.sides[0]
    return Handle(
        link=handle.link,
        joint=handle.joint,
        position_m=(float(edge[0]), float(edge[1]), float(edge[2])),
        axis=handle.axis,
        outward=(float(panel.sides[0][0]), float(panel.sides[0][1]), float(panel.sides[0][2])),
        length_m=2 * float(panel.half_m[1]),
        thickness_m=panel.thickness_m,
    )


def tilted_goals(
    handle: Handle,
    T_world_root: Array,
    T_world_link: Array,
    *,
    facing: Vector,
    tilts_deg: tuple[float, ...] | None = None,
) -> list[HandGoal]:
    """Returns hand poses that close on a handle's bar at several tilts about the bar and places along it.

    Args:
        handle: The bar, in its link's frame.
        T_world_root: (4, 4) where the object stands.
        T_world_link: (4, 4) where the bar's link is now.
        facing: Away from the front, in the object's frame: where a robot stands that takes a level bar.
        tilts_deg: Other tilts than the usual ones.
    """
    R_link = T_world_link[:3, :3]
    centre = (T_world_link @ np.array([*handle.position_m, 1.0]))[:3]
    axis, outward = R_link @ np.array(handle.axis), R_link @ np.array(handle.outward)
    level = abs(axis[2]) < 0.5
    # Positive tilts lift a level hand.
    lifting = axis if np.cross(axis, outward)[2] > 0 else -axis
    tilts = tilts_deg or (LEVEL_TILTS_DEG if level else UPRIGHT_TILTS_DEG)
    room = max(handle.length_m / 2 - END_ROOM_M, 0.0)
    goals = []
    for along_m in (0.0, min(ASIDE_M, room), -min(ASIDE_M, room)):
        for rank, tilt_deg in enumerate(tilts):
            back = Rotation.from_rotvec(np.deg2rad(tilt_deg) * lifting).apply(outward)
            closing = np.cross(axis, -back)
            R = np.stack([np.cross(closing, -back), closing, -back], axis=1)
            # A door that has come down faces the floor; where to stand before it does not change by that.
            heading = heading_of(-(T_world_root[:3, :3] @ np.array(facing)) if level else -back)
            cost = PITCH_COST * rank + 0.1 * abs(along_m)
            goals.append(HandGoal(transform(R, centre + along_m * axis), heading, cost))
    return goals
