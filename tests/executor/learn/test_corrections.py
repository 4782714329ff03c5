"""The planner goes on from where something else came to; what it does then is a demonstration that says so."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from executor.campaign.versions import outcome_version
from executor.cli.app import run
from executor.data.formats.export import write_set
from executor.data.formats.store_reader import stream_of
from executor.data.store import EpisodeStore
from executor.data.units import DemoSeries, DemoUnit, Takeover
from executor.data.worker import run_unit
from executor.envs.demonstration_replay import replay_episode
from executor.envs.scene_environment import SceneEnvironment
from executor.learn.acting import TrainedPolicy
from executor.learn.correcting import Corrector
from executor.learn.demonstrations import read_demonstrations
from executor.learn.evaluation.outcomes import OutcomeWatch
from executor.learn.policy_record import PolicyRecord, policy_key
from executor.learn.training import Trainer
from executor.rollouts.rollout import Conditions
from executor.rollouts.takeover import continue_plan
from tests.executor.learn.conftest import small
from tests.executor.learn.test_commands import last_json

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def policy(picked: EpisodeStore, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a policy that has learned next to nothing."""
    out = tmp_path_factory.mktemp("policy") / "p"
    data = read_demonstrations([picked.path], small())
    Trainer(out, PolicyRecord.of(small(), 3, data), data).run(lambda step, loss: None)
    return out


@pytest.fixture(scope="module")
def corrected(policy: Path, picked: EpisodeStore, tmp_path_factory: pytest.TempPathFactory) -> EpisodeStore:
    """Return the store of two corrections of it, of short episodes; in the second the base is pushed."""
    store = EpisodeStore(tmp_path_factory.mktemp("corrected") / "s")
    first = DemoUnit.from_json(next(picked.episodes()).meta["unit"])
    unit = replace(first, seed=62970, takeover=Takeover(policy_key(policy), 4))
    pushed = replace(unit, seed=62971, takeover=Takeover(policy_key(policy), 4, ("base",)))
    store.add_requests([DemoSeries(unit, 1).to_json(), DemoSeries(pushed, 1).to_json()])
    corrector = Corrector(TrainedPolicy.load(policy, execute=4))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("executor.learn.evaluation.trials.MOST_S", 3.0)
        patch.setattr("executor.learn.evaluation.trials.PUSHED_BETWEEN_S", (0.5, 1.0))
        for one in (unit, pushed):
            run_unit(store, one, outcome_version(), maker=corrector.make)
    corrector.close()
    return store


def test_the_planner_goes_on_with_what_is_in_the_hand(picked: EpisodeStore) -> None:
    """Recorded targets bring the hand to the glass; from there the planner lifts it, and does not begin anew."""
    episode = next(picked.demonstrations())
    env = SceneEnvironment(scene=episode.scene, task=episode.task)
    env.reset(seed=0)
    step = episode.arrays["step"]
    lifting = int(np.flatnonzero(step == step.max())[0])
    for target in episode.arrays["robot_target"][1 : lifting + 2]:
        env.step(target.astype(np.float32))
    start = env.checkpoint()
    assert start.held == "glass_0" and start.gripped is None
    done = continue_plan(env.episode.graph, start, 0, 1, Conditions(record_hz=10.0))
    assert [action.primitive.value for action in done.how.graph.task.subtasks[0].flow or ()] == [7]
    assert done.how.graph.verify() and done.rollout.succeeded
    env.resume(done.after)
    assert env.world.time_s == pytest.approx(done.rollout.simulated_s, abs=0.01)
    # An empty hand begins anew, and a shut one that holds nothing is opened first.
    env.reset(seed=0)
    for _ in range(12):
        env.step(np.array([*env.target[:10], 0.0, 0.0], np.float32))
    again = continue_plan(env.episode.graph, env.checkpoint(), 0, 1, Conditions(record_hz=10.0))
    assert [action.primitive.value for action in again.how.graph.task.subtasks[0].flow or ()] == [5, 17, 1, 2, 3, 7]
    assert again.rollout.succeeded
    env.close()


def test_corrections_are_labelled_replayable_and_learned_from(
    policy: Path, corrected: EpisodeStore, picked: EpisodeStore, tmp_path: Path
) -> None:
    episodes = list(corrected.episodes())
    assert len(episodes) == 2 and all(episode.succeeded for episode in episodes)
    told = episodes[0].meta["takeover"]
    unit = DemoUnit.from_json(episodes[0].meta["unit"])
    assert unit.takeover == Takeover(policy_key(policy), 4) and told["policy"] == policy_key(policy)
    assert told["because"] in ("anew", "stalled", "time") and told["phase"] in (17, 1, 2, 3, 7)
    assert episodes[0].start is not None and episodes[0].arrays["time_s"][0] >= told["at_s"] > 0.5
    assert "pushes" not in told and "pushes" not in episodes[0].meta["unit"]["takeover"]
    after = episodes[1].meta["takeover"]
    assert [push["what"] for push in after["pushes"]] == ["base"] == episodes[1].meta["unit"]["takeover"]["pushes"]
    assert after["pushes"][0]["moved_m"] > 0.02 and after["at_s"] > after["pushes"][0]["at_s"]
    assert replay_episode(episodes[0], "exact").good and replay_episode(episodes[0], "joint_target").good
    settings = small()
    both = read_demonstrations([picked.path, corrected.path], settings)
    assert both.takeovers == 2 and {62970, 62971} <= set(both.seeds)
    first = int(np.unique(both.starts)[both.names.index(unit.name)])
    assert both.steps[both.phases[first]] in (5, 17)  # The planner drives, the hand emptied first.
    write_set(stream_of(corrected), "zarr", tmp_path / "z")
    exported = read_demonstrations([tmp_path / "z"], settings)
    assert exported.takeovers == 2 and exported.steps == read_demonstrations([corrected.path], settings).steps


@pytest.mark.parametrize("anew", [1, 0])
def test_the_planner_takes_over_where_a_policy_begins_anew_and_not_where_it_succeeds(
    policy: Path,
    picked: EpisodeStore,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    anew: int,
) -> None:
    class Done(OutcomeWatch):
        def look(self, info: Mapping[str, Any]) -> None:
            self.succeeded_s = 1.0

    monkeypatch.setattr(TrainedPolicy, "restarts", property(lambda _: anew))
    monkeypatch.setattr("executor.learn.correcting.OutcomeWatch", Done)
    first = DemoUnit.from_json(next(picked.episodes()).meta["unit"])
    unit = replace(first, seed=62972, takeover=Takeover(policy_key(policy), 4))
    store, corrector = EpisodeStore(tmp_path / "s"), Corrector(TrainedPolicy.load(policy, execute=4))
    store.add_requests([DemoSeries(unit, 1).to_json()])
    run_unit(store, unit, outcome_version(), maker=corrector.make)
    corrector.close()
    (episode,) = store.episodes()
    if anew:
        assert episode.succeeded and episode.meta["takeover"]["because"] == "anew"
    else:
        assert episode.meta["failure"]["kind"] == "not-needed" and not list(store.demonstrations())


def test_what_cannot_be_corrected_is_refused(
    policy: Path, picked: EpisodeStore, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    blind = small(sees={"phase": False})
    data = read_demonstrations([picked.path], blind)
    Trainer(tmp_path / "blind", PolicyRecord.of(blind, 0, data), data).run(lambda step, loss: None)
    out = ["--out", str(tmp_path / "s"), "--json"]
    assert run(["correct", str(tmp_path / "blind"), *out]) == 2
    assert "phase = true" in json.dumps(last_json(capsys)["error"])
    assert run(["correct", str(policy), "--execute", "9", *out]) == 2
    assert "--execute 9: expected 1 to 8" in str(last_json(capsys)["error"])
    assert run(["correct", str(policy), "--noise-m", "1", *out]) == 2
    assert run(["correct", str(policy), "--push", "base", "base", *out]) == 2
    assert run(["correct", str(policy), "--stances", "0", *out]) == 2
    assert run(["correct", str(policy), "--task", "T1", "--seed", "62951", *out]) == 2
    assert "has learned nothing of ARTICULATE_OPEN" in capsys.readouterr().out
    assert not (tmp_path / "s").exists()


@pytest.mark.slow
def test_correct_makes_a_store_and_goes_on(policy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["correct", str(policy), "--episodes", "1", "--seed", "62975", "--workers", "1", "--json"]
    assert run([*command, "--out", str(tmp_path / "s")]) == 0
    assert last_json(capsys)["made"] == 1
    assert run([*command, "--out", str(tmp_path / "s")]) == 0
    told = last_json(capsys)
    assert told["made"] == 0 and told["endings"] == {"succeeded": 1}


def test_a_robot_that_leans_on_something_slides_off_it_first(picked: EpisodeStore) -> None:
    episode = next(picked.demonstrations())
    env = SceneEnvironment(scene=episode.scene, task=episode.task)
    env.reset(seed=0)
    target, table_m = env.target, env.world.T_world_link("table_0")[:2, 3]
    for _ in range(60):  # On towards the table, and against it.
        ahead = table_m - target[:2]
        target[:2] += 0.04 * ahead / np.hypot(*ahead)
        env.step(target.astype(np.float32))
        if np.hypot(*(env.target - np.array(env.world.robot.get_qpos()))[:2]) > 0.02:
            break
        target = env.target
    done = continue_plan(env.episode.graph, env.checkpoint(), 0, 1, Conditions(record_hz=10.0))
    flow = [action.primitive.value for action in done.how.graph.task.subtasks[0].flow or ()]
    assert flow[0] == 5 and flow[1] in (13, 14, 15, 16) and flow[2:] == [17, 1, 2, 3, 7]
    assert done.how.graph.verify() and done.rollout.succeeded
    env.close()
