"""What the doors of the executor are handed: a graph, and a clear error for anything else."""

from __future__ import annotations

from typing import Any

import pytest

import executor
import oag
from executor.scenes.vary import SeedError
from tests.oag.paper import scene, task_json

untyped: Any = executor


@pytest.mark.parametrize("door", ["rollout", "evolve", "resume"])
def test_a_task_is_no_graph(door: str) -> None:
    task = oag.Task.from_json(task_json("T1"), scene=scene("T1"))
    more = (None, 0) if door == "resume" else ()
    with pytest.raises(
        oag.TaskError, match=r"expected an object-action graph, got <Task .* \(oag\.compose\(task, scene\)"
    ):
        getattr(untyped, door)(task, *more)


def _graph() -> oag.ObjectActionGraph:
    return oag.compose(oag.Task.from_json(task_json("T1"), scene=scene("T1")))


@pytest.mark.parametrize("door", ["rollout", "evolve"])
@pytest.mark.parametrize("seed", [-1, 2**31, 0.5, "0", None])
def test_a_seed_is_a_whole_number_from_0(door: str, seed: object) -> None:
    with pytest.raises(SeedError, match=rf"the seed {seed!r} is not possible: expected a whole number from 0 to "):
        getattr(untyped, door)(_graph(), seed=seed)
    with pytest.raises(SeedError):
        untyped.vary(scene("T1"), seed)


@pytest.mark.parametrize("named", ["kitchen_t1", {}, 3])
def test_what_is_no_scene_is_not_taken_for_the_graphs_own(named: object) -> None:
    for door in (untyped.rollout, untyped.evolve):
        with pytest.raises(oag.SceneError, match=r"expected a Scene, got"):
            door(_graph(), named)
    with pytest.raises(oag.SceneError, match=r"expected a Scene, got"):
        untyped.vary(named, 0)


@pytest.mark.parametrize("given", [{}, None, 3, b"kitchen_t1", ["kitchen_t1"]])
def test_a_scene_is_loaded_by_name_or_path(given: object) -> None:
    with pytest.raises(oag.SceneError, match=r"expected the name of a scene or the path of its file, got"):
        untyped.load_scene(given)
