"""The robot's URDF: a Panda arm on a holonomic base, loaded with its drives.

The Panda comes from the installed distribution `example-robot-data`; nothing of it is copied into this project. The
scaled file is written once into the user's cache, so that physics, kinematics and cameras read the same numbers.

Source: the paper's scale of 0.7, at which the gripper opens to 0.056 m; the size proofs of `oag` use it, too. Mount
height, gains and friction are those of the feasibility study: with the mount at 0.30 m a horizontal hand reaches 0.65 m
to 0.80 m. Forces are those of a real robot, scaled. The arm's torques (87 N m, 12 N m in the wrist) scale with the
fourth power of the size: masses with the third power of a length, levers with the first. The fingers' 30 N lie between
the third and the second power of the Franka Hand's 70 N; a hand of full size presses no harder. The base's force is
what its wheels hold, at every scale. The mast of the head camera is ours, and it collides. It stands on a corner of the
base: there it meets neither the elbow, which folds back over the base's middle, nor an aisle that the base fits
through.

The Panda's visual meshes are Collada files with 135 thousand triangles together. Rendering time goes into vertices, so
they are simplified part by part to a twentieth, every material with its colour, and cached as GLB files.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bddl.errors import Scene2DemoError
from bddl.files import write_atomically
from executor.system.files import cache_dir, content_key
from oag.model.scene import PAPER_SCALE

KEPT_FRACTION = 0.05  # No difference shows at 224 pixels; pictures of 128 take a quarter less time than with 0.10.
_FEWEST_TRIANGLES = 24
_OUTLINE_TOLERANCE_M = 0.0015
_AGGRESSION = 3.0  # The library's default of 7 merges across thin parts before it has looked at all edges.
# Raised when the simplification changes, so that old cached files are not taken for new ones.
_RECIPE = "3"
_NAMESPACE = {"c": "http://www.collada.org/2005/11/COLLADASchema"}


@dataclass(frozen=True, slots=True)
class ColoredPart:
    """One piece of a mesh with one colour.

    Attributes:
        vertices_m: (N, 3) positions in the link frame.
        triangles: (M, 3) vertex indices.
        color: RGBA in [0, 1].
    """

    vertices_m: NDArray[np.float64]
    triangles: NDArray[np.int64]
    color: tuple[float, ...]


def decimated_mesh(source: Path) -> Path:
    """Return the cached GLB of a Collada mesh at about a twentieth of its triangles, made where it is missing.

    Args:
        source: A `.dae` file of flat nodes that hold triangles with one material each.
    """
    path = cache_dir() / "meshes" / f"{source.stem}_{content_key(source.read_bytes(), _RECIPE)}.glb"
    return path if path.is_file() else write_atomically(path, _to_glb(simplified(read_collada(source))))


def read_collada(source: Path) -> list[ColoredPart]:
    """Return the coloured parts of a Collada file, placed by their nodes.

    Args:
        source: File with a flat visual scene of triangle meshes, as Blender exports it.
    """
    root = ET.parse(source).getroot()
    colors = {
        effect.attrib["id"]: _element_floats(effect.find(".//c:diffuse/c:color", _NAMESPACE))
        for effect in root.iterfind(".//c:library_effects/c:effect", _NAMESPACE)
    }
    effects = {
        material.attrib["id"]: next(material.iterfind("c:instance_effect", _NAMESPACE)).attrib["url"][1:]
        for material in root.iterfind(".//c:library_materials/c:material", _NAMESPACE)
    }
    geometries = {g.attrib["id"]: g for g in root.iterfind(".//c:library_geometries/c:geometry", _NAMESPACE)}
    parts: list[ColoredPart] = []
    for node in root.iterfind(".//c:visual_scene/c:node", _NAMESPACE):
        T_link_node = _element_floats(node.find("c:matrix", _NAMESPACE)).reshape(4, 4)
        for instance in node.iterfind("c:instance_geometry", _NAMESPACE):
            geometry = geometries[instance.attrib["url"][1:]]
            targets = {
                bound.attrib["symbol"]: bound.attrib["target"][1:]
                for bound in instance.iterfind(".//c:instance_material", _NAMESPACE)
            }
            for triangles in geometry.iterfind(".//c:triangles", _NAMESPACE):
                color = colors[effects[targets[triangles.attrib["material"]]]]
                points, faces = _triangles(geometry, triangles)
                placed = points @ T_link_node[:3, :3].T + T_link_node[:3, 3]
                parts.append(ColoredPart(placed, faces, tuple(float(value) for value in color)))
    return parts


def simplified(parts: list[ColoredPart]) -> list[ColoredPart]:
    """Return the parts with about a twentieth of their triangles; a part that would lose its outline keeps more."""
    import fast_simplification

    result = []
    for part in parts:
        points, triangles = _merged(part.vertices_m, part.triangles)
        outline = _outline(points, triangles)
        wanted = max(_FEWEST_TRIANGLES, int(KEPT_FRACTION * len(triangles)))
        while wanted < len(triangles):
            fewer = fast_simplification.simplify(
                points.astype(np.float32), triangles.astype(np.int32), target_count=wanted, agg=_AGGRESSION
            )
            if np.abs(_outline(*fewer) - outline).max() <= _OUTLINE_TOLERANCE_M:
                points, triangles = np.asarray(fewer[0], float), np.asarray(fewer[1], np.int64)
                break
            wanted *= 2
        result.append(ColoredPart(points, triangles, part.color))
    return result


def _outline(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the corners (2, 3) of the box around the vertices that triangles use."""
    used = points[triangles.reshape(-1)]
    return np.stack([used.min(axis=0), used.max(axis=0)])


def _merged(points: NDArray[np.float64], triangles: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Join vertices that lie within 10 micrometres: simplification opens cracks along unjoined seams."""
    _, first, inverse = np.unique(np.round(points, 5), axis=0, return_index=True, return_inverse=True)
    joined = inverse.reshape(-1)[triangles]
    a, b, c = joined.T
    return points[first], joined[(a != b) & (b != c) & (c != a)]


def _triangles(geometry: ET.Element, triangles: ET.Element) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return vertex positions (N, 3) and indices (M, 3) of one `<triangles>` element."""
    inputs = triangles.findall("c:input", _NAMESPACE)
    stride = 1 + max(int(entry.attrib["offset"]) for entry in inputs)
    vertex = next(entry for entry in inputs if entry.attrib["semantic"] == "VERTEX")
    by_id = {element.attrib["id"]: element for element in geometry.iter() if "id" in element.attrib}
    vertices = by_id[vertex.attrib["source"][1:]]
    position = next(
        entry for entry in vertices.iterfind("c:input", _NAMESPACE) if entry.attrib["semantic"] == "POSITION"
    )
    source = by_id[position.attrib["source"][1:]]
    points = _element_floats(source.find("c:float_array", _NAMESPACE)).reshape(-1, 3)
    indices = _element_floats(triangles.find("c:p", _NAMESPACE)).astype(np.int64).reshape(-1, 3, stride)
    return points, indices[:, :, int(vertex.attrib["offset"])]


def _element_floats(element: ET.Element | None) -> NDArray[np.float64]:
    text = "" if element is None else element.text or ""
    return np.array(text.split(), dtype=np.float64)


def _to_glb(parts: list[ColoredPart]) -> bytes:
    import trimesh

    scene = trimesh.Scene()
    for part in parts:
        material = trimesh.visual.material.PBRMaterial(
            baseColorFactor=np.array(part.color), metallicFactor=0.0, roughnessFactor=0.5
        )
        mesh = trimesh.Trimesh(part.vertices_m, part.triangles, process=False)
        mesh.visual = trimesh.visual.TextureVisuals(material=material)
        scene.add_geometry(mesh)
    return bytes(scene.export(file_type="glb"))


MOUNT_HEIGHT_M = 0.30
ARM_HOME: tuple[float, ...] = (0.0, -0.9, 0.0, -2.35, 0.0, 2.6, 0.785)
JOINT_NAMES: tuple[str, ...] = (
    "base_x",
    "base_y",
    "base_yaw",
    *(f"panda_joint{index}" for index in range(1, 8)),
    "panda_finger_joint1",
    "panda_finger_joint2",
)
TCP_LINK = "panda_hand_tcp"
HAND_LINK = "panda_hand"
FINGER_LINKS = ("panda_leftfinger", "panda_rightfinger")
BASE_LINK = "base_body"
MAST_LINK = "base_mast"
CAMERA_MOUNT_M = (-0.110, 0.146, 1.36)
"""The lens of the head camera in the base's frame: the front of the housing on top of the mast."""

DISTRIBUTION = "example-robot-data"
_PANDA_URDF = "robots/panda_description/urdf/panda.urdf"
_PACKAGE_PREFIX = "package://example-robot-data/"
BASE_SIDE_M = 0.34
BASE_HEIGHTS_M = (0.03, 0.18)
"""Between which the base is a box with that side; its pedestal and the mast are above."""

_BASE_MASS_KG = 60.0
_PEDESTAL_WIDTH_M = 0.16
_PEDESTAL_BOTTOM_M = 0.18
_MAST_WIDTH_M = 0.03  # An aluminium profile of 30 by 30 mm, within the base's footprint.
_MAST_AXIS_M = (-0.150, 0.146)
_MAST_MASS_KG = 1.2  # 1.2 m of profile at 0.8 kg/m, and a camera.
_HOUSING_M = (0.05, 0.046, 0.03)

BASE_FORCE_N = 350.0
"""Along each of the base's two axes, 495 N at the most: three quarters of its weight, which rubber wheels hold."""

YAW_TORQUE_NM = 100.0  # Of 500 N at the wheels, 0.2 m off the middle.
# Stiffness, damping, force limit: N/m, Ns/m, N for sliding joints and Nm/rad, Nms/rad, Nm for turning ones.
BASE_DRIVE = (6e4, 8e3, BASE_FORCE_N)
YAW_DRIVE = (2e4, 2e3, YAW_TORQUE_NM)
ARM_DRIVE = (2e3, 2e2, 87.0)  # This and the wrist's at full size.
WRIST_DRIVE = (2e3, 2e2, 12.0)
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
_IGNORED = {
    BASE_LINK: _NEAR_THE_MOUNT | _MAST_FOOT,
    MAST_LINK: _MAST_FOOT,
    **dict.fromkeys(("panda_link0", "panda_link1", "panda_link2"), _NEAR_THE_MOUNT),
    **dict.fromkeys(("panda_link3", "panda_link4"), _NEAR_THE_MOUNT | _BEYOND_THE_ELBOW),
    **dict.fromkeys(("panda_link5", "panda_link6", "panda_link7", "panda_hand"), _BEYOND_THE_ELBOW),
}


class RobotDataMissing(Scene2DemoError):
    """The distribution that ships the Panda is not installed, or ships it no longer."""

    def __init__(self, problem: str) -> None:
        super().__init__(
            f"The robot's description was not found: {problem}. "
            f"Install it with `pip install 'scene2demo[sim]'` (it brings {DISTRIBUTION})."
        )


@cache
def data_root() -> Path:
    """Return the installed folder that `package://example-robot-data/` stands for.

    Raises:
        RobotDataMissing: When the distribution or its Panda is not there.
    """
    try:
        files = metadata.files(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:
        raise RobotDataMissing(f"the distribution {DISTRIBUTION} is not installed") from None
    for file in files:
        if file.as_posix().endswith("/" + _PANDA_URDF):
            path = Path(str(file.locate())).resolve()
            if path.is_file():
                return path.parents[3]
    raise RobotDataMissing(f"{DISTRIBUTION} {metadata.version(DISTRIBUTION)} has no {_PANDA_URDF}")


def drives(scale: float) -> tuple[tuple[float, float, float], ...]:
    """Return stiffness, damping and force limit of each joint's drive, in the order of `JOINT_NAMES`."""
    arm, wrist = (
        (stiffness, damping, torque_nm * scale**4) for stiffness, damping, torque_nm in (ARM_DRIVE, WRIST_DRIVE)
    )
    return (BASE_DRIVE, BASE_DRIVE, YAW_DRIVE, *[arm] * 4, *[wrist] * 3, FINGER_DRIVE, FINGER_DRIVE)


def armatures(scale: float) -> tuple[float, ...]:
    """Return the rotor's share of each joint's inertia, [kg m2] or [kg], in the order of `JOINT_NAMES`."""
    return (0.0,) * 3 + (ROTOR * scale**5,) * 7 + (ROTOR * scale**3,) * 2


def robot_urdf(scale: float = PAPER_SCALE, *, visual: bool) -> Path:
    """Return the path of the robot's URDF in the cache, writing it first where it is not there yet.

    Args:
        scale: Of a Panda's full size.
        visual: True for meshes that cameras see; False for a file without any `<visual>`, which loads without
            Vulkan.

    Returns:
        The URDF; its name holds a hash of its content.

    Raises:
        RobotDataMissing: When the Panda's distribution is not installed.
    """
    return _written(cache_dir(), scale, visual)


@cache
def _written(folder: Path, scale: float, visual: bool) -> Path:
    content = robot_xml(scale, visual=visual)
    name = f"panda_mobile_{'visual' if visual else 'physics'}_{content_key(content)}.urdf"
    path = folder / "robot" / name
    return path if path.is_file() else write_atomically(path, content)


def robot_xml(scale: float = PAPER_SCALE, *, visual: bool) -> bytes:
    """Return the robot's URDF as bytes; see `robot_urdf`."""
    root = ET.parse(data_root() / _PANDA_URDF).getroot()
    root.set("name", "panda_mobile")
    _strip(root, visual=visual)
    _scale(root, scale)
    for mesh in root.iter("mesh"):
        source = data_root() / mesh.attrib["filename"].removeprefix(_PACKAGE_PREFIX)
        path = decimated_mesh(source) if source.suffix == ".dae" else source
        mesh.set("filename", str(path))
        mesh.set("scale", _numbers([scale] * 3))
    for index, element in enumerate(_base(visual=visual)):
        root.insert(index, element)
    ET.indent(root)
    return ET.tostring(root, encoding="utf-8")


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


def _base(*, visual: bool) -> list[ET.Element]:
    """Return the holonomic base: two sliding links, a turning body with its pedestal, and the arm's mount."""
    body = ET.Element("link", name=BASE_LINK)
    body.append(_inertial(_BASE_MASS_KG, 2.0, "0 0 0.12"))
    width, pedestal = BASE_SIDE_M, MOUNT_HEIGHT_M - _PEDESTAL_BOTTOM_M
    # The physical base ends 3 cm above the floor: nearer, the engine would report it as a contact at every step.
    # The wheels' skirt below it is there for cameras only.
    pieces = (
        ((width, width, 0.15), 0.105, (0.25, 0.27, 0.30), True),
        ((_PEDESTAL_WIDTH_M, _PEDESTAL_WIDTH_M, pedestal), _PEDESTAL_BOTTOM_M + pedestal / 2, (0.6, 0.6, 0.62), True),
        ((width - 0.04, width - 0.04, 0.03), 0.015, (0.04, 0.04, 0.05), False),
    )
    for index, (size, height, color, collides) in enumerate(pieces):
        tags = (*(["visual"] if visual else []), *(["collision"] if collides else []))
        _add_box(body, tags, size, (0.0, 0.0, height), color, f"base_{index}")
    links = [ET.Element("link", name=name) for name in ("world_root", "base_link_x", "base_link_y")]
    for link in links:
        link.append(_inertial(1.0, 0.1))
    return [
        *links,
        body,
        _mast(visual=visual),
        _joint("base_x", "prismatic", "world_root", "base_link_x", axis="1 0 0", bounds=(10.0, 1.0, BASE_FORCE_N)),
        _joint("base_y", "prismatic", "base_link_x", "base_link_y", axis="0 1 0", bounds=(10.0, 1.0, BASE_FORCE_N)),
        # The base turns round and round; planning shifts its goals by whole turns, so two turns are soon used up.
        _joint("base_yaw", "revolute", "base_link_y", BASE_LINK, axis="0 0 1", bounds=(100.0, 2.0, YAW_TORQUE_NM)),
        _joint("arm_mount", "fixed", BASE_LINK, "panda_link0", height_m=MOUNT_HEIGHT_M),
        _joint("mast_foot", "fixed", BASE_LINK, MAST_LINK),
    ]


def _mast(*, visual: bool) -> ET.Element:
    """Return the mast of the head camera, from the top of the base up, in the base's frame; all of it collides."""
    x, y = _MAST_AXIS_M
    top = CAMERA_MOUNT_M[2]
    width, height = _MAST_WIDTH_M, top - _HOUSING_M[2] / 2 - _PEDESTAL_BOTTOM_M
    lens_x, lens_y, lens_z = CAMERA_MOUNT_M
    pieces = (
        ((width, width, height), (x, y, _PEDESTAL_BOTTOM_M + height / 2), (0.62, 0.64, 0.66)),
        (_HOUSING_M, (lens_x - _HOUSING_M[0] / 2, lens_y, lens_z), (0.10, 0.10, 0.12)),
    )
    mast = ET.Element("link", name=MAST_LINK)
    mast.append(_inertial(_MAST_MASS_KG, 0.15, _numbers([x, y, (_PEDESTAL_BOTTOM_M + top) / 2])))
    for index, (size, middle, color) in enumerate(pieces):
        _add_box(mast, (*(["visual"] if visual else []), "collision"), size, middle, color, f"mast_{index}")
    return mast


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
    height_m: float = 0.0,
) -> ET.Element:
    joint = ET.Element("joint", name=name, type=kind)
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_numbers([0, 0, height_m]), rpy="0 0 0")
    if axis:
        ET.SubElement(joint, "axis", xyz=axis)
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


def load_robot(sapien_scene: Any, scale: float = PAPER_SCALE, *, visual: bool) -> Any:
    """Return the robot's articulation, added to the scene and ready to be driven.

    Args:
        sapien_scene: A `sapien.Scene`; it needs a render system only where `visual` is true.
        scale: Of a Panda's full size.
        visual: Whether cameras shall see the robot.

    Returns:
        `sapien.physx.PhysxArticulation` with 12 active joints in the order of `description.JOINT_NAMES`.

    Raises:
        RobotDataMissing: When the Panda's distribution is not installed.
    """
    loader = sapien_scene.create_urdf_loader()
    loader.fix_root_link = True
    for finger in FINGER_LINKS:
        loader.set_link_material(finger, FINGER_FRICTION, FINGER_FRICTION, 0.0)
        loader.set_link_patch_radius(finger, PATCH_RADIUS_M)
        loader.set_link_min_patch_radius(finger, MIN_PATCH_RADIUS_M)
    robot = loader.load(str(robot_urdf(scale, visual=visual)))
    robot.name = "robot"
    for link in robot.links:
        link.set_disable_gravity(True)
        link.set_max_depenetration_velocity(_MAX_DEPENETRATION_M_S)
        _exclude_self_collision(link)
    _couple_fingers(robot)
    for joint, drive, armature in zip(robot.active_joints, drives(scale), armatures(scale), strict=True):
        joint.set_drive_properties(*drive)
        joint.set_armature(np.array([armature], dtype=np.float32))
        joint.set_friction(0.0)  # The loader's default of 0.05 would leave the arm short of its target.
    return robot


def _couple_fingers(robot: Any) -> None:
    """Couple the fingers, as the one motor of a real hand does: what they hold stays in its middle.

    Uncoupled, they would press with 30 N each and yield together to whatever pushes from the side.
    """
    left, right = (robot.find_link_by_name(name) for name in FINGER_LINKS)
    robot.create_fixed_tendon(
        [robot.find_link_by_name(HAND_LINK), left, right],
        [0.0, 1.0, -1.0],
        [0.0, 1.0, -1.0],
        stiffness=FINGER_COUPLING[0],
        damping=FINGER_COUPLING[1],
    )


def _exclude_self_collision(link: Any) -> None:
    """Mark a link's shapes with bits of the ignore group: shapes that share one do not collide.

    Hulls of neighbouring links overlap by design. Forearm, hand and fingers do collide with base, pedestal, shoulder
    and upper arm. Everything else in the scene lacks the bits and collides with all of the robot.
    """
    for shape in link.collision_shapes:
        contact_type, affinity, ignore, instance = shape.get_collision_groups()
        shape.set_collision_groups([contact_type, affinity, ignore | _IGNORED.get(link.name, 0), instance])
