"""Pushing a door or drawer with the closed gripper: shut from outside, or wider from inside where it stands ajar."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.model import Asset, Handle, Joint
from executor.geometry import Array, heading_of, transform
from executor.motion.articulation.rigid import driving_carries
from executor.motion.articulation.whole_body import Share
from executor.motion.grasping.grasps import PITCH_COST
from executor.motion.stances.candidates import HandGoal

TIP_M = 0.012
"""From the middle of the fingertips to where a tilted closed gripper touches first, with a little to spare."""

OVERLAP_M = 0.004
GAP_M = 0.012
EDGE_M = 0.035
TILTS_DEG = (0.0, 25.0, -25.0, 50.0, -50.0)
_UPRIGHT_SHARES = (
    Share(1.0, 1.0, 1.0),
    Share(1.0, 0.5, 0.5),
    Share(1.0, 0.0, 0.0),
    Share(0.6, 0.0, 0.0),
    Share(0.3, 0.0, 0.0),
)
_FOLDING_SHARES = (Share(0.8, 0.0, 0.0), Share(1.0, 0.0, 0.5), Share(0.8, 0.0, 1.0), Share(0.5, 0.0, 0.0))
_SLIDING_SHARES = (Share(1.0), Share(0.5), Share(0.0))


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

    def shares(self, joint: Joint, T_world_root: Array) -> tuple[Share, ...]:
        """Returns how base and arm may share the push, the likeliest first."""
        if joint.kind == "prismatic":
            return _SLIDING_SHARES
        return _UPRIGHT_SHARES if driving_carries(joint, T_world_root) else _FOLDING_SHARES


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
