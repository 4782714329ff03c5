"""What the built-in scenes admit: wishes by kind, seconds, whether a drawn sample proves, and how much of it succeeds.

python benchmarks/scene_tasks.py --drawn 200 --seed 0
python benchmarks/scene_tasks.py --drawn 200 --run 60 --seed 0 --full-size
"""

from __future__ import annotations

import argparse
import time
from collections import Counter

import numpy as np

import bddl
import llm
import oag
from executor.rollouts.feasibility import feasible
from executor.rollouts.rollout import rollout
from executor.scenes.file import load_scene
from oag import Scene
from oag.measurements import clopper_pearson
from oag.model.robots import FULL_SIZE
from oag.wish_list import KINDS, AdmittedTask

SCENES = (
    *("kitchen_t1", "kitchen_t2", "kitchen_t3", "kitchen_t4", "kitchen02-a"),
    *("kitchen07-b", "kitchen12-c", "bedroom01-a", "bedroom05-b", "t4-12000"),
)

Found = tuple[Scene, AdmittedTask]


def listed(name: str, full_size: bool) -> list[Found]:
    """Return what a scene admits, and print how much that is and how long it took."""
    scene = load_scene(name)
    scene = scene.with_robot(FULL_SIZE.name) if full_size else scene
    refused = Counter[str]()
    began, first_s, found = time.process_time(), 0.0, list[AdmittedTask]()
    for one in llm.tasks(scene, on_refusal=lambda wish, why: refused.update([why.code])):
        first_s = first_s or time.process_time() - began
        found.append(one)
    counts = Counter(one.wish.kind for one in found)
    kinds = ", ".join(f"{counts[kind]} {kind}" for kind in KINDS if counts[kind])
    took_s = time.process_time() - began
    print(
        f"{name:12} {len(found):4} in {took_s:5.2f} s, the first in {first_s:.2f} s: {kinds}; refused {dict(refused)}"
    )
    return [(scene, one) for one in found]


def proves(scene: Scene, one: AdmittedTask) -> bool:
    """Return whether a plan is proved by verifier and checker, and its sentence is read as the wish's goal."""
    report = oag.compose(one.task, scene=scene).verify()
    read = llm.propose(one.sentence, scene).task.goal
    same = bddl.equivalent(read, one.wish.goal, scene.categories)
    return report.verdict is oag.Verdict.PROVED and bool(oag.recheck(report.certificate)) and bool(same)


def executed(scene: Scene, one: AdmittedTask, seed: int) -> str:
    """Return how far a wish gets: infeasible, failed or succeeded."""
    answer = feasible(oag.compose(one.task, scene=scene), scene, seed, vary=False)
    if not answer:
        return f"infeasible: {answer.reason}"
    began, planned = time.process_time(), oag.compose(answer.task, scene=scene)
    done = rollout(planned, scene, seed, vary=False, conditions=answer.conditions())
    return f"{'succeeded' if done.succeeded else 'failed'} in {time.process_time() - began:.1f} s"


def main() -> None:
    """Print the table, the share that proves, and the share that succeeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--drawn", type=int, default=200)
    parser.add_argument("--run", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--full-size", action="store_true")
    options = parser.parse_args()
    found = [one for name in SCENES for one in listed(name, options.full_size)]
    order = np.random.default_rng(options.seed).permutation(len(found))
    drawn = [found[int(index)] for index in order[: options.drawn]]
    print(f"{len(found)} in {len(SCENES)} scenes; {sum(proves(*one) for one in drawn)} of {len(drawn)} drawn prove")
    endings = Counter[str]()
    for scene, one in drawn[: options.run]:
        ending = executed(scene, one, options.seed)
        endings[ending.split()[0].rstrip(":")] += 1
        print(f"  {scene.name:20} {one.wish.kind:9} {one.sentence:50} {ending}", flush=True)
    if options.run:
        low, high = clopper_pearson(endings["succeeded"], endings["succeeded"] + endings["failed"])
        print(f"{dict(endings)}; of the feasible {100 * low:.0f} to {100 * high:.0f} % succeed")


if __name__ == "__main__":
    main()
