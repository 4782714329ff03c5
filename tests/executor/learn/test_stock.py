"""Policies of LeRobot in the same episodes; LeRobot itself is played by what its source says of it."""

from __future__ import annotations

import json
import sys
from contextlib import closing
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from executor.cli.app import run
from executor.data.store import EpisodeStore
from executor.envs import MOST_STEPS
from executor.envs.episodes import family_source
from executor.learn.acting import LeRobotPolicy, is_stock
from executor.learn.demonstrations import learned_from
from executor.learn.evaluation import environment_for
from executor.learn.policy_record import NotAPolicy
from tests.executor.learn.test_commands import last_json

pytestmark = pytest.mark.physics


class Still:
    """Foretells chunks that keep everything where it is, and counts how often it looked."""

    def __init__(self, numbers: int) -> None:
        feature = SimpleNamespace(shape=(numbers,))
        self.config = SimpleNamespace(type="act", action_feature=feature, n_action_steps=4, chunk_size=8)
        self.looks: list[dict[str, Any]] = []
        self.queue: list[torch.Tensor] = []

    def eval(self) -> Still:
        return self

    def reset(self) -> None:
        self.queue = []

    def select_action(self, seen: dict[str, Any]) -> torch.Tensor:
        if not self.queue:
            self.looks.append(seen)
            self.queue = [torch.zeros(1, self.config.action_feature.shape[0])] * 4
        return self.queue.pop()


def installed(monkeypatch: pytest.MonkeyPatch, policy: Still) -> None:
    """Put a LeRobot in place that has one policy."""
    configs, factory = ModuleType("lerobot.configs.policies"), ModuleType("lerobot.policies.factory")
    loader = SimpleNamespace(from_pretrained=lambda folder, **_: policy)
    configs.PreTrainedConfig = SimpleNamespace(from_pretrained=lambda folder: policy.config)  # type: ignore[attr-defined]
    factory.get_policy_class = {"act": loader}.__getitem__  # type: ignore[attr-defined]
    # Normalisers, as LeRobot keeps them with its policies: this one opens the gripper.
    after = torch.nn.functional.one_hot(torch.tensor(6), policy.config.action_feature.shape[0])
    factory.make_pre_post_processors = lambda **_: (dict, lambda action: action + after)  # type: ignore[attr-defined]
    for name in ("lerobot", "lerobot.configs", "lerobot.policies"):
        monkeypatch.setitem(sys.modules, name, ModuleType(name))
    monkeypatch.setitem(sys.modules, "lerobot.configs.policies", configs)
    monkeypatch.setitem(sys.modules, "lerobot.policies.factory", factory)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder as LeRobot's trainer leaves one, so far as is looked at here."""
    out = tmp_path / "pretrained_model"
    out.mkdir()
    (out / "config.json").write_text('{"type": "act"}')
    (out / "train_config.json").write_text('{"seed": 7}')
    return out


def test_a_stock_policy_stands_in_the_same_table(
    picked: EpisodeStore, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = Still(10)
    installed(monkeypatch, policy)
    monkeypatch.setattr("executor.learn.evaluation.MOST_S", 0.8)
    asked = ["evaluate", str(folder), "--episodes", "2", "--json"]
    assert run([*asked, "--seed", "62985", "--data", str(picked.path)]) == 0
    (told,) = last_json(capsys)["policies"].values()  # type: ignore[attr-defined]
    assert (told["seed"], told["execute"], told["demonstrations"]) == (7, 4, 2)
    assert told["failures"] == {"not-reached": 2}
    # Eight actions are two chunks; it saw what a data set has, and the same in both episodes' beginnings but the room.
    assert len(policy.looks) == 4 and policy.looks[0]["task"] == ["pick up the glass"]
    assert policy.looks[0]["observation.state"].shape == (1, 20)
    assert policy.looks[0]["observation.environment_state"].shape == (1, 216)
    assert run([*asked, "--seed", "62980", "--data", str(picked.path)]) == 2
    assert "which are from 62980 to 62981" in json.dumps(last_json(capsys)["error"])
    assert run([*asked, "--seed", "62985"]) == 2
    assert "--data is missing" in json.dumps(last_json(capsys)["error"])


def test_what_it_does_is_what_the_environment_takes(
    picked: EpisodeStore, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = learned_from(picked.path)
    installed(monkeypatch, Still(12))
    actor = LeRobotPolicy(folder, found)
    assert actor.record.settings.acts.kind == "joint_target" and is_stock(folder)
    actor.begin([17], 3)
    action = actor.act({"agent_pos": np.zeros(20), "environment_state": np.zeros(216)})
    assert action.tolist() == [0.0] * 6 + [1.0] + [0.0] * 5
    installed(monkeypatch, Still(7))
    with pytest.raises(NotAPolicy, match="7 numbers at a time; the environment takes 10 or 12"):
        LeRobotPolicy(folder, found)
    foreign = Still(10)
    foreign.config.image_features = {"observation.images.top": SimpleNamespace(shape=(3, 32, 48))}
    installed(monkeypatch, foreign)
    with pytest.raises(NotAPolicy, match=r"observes observation\.images\.top; the environment has "):
        LeRobotPolicy(folder, found)


@pytest.mark.render
def test_a_policy_by_pictures_sees_those_of_the_environment_at_its_size(
    picked: EpisodeStore, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy = Still(10)
    views = ("observation.images.global", "observation.images.head")
    policy.config.image_features = dict.fromkeys(views, SimpleNamespace(shape=(3, 32, 48)))
    installed(monkeypatch, policy)
    found = learned_from(picked.path)
    actor = LeRobotPolicy(folder, found)
    with closing(environment_for(actor, found.kinds[0])) as env:
        observation, _ = env.reset(seed=62985)
        actor.begin([17], 62985)
        actor.act(observation)
        drawn = observation["pixels"]["head"]
    (look,) = policy.looks
    assert set(look) == {"observation.state", "task", *views}
    assert look[views[1]].shape == (1, 3, 32, 48) and drawn.shape == (32, 48, 3)
    assert np.array_equal(look[views[1]][0].numpy().transpose(1, 2, 0) * 255.0, drawn.astype(np.float32))


def checkpoint(run: Path, step: int | None, **training: object) -> Path:
    """Return a policy's folder in a run's, as LeRobot's trainer leaves both; `step` None is one copied by itself."""
    out = run / "checkpoints" / f"{step or 0:06d}" / "pretrained_model"
    out.mkdir(parents=True)
    told = {"steps": 2000, "seed": 0, "output_dir": str(run), "job_name": run.name, "policy": {"repo_id": run.name}}
    (out / "config.json").write_text(json.dumps({"type": "act", "repo_id": run.name}))
    (out / "train_config.json").write_text(json.dumps({**told, **training}))
    if step is not None:
        (out.parent / "training_state").mkdir()
        (out.parent / "training_state/training_step.json").write_text(json.dumps({"step": step}))
    return out


def test_policies_are_one_row_where_nothing_but_the_seed_differs(
    picked: EpisodeStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    installed(monkeypatch, Still(10))
    found = learned_from(picked.path)

    def row(folder: Path) -> tuple[str, int]:
        actor = LeRobotPolicy(folder, found)
        return actor.record.key_without_seed, actor.step

    first = row(checkpoint(tmp_path / "a", 2000))
    assert first[1] == 2000 and row(checkpoint(tmp_path / "b", 2000, seed=1)) == first
    assert row(checkpoint(tmp_path / "a", 1000)) != first
    assert row(checkpoint(tmp_path / "c", 100_000, seed=1, steps=100_000)) != first
    assert row(checkpoint(tmp_path / "d", 2000, seed=1, batch_size=8)) != first
    other = checkpoint(tmp_path / "e", 2000, seed=1)
    (other / "config.json").write_text('{"type": "act", "dim_model": 256}')
    assert row(other) != first
    # Nobody knows after how many steps these were copied, nor by what seed that was trained.
    alone = [row(checkpoint(tmp_path / name, None, seed=seed)) for seed, name in enumerate("fg")]
    unsaid = [row(checkpoint(tmp_path / name, 2000, seed=None)) for name in "hi"]
    assert len({first, *alone, *unsaid}) == 5


@pytest.mark.slow
def test_a_policy_is_told_the_sentence_of_each_episode(
    picked: EpisodeStore, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    policy = Still(10)
    installed(monkeypatch, policy)
    monkeypatch.setitem(MOST_STEPS, "T5", 4)
    asked = ["evaluate", str(folder), "--data", str(picked.path), "--task", "T5", "--seed", "62985", "--json"]
    assert run([*asked, "--episodes", "2"]) == 0
    capsys.readouterr()
    sentences = [family_source("T5")(seed, None).query for seed in (62985, 62986)]
    assert [looked["task"] for looked in policy.looks] == [[sentence] for sentence in sentences]
    assert len({"", "pick up the glass", *sentences}) == 4


def test_without_lerobot_it_says_so(picked: EpisodeStore, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "lerobot", None)
    with pytest.raises(NotAPolicy, match="LeRobot, which is not installed here"):
        LeRobotPolicy(folder, learned_from(picked.path))
