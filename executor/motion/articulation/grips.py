"""Hand poses at a door or drawer for motions in which the hand does not keep still: at a bar, an edge, or its panel.

The closed gripper pushes a panel shut from outside, or wider from inside where it stands ajar.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.model import Asset, Handle, Vector
from executor.geometry import Array, heading_of, transform
from executor.motion.grasping.grasps import PITCH_COST
from executor.motion.planning.candidates import HandGoal

LEVEL_TILTS_DEG = (50.0, 35.0, 65.0, 20.0, 0.0)
"""Above the panel's normal, for level bars: from 50 degrees on, the door of an oven can come all the way down."""

# Square to the panel first; a hand that is turned aside is the weaker hold.
UPRIGHT_TILTS_DEG = (0.0, 20.0, -20.0, 40.0, -40.0)
EDGE_TILTS_DEG = (10.0, 0.0, 20.0, -10.0)  # Nearly level first: the edge of a door that is down lies before the robot.
EDGE_CLEARANCE_M = 0.012  # So much wider than the panel the gripper opens.
EDGE_DEPTH_M = 0.012  # From the edge to between the fingertips.
END_ROOM_M = 0.05  # Kept from a bar's ends: all of the hand is on it.
ASIDE_M = 0.06  # Beside the middle of a bar, where that is out of reach.
TIP_M = 0.012
"""From the middle of the fingertips to where a tilted closed gripper touches first, with a little to spare."""

OVERLAP_M = 0.004  # So far into the panel the hand is sent, to keep pressing on it.
GAP_M = 0.012  # Before the panel, so that the approach ends without touching.
EDGE_M = 0.035  # Kept from the panel's edges: all of the hand is on it.
TILTS_DEG = (0.0, 25.0, -25.0, 50.0, -50.0)  # Square to the panel first.


def edge_of(asset: Asset, handle: Handle, opening_m: float) -> Handle | None:
    """Returns the panel's free edge as something to hold, where the gripper, so far open, takes it; else None."""
    panel = panel_of(asset, handle, inner=False)
    if panel is None or panel.thickness_m > opening_m - EDGE_CLEARANCE_M:
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


@dataclass(frozen=True, slots=True)
class Panel:
    """The face of a door or drawer that is pushed, in its link's frame.

    Attributes:
        center_m: (3,) middle of the face.
        normal: (3,) unit normal, away from the panel: the push goes against it.
        sides: (2, 3) unit vectors in the face: towards the edge that is farthest from the hinge, and across.
        half_m: (2,) half extents along these.
        thickness_m: From this face to the other one.
    """

    center_m: Array
    normal: Array
    sides: Array
    half_m: Array
    thickness_m: float


@dataclass(frozen=True, slots=True)
class Push:
    """One place and direction to push from.

    Attributes:
        goal: The hand before the panel, a little off.
        press: (3,) from there to where the hand presses, in the world.
    """

    goal: HandGoal
    press: Array


def panel_of(asset: Asset, handle: Handle, *, inner: bool) -> Panel | None:
    """Returns the face of the panel that carries a handle, the largest box of its link; None where there is none.

    Args:
        asset: Whose it is.
        handle: Its outward direction tells the outer face from the inner one.
        inner: Whether the inner face is wanted.
    """
    link = next(link for link in asset.links if link.name == handle.link)
    normal = np.array(handle.outward) * (-1.0 if inner else 1.0)
    thin = int(np.argmax(np.abs(normal)))
    across = [k for k in range(3) if k != thin]
    boxes = [s for s in link.shapes if s.kind == "box" and s.collides and s.orientation == (1.0, 0.0, 0.0, 0.0)]
    if not boxes:
        return None
    panel = max(boxes, key=lambda s: s.size_m[across[0]] * s.size_m[across[1]])
    center = np.array(panel.position_m) + normal * panel.size_m[thin]
    # The link's frame lies on the hinge: away from it is towards the free edge. A slide has no such edge.
    away = sorted(across, key=lambda k: -abs(panel.position_m[k]))
    sides = np.zeros((2, 3))
    for row, k in enumerate(away):
        sides[row, k] = 1.0 if panel.position_m[k] >= 0.0 else -1.0
    return Panel(center, normal, sides, np.array([panel.size_m[k] for k in away]), 2 * panel.size_m[thin])


def push_goals(panel: Panel, T_world_link: Array, T_world_root: Array) -> Iterator[Push]:
    """Yields hand poses before a panel, the ones near its free edge and square to it first.

    Args:
        panel: The face.
        T_world_link: (4, 4) where its link is.
        T_world_root: (4, 4) where the object stands, which tells from where a robot faces it.
    """
    R = T_world_link[:3, :3]
    normal, sides = R @ panel.normal, (R @ panel.sides.T).T
    centre = (T_world_link @ np.array([*panel.center_m, 1.0]))[:3]
    reach = np.maximum(panel.half_m - EDGE_M, 0.0)
    places = [(1.0, 0.0), (0.7, 0.0), (0.85, 0.6), (0.85, -0.6), (0.4, 0.0)]
    for (rank, tilt_deg), (far, aside), about in itertools.product(enumerate(TILTS_DEG), places, (0, 1)):
        back = Rotation.from_rotvec(np.deg2rad(tilt_deg) * sides[about]).apply(normal)
        # Nobody pushes from below the floor.
        if back[2] < -0.5:
            continue
        point = centre + far * reach[0] * sides[0] + aside * reach[1] * sides[1]
        # Closing along the axis of the tilt: open fingers come no nearer to the panel by it.
        closing = sides[about]
        hand = np.stack([np.cross(closing, -back), closing, -back], axis=1)
        level = np.hypot(back[0], back[1]) > 0.3
        heading = heading_of(-back) if level else heading_of(T_world_root[:3, 0])
        start = transform(hand, point + TIP_M * back + GAP_M * normal)
        yield Push(HandGoal(start, heading, PITCH_COST * rank), -(GAP_M + OVERLAP_M) * normal)
