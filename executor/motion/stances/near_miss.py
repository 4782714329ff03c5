"""How near the hand comes to a pose that it does not reach, the joints kept within their limits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from executor.geometry import Array, inverse
from executor.motion.stances.candidates import Placement
from executor.robot.description import JOINT_NAMES
from executor.robot.kinematics import ARM, Kinematics
from oag.revision.measurements import Unplanned

TURN_M_PER_RAD = 0.1
"""How many metres off the place a radian off the direction is worth: about the length of the hand."""

AT_LIMIT_RAD = 0.02
INSET_RAD = 1e-3
SLOPE_RAD = 1e-3
DRAWN, DESCENTS = 1000, 4
"""How many postures are drawn, and from how many of them a descent begins."""


@dataclass(frozen=True, slots=True)
class NearMiss:
    """The posture that comes nearest to a hand pose.

    Attributes:
        arm: (7,) the posture in rad.
        residual_m: How far the hand is off the place.
        residual_rad: How far it is off the direction.
        at_limit: Joints that are at a limit.
    """

    arm: Array
    residual_m: float
    residual_rad: float
    at_limit: tuple[str, ...]

    @property
    def off_m(self) -> float:
        """Both in one number; smaller is nearer."""
        return float(np.hypot(self.residual_m, TURN_M_PER_RAD * self.residual_rad))

    def words(self, what: str) -> str:
        """Returns the miss as a sentence about the thing that the hand was to get to."""
        held = f", held by {' and '.join(self.at_limit)}" if self.at_limit else ""
        turned = f" and {np.rad2deg(self.residual_rad):.0f} deg"
        return f"the hand stays {self.residual_m * 100:.1f} cm{turned} off {what} from every stance{held}"

    def added_to(self, found: Unplanned) -> Unplanned:
        """Returns what was found with the miss as numbers."""
        residual_m, residual_deg = round(self.residual_m, 4), round(float(np.rad2deg(self.residual_rad)), 1)
        return replace(found, residual_m=residual_m, residual_deg=residual_deg, joints_at_limit=self.at_limit)


def nearest(kinematics: Kinematics, candidates: Iterable[Placement]) -> NearMiss:
    """Returns what comes nearest to its hand pose over some placements.

    It is looked for among postures that are drawn, always the same ones, and then by descent from the best of them:
    descent alone does not find out of a folded arm.

    Args:
        kinematics: The robot's.
        candidates: At least one placement.
    """
    wanted = [inverse(kinematics.base_transform(c.base)) @ c.goal.T_world_eef for c in candidates]
    lower, upper = kinematics.arm_lower + INSET_RAD, kinematics.arm_upper - INSET_RAD
    arms = np.random.default_rng(0).uniform(lower, upper, (DRAWN, 7))
    hands = np.stack([kinematics.forward(np.concatenate([np.zeros(3), arm])) for arm in arms])
    starts = []
    for number, T in enumerate(wanted):
        off_m = np.linalg.norm(_off(hands, T), axis=1)
        starts += [(float(off_m[k]), number, int(k)) for k in np.argsort(off_m, kind="stable")[:DESCENTS]]
    misses = [_descent(kinematics, wanted[number], arms[k]) for _, number, k in sorted(starts)[:DESCENTS]]
    return min(misses, key=lambda miss: miss.off_m)


def _descent(kinematics: Kinematics, T_base_eef: Array, start: Array) -> NearMiss:
    """Returns where the way from a posture to ever nearer ones ends."""

    def off(arm: Array) -> Array:
        return _off(kinematics.forward(np.concatenate([np.zeros(3), arm]))[None], T_base_eef)[0]

    bounds = (kinematics.arm_lower + INSET_RAD, kinematics.arm_upper - INSET_RAD)
    # Poses have single precision, so that slopes need longer steps than usual.
    found = least_squares(off, start, bounds=bounds, diff_step=SLOPE_RAD, xtol=1e-5, ftol=1e-6)
    arm, error = np.asarray(found.x), np.asarray(found.fun)
    held = np.flatnonzero(np.minimum(arm - kinematics.arm_lower, kinematics.arm_upper - arm) < AT_LIMIT_RAD)
    return NearMiss(
        arm,
        float(np.linalg.norm(error[:3])),
        float(np.linalg.norm(error[3:])) / TURN_M_PER_RAD,
        tuple(JOINT_NAMES[ARM][index] for index in held),
    )


def _off(hands: Array, T_wanted: Array) -> Array:
    """Returns (N, 6): how far hand poses (N, 4, 4) are off one, the turn counted as a length."""
    turns = Rotation.from_matrix(hands[:, :3, :3].transpose(0, 2, 1) @ T_wanted[:3, :3]).as_rotvec()
    return np.concatenate([hands[:, :3, 3] - T_wanted[:3, 3], TURN_M_PER_RAD * turns], axis=1)
