"""A worker whose units end as their seeds say, without any physics."""

from __future__ import annotations

import os
import time
from typing import Any

from executor.system.workers import serve

CRASH, RAISE, FAIL, FAIL_TOO, SLOW = 3, 4, 5, 6, 9
SLOW_S = 120.0
NAMES = ["pick_up_apple", "put_apple_into_bowl"]


def invented(seed: int) -> dict[str, Any]:
    """Return a unit's result; the last digit of the seed decides how it ends."""
    failed = seed % 10 in (FAIL, FAIL_TOO)
    failure = {
        "kind": "grasp-missed",
        "message": "the fingers closed on <nothing> & stayed shut",
        "measurements": {"width_m": 0.001},
        "subtask": 1,
        "subtask_name": NAMES[1],
        "step": 2,
        "primitive": "LIFT_EEF_DOWN",
        "action": {"8": 0.3},
        "time_s": 12.5,
    }
    return {
        "pair": f"T3-{seed:06d}",
        "query": "put the apple into the bowl",
        "subtask_names": NAMES,
        "ended": "failed" if failed else "succeeded",
        "failure": failure if failed else None,
        "subtasks": [{"name": NAMES[0], "succeeded": True}, {"name": NAMES[1], "succeeded": not failed}],
        "state_hash": f"{seed:064x}",
        "simulated_s": 20.0,
        "penetration": {
            "p99_m": 0.0004,
            "deepest_m": 0.0007,
            "pair": ["robot/finger", "apple_0/apple"],
            "samples": 200,
        },
        "wall_s": {"scene": 0.1, "planning": 0.5, "physics": 0.4},
        "rss_mb": 400.0 + seed % 10,
        "peak_rss_mb": 410.0,
    }


def handle(request: dict[str, Any]) -> dict[str, Any]:
    ending = request["seed"] % 10
    if ending == CRASH:
        os._exit(11)
    if ending == RAISE:
        raise ValueError("no room could be made of this seed")
    if ending == SLOW:
        time.sleep(SLOW_S)
    return invented(request["seed"])


if __name__ == "__main__":
    serve(handle)
