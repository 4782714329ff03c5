"""Grasp poses of the hand: at the bar of a handle, around an item, at its wall; and push poses at a panel or its edge.

A hollow item that is too wide for the gripper is held by its wall, one finger inside and one outside. The closed
gripper pushes a panel shut from outside, or wider from inside where it stands ajar.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from executor.assets.asset_geometry import bounds, is_tall, rolls_freely, width_at
from executor.assets.model import Asset, Handle, Rim, Vector
from executor.geometry import Array, hand_rotation, heading_of, inverse, transform
from executor.planning.cargo import Carried
from executor.planning.stances import HandGoal
from oag.model.robots import HandShape

HANDLE_PITCHES_DEG = (0.0, 20.0, -15.0)  # Level first: that is square to an upright bar.
TALL_PITCHES_DEG = (0.0, 15.0, 30.0)  # Level first: the item is tall enough.
FROM_ABOVE_DEG = (45.0, 60.0, 75.0)  # For tall items among others.
LOW_PITCHES_DEG = (45.0, 60.0, 35.0, 75.0)  # The palm passes above what the item stands on.
FLATTER_DEG, FLATTER_FROM_M = (25.0, 15.0), 0.04
"""On high tops, where steep hands do not reach, things of this height are taken nearly level."""

FLAT_PITCHES_DEG = (82.0, 75.0, 60.0, 45.0)  # Nearly straight down first.
THIN_PITCHES_DEG = (88.0, 82.0, 75.0)  # Only steep hands: the tips hold a few millimetres.
FLAT_M, THIN_M = 0.030, 0.008
"""What is lower is taken almost straight down; of what is lower still the tips hold only a few millimetres."""

ITEM_HEADINGS = 12  # Every 30 degrees around what is round.
PITCH_COST = 0.02  # For each pitch after the preferred one.
THIN_PITCH_COST = 0.4  # Much, since a flatter hand holds less of what is thin.
RAISED = 0.12  # Of a tall item's height, above its middle.
FINGERTIPS_M = 0.005
"""How far the hand may stay back and still close around the middle of what it takes."""

HOLDING_SHARE = 0.75  # Of a round thing's diameter: its sides lean by 41 degrees there; friction of 0.9 holds up to 42.
GRIP_DEPTH_M = 0.010  # The least that the fingers hold of an upper edge.
FROM_ABOVE_COST = 0.10  # The hand comes from above only where the side is taken.
OFF_THE_SUPPORT_M, THIN_OFF_THE_SUPPORT_M = 0.002, 0.0016
_LEVEL = 0.3  # Of an axis: the fingers can close along it.
PITCHES_DEG = (*TALL_PITCHES_DEG[1:], *FROM_ABOVE_DEG)
DEEP_PITCHES_DEG, DEEP_ABOVE_M, DEEP_COST = (88.0, 75.0, 60.0), (0.0, 0.008, 0.015), 0.05
"""For what lies in a box: steep hands, and how far above its middle they hold it, so that the palm stays out."""

BELOW_TOP_M = (0.022, 0.016, GRIP_DEPTH_M)
"""How far below the top the fingers' middle is, the deepest hold first."""

BACK_M = (0.0, 0.005)
"""How far the hand stays back from the thing's middle."""

SHALLOW_COST = 0.03  # For each hold that is less deep.
GRIP_DEPTHS_M, DEPTH_COST = (0.016, 0.010), 0.1
"""From the wall's upper edge down along it to between the fingertips: the deeper, the less a heavy thing turns."""

LEANS_RAD, LEAN_COST = (0.0, 0.6, -0.6), 0.1
"""How far the hand leans over along the rim: where straight down is out of reach."""

SIDEWAYS_RAD = (0.9, -0.9, 1.2, -1.2)
"""The same of a hand that comes nearly level along the rim: under a board or into a microwave no steeper one gets.

What turns a thing in the fingers does not depend on it: the hand is turned about the axis along which they close.
"""

SPARE_M, NARROWED_COST = (0.006, 0.003, 0.0015), 0.1
"""How far each finger is beside what it is to close on where an open hand has no room: from three times what the robot
is off its path down to what it keeps anywhere at a grasp.
"""

LEVEL_SHARE = 0.3  # A hand whose approach is less level comes straight down.
UPRIGHT_COSINE = 0.95  # Within 18 degrees.
AT_WALL_M = 0.006
"""How near to the wall's middle the fingertips' middle is when they hold it."""

ACROSS_COSINE = 0.8
"""And how squarely they close on it; what is held around all of it is closed on along it there."""


def handle_goals(handle: Handle, T_world_link: Array) -> list[HandGoal]:
    """Return hand poses that close on a handle's bar at several heights and tilts.

    Args:
        handle: The bar, in its link's frame.
        T_world_link: (4, 4) where the link is now.
    """
    centre = (T_world_link @ np.array([*handle.position_m, 1.0]))[:3]
    axis = T_world_link[:3, :3] @ np.array(handle.axis)
    yaw = heading_of(-(T_world_link[:3, :3] @ np.array(handle.outward)))
    upright = abs(axis[2]) < 0.5
    room = max(handle.length_m / 2 - 0.05, 0.0)
    goals = []
    for along_m in (0.0, min(0.06, room), -min(0.06, room)):
        for rank, pitch_deg in enumerate(HANDLE_PITCHES_DEG):
            R = hand_rotation(yaw, np.deg2rad(pitch_deg), upright=upright)
            cost = PITCH_COST * rank + 0.1 * abs(along_m)
            goals.append(HandGoal(transform(R, centre + along_m * axis), yaw, cost))
    return goals


def item_goals(hand: HandShape, asset: Asset, T_world_object: Array) -> list[HandGoal]:
    """Return hand poses around an item: level ones for tall items, steep ones for low items.

    They come from all headings, or for an item with grasp axes, from headings across these. Steep hands take a tall
    item near its top, because its upper edge would meet the palm further down. Where the palm keeps all of these off,
    as from the middle of something low and long, hands come nearly straight down.

    Args:
        hand: Lengths of the hand.
        asset: The item; its frame is the centre of its bounding box.
        T_world_object: (4, 4) where it stands.
    """
    goals = _goals_at(hand, asset, T_world_object, _pitches_deg(asset))
    return goals or _goals_at(hand, asset, T_world_object, FLAT_PITCHES_DEG)


def _goals_at(hand: HandShape, asset: Asset, T_world_object: Array, pitches_deg: tuple[float, ...]) -> list[HandGoal]:
    pitch_cost = THIN_PITCH_COST if asset.extent_m[2] < THIN_M else PITCH_COST
    goals = []
    for yaw in item_headings(asset, T_world_object[:3, :3]):
        for rank, pitch_deg in enumerate(pitches_deg):
            R = hand_rotation(yaw, np.deg2rad(pitch_deg))
            point = _hold_at(hand, asset, T_world_object, R)
            if point is not None:
                cost = pitch_cost * rank + (FROM_ABOVE_COST if pitch_deg in FROM_ABOVE_DEG and is_tall(asset) else 0.0)
                goals.append(HandGoal(transform(R, point), yaw, cost))
    return goals


def _pitches_deg(asset: Asset) -> tuple[float, ...]:
    if is_tall(asset):
        return (*TALL_PITCHES_DEG, *FROM_ABOVE_DEG)
    height_m = asset.extent_m[2]
    if height_m < THIN_M:
        return THIN_PITCHES_DEG
    low_deg = FLAT_PITCHES_DEG if height_m < FLAT_M else LOW_PITCHES_DEG
    return (*low_deg, *FLATTER_DEG) if height_m >= FLATTER_FROM_M else low_deg


def _hold_at(hand: HandShape, asset: Asset, T_world_object: Array, R_world_hand: Array) -> Array | None:
    """Return the position between the fingertips, or None where the palm meets the item first.

    A little above the middle of a tall item is best: farther from the support, and the item hangs below the fingers.
    Where its upper edge would meet the palm, the hand takes it higher up; where its near side would, it stays back.
    """
    R = T_world_object[:3, :3]
    point = T_world_object[:3, 3] + R @ np.array(asset.grasp_point_m)
    approach = R_world_hand[:, 2]
    if not is_tall(asset):
        held = point - max(0.0, _depth_m(asset, T_world_object, point, R_world_hand) - hand.palm_room_m) * approach
        if not asset.symmetric_about_z and not _sides_hold(asset, T_world_object, held, point, R_world_hand):
            return None
        # The tips of a hand that takes something flat stay off what it lies on.
        drop_m = hand.fingertip_m * -float(approach[2]) + hand.finger_half_m * float(np.hypot(approach[0], approach[1]))
        off_m = THIN_OFF_THE_SUPPORT_M if asset.extent_m[2] < THIN_M else OFF_THE_SUPPORT_M
        low_m, high_m = (float(T_world_object[2, 3] + bound[2]) for bound in bounds(asset, R))
        down_m = float(held[2]) - (low_m + off_m + drop_m)
        # What is flat is held as low as that, where the palm stays off it: its side may be round further up.
        reaches = _depth_m(asset, T_world_object, held, R_world_hand) + down_m <= hand.palm_room_m
        held = np.asarray(
            held - np.array([0.0, 0.0, down_m if asset.extent_m[2] < FLAT_M and reaches else min(0.0, down_m)])
        )
        # Before the end of something long the palm keeps a flat hand so far back that its fingers close above it.
        deep_m = high_m - (float(held[2]) - drop_m)
        return held if deep_m >= min(GRIP_DEPTH_M, asset.extent_m[2] / 2) else None
    pitch = float(np.arcsin(-approach[2]))
    point = point + np.array([0.0, 0.0, RAISED * asset.extent_m[2]])
    side_m = _depth_m(asset, T_world_object, point, hand_rotation(heading_of(approach), 0.0)) * float(np.cos(pitch))
    edge_m = float(T_world_object[2, 3] + bounds(asset, R)[1][2] - point[2])
    # What is above the palm's upper edge passes over it.
    met_m = min(edge_m, hand.palm_half_m / float(np.cos(pitch)))
    beyond_m = side_m + met_m * float(np.sin(pitch)) - hand.palm_room_m
    held = np.asarray(point - max(0.0, beyond_m) * approach)
    if beyond_m <= FINGERTIPS_M:
        return held
    if not pitch and not asset.symmetric_about_z:
        return held if _sides_hold(asset, T_world_object, held, point, R_world_hand) else None
    lower_edge_m = (hand.palm_room_m + FINGERTIPS_M - side_m) / float(np.sin(pitch)) if pitch else 0.0
    if lower_edge_m < GRIP_DEPTH_M:
        return None
    return np.asarray(point + np.array([0.0, 0.0, edge_m - lower_edge_m]) - FINGERTIPS_M * approach)


def _sides_hold(asset: Asset, T_world_object: Array, held: Array, point: Array, R_world_hand: Array) -> bool:
    """Return whether the item is about as wide where the hand holds it as at the point that is best held.

    A box is; a mug is not in front of its axis, where fingers would slide off it towards the ear.
    """
    R_world_level = hand_rotation(heading_of(R_world_hand[:, 2]), 0.0)
    turn, ahead = R_world_level.T @ T_world_object[:3, :3], R_world_level[:, 2]
    held_m, best_m = (width_at(asset, turn, float(ahead @ (at - T_world_object[:3, 3]))) for at in (held, point))
    return held_m >= HOLDING_SHARE * best_m


def _depth_m(asset: Asset, T_world_object: Array, point: Array, R_world_hand: Array) -> float:
    """Return how far the item reaches towards the hand from a point, along the hand's approach."""
    nearest, _ = bounds(asset, R_world_hand.T @ T_world_object[:3, :3])
    return float((R_world_hand.T @ (point - T_world_object[:3, 3]))[2] - nearest[2])


def item_headings(asset: Asset, R_world_object: Array) -> list[float]:
    """Return headings of the hand; its fingers close across its heading."""
    level = [axis for axis in (R_world_object @ np.array(a) for a in asset.grasp_axes) if abs(axis[2]) < _LEVEL]
    if not level:
        return [2.0 * np.pi * k / ITEM_HEADINGS for k in range(ITEM_HEADINGS)]
    return [heading_of(axis) + side for axis in level for side in (np.pi / 2, -np.pi / 2)]


def deep_goals(asset: Asset, T_world_object: Array, along_rad: float) -> list[HandGoal]:
    """Return steep hand poses around a low item, at its middle and higher up; none for tall items.

    Walls around it, as of a box, keep flatter hands out, and the palm from coming down as far as usual. What is
    round is held no higher than where its sides hold.

    Args:
        asset: The item; its frame is the centre of its bounding box.
        T_world_object: (4, 4) where it stands.
        along_rad: Heading of a wall: along walls the open fingers have most room beside a thing that any side holds.
    """
    if is_tall(asset):
        return []
    R, height_m = T_world_object[:3, :3], asset.extent_m[2]
    point = T_world_object[:3, 3] + R @ np.array(asset.grasp_point_m)
    most_m = (
        float(np.sqrt(1.0 - HOLDING_SHARE**2)) * height_m / 2 if rolls_freely(asset) else height_m / 2 - GRIP_DEPTH_M
    )
    above_m = [above_m for above_m in DEEP_ABOVE_M if above_m <= most_m]
    headings = item_headings(asset, R) if asset.grasp_axes else [along_rad + side * np.pi / 2 for side in range(4)]
    goals = []
    for yaw, (rank, pitch_deg), (higher, up_m) in itertools.product(
        headings, enumerate(DEEP_PITCHES_DEG), enumerate(above_m)
    ):
        at = point + np.array([0.0, 0.0, up_m])
        cost = PITCH_COST * rank + DEEP_COST * higher
        goals.append(HandGoal(transform(hand_rotation(yaw, np.deg2rad(pitch_deg)), at), yaw, cost))
    return goals


def top_goals(asset: Asset, T_world_object: Array) -> list[HandGoal]:
    """Return hand poses that close around the upper part of an item, whose palm may or may not have room.

    Args:
        asset: The item; its frame is the centre of its bounding box.
        T_world_object: (4, 4) where it stands.

    Returns:
        None at all for what is low, round, or does not stand upright: `item_goals` has all that it can be held at.
    """
    R = T_world_object[:3, :3]
    if asset.symmetric_about_z or not is_tall(asset) or R[2, 2] < np.cos(np.deg2rad(5.0)):
        return []
    top_m = T_world_object[2, 3] + asset.extent_m[2] / 2
    point = T_world_object[:3, 3] + R @ np.array(asset.grasp_point_m)
    goals = []
    ways = itertools.product(enumerate(PITCHES_DEG), enumerate(BELOW_TOP_M), BACK_M)
    for yaw, ((rank, pitch_deg), (shallow, below_m), back_m) in itertools.product(item_headings(asset, R), ways):
        hand = hand_rotation(yaw, np.deg2rad(pitch_deg))
        at = np.array([point[0], point[1], top_m - below_m]) - back_m * hand[:, 2]
        cost = PITCH_COST * rank + SHALLOW_COST * shallow + (FROM_ABOVE_COST if pitch_deg in FROM_ABOVE_DEG else 0.0)
        goals.append(HandGoal(transform(hand, at), yaw, cost))
    return goals


def rim_goals(asset: Asset, T_world_object: Array, leans_rad: tuple[float, ...] = LEANS_RAD) -> list[HandGoal]:
    """Return hand poses at each flat piece of an upright thing's wall, coming down along it from outside.

    Args:
        asset: The thing; without a rim there are none.
        T_world_object: (4, 4) where it stands; there are none where it lies.
        leans_rad: How far the hand leans over along the rim.
    """
    if asset.rim is None or T_world_object[2, 2] < UPRIGHT_COSINE:
        return []
    goals = []
    middle = (T_world_object @ np.array([*asset.rim.center_m, 1.0]))[:3]
    sides, depths = range(asset.rim.sides), enumerate(GRIP_DEPTHS_M)
    for side, (rank, depth_m), lean in itertools.product(sides, depths, leans_rad):
        T = T_world_object @ _hand_at(asset.rim, 2.0 * np.pi * side / asset.rim.sides, depth_m, lean)
        cost = DEPTH_COST * rank + (LEAN_COST if lean else 0.0)
        goals.append(HandGoal(T, heading_of_hand(T, middle), cost))
    return goals


def narrowed_goals(goals: Iterable[HandGoal], width_m: float, finger_upper_m: float) -> list[HandGoal]:
    """Return the same hand poses of fingers that are open little wider than what they close on, the wider ones first.

    Beside a wall, or between things, there is no room for fingers that are open all the way.

    Args:
        goals: The poses.
        width_m: Of what the fingers close on.
        finger_upper_m: Position of each finger that is open all the way.
    """
    openings_m = [(rank, width_m / 2 + spare_m) for rank, spare_m in enumerate(SPARE_M)]
    return [
        replace(goal, opening_m=opening_m, cost=goal.cost + NARROWED_COST * rank)
        for goal in goals
        for rank, opening_m in openings_m
        if opening_m < finger_upper_m
    ]


def is_held_at_rim(asset: Asset, carried: Carried) -> bool:
    """Return whether a held thing has its wall between the fingers; else they are around all of it."""
    if asset.rim is None:
        return False
    rim, T_object_eef = asset.rim, inverse(carried.T_eef_object)
    hand, closing = T_object_eef[:3, 3] - np.array(rim.center_m), T_object_eef[:3, 1]
    outward = np.array([*hand[:2], 0.0]) / max(float(np.hypot(*hand[:2])), 1e-9)
    cosine, sine = float(np.cos(rim.slope_rad)), float(np.sin(rim.slope_rad))
    across = cosine * outward - np.array([0.0, 0.0, sine])
    beyond_m = float(across @ (hand - rim.radius_m * outward))
    return abs(beyond_m) < AT_WALL_M and abs(float(across @ closing)) > ACROSS_COSINE


def room_below_m(hand: HandShape, asset: Asset) -> tuple[float, float]:
    """Return the height [m] of the held piece of a wall above the thing's support, and the height that it needs.

    The outer finger of the open hand is as far below it as the wall leans over that finger.

    Raises:
        ValueError: The thing has no rim.
    """
    if asset.rim is None:
        raise ValueError(f"a {asset.category} has no rim")
    slope = asset.rim.slope_rad
    held_m = asset.rim.center_m[2] - GRIP_DEPTHS_M[-1] * np.cos(slope) + asset.extent_m[2] / 2
    outwards_m = hand.opening_m / 2 + hand.finger_thick_m
    return float(held_m), float(outwards_m * np.sin(slope) + hand.fingertip_m * np.cos(slope))


def _hand_at(rim: Rim, angle_rad: float, depth_m: float, lean_rad: float) -> Array:
    """Return the (4, 4) hand pose in the thing's frame on the wall's piece that faces an angle."""
    outward = np.array([np.cos(angle_rad), np.sin(angle_rad), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    cosine, sine = np.cos(rim.slope_rad), np.sin(rim.slope_rad)
    down_along, closing = -(cosine * up + sine * outward), cosine * outward - sine * up
    point = np.array(rim.center_m) + rim.radius_m * outward + depth_m * down_along
    approach = np.cos(lean_rad) * down_along + np.sin(lean_rad) * np.cross(closing, down_along)
    return transform(np.stack([np.cross(closing, approach), closing, approach], axis=1), point)


def heading_of_hand(T_eef: Array, middle_m: Array) -> float:
    """Return a hand's heading: along its approach, or for one that comes straight down, towards the middle."""
    approach = T_eef[:3, 2]
    return heading_of(approach if np.hypot(*approach[:2]) > LEVEL_SHARE else middle_m - T_eef[:3, 3])


LEVEL_TILTS_DEG = (50.0, 35.0, 65.0, 20.0, 0.0)
"""Above the panel's normal, for level bars: from 50 degrees on, the door of an oven can come all the way down."""

# Square to the panel first; a hand that is turned aside is the weaker hold.
UPRIGHT_TILTS_DEG = (0.0, 20.0, -20.0, 40.0, -40.0)
EDGE_TILTS_DEG = (10.0, 0.0, 20.0, -10.0)  # Nearly level first: the edge of a door that is down lies before the robot.
EDGE_CLEARANCE_M = 0.012  # So much wider than the panel the gripper opens.
EDGE_DEPTH_M = 0.012  # From the edge to between the fingertips.
END_ROOM_M = 0.05  # Kept from a bar's ends: all of the hand is on it.
ASIDE_M = 0.06  # Beside the middle of a bar, where that is out of reach.
OVERLAP_M = 0.004  # So far into the panel the hand is sent, to keep pressing on it.
GAP_M = 0.012  # Before the panel, so that the approach ends without touching.
EDGE_M = 0.035  # Kept from the panel's edges: all of the hand is on it.
TILTS_DEG = (0.0, 25.0, -25.0, 50.0, -50.0)  # Square to the panel first.


def edge_of(asset: Asset, handle: Handle, opening_m: float) -> Handle | None:
    """Return the panel's free edge as a handle, where the gripper, at this opening, can hold it; else None."""
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
    """Return hand poses that close on a handle's bar at several tilts about the bar and places along it.

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
    """Return the face of the panel that carries a handle, the largest box of its link; None where there is none.

    Args:
        handle: Its outward direction distinguishes the outer face from the inner one.
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


def push_goals(shape: HandShape, panel: Panel, T_world_link: Array, T_world_root: Array) -> Iterator[Push]:
    """Yield hand poses before a panel, first those near its free edge and square to it.

    Args:
        shape: Lengths of the hand.
        T_world_link: (4, 4) where its link is.
        T_world_root: (4, 4) where the object stands; from it follows the side of the robot.
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
        start = transform(hand, point + shape.press_tip_m * back + GAP_M * normal)
        yield Push(HandGoal(start, heading, PITCH_COST * rank), -(GAP_M + OVERLAP_M) * normal)
