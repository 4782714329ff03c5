"""What comes of executing the decompositions that RoboGen recorded of its language model, unchecked, in our rooms.

    python -m benchmarks.robogen_executed DIR [--episodes 5] [--seed 0]

DIR is a checkout of RoboGen. Of the recorded decompositions that `robogen_plans.py` can say, those are executed whose
thing with doors or drawers the library has a model of (`ROOMS`): that stands where `examples/policies/kitchen.json` has
its refrigerator, an item on the table or in the thing, and seeds draw where the robot begins. The items' words (item,
food, dish ...) name no model: a glass of the gripper's size stands for all. Nothing is proved before anything moves,
and the steps' own conditions are not judged: success is that no step fails, nothing beside is moved, and what the task
is called holds at rest in the end. Both readings of `robogen_plans.py` are executed; primitives see where to stand and
how to take hold, as everywhere here.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import bddl
from benchmarks.baselines.methods import UncheckedRun
from benchmarks.robogen_plans import Recorded, as_task, recorded
from executor.campaign.rate import Rate
from executor.records import Rollout
from executor.rollouts.rollout import failure_of
from executor.scenes.vary import vary
from oag import Scene, Task, compose

KITCHEN = Path(__file__).parents[1] / "examples" / "policies" / "kitchen.json"
FRIDGE = ("refrigerator", "upright_one_door", (0.68, 0.6, 1.2), {"hinge": "left", "shelf_heights_m": [0.42, 0.72]})
DRAWERS = ("bottom_cabinet", "cabinet_drawers", (0.6, 0.5, 0.8), {"drawers": 2})
CUPBOARD = ("bottom_cabinet", "cabinet_one_door", (0.6, 0.5, 0.8), {"hinge": "left"})
OPENED, SHUT = "(open {fixture})", "(not (open {fixture}))"
STORED = f"(and (inside {{item}} {{fixture}}) {SHUT})"
ROOMS: dict[str, tuple[tuple[str, str, tuple[float, float, float], dict[str, Any]], str]] = {
    "Pull_Drawer_Out": (DRAWERS, OPENED),
    "Retrieve_Item_from_Fridge": (FRIDGE, f"(and (not (inside {{item}} {{fixture}})) {SHUT})"),
    "Store_an_Object_in_the_Drawer": (DRAWERS, STORED),
    "close_the_drawer_of_the_table": (DRAWERS, SHUT),
    "close_the_oven_door": (("oven", "oven_bottom_hinge", (0.65, 0.58, 0.85), {}), SHUT),
    "load_dish_into_dishwasher": (
        ("dishwasher", "dishwasher_bottom_hinge", (0.65, 0.55, 0.85), {"racks": 1}),
        STORED,
    ),
    "store_an_item_into_the_storagefurniture": (CUPBOARD, STORED),
    "store_food_in_refrigerator": (FRIDGE, STORED),
}
"""Decomposition -> category, model, size in m and options of its thing, and what its task comes to."""

_FRONT_M, _SHELF_M, _TABLE_M, _HALF_OPEN = 0.6, 0.72, 0.6, 0.5
_FITS = 0.6  # Of a glass's size: the gripper of a Panda of 0.7 opens by 5.6 cm.


def prepared(plan: Recorded, *, grasping_lets_go: bool) -> tuple[Scene, Task]:
    """Return a decomposition's room, and its steps as a task that ends in what it is called."""
    (category, model, extent_m, options), goal = ROOMS[plan.name]
    # What stands on the floor there stands on the table here.
    facts = [fact.replace(" floor_0)", " table_0)") for fact in plan.scene["facts"]]
    told = as_task(replace(plan, scene={**plan.scene, "facts": facts}), grasping_lets_go=grasping_lets_go)
    kitchen = json.loads(KITCHEN.read_text(encoding="utf-8"))
    fridge, glass = kitchen["objects"].pop("refrigerator_0"), kitchen["objects"].pop("glass_0")
    stands = [_FRONT_M + extent_m[0] / 2, 0.0, extent_m[2] / 2]
    is_open = OPENED.format(fixture=plan.fixture) in facts
    parameters = {**options, **({"open_fraction": _HALF_OPEN} if is_open else {})}
    thing = {"category": category, "model": model, "position": stands, "bbox_extent": list(extent_m)}
    kitchen["objects"][plan.fixture] = {**fridge, **thing, "parameters": parameters}
    item, variation = "", kitchen["variation"]["objects"]
    if plan.items:
        (item,) = plan.items
        inside = any(fact.startswith(f"(inside {item} ") for fact in facts)
        half_m = _FITS * glass["bbox_extent"][2] / 2
        at = [stands[0] - 0.1, 0.0, _SHELF_M + half_m] if inside else [*glass["position"][:2], _TABLE_M + half_m]
        if not inside:
            variation[item] = variation["glass_0"]
        kitchen["objects"][item] = {**glass, "position": at, "scale": [_FITS] * 3}
    del variation["glass_0"]
    scene = Scene.from_json({**kitchen, "name": plan.name, "facts": facts})
    task = Task.from_json(told, scene=scene)
    goal = goal.format(fixture=plan.fixture, item=item)
    return scene, replace(task, goal=bddl.parse_formula(goal))


def executed(scene: Scene, task: Task, seed: int) -> Rollout:
    """Return what comes of doing the steps in the room of a seed."""
    concrete = vary(scene.with_scales(task.scales), seed)
    return UncheckedRun(compose(task, scene=concrete), concrete, seed).from_start()


def main() -> int:
    """Print what became of each decomposition, and the rates."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="a checkout of RoboGen with example_tasks")
    parser.add_argument("--episodes", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    plans = [plan for plan in recorded(options.checkout) if plan.name in ROOMS]
    if not plans:
        parser.error(f"DIR {options.checkout}: expected a checkout of RoboGen, with {', '.join(ROOMS)}")
    seeds = range(options.seed, options.seed + options.episodes)
    for lets_go in (False, True):
        done = 0
        print("as its code does" if lets_go else "as written")
        for plan in plans:
            scene, task = prepared(plan, grasping_lets_go=lets_go)
            rollouts = [executed(scene, task, seed) for seed in seeds]
            good = sum(one.succeeded for one in rollouts)
            done += good
            failed = Counter(_why(one) for one in rollouts if not one.succeeded)
            print(f"  {plan.name}: {good} of {len(rollouts)} {dict(failed)}", flush=True)
        # What repeats one decomposition succeeds and fails together.
        print(f"  together {Rate(done, len(plans) * len(seeds), clusters=len(plans))}")
    return 0


def _why(rollout: Rollout) -> str:
    failure = failure_of(rollout)
    return "goal-not-reached" if failure is None else failure.kind.value


if __name__ == "__main__":
    sys.exit(main())
