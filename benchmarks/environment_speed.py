"""How many actions a second and core the environment does, with state observations, while the robot moves.

`python -m benchmarks.environment_speed`: for each family, CPU time of episodes in which the base sways, the arm swings
and the gripper opens and shuts, all at once, so that everything that is moved has to be told. Resets are timed apart.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from executor.envs import FAMILIES
from executor.envs.scene_environment import SceneEnvironment
from executor.system.files import write_json

_SWING = np.array([0.03, 0.03, 0.05, *[0.08] * 7, 0.005, 0.005])  # m and rad, well within the speed limits.
_PERIOD = 20  # Actions.


def main() -> None:
    """Measure and prints one line a family."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--families", nargs="+", default=list(FAMILIES))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=3)
    parser.add_argument("--actions", type=int, default=200)
    parser.add_argument("--mode", default="joint_target", choices=["joint_target", "paper"])
    parser.add_argument("--out", type=Path)
    asked = parser.parse_args()
    rows = [_measured(family, asked) for family in asked.families]
    if asked.out is not None:
        write_json(asked.out, {"schema": "scene2demo-environment-speed/1", "mode": asked.mode, "rows": rows})


def _measured(family: str, asked: argparse.Namespace) -> dict[str, object]:
    env = SceneEnvironment(family, action_mode=asked.mode)  # type: ignore[arg-type]
    resets_s, steps_s = [], []
    for seed in range(asked.seed, asked.seed + asked.episodes):
        env.reset(seed=seed)
        began = time.process_time()
        env.reset(seed=seed)
        resets_s.append(time.process_time() - began)
        start = env.target
        began = time.process_time()
        for k in range(asked.actions):
            sway = np.sin(2.0 * np.pi * k / _PERIOD)
            env.step(start + sway * _SWING if asked.mode == "joint_target" else _hand(sway))
        steps_s.append(time.process_time() - began)
    env.close()
    rate = asked.actions * asked.episodes / sum(steps_s)
    reset_ms = 1000.0 * float(np.mean(resets_s))
    print(
        f"{family}: {rate:.0f} actions a CPU second, {reset_ms:.0f} ms for a reset to a scene that is known", flush=True
    )
    return {"family": family, "actions_a_cpu_s": rate, "reset_ms": reset_ms}


def _hand(sway: float) -> np.ndarray:
    return np.array([0.0, 0.01 * sway, 0.01 * sway, 0.0, 0.0, 0.03 * sway, 0.5, 0.005 * sway, 0.0, 0.01 * sway])


if __name__ == "__main__":
    main()
