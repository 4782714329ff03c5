"""Inverse kinematics of the robot's arm: ours beside three other solvers, on the same targets, in one run.

    python -m benchmarks.kinematics [--counts 1 100 1000] [--seed 0] [--without ikpy]

A target is the hand's pose at joint angles drawn evenly from within the limits, so every one can be reached. An answer
counts when the hand is within 1 mm and 0.01 rad of the target and every joint within its limits, judged by the same
forward kinematics for all. Solvers are used as their documentation shows them; each gets all targets of a count in one
call where it takes several at once, and one after another where it does not. Times are those of the call that is timed.

ikpy runs in an environment of its own, `.venv-peers`, which is made when it is missing.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from executor.geometry import Array, quaternion_wxyz
from executor.sim.robot.description import BASE_LINK, robot_urdf
from executor.sim.robot.kinematics import Kinematics
from executor.sim.world import World
from executor.system.extras import load_sapien
from oag import Scene
from oag.model.robots import PAPER_ROBOT
from oag.model.scene import RobotPose

ROOT = Path(__file__).parent.parent
PEERS = ROOT / ".venv-peers"
PEER = "ikpy==4.2.1"
POSITION_M, ROTATION_RAD = 1e-3, 1e-2
INSET_RAD = 0.05
RESTARTS = 60

Solver = Callable[[Array], list[Array | None]]


def targets(kinematics: Kinematics, count: int, seed: int) -> Array:
    """Return (count, 4, 4) hand poses in the base's frame."""
    rng = np.random.default_rng(seed)
    arms = rng.uniform(kinematics.arm_lower + INSET_RAD, kinematics.arm_upper - INSET_RAD, (count, 7))
    return np.stack([kinematics.forward(np.concatenate([np.zeros(3), arm])) for arm in arms])


def judged(kinematics: Kinematics, wanted: Array, answers: list[Array | None]) -> dict[str, float]:
    """Return the share of answers that reach their target, that respect the limits, and that do both."""
    reached, within = [], []
    for T, arm in zip(wanted, answers, strict=True):
        if arm is None:
            reached.append(False)
            within.append(True)
            continue
        found = kinematics.forward(np.concatenate([np.zeros(3), arm]))
        turn = np.arccos(np.clip((np.trace(found[:3, :3].T @ T[:3, :3]) - 1) / 2, -1.0, 1.0))
        reached.append(bool(np.linalg.norm(found[:3, 3] - T[:3, 3]) < POSITION_M and turn < ROTATION_RAD))
        within.append(kinematics.margin(arm) >= -1e-6)
    both = np.array(reached) & np.array(within)
    return {"reached": float(np.mean(reached)), "within limits": float(np.mean(within)), "success": float(both.mean())}


def ours(kinematics: Kinematics) -> Solver:
    """Return our solver: SAPIEN's from random starts until one posture is within the limits."""

    def solve(T: Array) -> Array | None:
        found = kinematics.solve(T, np.zeros(3), restarts=RESTARTS, minimum_margin_rad=0.0, enough=1)
        return found[0].arm if found else None

    return lambda wanted: [solve(T) for T in wanted]


def ours_widest(kinematics: Kinematics) -> Solver:
    """Return our solver as the planner uses it: of what 24 starts find, the posture farthest from its limits."""

    def solve(T: Array) -> Array | None:
        found = kinematics.solve(T, np.zeros(3))
        return found[0].arm if found else None

    return lambda wanted: [solve(T) for T in wanted]


def clik(world: World) -> Solver:
    """Return SAPIEN's solver as it comes: one start, which knows no joint limits."""
    sapien = load_sapien()

    model = world.robot.create_pinocchio_model()
    eef = [link.name for link in world.robot.links].index(PAPER_ROBOT.tip_link)
    mask = np.array([0] * 3 + [1] * 7 + [0] * 2, dtype=np.int32)

    def solve(T: Array) -> Array | None:
        pose = sapien.Pose(T[:3, 3], quaternion_wxyz(T))
        q, converged, _ = model.compute_inverse_kinematics(
            eef, pose, initial_qpos=np.zeros(len(PAPER_ROBOT.joint_names)), active_qmask=mask
        )
        return np.asarray(q[PAPER_ROBOT.arm], dtype=float) if converged else None

    return lambda wanted: [solve(T) for T in wanted]


def pytorch_kinematics(urdf: Path) -> Solver:
    """Return pytorch-kinematics' pseudo-inverse solver with the settings of its documentation."""
    import pytorch_kinematics as pk
    import torch

    torch.manual_seed(0)
    chain = pk.build_serial_chain_from_urdf(urdf.read_bytes(), PAPER_ROBOT.tip_link, root_link_name=BASE_LINK)
    limits = torch.tensor(chain.get_joint_limits()).T
    solver = pk.PseudoInverseIK(
        chain,
        max_iterations=30,
        num_retries=10,
        joint_limits=limits,
        early_stopping_any_converged=True,
        early_stopping_no_improvement="all",
        debug=False,
        lr=0.2,
    )

    def solve(wanted: Array) -> list[Array | None]:
        answer = solver.solve(pk.Transform3d(matrix=torch.tensor(wanted, dtype=torch.float32)))
        picked: list[Array | None] = []
        for postures, converged in zip(answer.solutions, answer.converged, strict=True):
            which = torch.nonzero(converged).flatten()
            picked.append(postures[which[0]].numpy().astype(float) if len(which) else None)
        return picked

    return solve


class Ikpy:
    """ikpy in its own environment, which answers a line of targets with a line of postures and the time it took."""

    def __init__(self, urdf: Path) -> None:
        python = PEERS / "bin" / "python"
        if not python.exists():
            subprocess.run([sys.executable, "-m", "venv", str(PEERS)], check=True)
        if subprocess.run([str(python), "-c", "import ikpy"], capture_output=True).returncode:
            subprocess.run([str(python), "-m", "pip", "install", "--quiet", PEER], check=True)
        command = [
            str(python),
            str(ROOT / "benchmarks" / "peer_kinematics.py"),
            str(urdf),
            BASE_LINK,
            PAPER_ROBOT.tip_link,
        ]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def measure(self, wanted: Array) -> tuple[list[Array | None], float]:
        """Return the postures and the seconds that they took in that process."""
        if self._process.stdin is None or self._process.stdout is None:
            raise SystemExit("the peer has no pipes")
        self._process.stdin.write(json.dumps(wanted.tolist()).encode() + b"\n")
        self._process.stdin.flush()
        answer: dict[str, Any] = json.loads(self._process.stdout.readline())
        return [np.array(arm) for arm in answer["postures"]], float(answer["seconds"])


def main() -> None:
    """Print one row for each solver."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--counts", type=int, nargs="+", default=[1, 100, 1000])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--without", nargs="*", choices=["ikpy"], default=[])
    options = parser.parse_args()
    scene = Scene(name="empty", robot=RobotPose(), objects={}, facts=(), closed=frozenset())
    with World(scene) as world:
        kinematics = Kinematics(world.robot, world.model)
        urdf = robot_urdf(visual=False)
        solvers: dict[str, Solver | Ikpy] = {
            "ours, first posture": ours(kinematics),
            "ours, widest of 24 starts": ours_widest(kinematics),
            "SAPIEN CLIK": clik(world),
            "pytorch-kinematics": pytorch_kinematics(urdf),
        }
        if "ikpy" not in options.without:
            solvers["ikpy"] = Ikpy(urdf)
        every = targets(kinematics, max(options.counts), options.seed)
        times = " | ".join(f"{count} targets" for count in options.counts)
        print(f"| solver | reached | within limits | success | {times} |")
        print("|---" * (4 + len(options.counts)) + "|")
        for name, solver in solvers.items():
            spent, shares = [], {}
            for count in options.counts:
                begin = time.perf_counter()
                if isinstance(solver, Ikpy):
                    answers, seconds = solver.measure(every[:count])
                else:
                    answers = solver(every[:count])
                    seconds = time.perf_counter() - begin
                spent.append(seconds)
                shares = judged(kinematics, every[:count], answers)
            figures = " | ".join(f"{100 * share:.1f} %" for share in shares.values())
            print(f"| {name} | {figures} | " + " | ".join(f"{1000 * s:.1f} ms" for s in spent) + " |", flush=True)


if __name__ == "__main__":
    main()
