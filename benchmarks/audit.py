"""An audit of the physics from outside: does anything happen in an episode that a sceptic would call cheating?

python benchmarks/audit.py --out audit.json                  24 episodes of T1 to T6, some minutes
python benchmarks/audit.py --per-family 1 --out audit.json   six

SAPIEN's own classes are hooked (`audit_watch.py`): every call that would set a state, apply a force, bind two bodies or
change what decides the physics of a live world is caught, and every step's state is logged. From the log it is checked
that positions change by velocity times time, that nothing is faster or stronger than the documentation says, that items
without the robot's touch do nothing but fall, that goals hold by a second geometry (`executor.audit`), and that the
recorded actions, replayed open loop in one world from the first recorded state, end in success again.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.audit_watch import CONTACTS_EVERY, ROBOT, StepLog, watching
from executor.audit.decision import holds
from executor.audit.geometry import Snapshot
from executor.bench.units import BenchSetting, Unit
from executor.bench.work import execute, prepare
from executor.campaign.versions import outcome_version
from executor.records import Rollout
from executor.scenes.generators.families import FAMILIES, HOUSEHOLD, indices_of
from executor.sim.world import World

GRAVITY_M_S2 = 9.81
FALL_WITHIN_M_S2 = 3.0  # Damping, and the step in which a touch ends.
MOVING_M_S, MOVING_JOINT = 0.02, 0.02
ENERGY_J_KG = 0.005  # Rolling gives back what it took up; 0.1 m/s worth.
UNTOUCHED_S = 0.1
GASKET_REACH = 0.15  # Of a hinge, in rad: 3 cm at a handle 0.2 m off it.
JOINT_GROWTH = 0.05  # rad/s or m/s: what ends of contact and springs leave.

# What docs/executor.md says of the robot, and what the engine's solver is allowed to correct in a step.
MOST = {
    "item step - v dt, mm": 3.0,
    "base and arm step - v dt, mm or mrad": 2.0,
    # Light, and stopped within a step where they close on something: the solver takes back what overlaps.
    "finger step - v dt, mm": 10.0,
    "door step - v dt, mm or mrad": 1.0,
    "item speed, m/s": 1.5,
    "base speed, m/s": 0.75,
    "base turn, rad/s": 1.2,
    "arm speed, rad/s": 1.8,
    # What a joint transmits, its own drive and the shocks of contacts: hence the mean over 40 ms, and a fifth above
    # the limits of the drives (20.9 and 2.88 Nm) for the arm. Peaks of single steps are told beside.
    "base force over 40 ms, N": 500.0,
    "base torque over 40 ms, Nm": 100.0,
    "shoulder and elbow torque over 40 ms, Nm": 25.0,
    "wrist torque over 40 ms, Nm": 3.5,
    # A world that was built anew finds its contacts in its first step; until then the fingers press on nothing.
    "boundary between subtasks, items, base, arm, mm or mrad": 0.5,
    "boundary between subtasks, fingers, mm": 2.0,
}
"""The largest value that each measure of an episode may have."""


@dataclass
class Finding:
    """One audited episode.

    Attributes:
        unit: Its name.
        succeeded: What the project says of it.
        caught: Forbidden calls on live worlds.
        measured: Measure -> largest value, in the units of `MOST`; accelerations and grip beside them.
        wrong: What is beyond a limit or unexplained, in words.
        steps: How many physics steps were logged.
        goal_holds: By the second geometry, at the end.
        replayed: Whether the goal holds by the second geometry after an open-loop replay.
    """

    unit: str
    succeeded: bool
    caught: list[str]
    measured: dict[str, float] = field(default_factory=dict)
    wrong: list[str] = field(default_factory=list)
    steps: int = 0
    goal_holds: bool = False
    replayed: bool = False

    @property
    def clean(self) -> bool:
        """Whether nothing was found, the episode's success included where it is claimed."""
        agrees = self.goal_holds == self.succeeded and self.replayed == self.succeeded
        return not self.caught and not self.wrong and agrees


def units(per_family: int, seed: int) -> Iterator[Unit]:
    """Yield the same number of episodes of each family, those of the household spread over its rooms."""
    for family in FAMILIES:
        indices = indices_of(family) if family in HOUSEHOLD else ()
        for k in range(per_family):
            if family in HOUSEHOLD:
                yield Unit(family, seed, indices[k * len(indices) // per_family], BenchSetting())
            else:
                yield Unit(family, seed + k, None, BenchSetting())


def audit(unit: Unit) -> Finding:
    """Return what is found in one episode."""
    pair, graph = prepare(unit)
    with watching() as watch:
        done, _ = execute(unit, pair, graph)
    found = Finding(unit.name, done.succeeded, watch.caught)
    for log in watch.logs:
        _measure(log, found)
        if len(set(log.makeup)) != 1:
            found.wrong.append("masses, shapes, materials, drives or components changed while the world ran")
    _across(watch.logs, found)
    for name, most in MOST.items():
        if found.measured.get(name, 0.0) > most:
            found.wrong.append(f"{name}: {found.measured[name]:.4g}, at most {most:g}")
    states = done.trajectory.packed_states
    replayed = replay(done)
    with World(done.scene) as world:
        before, *ends = (Snapshot(world, state) for state in (states[0], states[-1], replayed))
    found.goal_holds, found.replayed = (holds(done.task.goal, done.scene, before, end) for end in ends)
    return found


def replay(done: Rollout) -> bytes:
    """Return the state after the recorded drive targets, and nothing else, have run in one world.

    Between two samples targets go straight, with their speed fed forward. Nothing is planned, measured or restored.
    """
    motion = done.trajectory
    with World(done.scene) as world:
        world.unpack(motion.packed_states[0])
        every = round(1.0 / (done.record_hz * world.timestep_s))
        joints = world.robot.active_joints
        targets = motion.robot_target.astype(float)
        for now, after in pairwise(targets):
            speed = (after - now) / (every * world.timestep_s)
            for tick in range(1, every + 1):
                wanted = now + (after - now) * tick / every
                for index, joint in enumerate(joints):
                    joint.set_drive_target(float(wanted[index]))
                    if index < 10:
                        joint.set_drive_velocity_target(float(speed[index]))
                world.step()
        return world.pack()


def _measure(log: StepLog, found: Finding) -> None:
    """Add one world's log to what was measured, and says what is wrong in it."""
    robot, items, joints = np.array(log.robot), np.array(log.items), np.array(log.joints)
    found.steps += len(robot)
    q, qd, along = robot[:, :12], robot[:, 12:24], robot[:, 48:60]
    if len(robot) < 2:
        return

    def most(name: str, values: NDArray[np.float64]) -> None:
        found.measured[name] = max(found.measured.get(name, 0.0), float(np.abs(values).max(initial=0.0)))

    most("item step - v dt, mm", 1e3 * np.linalg.norm(_jump(items[..., :3], items[..., 7:10], log.dt_s), axis=-1))
    most("base and arm step - v dt, mm or mrad", 1e3 * _jump(q, qd, log.dt_s)[:, :10])
    most("finger step - v dt, mm", 1e3 * _jump(q, qd, log.dt_s)[:, 10:])
    most("door step - v dt, mm or mrad", 1e3 * _jump(joints[..., 0], joints[..., 1], log.dt_s))
    most("item speed, m/s", np.linalg.norm(items[..., 7:10], axis=-1))
    most("base speed, m/s", np.linalg.norm(qd[:, :2], axis=1))
    most("base turn, rad/s", qd[:, 2])
    most("arm speed, rad/s", qd[:, 3:10])
    for span, forces in (("over 40 ms", _mean(along, 10)), ("peak", along)):
        most(f"base force {span}, N", np.linalg.norm(forces[:, :2], axis=1))
        most(f"base torque {span}, Nm", forces[:, 2])
        most(f"shoulder and elbow torque {span}, Nm", forces[:, 3:7])
        most(f"wrist torque {span}, Nm", forces[:, 7:10])
        most(f"finger force {span}, N", forces[:, 10:12])
    told = np.diff(robot[:, 36:46], axis=0) / log.dt_s
    most("told base acceleration, m/s2", np.linalg.norm(told[:, :2], axis=1))
    most("base acceleration over 40 ms, m/s2", np.linalg.norm(_over(qd[:, :2], 10, log.dt_s), axis=1))
    most("arm acceleration over 40 ms, rad/s2", _over(qd[:, 3:10], 10, log.dt_s))
    _untouched_items(log, items, joints, found)
    _untouched_joints(log, joints, found)


def _jump(x: NDArray[np.float64], v: NDArray[np.float64], dt_s: float) -> NDArray[np.float64]:
    return np.asarray(np.diff(x, axis=0) - v[1:] * dt_s)


def _mean(rows: NDArray[np.float64], steps: int) -> NDArray[np.float64]:
    """Return the means of each column over so many steps, or nothing where there are fewer."""
    sums = np.cumsum(np.insert(rows, 0, 0.0, axis=0), axis=0)
    return np.asarray((sums[steps:] - sums[:-steps]) / steps)


def _over(v: NDArray[np.float64], steps: int, dt_s: float) -> NDArray[np.float64]:
    """Return mean accelerations over so many steps."""
    return np.asarray((v[steps:] - v[:-steps]) / (steps * dt_s))


def _with_robot(pairs: frozenset[tuple[str, str]]) -> set[str]:
    """Return what the robot touches, and what that touches, and so on; the ground and the robot pass nothing on."""
    reached: set[str] = set()
    ahead = {b if a.startswith(ROBOT) else a for a, b in pairs if a.startswith(ROBOT) != b.startswith(ROBOT)}
    while ahead:
        reached |= ahead
        ahead = {x for a, b in pairs for x, y in ((a, b), (b, a)) if y in ahead and not x.startswith(ROBOT)}
        ahead -= reached | {"ground", ""}
    return reached


def _untouched_items(log: StepLog, items: NDArray[np.float64], joints: NDArray[np.float64], found: Finding) -> None:
    """Say which items move without the robot's touch in any other way than by falling or coming to rest."""
    rows = items[::CONTACTS_EVERY][: len(log.touching)]
    span_s = CONTACTS_EVERY * log.dt_s
    moving_joints = np.abs(joints[::CONTACTS_EVERY, :, 1]) > MOVING_JOINT
    for k in range(len(rows) - 1):
        reached = _with_robot(log.touching[k + 1])
        carried = {owner for owner, moves in zip(log.joint_owners, moving_joints[k], strict=True) if moves}
        for index, name in enumerate(log.item_names):
            now, after = rows[k, index], rows[k + 1, index]
            if name in reached or np.linalg.norm(after[7:10]) < MOVING_M_S:
                continue
            touched = [pair for pair in log.touching[k + 1] if name in pair]
            acceleration = (after[7:10] - now[7:10]) / span_s
            if not touched:
                falling = np.abs(acceleration + [0.0, 0.0, GRAVITY_M_S2]).max() <= FALL_WITHIN_M_S2
                _count(found, "falling, s", span_s)
                if not falling:
                    found.wrong.append(f"{name} touches nothing and accelerates by {np.round(acceleration, 2)}")
            elif not any(set(pair) & carried for pair in touched):
                _count(found, "coming to rest, s", span_s)
                gain = _energy(after) - _energy(now)
                if gain > ENERGY_J_KG:
                    found.wrong.append(f"{name} gains {gain:.4f} J/kg without the robot")


def _untouched_joints(log: StepLog, joints: NDArray[np.float64], found: Finding) -> None:
    """Say which doors and drawers speed up though the robot has touched them for a tenth of a second no more."""
    rows, span_s = joints[::CONTACTS_EVERY][: len(log.touching)], CONTACTS_EVERY * log.dt_s
    patience = round(UNTOUCHED_S / span_s)
    since = dict.fromkeys(log.joint_owners, patience)
    for k in range(1, len(rows)):
        reached = _with_robot(log.touching[k])
        since = {owner: 0 if owner in reached else count + 1 for owner, count in since.items()}
        for index, owner in enumerate(log.joint_owners):
            position, speed, _ = rows[k, index]
            if since[owner] < patience or abs(speed) < MOVING_JOINT:
                continue
            _count(found, "doors coasting, s", span_s)
            gasket = speed < 0.0 and position < GASKET_REACH
            if abs(speed) - abs(rows[k - 1, index, 1]) > JOINT_GROWTH and not gasket:
                found.wrong.append(f"{owner} speeds up to {speed:.3f} without the robot")
    if (joints[..., 2] > 1e-6).any():
        found.wrong.append("a force was applied to a door or drawer that opens it")


def _across(logs: list[StepLog], found: Finding) -> None:
    """Measure how far things are from where they were, where a world was built anew at a subtask's end."""
    for before, after in pairwise(logs):
        items = np.abs(before.items[-1][:, :3] - after.items[0][:, :3]).max(initial=0.0)
        robot = np.abs(before.robot[-1][:12] - after.robot[0][:12])
        jumps = {"items, base, arm, mm or mrad": max(items, robot[:10].max()), "fingers, mm": robot[10:].max()}
        for what, jump in jumps.items():
            name = f"boundary between subtasks, {what}"
            found.measured[name] = max(found.measured.get(name, 0.0), 1e3 * float(jump))


def _energy(row: NDArray[np.float64]) -> float:
    return float(0.5 * row[7:10] @ row[7:10] + GRAVITY_M_S2 * row[2])


def _count(found: Finding, name: str, amount: float) -> None:
    found.measured[name] = found.measured.get(name, 0.0) + amount


def table(findings: list[Finding]) -> str:
    """Return the episodes, then the largest of each measure, as text."""
    lines = ["episode                       steps  ended      caught  goal  replay  wrong"]
    for each in findings:
        ended = "succeeded" if each.succeeded else "failed"
        cells = f"{len(each.caught):6}  {each.goal_holds!s:5} {each.replayed!s:6}"
        lines.append(f"{each.unit:28} {each.steps:6}  {ended:9}  {cells}  {'; '.join(each.wrong[:2]) or '-'}")
    lines.append("")
    for name in dict.fromkeys(name for each in findings for name in each.measured):
        values = [each.measured.get(name, 0.0) for each in findings]
        limit = f"at most {MOST[name]:g}" if name in MOST else ""
        lines.append(f"{name:56} median {np.median(values):8.3f}  largest {max(values):8.3f}  {limit}")
    ran = [each for each in findings if each.succeeded]
    lines += [
        "",
        f"{len(ran)} of {len(findings)} succeeded; second geometry agrees in "
        f"{sum(each.goal_holds == each.succeeded for each in findings)}; replayed open loop "
        f"{sum(each.replayed for each in ran)} of {len(ran)}; forbidden calls {sum(len(e.caught) for e in findings)}; "
        f"clean {sum(each.clean for each in findings)} of {len(findings)}",
    ]
    return "\n".join(lines)


def main() -> None:
    """Audits, prints the table and writes the JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--per-family", type=int, default=4)
    parser.add_argument("--seed", type=int, default=62300)
    parser.add_argument("--families", nargs="*", choices=FAMILIES, default=FAMILIES)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    findings = []
    for unit in units(options.per_family, options.seed):
        if unit.family in options.families:
            began = time.perf_counter()
            findings.append(audit(unit))
            last = findings[-1]
            print(f"{last.unit:28} {time.perf_counter() - began:5.1f} s  {'clean' if last.clean else last.wrong[:1]}")
            if options.out is not None:
                kept = {"version": outcome_version(), "limits": MOST, "episodes": [asdict(f) for f in findings]}
                options.out.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    print(table(findings))


if __name__ == "__main__":
    main()
