"""A step is whole or is none: in parts of a batch as at once, after Ctrl-C as without, and of finite numbers only."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from executor.cli.app import run
from executor.data.store import EpisodeStore
from executor.learn import training
from executor.learn.demonstrations import Demonstrations, read_demonstrations
from executor.learn.policy_record import LOSSES, RESUME, WEIGHTS, PolicyRecord, read_tensors
from executor.learn.settings import read_settings
from executor.learn.training import Trainer, TrainingDiverged, parts
from tests.executor.learn.conftest import small
from tests.executor.learn.test_commands import last_json

pytestmark = pytest.mark.physics


@pytest.fixture(scope="module")
def data(picked: EpisodeStore) -> Demonstrations:
    """Return the demonstrations as a policy of the state sees them."""
    return read_demonstrations([picked.path], small())


@pytest.mark.parametrize("form", [{"members": 3}, {"kind": "transformer", "heads": 4}])
@pytest.mark.parametrize(
    "at_once",
    [
        3,
        pytest.param(4, marks=pytest.mark.slow),
        pytest.param(7, marks=pytest.mark.slow),
        pytest.param(13, marks=pytest.mark.slow),
    ],
)
def test_a_step_in_parts_is_the_step_of_the_whole_batch(
    data: Demonstrations, out: Path, form: dict[str, object], at_once: int
) -> None:
    sees = {"frames": 3, "chooses": True}
    gradients: list[list[torch.Tensor]] = []
    losses: list[float] = []
    for name, once in (("whole", None), ("parts", at_once)):
        settings = small(sees=sees, network=form, training={"steps": 1, "batch": 16, "at_once": once})
        trainer = Trainer(out / name, PolicyRecord.of(settings, 3, data), data)
        assert len(trainer._parts) == 1 if once is None else len(trainer._parts) > 1
        trainer.run(lambda step, loss: losses.append(loss))
        found = [weight.grad for weight in trainer._network.parameters() if weight.grad is not None]
        gradients.append(found)
    whole, in_parts = gradients
    assert losses[1] == pytest.approx(losses[0], abs=1e-5) and len(whole) == len(in_parts) > 10
    assert all(torch.allclose(one, other, atol=1e-6) for one, other in zip(whole, in_parts, strict=True))
    assert max(float(one.abs().max()) for one in whole) > 1e-2


def test_a_locator_learns_from_its_clouds_once_a_step(picked: EpisodeStore, out: Path) -> None:
    losses: list[float] = []
    for name, once in (("whole", None), ("parts", 8)):
        sees = {"kind": "cloud", "points": 64, "locates": True}
        training = {"steps": 1, "batch": 16, "at_once": once, "clouds": 12}
        settings = small(sees=sees, network={"point_widths": [8]}, training=training)
        seen = read_demonstrations([picked.path], settings, 1)
        trainer = Trainer(out / name, PolicyRecord.of(settings, 3, seen), seen)
        trainer.run(lambda step, loss: losses.append(loss))
    assert losses[1] == pytest.approx(losses[0], rel=1e-6)


def test_parts_are_no_larger_than_was_asked_for_and_each_members_own() -> None:
    form = read_settings("paper").training
    assert [len(rows) for rows in parts(form, 1)] == [128] * 8
    assert [rows.tolist() for rows in parts(small(training={"batch": 4}).training, 2)] == [[0, 1, 2, 3]]
    in_two = parts(small(training={"batch": 7, "at_once": 5}).training, 2)
    assert [rows.tolist() for rows in in_two] == [[0, 1, 4, 5], [2, 3, 6]]


@pytest.mark.parametrize(
    "where",
    [pytest.param("optimiser", marks=pytest.mark.slow), pytest.param("average", marks=pytest.mark.slow), "keeping"],
)
def test_ctrl_c_in_the_middle_of_a_step_leaves_no_half_of_it(
    data: Demonstrations, out: Path, where: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The weights are those of an uninterrupted training, and so is what is kept on the way."""
    record = PolicyRecord.of(small(training={"keep_every": 2}), 3, data)
    Trainer(out / "whole", record, data).run(lambda step, loss: None)
    trainer = Trainer(out / "cut", record, data)
    monkeypatch.setattr("executor.learn.training.SAVE_EACH_S", -1.0)  # After each step.
    owner, name, at = {
        "optimiser": (trainer._optimiser, "step", 3),
        "average": (torch, "_foreach_lerp_", 4),
        "keeping": (training, "step_path", 4),
    }[where]
    does = getattr(owner, name)

    def does_it_and_stops(*given: object) -> object:
        found = does(*given)
        if trainer.step == at:
            raise KeyboardInterrupt
        return found

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, does_it_and_stops)
        with pytest.raises(KeyboardInterrupt):
            trainer.run(lambda step, loss: None)
    rest = Trainer(out / "cut", record, data)
    assert rest.step == 3
    rest.run(lambda step, loss: None)
    kept = ["steps/000004.safetensors", "steps/000006.safetensors"]
    for name in (WEIGHTS, *kept):
        whole, cut = read_tensors(out / "whole" / name), read_tensors(out / "cut" / name)
        assert all(torch.equal(weight, cut[part]) for part, weight in whole.items())


def test_a_training_that_diverges_ends_there(
    picked: EpisodeStore, data: Demonstrations, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    record = PolicyRecord.of(small(training={"steps": 50, "learning_rate": 1e6, "warm_up": 0}), 3, data)
    with pytest.raises(TrainingDiverged, match=r"of step \d+ is (nan|inf), and has to be finite.*learning_rate below"):
        Trainer(out, record, data).run(lambda step, loss: None)
    assert not (out / WEIGHTS).exists() and "NaN" not in (out / LOSSES).read_text()
    assert all(torch.isfinite(part).all() for part in read_tensors(out / RESUME).values())
    settings = out.with_name("hot.toml")
    settings.write_text("[network]\nwidth = 16\n[training]\nsteps = 50\nlearning_rate = 1e6\nwarm_up = 0\n")
    hot = out.with_name("hot")
    assert run(["train", str(settings), "--data", str(picked.path), "--out", str(hot), "--json"]) == 2
    assert "has to be finite" in str(last_json(capsys)["error"])
