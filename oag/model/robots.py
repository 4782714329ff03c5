"""Robots as data: one record that graph, planner, motion, environments, data sets and policies read.

A robot is an arm with a two-finger hand on a base that drives and turns. Its joints come in this order: `base_x`,
`base_y` [m], `base_yaw` [rad], `lift` [m] where a lift carries the arm, then the arm [rad], then the fingers [m].
A configuration q is base (the lift is its fourth coordinate) and arm; slices of the record take it apart. Links are
named by role. The base's frame moves with the lift: hand poses in it do not depend on where the arm has been lifted to.

Lengths are as simulated, `scale` applied. The description is a file of an installed package; `executor` reads it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from oag.model.symbols import Primitive

BASE_JOINTS = ("base_x", "base_y", "base_yaw")
LIFT_JOINT = "lift"


@dataclass(frozen=True, slots=True)
class HandShape:
    """Lengths [m] of a hand with two fingers; its frame is between the fingertips, with the approach along z.

    Attributes:
        opening_m: Between the open fingers.
        aim_m: The width that is aimed at where a thing is scaled and nothing is drawn; the paper's robot has 0.05.
        least_m: Least width of a scaled thing: narrower ones would be toys.
        palm_room_m: From the middle of the fingertips back to the palm, with two millimetres to spare.
        palm_half_m: From the hand's axis to the palm's upper edge.
        fingertip_m: How far the fingers go on beyond the middle of their tips.
        finger_half_m: Half a finger's thickness across the closing direction.
        finger_thick_m: Of one finger, in the closing direction.
        press_tip_m: From the middle of the fingertips to where a tilted closed hand touches first, with some to spare.
    """

    opening_m: float
    aim_m: float
    least_m: float
    palm_room_m: float
    palm_half_m: float
    fingertip_m: float
    finger_half_m: float
    finger_thick_m: float
    press_tip_m: float


@dataclass(frozen=True, slots=True)
class BoxGripper:
    """A parallel gripper of boxes, for an arm whose description has no hand; lengths [m] as simulated.

    Attributes:
        flange: Link of the description that carries it.
        position_m, rpy_rad: Of the gripper's frame in that link: its approach is z, and its fingers close along y.
        palm_m: Sides of the housing, along x, y and z.
        finger_m: Sides of a finger.
        palm_kg, finger_kg: Masses.
    """

    flange: str
    position_m: tuple[float, float, float]
    rpy_rad: tuple[float, float, float]
    palm_m: tuple[float, float, float]
    finger_m: tuple[float, float, float]
    palm_kg: float
    finger_kg: float


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """A robot; two records are equal where they are the same one of `ROBOTS`.

    Attributes:
        name: By which scenes, commands and data sets name it.
        words: What it is, after "a mobile".
        distribution, urdf: Installed distribution, and the end of the path of its description.
        scale: Of the description's size.
        arm_joints, finger_joints: Names in the description, from the base on.
        arm_links: From the one that is mounted to the last one before the hand.
        hand_link, finger_links, tip_link: The palm, the two fingers, and the frame between the fingertips.
        elbow: How many of `arm_links` are near the mount. Those from `forearm` on are beyond the elbow. Links of one
            of these groups overlap by design.
        home: The arm's posture for driving [rad].
        swing_deg: How far the arm turns on its mount from straight ahead, to either side.
        torques_nm: Of the arm's joints, at the description's size.
        speeds_rad_s: Fastest that the maker lets the arm's joints turn, and those of its wrist.
        acceleration_rad_s2: Of the arm's joints in planned motions: what a Panda's slowest one may do.
        wrist: How many of the arm's last joints are its wrist.
        chassis_m: Height of the base's top.
        mount_m: Height of the arm's mount on the base, the lift down.
        lift_m: How far the lift raises it; 0 where there is none.
        shoulder_m, stretched_m: From the mount up to the shoulder, and from there to between the stretched arm's
            fingertips.
        comfort_m: Height of the wrist over the mount at which the arm has most room, of a level hand and of one that
            points down; chooses the lift's position.
        wrist_m: From the wrist to between the fingertips.
        reaches_m: From the base's axis to the hand, the most comfortable first.
        close_reaches_m: Reaches with the elbow high, where there is no room farther off.
        far_reaches_m: Reaches with the arm nearly stretched, where there is no room nearer: deep in a compartment.
        tucked_m: Reaches with which things are carried over the base.
        withdraw_m: How far the base backs out, until the arm has room to go home.
        mirrored: For each of the arm's joints the sign and the addition [rad] that mirror it in the plane of the base's
            x axis and the arm's first axis.
            Empty where an arm has no mirror image; nothing is learned from mirrored episodes of it.
        leaning_rad: Of the arm's second joint, where the upper arm leans forward.
        mast_side: On which side the mast stands, 1 for left and -1 for right: not where the elbow folds back.
        hand: Lengths of the hand.
        box_gripper: The gripper, where the arm's description has none.
        keeps_order: Whether searches keep the order in which stored results of the robot were found. Those of another
            one ask the floor before postures, and begin with what a dry run chose.
    """

    name: str
    words: str
    distribution: str
    urdf: str
    scale: float
    arm_joints: tuple[str, ...]
    finger_joints: tuple[str, str]
    arm_links: tuple[str, ...]
    hand_link: str
    finger_links: tuple[str, str]
    tip_link: str
    elbow: int
    forearm: int
    home: tuple[float, ...]
    swing_deg: float
    torques_nm: tuple[float, ...]
    speeds_rad_s: tuple[float, float]
    acceleration_rad_s2: float
    wrist: int
    chassis_m: float
    mount_m: float
    lift_m: float
    shoulder_m: float
    stretched_m: float
    comfort_m: tuple[float, float]
    wrist_m: float
    reaches_m: tuple[float, ...]
    close_reaches_m: tuple[float, ...]
    far_reaches_m: tuple[float, ...]
    tucked_m: tuple[float, ...]
    withdraw_m: tuple[float, ...]
    mirrored: tuple[tuple[float, float], ...]
    hand: HandShape
    leaning_rad: float = 0.5
    mast_side: int = 1
    box_gripper: BoxGripper | None = None
    keeps_order: bool = True

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle by name, so that another process has its own one and the same record."""
        return robot_named, (self.name,)

    @property
    def base_joints(self) -> tuple[str, ...]:
        """Names of the base's joints, the lift among them."""
        return (*BASE_JOINTS, LIFT_JOINT) if self.lift_m else BASE_JOINTS

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of all joints, in the order of every array of joints."""
        return (*self.base_joints, *self.arm_joints, *self.finger_joints)

    @property
    def base(self) -> slice:
        """The base's coordinates in an array of joints: x, y, yaw, and the lift."""
        return slice(0, len(self.base_joints))

    @property
    def arm(self) -> slice:
        """The arm's joints."""
        return slice(len(self.base_joints), self.movers)

    @property
    def movers(self) -> int:
        """Number of coordinates of base and arm, a configuration's."""
        return len(self.base_joints) + len(self.arm_joints)

    @property
    def fingers(self) -> slice:
        """The fingers' joints."""
        return slice(self.movers, self.movers + 2)

    @property
    def gripper_links(self) -> tuple[str, ...]:
        """The palm and the fingers."""
        return (self.hand_link, *self.finger_links)

    def start(self, x_m: float, y_m: float, yaw_rad: float) -> tuple[float, ...]:
        """Return the configuration of a robot that stands somewhere, lift down and arm at home."""
        return (x_m, y_m, yaw_rad, *((0.0,) if self.lift_m else ()), *self.home)

    def longest_motion_m(self, primitive: Primitive) -> float | None:
        """Return the longest distance [m] by which a primitive can move the hand; None where it moves no hand.

        Vertically it reaches from the floor to the height of the stretched arm, else from one side of the shoulder to
        the other.
        """
        if primitive in (Primitive.LIFT_EEF_UP, Primitive.LIFT_EEF_DOWN):
            return round(self.mount_m + self.lift_m + self.shoulder_m + self.stretched_m, 2)
        return round(2 * self.stretched_m, 2) if primitive in _SIDEWAYS else None


_SIDEWAYS = frozenset(
    (
        Primitive.MOVE_EEF_FORWARD,
        Primitive.MOVE_EEF_BACKWARD,
        Primitive.MOVE_EEF_LEFT,
        Primitive.MOVE_EEF_RIGHT,
    )
)

PAPER_ROBOT = Robot(
    name="paper",
    words="Panda at 0.7 of its size",
    distribution="example-robot-data",
    urdf="robots/panda_description/urdf/panda.urdf",
    scale=0.7,
    arm_joints=tuple(f"panda_joint{index}" for index in range(1, 8)),
    finger_joints=("panda_finger_joint1", "panda_finger_joint2"),
    arm_links=tuple(f"panda_link{index}" for index in range(8)),
    hand_link="panda_hand",
    finger_links=("panda_leftfinger", "panda_rightfinger"),
    tip_link="panda_hand_tcp",
    elbow=5,
    forearm=3,
    home=(0.0, -0.9, 0.0, -2.35, 0.0, 2.6, 0.785),
    swing_deg=166.0,
    torques_nm=(87.0,) * 4 + (12.0,) * 3,
    speeds_rad_s=(2.175, 2.61),
    acceleration_rad_s2=7.0,
    wrist=3,
    chassis_m=0.18,
    mount_m=0.30,
    lift_m=0.0,
    shoulder_m=0.333 * 0.7,
    stretched_m=0.96 * 0.7,  # A Panda's 0.855 m and the hand.
    comfort_m=(0.55, 0.35),
    wrist_m=0.147,
    reaches_m=(0.45, 0.40, 0.50, 0.35, 0.55),
    close_reaches_m=(0.30, 0.25),
    far_reaches_m=(),  # Stored results stay repeatable.
    tucked_m=(0.36, 0.40, 0.32),
    withdraw_m=(0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.65),
    mirrored=(*((-1.0, 0.0), (1.0, 0.0)) * 3, (-1.0, math.pi / 2)),
    hand=HandShape(
        opening_m=0.056,
        aim_m=0.05,
        least_m=0.035,
        palm_room_m=0.024,
        palm_half_m=0.023,
        fingertip_m=0.007,
        finger_half_m=0.008,
        finger_thick_m=0.012,
        press_tip_m=0.012,
    ),
)
"""The robot of the paper, of T1 to T6 and of their tables."""

FULL_SIZE = replace(
    PAPER_ROBOT,
    name="panda",
    words="Panda at 1 of its size",
    scale=1.0,
    shoulder_m=0.333,
    stretched_m=0.96,
    comfort_m=(0.80, 0.50),
    wrist_m=0.21,
    # Lengths of the smaller hand, as grasps were planned before robots had records: stored results stay repeatable.
    hand=replace(PAPER_ROBOT.hand, opening_m=0.08, aim_m=0.071, least_m=0.05),
)
"""A Panda that nothing is scaled for, its mount as low as the paper's."""

LIFTED = replace(
    FULL_SIZE,
    name="panda-lift",
    words="Panda at 1 of its size on a lift",
    chassis_m=0.12,
    mount_m=0.16,
    lift_m=0.60,
    reaches_m=(0.55, 0.50, 0.60, 0.45, 0.65, 0.70),
    close_reaches_m=(0.40, 0.35),
    far_reaches_m=(0.75, 0.80, 0.85),
    tucked_m=(0.40, 0.45, 0.36),
    withdraw_m=(0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.95),
    hand=HandShape(
        opening_m=0.08,
        aim_m=0.071,
        least_m=0.05,
        palm_room_m=0.035,
        palm_half_m=0.033,
        fingertip_m=0.010,
        finger_half_m=0.011,
        finger_thick_m=0.017,
        press_tip_m=0.017,
    ),
    keeps_order=False,
)
"""The arm is on a carriage, which the mast of the head camera guides: as low as level hands need it at a table."""

UR5 = Robot(
    name="ur5-lift",
    words="UR5 with a parallel gripper on a lift",
    distribution="example-robot-data",
    urdf="robots/ur_description/urdf/ur5_joint_limited_robot.urdf",
    scale=1.0,
    arm_joints=(
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "elbow_joint",
        "wrist_1_joint",
        "wrist_2_joint",
        "wrist_3_joint",
    ),
    finger_joints=("gripper_left_joint", "gripper_right_joint"),
    arm_links=(
        "base_link",
        "shoulder_link",
        "upper_arm_link",
        "forearm_link",
        "wrist_1_link",
        "wrist_2_link",
        "wrist_3_link",
    ),
    hand_link="gripper_palm",
    finger_links=("gripper_left_finger", "gripper_right_finger"),
    tip_link="gripper_tip",
    elbow=4,
    forearm=3,
    home=(0.0, -1.91, 1.57, 0.75, 1.571, 1.571),
    swing_deg=180.0,
    torques_nm=(150.0,) * 3 + (28.0,) * 3,
    speeds_rad_s=(3.15, 3.2),
    acceleration_rad_s2=7.0,
    wrist=3,
    chassis_m=0.12,
    mount_m=0.30,
    lift_m=0.60,
    shoulder_m=0.089,
    stretched_m=1.05,
    comfort_m=(0.35, 0.35),
    wrist_m=0.205,
    reaches_m=(0.55, 0.60, 0.50, 0.65, 0.70, 0.45),
    close_reaches_m=(0.40, 0.35),
    far_reaches_m=(0.75, 0.80, 0.85, 0.90),
    tucked_m=(0.40, 0.45, 0.36),
    withdraw_m=(0.0, 0.15, 0.3, 0.45, 0.6, 0.75, 0.95),
    mirrored=(),
    hand=HandShape(
        opening_m=0.085,
        aim_m=0.075,
        least_m=0.05,
        palm_room_m=0.046,
        palm_half_m=0.027,
        fingertip_m=0.010,
        finger_half_m=0.010,
        finger_thick_m=0.012,
        press_tip_m=0.017,
    ),
    leaning_rad=-0.9,
    mast_side=-1,
    box_gripper=BoxGripper(
        flange="wrist_3_link",
        position_m=(0.0, 0.0823, 0.0),
        rpy_rad=(-math.pi / 2, 0.0, 0.0),
        palm_m=(0.05, 0.13, 0.075),
        finger_m=(0.020, 0.012, 0.058),
        palm_kg=0.8,
        finger_kg=0.03,
    ),
    keeps_order=False,
)
"""Of the installed arms the least like a Panda: six joints, shoulder and elbow side by side, and no hand.

Its description draws a gripper as three boxes that do not move. Here such boxes are a gripper of 85 mm, about as wide
as those that such arms have. The upper arm leans back on the left, so the mast stands on the right.
"""

DEFAULT_ROBOT = LIFTED
"""The robot of a scene whose author names none. T1 to T6, their built-in scenes and their tables have the paper's."""

ROBOTS = {robot.name: robot for robot in (PAPER_ROBOT, FULL_SIZE, LIFTED, UR5)}
"""Every robot by its name."""


def robot_of_record(data: Mapping[str, Any]) -> Robot:
    """Return the robot of a record's data: by its name, or by its scale, as before robots had names.

    Raises:
        KeyError: There is no such robot.
    """
    if "name" in data:
        return robot_named(str(data["name"]))
    return {PAPER_ROBOT.scale: PAPER_ROBOT, FULL_SIZE.scale: FULL_SIZE}[float(data["scale"])]


def record_of_robot(robot: Robot) -> dict[str, Any]:
    """Return the data from which `robot_of_record` finds a robot; of the first two it is what it was before names."""
    named = {} if robot in (PAPER_ROBOT, FULL_SIZE) else {"name": robot.name}
    return {**named, "scale": robot.scale}


def chosen_robot(name: str, *, full_size: bool) -> str:
    """Return a robot's name from options; empty where nothing was chosen."""
    return name or (FULL_SIZE.name if full_size else "")


def known_robot(name: str) -> str:
    """Return the name of a robot, or an empty one; a ValueError names the robots where it is another."""
    if name and name not in ROBOTS:
        raise ValueError(f"no robot is named {name!r}; expected one of {', '.join(ROBOTS)}")
    return name


def robot_named(name: str) -> Robot:
    """Return the robot of a name; a KeyError where there is none."""
    return ROBOTS[name]
