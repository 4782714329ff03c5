"""The base turns as often as a long task wants it to."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

from executor.sim.robot.description import robot_urdf

TURNS = 10


def test_the_base_is_not_out_of_turns_after_a_few_drives() -> None:
    joint = ET.parse(robot_urdf(visual=False)).find("joint[@name='base_yaw']/limit")
    assert joint is not None
    assert float(joint.attrib["lower"]) < -2 * math.pi * TURNS
    assert float(joint.attrib["upper"]) > 2 * math.pi * TURNS
