"""GenSim2's own code on its own tasks: its assets, its constraint files, its criteria; physics only, no GPU, no key.

    PYTHON benchmarks/gensim2_tasks.py CHECKOUT [--episodes 20] [--seed 0] [TASK ...]

PYTHON is of an environment of its own; docs/baselines.md says how to make it. Nothing of GenSim2 belongs to this
repository. Its simulator is asked for no renderer, lights and cameras, and libraries that only its pictures and
learning need are stood in for by nothing; tasks, solver, planner and physics are as they are. Each episode draws pose
and opening anew, by a seed of its own. Prints a line an episode, and of each task successes and the exact interval.

It runs on Python 3.9, imports nothing of this project, and is run by its path.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import os
import random
import sys
import time
import types
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Any

PRIMITIVE = (
    *("OpenRefrigeratorDoor", "CloseRefrigeratorDoor", "OpenBox", "OpenDrawer", "PushDrawerClose", "OpenSafe"),
    *("RotateMicrowaveDoor", "CloseMicrowave"),
)
LONG_HORIZON = ("StoreLemonInRefrigerator", "PlaceCrackerBoxIntoRefrigerator")
NOT_NEEDED = ("torch", "noise", "ipdb", "IPython", "openai", "matplotlib", "matplotlib.pyplot")
MOST_ACTIONS = 500  # Of one motion; its own scripts have as many.


class Nothing(types.ModuleType):
    """Stands in for a library that physics does not need."""

    def __getattr__(self, name: str) -> Nothing:
        if name.startswith("__"):
            raise AttributeError(name)
        return Nothing(name)

    def __call__(self, *args: Any, **kwargs: Any) -> Nothing:
        return self


def without_pictures() -> Any:
    """Imports GenSim2 with its renderer, lights and cameras left out; returns what makes its environments."""
    for name in NOT_NEEDED:
        try:
            importlib.import_module(name)
        except ImportError:
            missing = Nothing(name)
            missing.__spec__, missing.__path__, missing.__file__ = ModuleSpec(name, None), [], __file__
            sys.modules[name] = missing
    sapien = importlib.import_module("sapien.core")
    constructor = importlib.import_module("gensim2.env.sapien.constructor")
    simulation = importlib.import_module("gensim2.env.sapien.sim")

    def engine_alone(*args: Any, **kwargs: Any) -> Any:
        engine = sapien.Engine()
        engine.set_log_level("critical")
        return engine, None

    for module in (constructor, simulation):
        module.get_engine_and_renderer = engine_alone
        module.add_default_scene_light = lambda *args, **kwargs: None
    environment = importlib.import_module("gensim2.env.sapien.env").SapienEnv
    for name in (
        "update_render",
        "take_picture",
        "create_camera",
        "create_camera_from_pose",
        "setup_lighting",
        "render",
    ):
        setattr(environment, name, lambda self, *args, **kwargs: None)
    making = importlib.import_module("gensim2.env.create_task")
    # Tasks are looked up by name there, and these two are not among the names.
    longer = importlib.import_module("gensim2.env.task.longhorizon_tasks")
    for name in dir(longer):
        setattr(making, name, getattr(longer, name))
    return making


def episode(env: Any, seed: int) -> bool:
    """Return whether a task succeeded, by its own criterion, from a pose and an opening that a seed draws."""
    numpy = importlib.import_module("numpy")
    planner = importlib.import_module("gensim2.env.solver.planner").KPAMPlanner
    random.seed(seed)
    numpy.random.seed(seed)
    env.reset(True)
    for motion in env.sub_tasks:
        if motion in ("Grasp", "UnGrasp"):
            env.grasp() if motion == "Grasp" else env.ungrasp()
            continue
        solver = planner(env, f"gensim2/env/solver/kpam/config/{motion}.yaml")
        solver.reset_expert()
        for _ in range(MOST_ACTIONS):
            if env.step(solver.get_action(), whole_eps=True)[2]:
                break
    state = env.task.get_progress_state()
    return bool(state >= 1)


def interval_percent(successes: int, trials: int) -> tuple[float, float]:
    """Return the exact interval, 95 %, of Clopper and Pearson."""
    beta = importlib.import_module("scipy.stats").beta
    low = 0.0 if successes == 0 else float(beta.ppf(0.025, successes, trials - successes + 1))
    high = 1.0 if successes == trials else float(beta.ppf(0.975, successes + 1, trials - successes))
    return 100.0 * low, 100.0 * high


def main(words: list[str]) -> int:
    """Run the tasks, and prints what came of each."""
    parser = argparse.ArgumentParser(description="GenSim2's own code on its own tasks.")
    parser.add_argument("checkout", type=Path, help="a checkout of GenSim2, with its assets")
    parser.add_argument("tasks", nargs="*", default=[*PRIMITIVE, *LONG_HORIZON])
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_intermixed_args(words)
    if not (asked.checkout / "gensim2" / "env").is_dir():
        parser.error(f"{asked.checkout} is no checkout of GenSim2: it has no gensim2/env")
    os.chdir(asked.checkout)
    sys.path.insert(0, os.getcwd())
    told = io.StringIO()
    for task in asked.tasks:
        good = 0
        # It prints a page an episode.
        with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
            settings = {"use_gui": False, "use_ray_tracing": False, "eval": False, "headless": True, "cam": "default"}
            env = without_pictures().create_gensim(task_name=task, asset_id="", obs_mode="state", **settings)
        for number in range(asked.episodes):
            began, why = time.process_time(), ""
            try:
                with contextlib.redirect_stdout(told), contextlib.redirect_stderr(told):
                    succeeded = episode(env, asked.seed + number)
            except Exception as error:  # A task that breaks off has failed, and the next one is still measured.
                succeeded, why = False, f"  {type(error).__name__}: {error}"
            good += succeeded
            ending = "succeeded" if succeeded else "failed"
            print(f"  {task} {asked.seed + number}: {ending}, {time.process_time() - began:.1f} s{why}", flush=True)
        low, high = interval_percent(good, asked.episodes)
        print(f"{task}: {good} of {asked.episodes} ({low:.1f} to {high:.1f} %)", flush=True)
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
