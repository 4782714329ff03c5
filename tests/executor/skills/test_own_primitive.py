"""A primitive of an own domain that the robot carries out: PUSH of `examples/skills/push.py`."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import oag
from executor import add_skill, feasible, rollout
from executor.reports.run_folder import RunFolder
from executor.rollouts.run_record import RunRecord
from executor.scenes.file import complete_scene, load_scene
from executor.skills.library import MissingSkill, require_skills, skill_of
from executor.skills.session import Session, StepResult
from tests.source_tree import ROOT

NEXT_TO = oag.Domain.from_toml(ROOT / "examples" / "domains" / "next_to.toml")
THINGS = ("box", "bowl", "mug", "can", "bottle", "book", "plate", "water_glass")


@pytest.fixture(scope="module")
def example() -> ModuleType:
    """The example's module, with its skill added."""
    spec = importlib.util.spec_from_file_location("push_example", ROOT / "examples" / "skills" / "push.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules.setdefault(spec.name, importlib.util.module_from_spec(spec))
    spec.loader.exec_module(module)
    add_skill("PUSH", module.push)
    return module


def two_things(seed: int) -> oag.Scene:
    """Return a table with two drawn things, in a drawn direction from each other."""
    draw = np.random.default_rng(seed)
    first, second = draw.choice(THINGS, 2)
    angle, apart_m, middle = draw.uniform(0, 2 * np.pi), draw.uniform(0.22, 0.32), draw.uniform(-0.08, 0.08, 2)
    off = apart_m / 2 * np.array([np.cos(angle), np.sin(angle)])
    things = {
        "table_0": {"category": "table", "model": "table_four_legs", "position": [0.9, 0.0]},
        "a_0": {"category": str(first), "on": "table_0", "at": (middle + off).round(3).tolist()},
        "b_0": {"category": str(second), "on": "table_0", "at": (middle - off).round(3).tolist()},
    }
    completed = complete_scene(
        {"name": "push", "robot": {"position": [-0.6, 0.0], "name": "panda-lift"}, "objects": things}
    )
    assert completed.scene is not None
    return replace(completed.scene, domain=NEXT_TO)


def pushing(scene: oag.Scene) -> oag.ObjectActionGraph:
    """Return the plan that pushes the first thing to the second one."""
    graph = oag.compose(oag.task(scene, goal="(nextto a_0 b_0)", steps=["PUSH a_0 b_0 table_0"]))
    assert graph.verify()
    return graph


def test_a_primitive_without_a_skill_is_refused_and_no_name_has_two() -> None:
    graph = oag.compose(oag.task(two_things(0), steps=["PLACE_NEXT_TO a_0 table_0 b_0"]))
    with pytest.raises(MissingSkill, match="PLACE_NEXT_TO"):
        require_skills(graph.task)

    def stay(session: Session, action: oag.Action) -> StepResult:
        return session.done(action)

    add_skill("WAVE", skill_of(oag.Primitive.RETREAT))
    for name in ("GRASP", "WAVE"):
        with pytest.raises(ValueError, match=name):
            add_skill(name, stay)
    with pytest.raises(ValueError, match="GRASP"):
        add_skill("GRASP", stay, replace=True)
    add_skill("WAVE", stay, replace=True)
    bound = _Stayer()
    add_skill("STAY", bound.stay)
    add_skill("STAY", bound.stay)
    wrong: list[tuple[Any, Any, type[Exception]]] = [
        (3, stay, TypeError),
        ("NOD", "stay", TypeError),
        (" ", stay, ValueError),
    ]
    for row, runner, error in wrong:
        with pytest.raises(error):
            add_skill(row, runner)


class _Stayer:
    def stay(self, session: Session, action: oag.Action) -> StepResult:
        return session.done(action)


@pytest.mark.parametrize(("given", "run"), [(None, 0.5), (0.2, 0.2)])
def test_a_push_reports_the_number_that_it_ran_with(
    example: ModuleType, monkeypatch: pytest.MonkeyPatch, given: float | None, run: float
) -> None:
    monkeypatch.setattr(example, "box_around", lambda world, name: (np.zeros(3), np.ones(3)))
    monkeypatch.setattr(example, "stroke_towards", lambda *given: None)
    monkeypatch.setattr(example, "adopt_first", lambda *given: 0)
    subtask = SimpleNamespace(target="a_0", support_goal="b_0")
    session = SimpleNamespace(
        subtask=subtask, believed=None, sync_planner=lambda: None, done=lambda action, failure: action
    )
    primitive = NEXT_TO.primitive("PUSH table_0")
    assert primitive is not None
    assert example.push(session, oag.Action(primitive, given)).parameter == run


def test_an_episode_in_an_own_domain_is_written_and_read(tmp_path: Path) -> None:
    row = {"objects": {"?a": "item"}, "writes": ["(lit ?a)"]}
    domain = oag.Domain.from_json({"name": "lamps", "predicates": {"lit": ["a"]}, "primitives": {"SHINE": row}})
    scene = replace(two_things(0), domain=domain)
    scene = replace(scene, facts=(*scene.facts, domain.formula("(not (lit a_0))")))
    add_skill("SHINE", lambda session, action: session.done(action))
    task = oag.task(scene, goal="(lit a_0)", steps=["SHINE a_0"])
    back = oag.Action(oag.Primitive.MOVE_BASE_BACKWARD, 0.1)
    shine = domain.primitive("SHINE")
    assert shine is not None
    flow = (back, oag.Action(shine))
    graph = oag.compose(replace(task, subtasks=(replace(task.subtasks[0], flow=flow),)), scene=scene)
    done = rollout(graph, scene, 0, vary=False)
    folder = RunFolder.prepare(tmp_path)
    folder.write_rollout(RunRecord(graph, graph.verify(), rollout=done))
    folder.write_episode(done, None)
    assert {"scene.json", "episode.hdf5"} <= set(folder.written())
    assert load_scene(tmp_path / "scene.json").domain == domain


@pytest.mark.physics
@pytest.mark.slow
@pytest.mark.parametrize("seed", [1001, 1004, 1005])
def test_a_thing_is_pushed_next_to_another_one(example: ModuleType, seed: int) -> None:
    scene = two_things(seed)
    graph = pushing(scene)
    found = feasible(graph, scene, seed, vary=False)
    assert found, found.reason
    done = rollout(graph, scene, seed, vary=False, conditions=found.conditions())
    assert done.succeeded, done.failure
    pushed = done.subtasks[0]
    # The thing went with the hand, and nothing else did.
    assert not pushed.moved_m
