"""The generated robot: scaled as a whole, readable without a renderer, one file for everybody."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from executor.sim.robot import description
from executor.sim.robot.description import (
    RobotDataMissing,
    mount_link,
    robot_urdf,
    robot_xml,
)
from executor.sim.robot.kinematics import ArmChain
from executor.sim.robot.meshes import ColoredPart, read_collada, simplified
from oag import Primitive
from oag.model.robots import PAPER_ROBOT, ROBOTS, Robot
from oag.model.scene import RobotPose
from oag.sizes import Gripper

every_robot = pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)


@pytest.fixture(scope="module")
def physics() -> ET.Element:
    return ET.fromstring(robot_xml(visual=False))


@pytest.fixture(scope="module")
def original() -> ET.Element:
    return ET.parse(description.description_path()).getroot()


def joint(root: ET.Element, name: str) -> ET.Element:
    return next(element for element in root.findall("joint") if element.get("name") == name)


def numbers(element: ET.Element | None, key: str) -> np.ndarray:
    assert element is not None
    return np.array([float(value) for value in element.attrib[key].split()])


def test_moving_joints_are_the_named_ones(physics: ET.Element) -> None:
    moving = [element.get("name") for element in physics.findall("joint") if element.get("type") != "fixed"]
    assert sorted(map(str, moving)) == sorted(PAPER_ROBOT.joint_names)
    for name in PAPER_ROBOT.joint_names:
        limit = joint(physics, name).find("limit")
        assert limit is not None and {"lower", "upper", "effort", "velocity"} <= set(limit.attrib)


def test_physics_file_has_nothing_to_draw_and_no_foreign_tags(physics: ET.Element) -> None:
    for tag in ("visual", "dynamics", "safety_controller", "mimic"):
        assert list(physics.iter(tag)) == []


def test_lengths_masses_and_inertias_scale_with_their_powers(physics: ET.Element, original: ET.Element) -> None:
    for name in ("panda_joint3", "panda_joint5", "panda_hand_tcp_joint"):
        scaled = numbers(joint(physics, name).find("origin"), "xyz")
        assert scaled == pytest.approx(PAPER_ROBOT.scale * numbers(joint(original, name).find("origin"), "xyz"))
    for name in ("panda_link4", "panda_hand"):
        new, old = (
            next(link for link in root.findall("link") if link.get("name") == name) for root in (physics, original)
        )
        mass = numbers(new.find("inertial/mass"), "value") / numbers(old.find("inertial/mass"), "value")
        inertia = numbers(new.find("inertial/inertia"), "ixx") / numbers(old.find("inertial/inertia"), "ixx")
        assert mass == pytest.approx(PAPER_ROBOT.scale**3)
        assert inertia == pytest.approx(PAPER_ROBOT.scale**5)


@every_robot
def test_gripper_opens_to_what_the_limit_on_objects_needs(robot: Robot) -> None:
    root = ET.fromstring(robot_xml(robot, visual=False))
    upper = [numbers(joint(root, name).find("limit"), "upper")[0] for name in robot.finger_joints]
    assert sum(upper) == pytest.approx(Gripper.of(RobotPose(name=robot.name)).opening_m)


@every_robot
def test_no_posture_of_the_arm_gets_beyond_the_longest_motions_of_its_hand(robot: Robot) -> None:
    root = ET.fromstring(robot_xml(robot, visual=False))
    limits = [joint(root, name).find("limit") for name in robot.arm_joints]
    low, high = (np.concatenate([numbers(limit, end) for limit in limits]) for end in ("lower", "upper"))
    chain = ArmChain(robot_urdf(robot, visual=False), mount_link(robot), robot.tip_link)
    hands_m = chain.forward(np.random.default_rng(0).uniform(low, high, (20_000, len(low))))[:, :3, 3]
    up_m = robot.longest_motion_m(Primitive.LIFT_EEF_UP)
    across_m = robot.longest_motion_m(Primitive.MOVE_EEF_LEFT)
    assert up_m is not None and 0.85 * up_m < hands_m[:, 2].max() + robot.lift_m <= up_m
    assert across_m is not None and 0.85 * across_m < np.ptp(hands_m[:, 1]) <= across_m


@every_robot
def test_the_arm_turns_on_its_mount_as_far_as_the_record_says(robot: Robot) -> None:
    limit = joint(ET.fromstring(robot_xml(robot, visual=False)), robot.arm_joints[0]).find("limit")
    ends_deg = np.degrees([numbers(limit, end)[0] for end in ("lower", "upper")])
    assert np.abs(ends_deg) == pytest.approx([robot.swing_deg] * 2, abs=0.01)


def test_the_mast_stands_on_the_base_within_its_footprint_and_has_the_lens_at_its_front(physics: ET.Element) -> None:
    def boxes(name: str) -> list[tuple[np.ndarray, np.ndarray]]:
        link = next(link for link in physics.findall("link") if link.get("name") == name)
        found = []
        for collision in link.findall("collision"):
            middle, size = numbers(collision.find("origin"), "xyz"), numbers(collision.find("geometry/box"), "size")
            found.append((middle - size / 2, middle + size / 2))
        return found

    base, (profile, housing) = boxes(description.BASE_LINK), boxes(description.MAST_LINK)
    low, high = np.min([low for low, _ in base], axis=0), np.max([high for _, high in base], axis=0)
    for piece in (profile, housing):
        assert (piece[0][:2] >= low[:2] - 1e-9).all() and (piece[1][:2] <= high[:2] + 1e-9).all()
    assert profile[0][2] == pytest.approx(base[0][1][2]) and profile[1][2] == pytest.approx(housing[0][2])
    lens = np.array(description.camera_mount_m(PAPER_ROBOT))
    assert lens[0] == pytest.approx(housing[1][0]) and (lens[1:] > housing[0][1:]).all()
    assert (lens[1:] < housing[1][1:]).all()


def test_arm_angles_are_not_scaled_and_home_is_within_them(physics: ET.Element, original: ET.Element) -> None:
    for name, home in zip(PAPER_ROBOT.joint_names[3:10], PAPER_ROBOT.home, strict=True):
        limit, unscaled = joint(physics, name).find("limit"), joint(original, name).find("limit")
        assert limit is not None and unscaled is not None
        assert limit.attrib["lower"] == unscaled.attrib["lower"]
        assert float(limit.attrib["lower"]) < home < float(limit.attrib["upper"])


def test_arm_stands_at_the_mount_height(physics: ET.Element) -> None:
    assert numbers(joint(physics, "arm_mount").find("origin"), "xyz") == pytest.approx([0, 0, PAPER_ROBOT.mount_m])


def test_every_link_has_a_mass(physics: ET.Element) -> None:
    for link in physics.findall("link"):
        assert numbers(link.find("inertial/mass"), "value") > 0


def test_both_files_have_the_same_joints_and_collisions() -> None:
    seen = ET.fromstring(robot_xml(visual=True))
    unseen = ET.fromstring(robot_xml(visual=False))
    assert list(seen.iter("visual"))
    for link in seen.findall("link"):
        for element in link.findall("visual"):
            link.remove(element)
    ET.indent(seen)
    assert ET.tostring(seen) == ET.tostring(unseen)


def test_all_mesh_files_exist() -> None:
    for mesh in ET.fromstring(robot_xml(visual=True)).iter("mesh"):
        assert Path(mesh.attrib["filename"]).is_file()


def test_the_file_is_written_once_and_where_the_cache_is(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    first = robot_urdf(visual=False)
    assert robot_urdf(visual=False) == first
    monkeypatch.setenv("SCENE2DEMO_CACHE", str(tmp_path))
    elsewhere = robot_urdf(visual=False)
    assert elsewhere.is_relative_to(tmp_path)
    assert elsewhere.read_bytes() == first.read_bytes() and elsewhere.name == first.name


def test_a_missing_distribution_is_one_clear_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> None:
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(description.metadata, "files", missing)
    with pytest.raises(RobotDataMissing, match=r"scene2demo\[sim\]"):
        description.description_path.__wrapped__(PAPER_ROBOT)


def test_a_distribution_without_the_panda_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(description.metadata, "files", lambda name: [])
    with pytest.raises(RobotDataMissing, match=r"panda\.urdf"):
        description.description_path.__wrapped__(PAPER_ROBOT)


def hand_parts() -> list[ColoredPart]:
    folder = description.description_path().parents[1] / "meshes/visual"
    return read_collada(folder / "hand.dae")


def test_collada_parts_keep_their_colours_and_places() -> None:
    parts = hand_parts()
    assert len(parts) == 5
    brightness = sorted(round(sum(part.color[:3]) / 3, 2) for part in parts)
    assert brightness[0] < 0.3 and brightness[-1] > 0.9
    points = np.concatenate([part.vertices_m for part in parts])
    # The hand is 0.2 m wide along the fingers' way and its flange lies on the wrist.
    assert points[:, 1].max() - points[:, 1].min() == pytest.approx(0.2, abs=0.02)
    assert abs(points[:, 2].min()) < 0.03


def test_simplified_parts_are_a_small_share_and_of_the_same_size() -> None:
    before = hand_parts()
    after = simplified(before)
    assert [part.color for part in after] == [part.color for part in before]
    count = sum(len(part.triangles) for part in before), sum(len(part.triangles) for part in after)
    assert 0.05 * count[0] < count[1] < 0.2 * count[0]
    for old, new in zip(before, after, strict=True):
        used, kept = old.vertices_m[old.triangles.reshape(-1)], new.vertices_m[new.triangles.reshape(-1)]
        assert kept.max(axis=0) == pytest.approx(used.max(axis=0), abs=0.002)
        assert kept.min(axis=0) == pytest.approx(used.min(axis=0), abs=0.002)
