"""Drives of the base, with or without something in the gripper, and withdrawal of the open hand back to the home
posture.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from executor.geometry import Array, hand_rotation, heading_of, pitch_of, rotation_z, transform
from executor.planning.collision import NOTHING, Allowed
from executor.planning.paths import base_move, segment
from executor.planning.planner import Planner

BACK_OUT_M = (0.35, 0.3, 0.25, 0.2, 0.15, 0.1, 0.05)  # The farthest that is free, from over a table to before it.
BACK_OUT_TURNS_RAD = (0.0, 0.4, -0.4, 0.8, -0.8)  # Straight back first.
BACK_OUT_CLEARANCE_M = 0.003  # Little: what is carried is still near to what it stood on.
TUCKED_HEIGHTS_M = (0.80, 0.70, 0.90)  # Above tables of usual height; a lift carries them higher.
SPLIT = 3  # First legs that are tried: each costs a search for the drive.
ROLLED = 0.1
"""How far a hand's closing axis is off the level that holds something by its rim; tucked in, it keeps its roll."""


Leg = tuple[Literal["back out", "take up a posture", "drive", "take up the goal posture"], Array]
"""Purpose of a part of a journey, and its path (N, Q)."""


@dataclass(frozen=True, slots=True)
class Drive:
    """A journey in legs."""

    legs: tuple[Leg, ...]

    @property
    def end(self) -> Array:
        """Where the journey ends, (Q,)."""
        return self.legs[-1][1][-1]


def drive_to(planner: Planner, q: Array, goal: Array) -> Drive | None:
    """Return a free journey to a configuration (Q,), or None.

    With something in the gripper the robot first backs away from where it took it. Then it tries to take up the
    goal's arm posture before driving, then at the end, and last to carry tucked in.

    Args:
        planner: Its oracle knows what is carried and where things are.
        q: (Q,) where the robot is.
        goal: (Q,) wanted base pose and arm posture.
    """
    for start in _starts(planner, q):
        here = start.end if start.legs else q
        for posture in _postures(planner, here, goal):
            legs = _legs(planner, here, posture, goal)
            if legs is not None:
                return Drive(start.legs + legs)
    return None


def _starts(planner: Planner, q: Array) -> list[Drive]:
    """Return candidate first legs: backing out as far as is free when something is carried, else none."""
    if planner.oracle.carried is None:
        return [Drive(())]
    heading = float(q[2]) + np.pi
    found = []
    for distance_m in BACK_OUT_M:
        for turn in BACK_OUT_TURNS_RAD:
            out = base_move(q, distance_m, heading + turn)
            if planner.oracle.first_hit(segment(planner.robot, out[0], out[1]), margin_m=BACK_OUT_CLEARANCE_M) is None:
                found.append(Drive((("back out", out),)))
                if len(found) == SPLIT:
                    return found
    return [*found, Drive(())]


def _postures(planner: Planner, q: Array, goal: Array) -> list[Array]:
    """Return arm postures (A,) to drive with: the goal's, the present one, and one tucked in."""
    arm = planner.robot.arm
    postures = [goal[arm]]
    if planner.oracle.carried is None:
        return [q[arm], goal[arm]]
    tucked = _tucked(planner, q)
    return [*postures, *([] if tucked is None else [tucked]), q[arm]]


def _tucked(planner: Planner, q: Array) -> Array | None:
    """Return a posture that holds the hand near the base at its present tilt, or None."""
    kinematics = planner.kinematics
    T = kinematics.forward(q)
    base = q[planner.robot.base]
    lifted_m = float(kinematics.base_transform(base)[2, 3])
    yaw = heading_of(T[:3, 2])
    T_turned = T[:3, :3]
    for reach_m in planner.robot.tucked_m:
        for height_m in TUCKED_HEIGHTS_M:
            heading = float(base[2])
            if abs(T_turned[2, 1]) > ROLLED:
                R = rotation_z(heading - yaw) @ T_turned
            else:
                R = hand_rotation(heading, pitch_of(T), flip=_is_flipped(T_turned, yaw, pitch_of(T)))
            point = [base[0] + reach_m * np.cos(heading), base[1] + reach_m * np.sin(heading), lifted_m + height_m]
            for solution in kinematics.solve(transform(R, point), base, near=q[planner.robot.arm], restarts=8)[:1]:
                if planner.oracle.is_free(np.concatenate([base, solution.arm])):
                    return solution.arm
    return None


def _is_flipped(R: Array, yaw: float, pitch: float) -> bool:
    return float(R[:, 1] @ hand_rotation(yaw, pitch)[:, 1]) < 0.0


def _legs(planner: Planner, q: Array, posture: Array, goal: Array) -> tuple[Leg, ...] | None:
    """Return legs: take up a posture, drive, take up the goal's posture; or None when one is not free."""
    legs: list[Leg] = []
    here, arm = q, planner.robot.arm
    if np.abs(posture - here[arm]).max() > 1e-6:
        path = planner.arm_path(here, posture)
        if path is None:
            return None
        legs.append(("take up a posture", path))
        here = path[-1]
    path = planner.base_path(here, goal[planner.robot.base])
    if path is None:
        return None
    legs.append(("drive", path))
    here = path[-1]
    if np.abs(goal[arm] - here[arm]).max() > 1e-6:
        path = planner.arm_path(here, goal[arm])
        if path is None:
            return None
        legs.append(("take up the goal posture", path))
    return tuple(legs)


BACK_OFF_M = (0.15, 0.12, 0.09, 0.06, 0.04)  # The longest free one is taken.
BACK_OFF_CLEARANCE_M = 0.0015  # What is left next to the widest thing between the open fingers.
BACK_OFF_SHARE = 0.25  # Of the base's usual steps: a finger is not stepped through a wall.
APART_FROM = 3
"""Rows of a withdrawal, a centimetre or two, in which the fingers come free of what they held."""

SIDE_STEPS_RAD = (0.0, 0.4, -0.4, 0.8, -0.8)  # Straight back first.
ASIDE_RAD = (0.5, -0.5, 1.0, -1.0, np.pi / 2, -np.pi / 2)  # Where straight back is taken.
PUSHED_M = 0.003
"""A path on which the open hand would be so deep inside the released object pushes it."""

SHORT_LIFTS_M = (0.035, 0.03, 0.025, 0.02)
"""Under a low ceiling, such as a shelf, there is room to lift the fingers over something flat, and for no more."""

DRIVE_M = (0.3, 0.5, 0.7, 0.9, 1.2, 1.5)  # The nearest place where the arm has room is taken.
DRIVE_HEADINGS_RAD = (0.0, 0.6, -0.6, 1.2, -1.2, 1.9, -1.9, 2.5, -2.5)  # Backwards first.
DRIVE_MARGIN_M = 0.01  # Of the arm at home there.
MOST_DRIVES = 8  # Each costs a search.
MOST_TREES = 4  # Of the slides after which the way home is searched for.
DOWN = np.array([0.0, 0.0, -1.0])
OUT_M, UP_M = (*(0.005 * step for step in range(13)), 0.08, 0.10, 0.15), (0.30, 0.20, 0.12)
"""Out of a drawer: how far a thing that is partly below the top comes out first, and how far the lift raises it."""


@dataclass(frozen=True, slots=True)
class Withdrawal:
    """Two paths (N, Q): away from the object, then home with the arm (by way of a base move where needed)."""

    back_off: Array
    home: Array


def can_withdraw(planner: Planner, q: Array, *, allowed: Allowed = NOTHING) -> bool:
    """Return whether the open hand can leave what it holds, or held, without moving it."""
    return any(not _pushes(planner, away) for away in withdrawal_paths(planner, q, allowed=allowed))


def withdrawal_paths(planner: Planner, q: Array, *, allowed: Allowed = NOTHING) -> Iterator[Array]:
    """Yield free paths (N, Q) away from what the hand holds or held, the longest of each kind.

    Level hands back off with the base, steep ones with the arm; the other kind comes next, then straight up. Stepping
    aside is the last resort, because it drags a finger along the object. First come paths that get clear of the object
    at once, and of everything else; then those that get clear of everything else; then those that come no nearer to it.
    """
    T = planner.kinematics.forward(q)
    straight = [partial(_by_base, planner, q, T, d, 0.0) for d in BACK_OFF_M]
    by_arm = [partial(_by_arm, planner, q, T, T[:3, 2], d) for d in BACK_OFF_M]
    up = [partial(_by_arm, planner, q, T, DOWN, d) for d in BACK_OFF_M]
    aside = [partial(_by_base, planner, q, T, d, turn) for turn in SIDE_STEPS_RAD[1:] for d in BACK_OFF_M]
    level = abs(pitch_of(T)) < np.deg2rad(50.0)
    kinds = (straight, by_arm, up, aside) if level else (by_arm, up, straight, aside)
    known: dict[Callable[[], Array | None], Array | None] = {}

    def paths(kind: Sequence[Callable[[], Array | None]]) -> Iterator[Array]:
        # Most hands get away by the first of some thirty ways, and each costs a line of hand poses.
        for way in kind:
            if way not in known:
                known[way] = way()
            path = known[way]
            if path is not None:
                yield path

    oracle = planner.oracle
    for kind in kinds[:3]:
        yield from itertools.islice((path for path in paths(kind) if _gets_apart(planner, q, path)), 1)
    for kind in kinds:
        clear = (p for p in paths(kind) if oracle.is_path_free(p[1:], margin_m=BACK_OFF_CLEARANCE_M, allowed=allowed))
        yield from itertools.islice(clear, 1)
    for kind in kinds:
        with oracle.leaving(q, allowed=allowed):
            found = next((path for path in paths(kind) if oracle.is_path_free(path, allowed=allowed)), None)
        if found is not None:
            yield found


def _gets_apart(planner: Planner, q: Array, path: Array) -> bool:
    """Return whether a path is clear of everything, the released object included, after its first rows."""
    oracle = planner.oracle
    if not oracle.is_path_free(path[APART_FROM:], margin_m=BACK_OFF_CLEARANCE_M):
        return False
    with oracle.leaving(q, margin_m=BACK_OFF_CLEARANCE_M):
        return oracle.is_path_free(path[1:APART_FROM], margin_m=BACK_OFF_CLEARANCE_M)


def withdraw(planner: Planner, q: Array, *, allowed: Allowed = NOTHING) -> Withdrawal | None:
    """Return the withdrawal of the hand and the arm's path home, or None where no free path was found.

    Where a flow's own numbers have brought the base very near to something, its usual clearance is given up.

    Args:
        planner: The planner; its oracle must know where things are now.
        q: (Q,) where the robot is, gripper open.
        allowed: Contacts of the fingers with the released object, while backing off.
    """
    found = _withdraw(planner, q, allowed)
    if found is None:
        with planner.oracle.without_clearance():
            found = _withdraw(planner, q, allowed)
    return found


def _withdraw(planner: Planner, q: Array, allowed: Allowed) -> Withdrawal | None:
    if not planner.robot.keeps_order:
        # Trees take long to find nothing, and another path off the thing may lead home without one.
        straight = next(_straight_ways(planner, q, allowed), None)
        if straight is not None:
            return straight
    still_inside: list[Array] = []
    for away in _gentle_first(planner, q, allowed):
        home = _straight_home(planner, away[-1])
        if home is None and _is_behind_a_wall(planner, away[-1]):
            # The search for a drive out of a hollow takes long to find none; another path may lead over its rim.
            still_inside.append(away)
            continue
        home = home if home is not None else _drive_home(planner, away[-1])
        if home is not None:
            return Withdrawal(away, home)
    for away in still_inside:
        home = _drive_home(planner, away[-1])
        if home is not None:
            return Withdrawal(away, home)
    return None


def leads_away(planner: Planner, q: Array, *, allowed: Allowed = NOTHING) -> bool:
    """Return whether the open hand gets home from what it has let go of by straight motions, without a random search.

    Args:
        planner, q, allowed: As for `withdraw`.
    """
    return next(_straight_ways(planner, q, allowed), None) is not None


def _straight_ways(planner: Planner, q: Array, allowed: Allowed) -> Iterator[Withdrawal]:
    for away in _gentle_first(planner, q, allowed):
        home = _straight_home(planner, away[-1], most_trees=0)
        home = home if home is not None else _raised_home(planner, away[-1], _anywhere, None)
        if home is not None:
            yield Withdrawal(away, home)


def _gentle_first(planner: Planner, q: Array, allowed: Allowed) -> Iterator[Array]:
    """Yield the paths off, but those that would push the released object only after short lifts off it."""
    pushing: list[Array] = []
    for away in withdrawal_paths(planner, q, allowed=allowed):
        if _pushes(planner, away):
            pushing.append(away)
        else:
            yield away
    if pushing:
        lifts = (_by_arm(planner, q, planner.kinematics.forward(q), DOWN, d) for d in SHORT_LIFTS_M)
        yield from (lift for lift in lifts if lift is not None and _gets_apart(planner, q, lift))
    yield from pushing


def _pushes(planner: Planner, path: Array) -> bool:
    return any(
        hit.mover in planner.robot.gripper_links and hit.separation_m < -PUSHED_M
        for row in path
        for hit in planner.oracle.hits(row)
    )


def _anywhere(_: Array) -> bool:
    return True


def go_home(
    planner: Planner, q: Array, is_out: Callable[[Array], bool] = _anywhere, outward_rad: float | None = None
) -> Array | None:
    """Return a free path (N, Q), q first, to the arm's home posture, or None.

    The base backs out straight where it has to, then aside. Where nothing straight is free, a lift raises the hand on
    the way, as out of a drawer. Else the base drives to the nearest place where the arm has room.

    Args:
        q: (Q,) where the robot is.
        is_out: Whether the path may end in a configuration (Q,): with the arm at home a hand may still be within
            what it reached into.
        outward_rad: Heading in which a drawer that the hand is in was pulled; None where it is in none.
    """
    straight = _straight_home(planner, q, is_out)
    straight = straight if straight is not None else _raised_home(planner, q, is_out, outward_rad)
    return straight if straight is not None else _drive_home(planner, q, is_out)


def leads_straight_home(
    planner: Planner, q: Array, is_out: Callable[[Array], bool], outward_rad: float | None = None
) -> bool:
    """Return whether there is a way home, as of `go_home`, that no tree has to be grown for: that is left to chance."""
    straight = _straight_home(planner, q, is_out, most_trees=0)
    return straight is not None or _raised_home(planner, q, is_out, outward_rad) is not None


def _raised_home(
    planner: Planner, q: Array, is_out: Callable[[Array], bool], outward_rad: float | None
) -> Array | None:
    """Return a way home on which the hand comes out a little, is raised, and goes on straight; or None.

    A thing that is in part below the top of what its drawer is in has to come out before it is raised over the front.
    """
    if not planner.robot.lift_m or planner.robot.keeps_order:
        return None
    back_rad = float(q[2]) + np.pi
    for heading_rad in (back_rad,) if outward_rad is None else (outward_rad, back_rad):
        for out_m in OUT_M:
            out = base_move(q, out_m, heading_rad)
            with planner.oracle.leaving(q):
                if out_m and not _is_slide_free(planner, out[0], out[1]):
                    break
            up = _raised(planner, out[1])
            if up is None:
                continue
            home = _straight_home(planner, up, is_out, most_trees=0)
            if home is not None:
                return np.concatenate([q[None], *([out[1:]] if out_m else []), home])
            break  # From a little farther out it would be the same.
    return None


def _raised(planner: Planner, q: Array) -> Array | None:
    """Return a configuration (Q,) to which the lift can raise the hand, the highest one; or None."""
    for up_m in UP_M:
        up = q.copy()
        up[3] = min(up[3] + up_m, planner.robot.lift_m)
        with planner.oracle.leaving(q):
            if up[3] > q[3] and _is_slide_free(planner, q, up):
                return up
    return None


def _straight_home(
    planner: Planner, q: Array, is_out: Callable[[Array], bool] = _anywhere, most_trees: int = MOST_TREES
) -> Array | None:
    back = [float(q[2]) + np.pi]
    T = planner.kinematics.forward(q)
    if abs(pitch_of(T)) < np.deg2rad(60.0):
        back.append(heading_of(-T[:3, 2]))
    with planner.oracle.leaving(q):
        straight = _slide_home(planner, q, back, is_out, most_trees)
        straight = straight or _slide_home(planner, q, [back[0] + turn for turn in ASIDE_RAD], is_out, most_trees)
    return None if straight is None else np.concatenate(straight)


def _slide_home(
    planner: Planner, q: Array, headings: list[float], is_out: Callable[[Array], bool], most_trees: int
) -> list[Array] | None:
    """Return a slide of the base and the arm's path home from there, or None."""
    withdraw_m, home, base = planner.robot.withdraw_m, np.array(planner.robot.home), planner.robot.base
    free = _free_slides(planner, q, headings)
    slides: Iterator[tuple[float, Array]] = (
        (distance_m, out) for distance_m, out in free if is_out(np.concatenate([out[1][base], home]))
    )
    if not planner.robot.keeps_order:
        # Out of a compartment most ways home are straight, or there is none: trees grow where the arm is farthest out.
        known: list[tuple[float, Array]] = []
        for distance_m, out in slides:
            path = planner.arm_path(out[1], home, iterations=0)
            if path is not None:
                return [out[:1], path] if distance_m else [path]
            known.append((distance_m, out))
        slides = iter(known[::-1][:most_trees])
    for distance_m, out in slides:
        iterations = 150 if distance_m < withdraw_m[-1] else 600
        path = planner.arm_path(out[1], home, iterations=iterations)
        if path is not None:
            return [out[:1], path] if distance_m else [path]
    return None


def _free_slides(planner: Planner, q: Array, headings: list[float]) -> Iterator[tuple[float, Array]]:
    """Yield how far the base can slide, with the slide (2, Q), the nearest first; none first of all."""
    blocked: set[float] = set()
    for distance_m in planner.robot.withdraw_m:
        for heading in headings[:1] if not distance_m else headings:
            out = base_move(q, distance_m, heading)
            if heading in blocked:
                continue
            if distance_m and not _is_slide_free(planner, out[0], out[1]):
                blocked.add(heading)
                continue
            yield distance_m, out


def _is_slide_free(planner: Planner, start: Array, end: Array) -> bool:
    """Return whether the base can slide from one configuration to another.

    The wall of a bowl is thinner than the base's usual steps, which would step a finger through it.
    """
    return planner.oracle.is_path_free(segment(planner.robot, start, end)) and not _meets_a_wall(planner, start, end)


def _meets_a_wall(planner: Planner, start: Array, end: Array) -> bool:
    way = segment(planner.robot, start, end, base_share=BACK_OFF_SHARE)
    with planner.oracle.leaving(start, margin_m=BACK_OFF_CLEARANCE_M):
        return not planner.oracle.is_path_free(way, margin_m=BACK_OFF_CLEARANCE_M)


def _is_behind_a_wall(planner: Planner, q: Array) -> bool:
    """Return whether the path straight back leads through something thinner than the base's usual steps."""
    back = base_move(q, planner.robot.withdraw_m[1], float(q[2]) + np.pi)
    with planner.oracle.leaving(q):
        return planner.oracle.is_path_free(segment(planner.robot, *back)) and _meets_a_wall(planner, *back)


def _drive_home(planner: Planner, q: Array, is_out: Callable[[Array], bool] = _anywhere) -> Array | None:
    """Return a drive to a place where the arm can go home, and its path home from there, or None."""
    tried = 0
    for distance_m, heading in itertools.product(DRIVE_M, DRIVE_HEADINGS_RAD):
        there = base_move(q, distance_m, float(q[2]) + np.pi + heading)[1]
        home = np.concatenate([there[planner.robot.base], planner.robot.home])
        if not (planner.oracle.is_free(there) and planner.oracle.is_free(home, margin_m=DRIVE_MARGIN_M)):
            continue
        if not is_out(home):
            continue
        tried += 1
        way = planner.base_path(q, there[planner.robot.base], iterations=300)
        path = None if way is None else planner.arm_path(way[-1], np.array(planner.robot.home))
        if way is not None and path is not None:
            return np.concatenate([way, path[1:]])
        if tried == MOST_DRIVES:
            break
    return None


def _by_base(planner: Planner, q: Array, T_world_eef: Array, distance_m: float, turn_rad: float) -> Array:
    ends = base_move(q, distance_m, heading_of(-T_world_eef[:3, 2]) + turn_rad)
    return np.concatenate([ends[:1], segment(planner.robot, ends[0], ends[1], base_share=BACK_OFF_SHARE)])


def _by_arm(planner: Planner, q: Array, T_world_eef: Array, away_from: Array, distance_m: float) -> Array | None:
    T = T_world_eef.copy()
    T[:3, 3] -= distance_m * away_from
    return planner.line(q, T).path
