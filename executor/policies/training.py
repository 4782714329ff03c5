"""Trains a policy: the same seed, data, settings and number of threads give the same weights, interrupted or not."""

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

from executor.machine.files import write_text
from executor.policies.networks import PolicyNetwork
from executor.policies.seen.features import ROBOT_NUMBERS
from executor.policies.seen.locator import Locator
from executor.policies.settings import TrainingForm
from executor.policies.trained import (
    LOSSES,
    RESUME,
    WEIGHTS,
    NotAPolicy,
    PolicyRecord,
    normalised,
    read_tensors,
    step_path,
    write_record,
    write_tensors,
)
from executor.policies.windows import Demonstrations

SAVE_EACH_S = 60.0
"""What an interruption costs at most, in seconds; writing takes hundredths of one."""

_PHASE_WEIGHT = 0.1  # Of the phase's loss: enough for it to be learned, too little to take the trunk from the actions.
_CHOICE_WEIGHT = 0.1
_PLACES_WEIGHT = 10.0  # A decimetre counts as much as an action that is one deviation off.
_LARGEST_GRADIENT = 1.0
_LOG_EACH = 100

Told = Callable[[int, float], None]
"""Called with a step and the mean loss of the last hundred."""


class TrainingDiverged(NotAPolicy):
    """A loss, or its gradient, is no number any more: no policy comes of going on."""


class _Batch(NamedTuple):
    """What a step learns from, on the device; the first axis counts samples, T and H are frames and actions of a chunk.

    Attributes:
        numbers, phase, way, cloud: As the network is given them; no cloud where it sees none, or locates by it.
        target: (B, T, H, A) normalised actions.
        after: (B, T, H) what goes on after each of them.
        begins: (B,) 1 where a way is chosen.
    """

    numbers: Tensor
    phase: Tensor
    way: Tensor
    cloud: Tensor | None
    target: Tensor
    after: Tensor
    begins: Tensor

    def of(self, rows: Tensor) -> _Batch:
        """Returns some samples of it."""
        return _Batch(*(None if column is None else column[rows] for column in self))


class Trainer:
    """One training run.

    Args:
        folder: Where the policy goes, and where an interrupted training is gone on with.
        record: What the policy is.
        data: What it learns from.
        device: "cpu" or "cuda".

    Attributes:
        step: How many steps are done.

    Raises:
        NotAPolicy: What is there to go on with cannot be read.
    """

    def __init__(self, folder: Path, record: PolicyRecord, data: Demonstrations, device: str = "cpu") -> None:
        self._folder, self._record, self._data = folder, record, data
        self._form, self._device = record.settings.training, torch.device(device)
        torch.manual_seed(record.seed)
        self._network = record.network().to(self._device)
        form = self._form
        # Fused it takes a fifth less time in all.
        self._optimiser = torch.optim.AdamW(
            self._network.parameters(), form.learning_rate, weight_decay=form.weight_decay, fused=True
        )
        self._average = {name: weight.detach().clone() for name, weight in self._network.state_dict().items()}
        self._seen = (self._there(record.numbers[0]), self._there(record.numbers[1]))
        self._done = (self._there(record.actions[0]), self._there(record.actions[1]))
        self._phases = data.phases if record.settings.sees.phase else np.zeros_like(data.phases)
        self._usual = np.flatnonzero(data.ways == 0)
        self._parts = [rows.to(self._device) for rows in parts(form, len(self._network.members))]
        self._losses: list[tuple[int, float]] = []
        self._whole = True  # Whether weights, their averages and what is said of them are of one and the same step.
        self.step = 0
        if (folder / RESUME).exists():
            self._go_on(read_tensors(folder / RESUME))

    def run(self, told: Told) -> None:
        """Trains until all steps are done; what is done is written at the end, every minute, and when interrupted.

        What is interrupted in the middle of changing the weights goes on from what was written before.

        Raises:
            TrainingDiverged: A loss is no number; what came of the steps before is written.
            OSError: The folder cannot be written.
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
                    told(*self._losses[-1])
                if time.monotonic() - saved > SAVE_EACH_S:
                    self._save()
                    saved = time.monotonic()
        finally:
            if self._whole:
                self._save()
        write_tensors(self._folder / WEIGHTS, self.weights())

    def weights(self) -> dict[str, Tensor]:
        """Returns the weights that are evaluated: the averaged ones, where that was asked for."""
        return dict(self._average) if self._form.average else dict(self._network.state_dict())

    def _one_step(self) -> float:
        """Does a step and returns its loss.

        Raises:
            TrainingDiverged: That is no number, or its gradient is none; the weights are as they were.
        """
        form = self._form
        for group in self._optimiser.param_groups:
            group["lr"] = learning_rate(form, self.step)
        # What is drawn follows from seed and step, so that nothing of it has to be kept for going on.
        rng = np.random.default_rng((self._record.seed, self.step))
        if self._record.settings.network.dropout:
            torch.manual_seed(int(rng.integers(2**31)))
        batch, astray = self._drawn(rng)
        self._optimiser.zero_grad(set_to_none=True)
        loss = 0.0
        for number, rows in enumerate(self._parts):
            part = self._loss(batch.of(rows), len(rows) / form.batch, torch.zeros_like(astray) if number else astray)
            part.backward()
            loss += float(part.detach())
        steep = float(nn.utils.clip_grad_norm_(self._network.parameters(), _LARGEST_GRADIENT))
        if not math.isfinite(loss) or not math.isfinite(steep):
            what, found = ("gradient", steep) if math.isfinite(loss) else ("loss", loss)
            raise TrainingDiverged(
                f"the {what} of step {self.step + 1} is {found}, and has to be finite: no policy comes of these "
                f"settings in {self._folder}. Try a learning_rate below {form.learning_rate:g} or a longer warm_up "
                f"than {form.warm_up}, and --force, which begins anew"
            )
        self._whole = False
        self._optimiser.step()
        self.step += 1
        if form.average:
            # Averages of few steps would remember where the weights began.
            keeps = min(form.average, self.step / (self.step + 10.0))
            with torch.no_grad():
                weights = list(self._network.state_dict().values())
                torch._foreach_lerp_(list(self._average.values()), weights, 1.0 - keeps)
        return loss

    def _drawn(self, rng: np.random.Generator) -> tuple[_Batch, Tensor]:
        """Returns the batch of a step, and the loss of what is told from clouds, 0 where nothing is."""
        data, settings, form = self._data, self._record.settings, self._form
        moments = rng.integers(len(data), size=form.batch)
        if settings.sees.way and self.step >= (1.0 - form.usual) * form.steps:
            moments = self._usual[rng.integers(len(self._usual), size=form.batch)]
        frames = data.frames(moments, settings.sees.frames)
        outputs = frames if settings.network.kind == "transformer" else frames[:, -1:]
        wanted, after = data.chunks(outputs.ravel(), settings.acts.chunk)
        phase = self._there(self._phases[frames])
        numbers = normalised(self._there(data.numbers[frames]), phase, self._seen)
        if form.noise:
            numbers = numbers + form.noise * self._there(rng.standard_normal(numbers.shape, np.float32))
        cloud, astray = None, torch.zeros((), device=self._device)
        if (locator := self._network.locator) is not None:
            astray = self._astray(locator, moments, rng)
        elif data.clouds is not None:
            cloud = self._there(data.clouds[frames].astype(np.float32))
            shift = rng.uniform(-form.shift_m, form.shift_m, (len(moments), 1, 1, 3))
            jitter = form.jitter_m * rng.standard_normal((*cloud.shape[:-1], 3), np.float32)
            cloud[..., :3] += self._there(shift.astype(np.float32)) + self._there(jitter)
        begun = self._there(self._phases[outputs.ravel()])
        target = (self._there(wanted) - self._done[0][begun]) / self._done[1][begun]
        batch = _Batch(
            numbers=numbers,
            phase=phase,
            way=self._there(data.ways[frames]),
            cloud=cloud,
            target=target.unflatten(0, outputs.shape),
            after=self._there(after).unflatten(0, outputs.shape),
            begins=self._there(data.begins[moments]),
        )
        return batch, astray

    def _loss(self, batch: _Batch, share: float, astray: Tensor) -> Tensor:
        """Returns the loss of a part of a batch, by its share in the means over all of it, and another beside."""
        phase = batch.phase if self._record.settings.sees.phase else None
        actions, logits, ways = self._network(batch.numbers, phase, batch.cloud, batch.way)
        loss = share * nn.functional.l1_loss(actions, batch.target) + astray
        if logits is not None:
            wrong = nn.functional.cross_entropy(logits.flatten(0, -2), batch.after.flatten())
            loss = loss + share * _PHASE_WEIGHT * wrong
        if ways is not None:
            wrong = nn.functional.cross_entropy(ways, batch.way[:, -1], reduction="none")
            loss = loss + share * _CHOICE_WEIGHT * (wrong * batch.begins).mean()
        return loss

    def _astray(self, locator: Locator, moments: np.ndarray, rng: np.random.Generator) -> Tensor:
        """Returns the loss of what is told from clouds: how far it is off, before and after it is corrected."""
        assert self._data.clouds is not None
        moments = moments[: self._form.clouds]
        cloud = self._data.clouds[moments].astype(np.float32)
        cloud[..., :3] += self._form.jitter_m * rng.standard_normal((*cloud.shape[:-1], 3), np.float32)
        numbers = self._there(self._data.numbers[moments])
        told = locator(self._there(cloud), numbers[:, :ROBOT_NUMBERS])
        wanted = numbers[:, ROBOT_NUMBERS:]
        return _PLACES_WEIGHT * sum((nn.functional.l1_loss(part, wanted) for part in told), torch.zeros(()))

    def _there(self, array: np.ndarray) -> Tensor:
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
    """Returns the learning rate of a step, counted from 0."""
    left = 1.0 - step / form.steps
    share = left if form.decay == "linear" else 0.5 * (1.0 - math.cos(math.pi * left))
    return float(form.learning_rate) * share * min(1.0, (step + 1) / max(form.warm_up, 1))


def parts(form: TrainingForm, members: int) -> list[Tensor]:
    """Returns which samples of a batch go through the network at once.

    Of each member's share of the batch (`PolicyNetwork.forward`) there are as many in each, the last one left out, so
    that every sample is the same member's as with all at once.
    """
    if form.at_once is None or form.at_once >= form.batch:
        return [torch.arange(form.batch)]
    shares, each = torch.arange(form.batch).tensor_split(members), form.at_once // members
    return [torch.cat([share[first : first + each] for share in shares]) for first in range(0, len(shares[0]), each)]


def parameters(network: PolicyNetwork) -> int:
    """Returns how many numbers a network learns."""
    return sum(weight.numel() for weight in network.parameters())
