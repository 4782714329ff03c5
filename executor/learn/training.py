"""Train a policy: equal seed, data, settings and threads give equal weights, interrupted or not."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from executor.learn.demonstrations import Demonstrations
from executor.learn.networks import Locator, PolicyNetwork
from executor.learn.observations import robot_number_count
from executor.learn.policy_record import (
    LOSSES,
    RESUME,
    WEIGHTS,
    NotAPolicy,
    PolicyRecord,
    normalise,
    read_tensors,
    step_path,
    write_record,
    write_tensors,
)
from executor.learn.settings import TrainingForm
from executor.system.files import write_text

SAVE_EACH_S = 60.0
"""Interval of saved states, the maximum loss by an interruption [s]; writing takes hundredths of a second."""

_PHASE_WEIGHT = 0.1  # Weight of the phase's loss: enough to learn it, too little to take the trunk from the actions.
_CHOICE_WEIGHT = 0.1
_PLACES_WEIGHT = 10.0  # A decimetre counts as much as one deviation of an action.
_LARGEST_GRADIENT = 1.0
_LOG_EACH = 100

LossCallback = Callable[[int, float], None]
"""Called with a step and the mean loss of the last hundred."""


class TrainingDiverged(NotAPolicy):
    """A loss, or its gradient, is not finite any more."""


class _Batch(NamedTuple):
    """Data of a training step, on the device; the first axis counts samples, T and H frames and actions of a chunk.

    Attributes:
        numbers, phase, grasp_mode, cloud: Inputs of the network; no cloud where it observes none, or locates in it.
        target: (B, T, H, A) normalised actions.
        after: (B, T, H) the running step after each action.
        begins: (B,) 1 where a grasp mode is chosen.
    """

    numbers: Tensor
    phase: Tensor
    grasp_mode: Tensor
    cloud: Tensor | None
    target: Tensor
    after: Tensor
    begins: Tensor

    def of(self, rows: Tensor) -> _Batch:
        """Return some of its samples."""
        return _Batch(*(None if column is None else column[rows] for column in self))


class Trainer:
    """One training run.

    Args:
        folder: Folder of the policy; an interrupted training continues there.
        device: "cpu" or "cuda".

    Attributes:
        step: Number of finished steps.

    Raises:
        NotAPolicy: The state of an interrupted training is unreadable.
    """

    def __init__(self, folder: Path, record: PolicyRecord, data: Demonstrations, device: str = "cpu") -> None:
        self._folder, self._record, self._data = folder, record, data
        self._form, self._device = record.settings.training, torch.device(device)
        torch.manual_seed(record.seed)
        self._network = record.network().to(self._device)
        form = self._form
        # Fused, training takes a fifth less time.
        self._optimiser = torch.optim.AdamW(
            self._network.parameters(), form.learning_rate, weight_decay=form.weight_decay, fused=True
        )
        self._average = {name: weight.detach().clone() for name, weight in self._network.state_dict().items()}
        self._input_scales = (self._to_device(record.numbers[0]), self._to_device(record.numbers[1]))
        self._action_scales = (self._to_device(record.actions[0]), self._to_device(record.actions[1]))
        self._phases = data.phases if record.settings.sees.phase else np.zeros_like(data.phases)
        self._usual = np.flatnonzero(data.grasp_modes == 0)
        self._parts = [rows.to(self._device) for rows in parts(form, len(self._network.members))]
        self._losses: list[tuple[int, float]] = []
        self._whole = True  # Whether weights, averages and losses are of the same step.
        self.step = 0
        if (folder / RESUME).exists():
            self._go_on(read_tensors(folder / RESUME))

    def run(self, on_progress: LossCallback) -> None:
        """Train until all steps are done; state is written at the end, every minute, and on interruption.

        An interruption in the middle of a weight update continues from the state written before.

        Raises:
            TrainingDiverged: A loss is not finite; the state of the steps before is written.
        """
        write_record(self._folder, self._record)
        self._network.train()
        saved, recent = time.monotonic(), []
        try:
            while self.step < self._form.steps:
                recent.append(self._one_step())
                if logs := self.step % _LOG_EACH == 0 or self.step == self._form.steps:
                    self._losses.append((self.step, float(np.mean(recent))))
                    recent = []
                if self._form.keep_every and self.step % self._form.keep_every == 0:
                    write_tensors(step_path(self._folder, self.step), self.weights())
                self._whole = True
                if logs:
                    on_progress(*self._losses[-1])
                if time.monotonic() - saved > SAVE_EACH_S:
                    self._save()
                    saved = time.monotonic()
        finally:
            if self._whole:
                self._save()
        write_tensors(self._folder / WEIGHTS, self.weights())

    def weights(self) -> dict[str, Tensor]:
        """Return the evaluated weights: the averaged ones, where that was requested."""
        return dict(self._average) if self._form.average else dict(self._network.state_dict())

    def _one_step(self) -> float:
        """Do a step and return its loss.

        Raises:
            TrainingDiverged: The loss or its gradient is not finite; the weights are unchanged.
        """
        form = self._form
        for group in self._optimiser.param_groups:
            group["lr"] = learning_rate(form, self.step)
        # Draws follow from seed and step, so that resuming needs no generator state.
        rng = np.random.default_rng((self._record.seed, self.step))
        if self._record.settings.network.dropout:
            torch.manual_seed(int(rng.integers(2**31)))
        batch, locator_loss = self._draw_batch(rng)
        self._optimiser.zero_grad(set_to_none=True)
        loss = 0.0
        for number, rows in enumerate(self._parts):
            part = self._loss(
                batch.of(rows), len(rows) / form.batch, torch.zeros_like(locator_loss) if number else locator_loss
            )
            part.backward()
            loss += float(part.detach())
        steep = float(nn.utils.clip_grad_norm_(self._network.parameters(), _LARGEST_GRADIENT))
        if not math.isfinite(loss) or not math.isfinite(steep):
            what, found = ("gradient", steep) if math.isfinite(loss) else ("loss", loss)
            raise TrainingDiverged(
                f"the {what} of step {self.step + 1} is {found}, and has to be finite: no policy comes of these "
                f"settings in {self._folder}. Try a learning_rate below {form.learning_rate:g} or a longer warm_up "
                f"than {form.warm_up}, and --force, which begins again"
            )
        self._whole = False
        self._optimiser.step()
        self.step += 1
        if form.average:
            # Averages of few steps would keep the initial weights.
            keeps = min(form.average, self.step / (self.step + 10.0))
            with torch.no_grad():
                weights = list(self._network.state_dict().values())
                torch._foreach_lerp_(list(self._average.values()), weights, 1.0 - keeps)
        return loss

    def _draw_batch(self, rng: np.random.Generator) -> tuple[_Batch, Tensor]:
        """Draw the batch of a step, and return the locator's loss with it; 0 without a locator."""
        data, settings, form = self._data, self._record.settings, self._form
        moments = rng.integers(len(data), size=form.batch)
        if settings.sees.way and self.step >= (1.0 - form.usual) * form.steps:
            moments = self._usual[rng.integers(len(self._usual), size=form.batch)]
        frames = data.frames(moments, settings.sees.frames)
        outputs = frames if settings.network.kind == "transformer" else frames[:, -1:]
        wanted, after = data.chunks(outputs.ravel(), settings.acts.chunk)
        phase = self._to_device(self._phases[frames])
        numbers = normalise(self._to_device(data.numbers[frames]), phase, self._input_scales)
        if form.noise:
            numbers = numbers + form.noise * self._to_device(rng.standard_normal(numbers.shape, np.float32))
        cloud, locator_loss = None, torch.zeros((), device=self._device)
        if (locator := self._network.locator) is not None:
            locator_loss = self._locator_loss(locator, moments, rng)
        elif data.clouds is not None:
            cloud = self._to_device(data.clouds[frames].astype(np.float32))
            shift = rng.uniform(-form.shift_m, form.shift_m, (len(moments), 1, 1, 3))
            jitter = form.jitter_m * rng.standard_normal((*cloud.shape[:-1], 3), np.float32)
            cloud[..., :3] += self._to_device(shift.astype(np.float32)) + self._to_device(jitter)
        begun = self._to_device(self._phases[outputs.ravel()])
        target = (self._to_device(wanted) - self._action_scales[0][begun]) / self._action_scales[1][begun]
        batch = _Batch(
            numbers=numbers,
            phase=phase,
            grasp_mode=self._to_device(data.grasp_modes[frames]),
            cloud=cloud,
            target=target.unflatten(0, outputs.shape),
            after=self._to_device(after).unflatten(0, outputs.shape),
            begins=self._to_device(data.begins[moments]),
        )
        return batch, locator_loss

    def _loss(self, batch: _Batch, share: float, locator_loss: Tensor) -> Tensor:
        """Return the loss of a part of a batch, weighted by its share, plus the locator's loss."""
        phase = batch.phase if self._record.settings.sees.phase else None
        actions, logits, grasp_modes = self._network(batch.numbers, phase, batch.cloud, batch.grasp_mode)
        loss = share * nn.functional.l1_loss(actions, batch.target) + locator_loss
        if logits is not None:
            wrong = nn.functional.cross_entropy(logits.flatten(0, -2), batch.after.flatten())
            loss = loss + share * _PHASE_WEIGHT * wrong
        if grasp_modes is not None:
            wrong = nn.functional.cross_entropy(grasp_modes, batch.grasp_mode[:, -1], reduction="none")
            loss = loss + share * _CHOICE_WEIGHT * (wrong * batch.begins).mean()
        return loss

    def _locator_loss(self, locator: Locator, moments: np.ndarray, rng: np.random.Generator) -> Tensor:
        """Return the locator's loss, before and after its correction."""
        assert self._data.clouds is not None
        moments = moments[: self._form.clouds]
        cloud = self._data.clouds[moments].astype(np.float32)
        cloud[..., :3] += self._form.jitter_m * rng.standard_normal((*cloud.shape[:-1], 3), np.float32)
        numbers = self._to_device(self._data.numbers[moments])
        own = robot_number_count(self._data.robot)
        located = locator(self._to_device(cloud), numbers[:, :own])
        wanted = numbers[:, own:]
        return _PLACES_WEIGHT * sum((nn.functional.l1_loss(part, wanted) for part in located), torch.zeros(()))

    def _to_device(self, array: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self._device)

    def _save(self) -> None:
        weights = self._network.state_dict()
        found: dict[str, Tensor] = {
            "step": torch.tensor(self.step),
            "losses": torch.tensor(self._losses).reshape(-1, 2),
        }
        found |= {f"weights.{name}": weight for name, weight in weights.items()}
        found |= {f"average.{name}": weight for name, weight in self._average.items()}
        for index, state in self._optimiser.state_dict()["state"].items():
            found |= {f"adamw.{index}.{name}": torch.as_tensor(value) for name, value in state.items()}
        write_tensors(self._folder / RESUME, found)
        lines = (json.dumps({"step": step, "loss": round(loss, 6)}) for step, loss in self._losses)
        write_text(self._folder / LOSSES, "".join(f"{line}\n" for line in lines))

    def _go_on(self, found: Mapping[str, Tensor]) -> None:
        def part(name: str) -> dict[str, Tensor]:
            return {key.removeprefix(f"{name}."): value for key, value in found.items() if key.startswith(f"{name}.")}

        try:
            self._network.load_state_dict(part("weights"))
            self._average = {name: part("average")[name].to(self._device) for name in self._average}
            states: dict[int, dict[str, Tensor]] = {}
            for key, value in part("adamw").items():
                index, name = key.split(".")
                states.setdefault(int(index), {})[name] = value
            self._optimiser.load_state_dict({**self._optimiser.state_dict(), "state": states})
            self._losses = [(int(step), float(loss)) for step, loss in found["losses"].tolist()]
            self.step = int(found["step"])
        except (KeyError, ValueError, RuntimeError) as problem:
            raise NotAPolicy(f"{self._folder / RESUME} does not go on with this policy: {problem}") from None


def learning_rate(form: TrainingForm, step: int) -> float:
    """Return the learning rate of a step, counted from 0."""
    left = 1.0 - step / form.steps
    share = left if form.decay == "linear" else 0.5 * (1.0 - math.cos(math.pi * left))
    return float(form.learning_rate) * share * min(1.0, (step + 1) / max(form.warm_up, 1))


def parts(form: TrainingForm, members: int) -> list[Tensor]:
    """Split the samples of a batch into parts for one network pass each.

    Each part has equally many samples of each member's share of the batch (`PolicyNetwork.forward`), except for the
    last. Every sample so has the same member as with the whole batch at once.
    """
    if form.at_once is None or form.at_once >= form.batch:
        return [torch.arange(form.batch)]
    shares, each = torch.arange(form.batch).tensor_split(members), form.at_once // members
    return [torch.cat([share[first : first + each] for share in shares]) for first in range(0, len(shares[0]), each)]


def parameters(network: PolicyNetwork) -> int:
    """Return the number of learned parameters of a network."""
    return sum(weight.numel() for weight in network.parameters())
