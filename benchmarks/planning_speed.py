"""What boxes save: CPU time of forecasts with and without them, in alternation, and whether the answers are equal.

    python -m benchmarks.planning_speed --seeds 80020 80040 --rounds 2

Wishes are those of T7. A ratio holds on any machine; seconds depend on it and on what else runs there. Without boxes
every configuration is put to the engine, and all else is the same.
"""

from __future__ import annotations

import time
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any
from unittest import mock

import numpy as np
import tyro

from executor.campaign.planning_model import plan_offline
from executor.geometry import Array
from executor.planning.collision import CollisionOracle
from executor.rollouts.feasibility import feasible
from executor.scenes.generators import any_task
from executor.scenes.generators.any_task import AnyWish
from oag import compose
from oag.sizes import Sizing


@dataclass(frozen=True)
class Settings:
    """Which wishes, and how often each.

    Attributes:
        seeds: Of the wishes.
        rounds: How often each forecast is made with boxes and without; the fastest counts.
    """

    seeds: tuple[int, ...] = (80020, 80040, 79021)
    rounds: int = 2


def without_boxes() -> AbstractContextManager[Any]:
    """Return a context in which boxes show nothing to be free."""

    def none(oracle: CollisionOracle, path: Array, **_: object) -> Array:
        return np.zeros(len(path), dtype=bool)

    return mock.patch.object(CollisionOracle, "surely_free", none)


def forecast(wish: AnyWish) -> tuple[float, dict[str, Any]]:
    """Return the CPU time of a wish's forecast, and the answer without its times."""
    graph = compose(plan_offline(wish.query, wish.scene, Sizing(keep=True)), scene=wish.scene)
    began = time.process_time()
    found = feasible(graph, wish.scene, wish.seed, vary=False)
    spent_s, answer = time.process_time() - began, found.to_json() | {"effort_s": found.effort_s}
    for part in (answer, *answer["subtasks"]):
        part.pop("cpu_s")
    return spent_s, answer


def main(settings: Settings) -> None:
    """Print a line for each wish."""
    for seed in settings.seeds:
        wish, answers = any_task.draw(seed), list[dict[str, Any]]()
        spent_s: dict[bool, list[float]] = {True: [], False: []}
        for _ in range(settings.rounds):
            for boxes in (False, True):
                with nullcontext() if boxes else without_boxes():
                    cpu_s, answer = forecast(wish)
                spent_s[boxes].append(cpu_s)
                answers.append(answer)
        without_s, with_s = min(spent_s[False]), min(spent_s[True])
        same = "same answer" if all(answer == answers[0] for answer in answers) else "OTHER ANSWER"
        print(f"{seed}: {without_s:.2f} s without, {with_s:.2f} s with boxes, {with_s / without_s:.2f} of it; {same}")


if __name__ == "__main__":
    main(tyro.cli(Settings))
