"""Policies judged: monitors, the graph's guidance, interruptions, tables and the page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from executor import load_scene
from executor.campaign.rate import Rate
from executor.cli.app import run
from executor.data.generation import series_of
from executor.data.store import EpisodeStore
from executor.data.work import prepare_unit
from executor.envs.scene_environment import SceneEnvironment
from executor.learn.acting import Policy, TrainedPolicy
from executor.learn.evaluation import (
    AFTER_S,
    MOST_S,
    UNDONE_S,
    EpisodeOutcome,
    MonitorWatch,
    OutcomeWatch,
    PlanGuide,
    most_steps,
    run_episode,
)
from executor.learn.observations import subtask_of
from executor.learn.scores import (
    Curve,
    EvaluationReport,
    FailedEpisode,
    PolicyScore,
    by_training,
    evaluation_page,
    loss_curve,
)
from executor.rollouts.rollout import RunConditions, rollout
from llm import propose
from tests.executor.learn.conftest import KITCHEN, PLAN
from tests.executor.learn.test_commands import TINY, last_json

pytestmark = pytest.mark.physics


@pytest.fixture
def env(picked: EpisodeStore) -> Iterator[SceneEnvironment]:
    """Return the environment of a demonstration, at its start."""
    episode = next(picked.demonstrations())
    with closing(SceneEnvironment(scene=episode.scene, task=episode.task)) as found:
        found.reset(seed=0)
        yield found


def test_a_whole_task_has_time_for_each_of_its_subtasks() -> None:
    task = propose("put the glass into the refrigerator", load_scene(str(KITCHEN))).task
    assert len(task.subtasks) > 1
    assert most_steps(None, task, 5.0) == 5 * MOST_S * len(task.subtasks)


def test_monitors_see_a_robot_that_runs_into_things(env: SceneEnvironment) -> None:
    watch, target = MonitorWatch(env.world, env.episode.task), env.target
    for _ in range(60):
        target[0] += 0.05  # On, whatever is there: at last the table.
        env.step(target.astype(np.float32))
        watch.look(env.target)
    assert {"stalled", "unexpected-contact"} & set(watch.first_failures_s)


def test_seeds_of_a_training_are_one_row() -> None:
    found = {name: [episode(k, good=k < good) for k in range(10)] for name, good in (("a", 8), ("b", 6), ("c", 3))}
    first, second = by_training({"a": ("x", 0), "b": ("x", 1), "c": ("y", 0)}, found)
    assert (first.names, first.seeds, first.shares) == (("a", "b"), (0, 1), (0.8, 0.6))
    assert (first.once.successes, first.once.trials) == (14, 20) and first.spread == pytest.approx(0.1414, abs=1e-4)
    assert second.names == ("c",) and second.spread is None
    # Ten rooms, each met twice: no narrower than what seven of ten say.
    assert first.once.interval_percent == Rate(7, 10).interval_percent
    assert second.once.interval_percent == Rate(3, 10).interval_percent


class Pretender:
    """Takes some subtask to be going on, whatever it sees."""

    name = folder = "pretender"
    execute, step = 6, 0
    record = SimpleNamespace(rate_hz=10.0)

    def __init__(self) -> None:
        self.subtask = self.restarts = 0
        self.begun: list[list[int]] = []

    def begin(self, plan: Sequence[int], seed: int) -> None:
        self.go_on(plan)

    def go_on(self, plan: Sequence[int]) -> None:
        self.begun.append(sorted({subtask_of(step) for step in plan}))


def test_the_graph_sends_back_who_goes_on_from_what_is_not_done_and_on_who_does_what_is() -> None:
    task = propose("put the glass into the refrigerator", load_scene(str(KITCHEN))).task
    actor = Pretender()
    guide = PlanGuide(cast(Policy, actor), task)
    for _ in range(100):
        guide.look({"stage": 0})
        guide.look({"stage": 1})  # A door counts as open long before it was opened as far as it has to be.
    assert actor.begun == []
    actor.restarts = 1
    guide.look({"stage": 0})
    assert actor.begun == [], "what is not done may be begun anew"
    actor.restarts = 2
    guide.look({"stage": 1})
    assert actor.begun == [[1, 2, 3]]
    actor.restarts, actor.subtask = 2, 2
    for _ in range(int(UNDONE_S * 10.0)):
        guide.look({"stage": 1})
    assert len(actor.begun) == 1
    guide.look({"stage": 1})
    assert actor.begun[1:] == [[1, 2, 3]]
    actor.restarts, actor.subtask = 3, 3
    guide.look({"stage": 4})
    assert len(actor.begun) == 2, "behind the last subtask there is nothing to go on with"


def test_who_succeeds_as_the_time_runs_out_is_looked_at_for_as_long_as_anybody(
    env: SceneEnvironment, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Late(OutcomeWatch):
        def look(self, info: Mapping[str, Any]) -> None:
            super().look(info)
            if self.succeeded_s is None and self.elapsed_s > 0.85:
                self.succeeded_s = self.elapsed_s

    actor = Pretender()
    actor.act = lambda observation: env.target  # type: ignore[attr-defined]
    monkeypatch.setattr("executor.learn.evaluation.MOST_S", 1.0)
    monkeypatch.setattr("executor.learn.evaluation.OutcomeWatch", Late)
    outcome, _ = run_episode(env, cast(Policy, actor), 0)
    assert outcome.success_once and not outcome.success_at_end, "it did not hold"
    assert outcome.simulated_s == pytest.approx(0.9, abs=0.05) and env.world.time_s >= 0.9 + AFTER_S


def test_curves_are_drawn_and_logs_that_are_none_are_passed_over() -> None:
    lines = ['{"step": 200, "loss": 0.5}', "nonsense", '{"step": 100, "loss": 1.0}', "[]"]
    curve = loss_curve("<p>", lines)
    assert curve is not None and curve.points == ((100.0, 1.0), (200.0, 0.5))
    curves = [curve, Curve("q", ((200.0, 0.0),), ((0.0, 0.3),))]
    drawn = evaluation_page(EvaluationReport("", {}, (), (), curves, (), ()))
    assert drawn.count("<polyline") == 2 and drawn.count("<polygon") == 1 and "&lt;p&gt;" in drawn
    assert loss_curve("p", ["nonsense"]) is None


@pytest.mark.slow
def test_the_page_shows_what_failed_and_the_video_that_there_is() -> None:
    score = PolicyScore(Rate(1, 3), Rate(1, 3), {"lost": 2}, {}, 9.0)
    failed = [FailedEpisode("<act>", 900, "lost", "00-000900-lost/global.mp4"), FailedEpisode("<act>", 901, "lost")]
    report = EvaluationReport("open it", {"<act>": score}, [], [], [], [], failed, "scene2demo view r")
    page = evaluation_page(report)
    assert page.count("<video") == 1 and page.count("00-000900-lost/global.mp4") == 2
    assert "seed 901" in page and "<act>" not in page and "scene2demo view r" in page
    assert "With --videos" not in page and "With --videos" in evaluation_page(replace(report, failed=failed[1:]))


@pytest.mark.slow
def test_where_stances_are_compared_how_an_episode_goes_depends_on_the_room_alone() -> None:
    unit = next(series_of({**PLAN, "stances": 2, "episodes": 1})[0].units())
    assert unit.stances == 2 and unit.to_json()["stances"] == 2
    assert "stances" not in replace(unit, stances=1).to_json()
    graph = prepare_unit(unit).graph
    hashes = [rollout(graph, seed=seed, vary=False, conditions=RunConditions(stances=2)).state_hash for seed in (0, 7)]
    assert hashes[0] == hashes[1] != rollout(graph, seed=7, vary=False).state_hash


def test_evaluate_tells_of_steps_and_seeds_and_keeps_what_an_interruption_left(
    picked: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = tmp_path / "tiny.toml"
    settings.write_text(TINY)
    for seed in (0, 1):
        told = ["--data", str(picked.path), "--out", str(tmp_path / f"p{seed}"), "--seed", str(seed), "--json"]
        assert run(["train", str(settings), "--threads", "1", *told]) == 0
    monkeypatch.setattr("executor.learn.evaluation.MOST_S", 0.5)
    capsys.readouterr()
    policies = [str(tmp_path / "p0"), str(tmp_path / "p1")]
    asked = ["--episodes", "2", "--seed", "62985", "--steps", "2", "4", "--json"]
    assert run(["evaluate", *policies, *asked, "--out", str(tmp_path / "r")]) == 0
    found = last_json(capsys)
    assert len(found["policies"]) == 4  # type: ignore[arg-type]
    assert [row["seeds"] for row in found["trainings"]] == [[0, 1], [0, 1]]  # type: ignore[attr-defined]
    page = (tmp_path / "r" / "evaluation.html").read_text()
    assert "Loss by step" in page and "Success by step" in page

    # Ctrl-C in the second episode of the second policy: what both had done by then is kept.
    def ended(env: SceneEnvironment, actor: TrainedPolicy, seed: int, *, keep_states: bool) -> object:
        if seed == 62986 and actor.name == policies[1]:
            raise KeyboardInterrupt
        return run_episode(env, actor, seed, keep_states=keep_states)

    monkeypatch.setattr("executor.learn.evaluation.run_episode", ended)
    asked = ["--episodes", "2", "--seed", "62985", "--json", "--out", str(tmp_path / "ended")]
    assert run(["evaluate", *policies, *asked]) == 130
    kept = last_json(capsys)
    assert [len(row["episodes"]) for row in kept["policies"].values()] == [1, 1]  # type: ignore[attr-defined]
    assert json.loads((tmp_path / "ended" / "evaluation.json").read_text())["policies"] == kept["policies"]


def episode(seed: int, *, good: bool) -> EpisodeOutcome:
    """Return an outcome."""
    return EpisodeOutcome(seed, good, good, "" if good else "lost", 2.0, {})
