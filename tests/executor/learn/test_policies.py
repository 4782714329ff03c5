"""What policies are told fits what they do, training repeats and goes on, and nothing foreign is taken for one."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from executor.data.formats.export import open_set, write_set
from executor.data.formats.store_reader import stream_of
from executor.data.state_readers import AGENT, ENVIRONMENT, THING, THINGS
from executor.data.store import EpisodeStore, NotADataset
from executor.envs.scene_environment import SceneEnvironment
from executor.learn import demonstrations
from executor.learn.acting import TrainedPolicy
from executor.learn.action_chunks import to_base_targets, to_world_targets
from executor.learn.demonstrations import Demonstrations, read_demonstrations
from executor.learn.evaluation import NEAR_M, EpisodeOutcome, OutcomeWatch, environment_for, run_episode
from executor.learn.networks import NetworkSizes, PolicyNetwork
from executor.learn.observations import (
    HANDLE_NUMBERS,
    ROBOT_NUMBERS,
    THING_NUMBERS,
    own_numbers,
    primitive_of,
    state_numbers,
    subtask_of,
)
from executor.learn.policy_record import (
    ABOUT,
    MOST_DEVIATIONS,
    WEIGHTS,
    NotAPolicy,
    PolicyRecord,
    load_network,
    normalise,
    read_record,
    read_tensors,
)
from executor.learn.scores import PolicyScore, paired_tests
from executor.learn.settings import Sees, SettingsError, known_settings, read_settings, settings_of
from executor.learn.training import Trainer, learning_rate, parameters
from executor.sim.robot.actions import joint_limits
from oag.model.scene import FULL_SCALE
from oag.model.symbols import Primitive
from tests.executor.learn.conftest import small

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def data(picked: EpisodeStore) -> Demonstrations:
    """Return the demonstrations as a policy of the state sees them."""
    return read_demonstrations([picked.path], small())


def trained(data: Demonstrations, out: Path, **parts: dict[str, object]) -> PolicyRecord:
    """Train a small policy and returns its record."""
    record = PolicyRecord.of(small(**parts), 3, data)
    Trainer(out, record, data).run(lambda step, loss: None)
    return record


def test_targets_in_the_room_undo_targets_from_here() -> None:
    rng = np.random.default_rng(0)
    low, high = joint_limits(FULL_SCALE).T
    qpos, targets = rng.uniform(low, high), rng.uniform(low, high, (5, 12))
    targets[:, 11] = targets[:, 10]
    chunk = to_base_targets(qpos[None], targets[None])[0]
    assert np.allclose(to_world_targets(qpos, chunk), targets, atol=1e-5)


def test_what_is_seen_does_not_depend_on_where_the_room_is() -> None:
    rng = np.random.default_rng(1)
    agent, environment = rng.uniform(-1, 1, (1, AGENT)), np.zeros((1, ENVIRONMENT))
    agent[:, 15:19] = [[0.5, 0.5, 0.5, 0.5]]
    rows = environment[:, : THINGS * THING].reshape(1, THINGS, THING)
    rows[0, 0] = [1.0, 0.4, -0.2, 0.6, 0.0, 0.0, 0.0, 1.0, 0.1, 0.2, 0.3, 0.4, -0.2, 0.7]
    environment[:, THINGS * THING :][:, :6] = [[1.0, 0.3, 0.2, 0.5, 0.1, 0.8]]
    sees = Sees(things=2, handles=1)
    before = state_numbers(agent, environment, sees)
    assert before.shape == (1, ROBOT_NUMBERS + 2 * THING_NUMBERS + HANDLE_NUMBERS)
    # The whole room, with the robot in it, is driven 2 m aside.
    agent[:, [0, 12]] += 2.0
    rows[0, 0, [1, 11]] += 2.0
    environment[:, THINGS * THING + 3] += 2.0
    assert np.allclose(state_numbers(agent, environment, sees), before, atol=1e-6)
    assert np.all(before[0, ROBOT_NUMBERS + THING_NUMBERS : ROBOT_NUMBERS + 2 * THING_NUMBERS] == 0.0)
    turned = agent.copy()
    turned[:, 15:19] *= -1.0
    assert np.allclose(own_numbers(turned), own_numbers(agent))


def test_windows_stay_within_their_episode(data: Demonstrations) -> None:
    border = int(data.ends[0])
    assert len(data.names) == 2 and border < len(data)
    assert data.frames(np.array([border]), 3).tolist() == [[border, border, border]]
    assert (data.phases[data.lasts - 1] == data.phases).all() and (data.lasts <= data.ends).all()
    begins = int(np.flatnonzero(np.diff(data.phases))[0]) + 1
    chunk, after = data.chunks(np.array([begins - 2]), 4)
    expected = to_base_targets(data.qpos[[begins - 2]], data.actions[None, [begins - 2, *[begins - 1] * 3]])
    assert np.array_equal(chunk, expected)
    assert after[0].tolist() == data.phases[begins - 1 : begins + 3].tolist() and after[0, 0] != after[0, 1]
    chunk, after = data.chunks(np.array([border - 2]), 4)
    expected = to_base_targets(data.qpos[[border - 2]], data.actions[None, [border - 2, *[border - 1] * 3]])
    assert np.array_equal(chunk, expected)
    assert after.tolist() == [[data.phases[border - 1]] * 4]
    assert data.kinds[0].variation.target and data.kinds[0].variation.noise_m == 0
    assert set(data.steps) >= {17, 1, 2, 3, 7} and 0 not in data.steps


def test_what_was_exported_is_learned_from_as_the_store_is(
    picked: EpisodeStore, data: Demonstrations, tmp_path: Path
) -> None:
    write_set(stream_of(picked), "lerobot", tmp_path / "z")
    found = read_demonstrations([tmp_path / "z"], small())
    assert (found.names, found.key, found.kinds, found.seeds) == (data.names, data.key, data.kinds, data.seeds)
    assert np.array_equal(found.numbers, data.numbers) and np.array_equal(found.phases, data.phases)
    with pytest.raises(NotADataset, match="has no point clouds"):
        read_demonstrations([tmp_path / "z"], read_settings("cloud"))


def test_training_repeats_and_an_interrupted_one_goes_on_to_the_same_weights(data: Demonstrations, out: Path) -> None:
    record = trained(data, out, network={"dropout": 0.2})
    again = trained(data, out.with_name("again"), network={"dropout": 0.2})
    weights = read_tensors(out / WEIGHTS)
    assert record.key == again.key
    assert all(
        torch.equal(value, weights[name]) for name, value in read_tensors(out.parent / "again" / WEIGHTS).items()
    )

    class Stop(Exception):
        pass

    stopped = out.with_name("stopped")
    trainer = Trainer(stopped, record, data)
    one_step = trainer._one_step

    def until_three() -> float:
        if trainer.step == 3:
            raise Stop
        return one_step()

    trainer._one_step = until_three  # type: ignore[method-assign]
    with pytest.raises(Stop):
        trainer.run(lambda step, loss: None)
    assert not (stopped / WEIGHTS).exists()
    rest = Trainer(stopped, record, data)
    assert rest.step == 3
    rest.run(lambda step, loss: None)
    assert all(torch.equal(value, weights[name]) for name, value in read_tensors(stopped / WEIGHTS).items())


def test_a_primitive_of_another_subtask_is_another_step(
    picked: EpisodeStore, data: Demonstrations, monkeypatch: pytest.MonkeyPatch
) -> None:
    def in_two(path: Path, *how: Any) -> SimpleNamespace:
        stream = open_set(path, *how)
        lifting = ((one, one.columns["primitive_index"] == Primitive.LIFT_EEF_UP) for one in stream.episodes())
        episodes = [replace(one, columns={**one.columns, "subtask_index": rows * 1}) for one, rows in lifting]
        return SimpleNamespace(found=stream.found, episodes=lambda: episodes)

    monkeypatch.setattr(demonstrations, "open_set", in_two)
    found = read_demonstrations([picked.path], small())
    assert data.steps == (1, 2, 3, 7, 17) and found.steps == (1, 2, 3, 17, 107)
    assert [primitive_of(step).value for step in found.steps] == [1, 2, 3, 17, 7]
    assert [subtask_of(step) for step in found.steps] == [0, 0, 0, 0, 1]
    assert not found.grasp_modes[found.phases == 4].any()  # Nothing is grasped in the second one.
    least, _ = PolicyRecord.of(small(), 0, found).exit_bounds
    assert least[2, 1] > -1.0 and least[4, 1] < -100.0


def test_another_seed_gives_other_weights(data: Demonstrations) -> None:
    settings = small()
    first, second = (PolicyRecord.of(settings, seed, data) for seed in (0, 1))
    assert first.key != second.key


def test_numbers_are_normalised_primitive_by_primitive(data: Demonstrations) -> None:
    record = PolicyRecord.of(small(), 0, data)
    mean, deviation = (torch.from_numpy(part) for part in record.numbers)
    grasping = data.phases == record.steps.index(3)
    seen = normalise(torch.from_numpy(data.numbers), torch.from_numpy(data.phases), (mean, deviation)).numpy()
    assert np.allclose(seen[grasping].mean(axis=0), 0.0, atol=0.02) and np.abs(seen).max() <= MOST_DEVIATIONS
    assert (record.numbers[1] >= 0.099 * np.maximum(data.numbers.std(axis=0), 1e-3)).all()
    whole = PolicyRecord.of(small(sees={"phase": False}), 0, data)
    assert whole.numbers[0].shape == (1, data.numbers.shape[1])
    assert np.allclose(whole.numbers[0], data.numbers.mean(axis=0), atol=1e-5)


@pytest.mark.parametrize("told", [False, True])
def test_what_is_done_depends_on_the_way_where_it_is_told(told: bool) -> None:
    torch.manual_seed(0)
    network = PolicyNetwork(
        small(sees={"way": told}), NetworkSizes(numbers=5, action=11, phases=3, grasp_modes=4)
    ).eval()
    numbers, phase = torch.randn(1, 1, 5), torch.ones(1, 1, dtype=torch.int64)
    usual, other = (network(numbers, phase, grasp_mode=torch.full((1, 1), grasp_mode))[0] for grasp_mode in (0, 1))
    assert torch.equal(usual, other) is not told


def test_of_several_networks_each_learns_from_its_part_and_the_mean_counts() -> None:
    torch.manual_seed(0)
    network = PolicyNetwork(small(network={"members": 2}), NetworkSizes(numbers=5, action=11, phases=3, grasp_modes=4))
    given = {"numbers": torch.randn(4, 1, 5), "phase": torch.ones(4, 1, dtype=torch.int64)}
    given["grasp_mode"] = torch.zeros_like(given["phase"])
    first, second = (member(**given) for member in network.members)
    learned, *_ = network.train()(**given)
    assert torch.allclose(learned, torch.cat([first[0][:2], second[0][2:]]), atol=1e-5)
    assert not torch.allclose(first[0], second[0], atol=1e-2)
    for told, one, other in zip(network.eval()(**given)[:2], first[:2], second[:2], strict=True):
        assert torch.allclose(told, (one + other) / 2, atol=1e-5)


def test_the_usual_way_is_learned_from_last(data: Demonstrations, out: Path) -> None:
    assert set(data.grasp_modes) == {0, 1}
    record = PolicyRecord.of(small(training={"steps": 10, "usual": 0.3}), 0, data)
    trainer, seen = Trainer(out, record, data), []
    forward = trainer._network.forward
    trainer._network.forward = lambda *told: seen.append(set(told[3].flatten().tolist())) or forward(*told)  # type: ignore
    trainer.run(lambda step, loss: None)
    assert seen == [{0, 1}] * 7 + [{0}] * 3


def test_more_steps_lower_the_loss(data: Demonstrations, out: Path) -> None:
    losses: list[float] = []
    record = PolicyRecord.of(small(training={"steps": 200, "batch": 64, "learning_rate": 5e-3, "warm_up": 10}), 0, data)
    Trainer(out, record, data).run(lambda step, loss: losses.append(loss))
    assert losses[-1] < 0.7 * losses[0]


@pytest.mark.slow
def test_the_papers_configuration_is_the_papers_and_takes_a_step(picked: EpisodeStore, out: Path) -> None:
    paper = read_settings("paper")
    assert (paper.sees.frames, paper.sees.points) == (10, 1024)
    assert (paper.network.layers, paper.network.width, paper.network.heads, paper.network.dropout) == (4, 512, 8, 0.1)
    assert paper.acts.kind == "paper" and paper.training.batch * paper.training.steps == 200 * 102_400
    assert (paper.training.learning_rate, paper.training.decay) == (4e-4, "linear")
    assert (paper.training.shift_m, paper.training.jitter_m) == (0.04, 0.005)
    assert learning_rate(paper.training, 10_000) == pytest.approx(2e-4)
    content = paper.model_dump(mode="json")
    content["training"] |= {"batch": 2, "steps": 1}
    smoke = settings_of(content, "smoke")
    seen = read_demonstrations([picked.path], smoke, 1)
    assert seen.clouds is not None and seen.clouds.shape == (len(seen), 1024, 4)
    record = PolicyRecord.of(smoke, 0, seen)
    assert parameters(record.network()) > 12e6
    Trainer(out, record, seen).run(lambda step, loss: None)
    actor = TrainedPolicy.load(out)
    # It is told no steps, so that those of doors are nothing to it either.
    TrainedPolicy("doors", replace(record, steps=(1, 2, 3, 4, 5, 6, 17, 19)), record.network())
    env = environment_for(actor, record.kinds[0])
    observation, _ = env.reset(seed=62985)
    actor.begin([17, 1, 2, 3, 7], 62985)
    for _ in range(2):
        action = actor.act(observation)
        assert action.shape == (10,) and np.isfinite(action).all()
        observation = env.step(action)[0]
    env.close()


def test_the_future_does_not_reach_the_past(picked: EpisodeStore, data: Demonstrations) -> None:
    kinds = {"sees": {"frames": 4}, "network": {"kind": "transformer", "heads": 4}}
    network = PolicyRecord.of(small(**kinds), 0, data).network().eval()  # type: ignore[arg-type]
    numbers, phase = torch.zeros(1, 4, data.numbers.shape[1]), torch.zeros(1, 4, dtype=torch.int64)
    with torch.inference_mode():
        before = network(numbers, phase, grasp_mode=phase)[0]
        numbers[0, 3] = 5.0
        after = network(numbers, phase, grasp_mode=phase)[0]
    assert torch.equal(before[0, :3], after[0, :3]) and not torch.equal(before[0, 3], after[0, 3])


def test_the_expert_succeeds_through_the_watch_that_judges_policies(picked: EpisodeStore) -> None:
    """Recorded targets, given to the environment as a policy's actions are, count as a success, and not too early."""
    episode = next(picked.demonstrations())
    env = SceneEnvironment(scene=episode.scene, task=episode.task)
    env.reset(seed=0)
    watch = OutcomeWatch(env.episode, env.world)
    targets = episode.arrays["robot_target"]
    for row, target in enumerate([*targets[1:], *[targets[-1]] * 60]):
        watch.look(env.step(target.astype(np.float32))[4])
        if row < len(targets) // 2:
            assert watch.succeeded_s is None
        if watch.over:
            break
    outcome = watch.outcome(0)
    assert outcome.success_once and outcome.success_at_end and outcome.failure == ""
    assert outcome.measured["most"] >= 0.05 and outcome.measured["nearest_m"] < NEAR_M
    env.reset(seed=0)
    idle = OutcomeWatch(env.episode, env.world)
    for _ in range(5):
        idle.look(env.step(env.target.astype(np.float32))[4])
    assert idle.outcome(0).failure == "not-reached"
    env.close()


def test_policies_act_in_the_rooms_that_demonstrations_are_of(picked: EpisodeStore, data: Demonstrations) -> None:
    (kind,) = data.kinds
    env = SceneEnvironment(scene=kind.origin.scene, query=kind.origin.query, variation=kind.variation)
    for episode in picked.demonstrations():
        observation, _ = env.reset(seed=int(episode.meta["unit"]["seed"]))
        assert env.episode.scene.objects == episode.scene.objects
        # Sizes are adjusted to the gripper once: the glass fills most of the 5.6 cm between the fingers.
        assert 0.038 < observation["environment_state"][8] < 0.055
    env.close()


def test_a_policy_acts_the_same_twice_and_phases_follow_the_plan(data: Demonstrations, out: Path) -> None:
    record = trained(data, out)
    kind = record.kinds[0]
    env = SceneEnvironment(scene=kind.origin.scene, query=kind.origin.query, variation=kind.variation)
    actor = TrainedPolicy.load(out)

    def actions(plan: list[int]) -> list[np.ndarray]:
        observation, _ = env.reset(seed=62985)
        actor.begin(plan, 62985)
        found = []
        for _ in range(9):
            found.append(actor.act(observation))
            observation = env.step(found[-1])[0]
        return found

    plan = [17, 1, 2, 3, 7]
    assert all(np.array_equal(a, b) for a, b in zip(actions(plan), actions(plan), strict=True))
    assert not np.array_equal(actions([7])[0], actions(plan)[0])
    with pytest.raises(NotAPolicy, match=r"learned nothing of ARTICULATE_OPEN in subtask 0.*trained on pick-up"):
        actor.begin([17, 1, 2, 3, 4, 5, 6], 62985)
    env.close()


def test_a_policy_whose_numbers_ran_away_is_named(data: Demonstrations, out: Path) -> None:
    kind = trained(data, out).kinds[0]
    actor = TrainedPolicy.load(out)
    for weights in actor._network.parameters():
        weights.data.fill_(float("nan"))
    env = SceneEnvironment(scene=kind.origin.scene, query=kind.origin.query, variation=kind.variation)
    with closing(env), pytest.raises(NotAPolicy, match=rf"{out.name} gives actions that are not finite"):
        run_episode(env, actor, 62985)


def test_an_episode_has_an_end(data: Demonstrations, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record = trained(data, out)
    monkeypatch.setattr("executor.learn.evaluation.MOST_S", 1.0)
    kind = record.kinds[0]
    env = SceneEnvironment(scene=kind.origin.scene, query=kind.origin.query, variation=kind.variation)
    outcome, footage = run_episode(env, TrainedPolicy.load(out), 62985, keep_states=True)
    assert not outcome.success_once and outcome.failure and len(footage.states) == 10
    env.close()


def test_scores_and_pairs() -> None:
    def episodes(*good: int) -> list[EpisodeOutcome]:
        return [EpisodeOutcome(k, bool(g), bool(g), "" if g else "lost", 2.0, {}) for k, g in enumerate(good)]

    found = {"a": episodes(*[1] * 9, 0), "b": episodes(*[1] * 3, *[0] * 7)}
    score = PolicyScore.of(found["a"])
    assert (score.once.successes, score.once.trials, score.failures) == (9, 10, {"lost": 1})
    assert score.once.interval_percent == pytest.approx((55.5, 99.7), abs=0.1)
    (test,) = paired_tests(found)
    assert (test.only_first, test.only_second) == (6, 0) and test.p == pytest.approx(2 / 2**6, abs=1e-4)


@pytest.mark.parametrize(
    "content, words",
    [
        ({"sees": {"kind": "smell"}}, "sees.kind"),
        ({"sees": {"frame": 2}}, "did you mean frames"),
        ({"acts": {"chunk": 4, "execute": 5}}, "acts.execute: expected at most the 4 actions of a chunk, got 5"),
        ({"network": {"kind": "transformer", "width": 30, "heads": 4}}, "network.heads: expected a divisor"),
        ({"training": {"steps": 0}}, "training.steps"),
        ({"sees": {"locates": True}}, "sees.locates: expected false where it sees no cloud"),
        ({"sees": {"kind": "cloud", "way": True, "chooses": True}}, "sees.chooses: expected false where no way"),
        ({"sees": {"kind": "cloud", "room": 8}}, "sees.room: expected 0 where it sees a cloud, got 8"),
        ({"training": {"shift_m": 0.1}}, "training.shift_m: expected 0 where it sees no cloud, or locates by it"),
        ({"sees": {"kind": "cloud", "locates": True}, "training": {"shift_m": 0.1}}, "training.shift_m: expected 0"),
        ({"training": {"jitter_m": 0.1}}, "training.jitter_m: expected 0 where it sees no cloud, got 0.1"),
        ({"training": {"usual": 0.4}}, "training.usual: expected 0 where no way is told, got 0.4"),
        (
            {"network": {"members": 4}, "training": {"batch": 3}},
            "training.batch: expected at least 1 for each of the 4",
        ),
        ({"network": {"members": 4}, "training": {"at_once": 3}}, "training.at_once: expected at least 1 for each"),
    ],
)
def test_settings_that_cannot_be_are_refused(content: dict[str, object], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        settings_of(content, "x.toml")


def test_settings_that_come_along_can_be_read() -> None:
    assert known_settings() == ("cloud", "ensemble", "paper", "rooms", "state")
    for name in known_settings():
        read_settings(name)
    with pytest.raises(SettingsError, match=r"cloud, ensemble, paper, rooms, state, or a file that ends in \.toml"):
        read_settings("stat")


def test_what_is_no_policy_is_refused(data: Demonstrations, out: Path) -> None:
    record = trained(data, out)
    with pytest.raises(NotAPolicy, match="holds no policy"):
        read_record(out / "nothing")
    with pytest.raises(NotAPolicy, match="no weights of step 7"):
        load_network(out, record, 7)
    (out / WEIGHTS).write_bytes(b"\x80\x04c__builtin__\neval\n")
    with pytest.raises(NotAPolicy, match="no file of tensors"):
        load_network(out, record)
    wider = replace(record, settings=small(network={"width": 64}))
    Trainer(out.with_name("other"), record, data).run(lambda step, loss: None)
    with pytest.raises(NotAPolicy, match="another network"):
        load_network(out.with_name("other"), wider)
    told = json.loads((out / ABOUT).read_text())
    broken = (
        *({"schema": "x"}, {"numbers": [[1.0], [0.0]]}, {"kinds": [{"origin": 3}]}, {"kinds": []}),
        *({"rate_hz": 0.0}, {"rate_hz": float("nan")}, {"steps": told["steps"][::-1]}),
        *({"steps": [*told["steps"][:-1], 99]}, {"left": [[row[:-1] for row in bound] for bound in told["left"]]}),
    )
    for otherwise in broken:
        (out / ABOUT).write_text(json.dumps({**told, **otherwise}))
        with pytest.raises(NotAPolicy):
            read_record(out)
