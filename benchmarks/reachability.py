"""Where the hand can be: the best joint margin for each hand pitch, height and reach, as tables for the documentation.

    python -m benchmarks.reachability

The arm is mounted 0.30 m above the floor. Height is that of the point between the fingertips above the floor, reach
its distance from the base's axis, the base facing it or turned by 0.3 rad to either side; pitch 0 is a level hand, 90
one that points straight down. The margin is the distance of the nearest joint to its limit, in degrees, the best of
the postures that random restarts found.
"""

from __future__ import annotations

import itertools

import numpy as np

from executor.geometry import hand_rotation, transform
from executor.sim.robot.kinematics import Kinematics
from executor.sim.world import World
from oag import Scene
from oag.model.scene import RobotPose

PITCHES_DEG = (-15, 0, 15, 30, 45, 60, 75)
HEIGHTS_M = tuple(round(0.1 * k, 1) for k in range(1, 13))
REACHES_M = (0.30, 0.35, 0.40, 0.45, 0.50, 0.55, 0.60)
TURNS_RAD = (0.0, 0.3, -0.3)
RESTARTS = 16


def margin_deg(kinematics: Kinematics, pitch_deg: float, height_m: float, reach_m: float, *, upright: bool) -> float:
    """Return the best joint margin in degrees; NaN where no posture within limits was found.

    Args:
        kinematics: The robot's.
        pitch_deg: Downward tilt of the hand.
        height_m: Of the point between the fingertips.
        reach_m: Its distance from the base's axis.
        upright: Whether the fingers close vertically, as on a drawer's level bar.
    """
    best = np.nan
    for turn, flip in itertools.product(TURNS_RAD, (False, True)):
        R = hand_rotation(-turn, np.deg2rad(pitch_deg), flip=flip, upright=upright)
        found = kinematics.solve(transform(R, [reach_m, 0.0, height_m]), np.zeros(3), restarts=RESTARTS)
        if found:
            best = np.nanmax([best, np.rad2deg(found[0].margin_rad)])
    return float(best)


def table(kinematics: Kinematics, *, upright: bool) -> list[str]:
    """Return the lines of a Markdown table: heights down, pitches across, the best margin and its reach."""
    lines = ["| height [m] | " + " | ".join(f"{pitch} deg" for pitch in PITCHES_DEG) + " |"]
    lines.append("|" + " --- |" * (len(PITCHES_DEG) + 1))
    for height_m in HEIGHTS_M:
        cells = []
        for pitch in PITCHES_DEG:
            margins = [margin_deg(kinematics, pitch, height_m, reach, upright=upright) for reach in REACHES_M]
            known = [(margin, reach) for margin, reach in zip(margins, REACHES_M, strict=True) if margin == margin]
            cells.append(f"{max(known)[0]:.0f} at {max(known)[1]:.2f}, {len(known)}/{len(margins)}" if known else "-")
        lines.append(f"| {height_m:.1f} | " + " | ".join(cells) + " |")
    return lines


def main() -> None:
    """Print both tables."""
    with World(Scene("empty", RobotPose(), {})) as world:
        kinematics = Kinematics(world.robot, world.model)
        for upright, what in ((False, "level (items, upright bars)"), (True, "vertically (level bars)")):
            print(f"\nFingers that close {what}: best margin in degrees at reach in m, reaches that are possible\n")
            print("\n".join(table(kinematics, upright=upright)))


if __name__ == "__main__":
    main()
