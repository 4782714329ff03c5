"""The networks that act: over the frames a causal transformer or a plain perceptron.

Source of the transformer with a PointNet: the paper's policy (its widths are settings); LayerNorm throughout, since a
policy acts on one observation at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from executor.policies.seen.features import Numbers
from executor.policies.seen.locator import Locator, PointNet
from executor.policies.settings import NetworkForm, PolicySettings

_POINT = 4
_CHOICE_WIDTH = 64  # Of what chooses among a few ways: each demonstration shows one choice.


class Foretold(NamedTuple):
    """What a network foretells from B times T frames.

    T is the number of frames for a transformer, which foretells from each, and 1 for a perceptron.

    Attributes:
        actions: (B, T, H, A) chunks of normalised actions.
        phases: (B, T, H, phases) how likely each is to go on after each of them, as logits; None where none are told.
        ways: (B, ways) how likely each way of grasping is, as logits; None where it does not choose.
    """

    actions: Tensor
    phases: Tensor | None
    ways: Tensor | None


@dataclass(frozen=True, slots=True)
class NetworkSizes:
    """What follows from the data.

    Attributes:
        numbers: Of what is seen, points left out.
        action: Numbers of an action.
        phases: Primitives that occur.
        ways: Ways of grasping that are told apart.
    """

    numbers: int
    action: int
    phases: int
    ways: int


class PolicyNetwork(nn.Module):
    """Frames -> chunks of normalised actions, by one network or the mean of several.

    Where a few demonstrations leave open what is done, networks that began otherwise and met other batches differ, and
    their mean is nearer to what is right than most of them.

    Args:
        settings: What it sees, does and consists of.
        sizes: What follows from the data.
    """

    def __init__(self, settings: PolicySettings, sizes: NetworkSizes) -> None:
        super().__init__()
        self.members = nn.ModuleList(_Member(settings, sizes) for _ in range(settings.network.members))
        sees, widths = settings.sees, settings.network.point_widths
        self.locator = Locator(sees.things, sees.handles, widths) if sees.locates else None

    def forward(
        self, numbers: Tensor, phase: Tensor | None = None, cloud: Tensor | None = None, way: Tensor | None = None
    ) -> Foretold:
        """Returns what is foretold.

        In training each member sees its own part of a batch; else all see all of it, and their mean counts.

        Args:
            numbers: (B, T, F) normalised.
            phase: (B, T) which primitive goes on, where it is told.
            cloud: (B, T, P, 4), where it is seen.
            way: (B, T) which way it grasps, where it is told.
        """
        given = (numbers, phase, cloud, way)
        if not self.training:
            parts = zip(*(member(*given) for member in self.members), strict=True)
            return Foretold(*(None if part[0] is None else torch.stack(part).mean(dim=0) for part in parts))
        count = len(self.members)
        shares = [[None] * count if part is None else part.tensor_split(count) for part in given]
        found = [member(*share) for member, share in zip(self.members, zip(*shares, strict=True), strict=True)]
        return Foretold(*(None if part[0] is None else torch.cat(part) for part in zip(*found, strict=True)))

    def located(self, robot: Numbers, cloud: NDArray) -> Numbers:
        """Returns (N, F) the robot's numbers, and behind them where the locator says things and handles are.

        Args:
            robot: (N, ROBOT_NUMBERS) the robot.
            cloud: (N, P, 4) clouds.
        """
        if self.locator is None:
            raise ValueError("this policy has no locator")
        with torch.inference_mode():
            _, places = self.locator(torch.from_numpy(cloud), torch.from_numpy(robot))
        return np.concatenate([robot, places.numpy()], axis=1)


class _Member(nn.Module):
    def __init__(self, settings: PolicySettings, sizes: NetworkSizes) -> None:
        super().__init__()
        sees, acts, form = settings.sees, settings.acts, settings.network
        self._chunk, self._sizes = acts.chunk, sizes
        self._told = sizes.phases if sees.phase else 0
        self._ways = sizes.ways if sees.way else 0
        self.cloud = None if sees.places else PointNet(_POINT, form.point_widths)
        each = sizes.numbers + self._told + self._ways + (form.point_widths[-1] if self.cloud is not None else 0)
        self.trunk: nn.Module = (
            _CausalTransformer(form, each, sees.frames)
            if form.kind == "transformer"
            else _Perceptron(form, each * sees.frames)
        )
        straight = sizes.numbers * max(self._told, 1)
        self.straight = nn.Linear(straight, acts.chunk * sizes.action) if form.linear else None
        last = nn.Linear(form.width, acts.chunk * sizes.action)
        first = (nn.Linear(form.width, form.width), nn.GELU()) if form.kind == "transformer" else ()
        self.action = nn.Sequential(*first, last)
        self.next_phase = nn.Linear(form.width, acts.chunk * sizes.phases) if self._told else None
        self.choice = (
            nn.Sequential(
                nn.Linear(sizes.numbers * max(self._told, 1), _CHOICE_WIDTH),
                nn.GELU(),
                nn.Linear(_CHOICE_WIDTH, sizes.ways),
            )
            if sees.chooses
            else None
        )

    def forward(
        self, numbers: Tensor, phase: Tensor | None = None, cloud: Tensor | None = None, way: Tensor | None = None
    ) -> Foretold:
        parts = [numbers]
        if self.cloud is not None and cloud is not None:
            parts.append(self.cloud(cloud))
        if self._told and phase is not None:
            parts.append(nn.functional.one_hot(phase, self._told).to(numbers.dtype))
        if self._ways and way is not None:
            parts.append(nn.functional.one_hot(way, self._ways).to(numbers.dtype))
        found = self.trunk(torch.cat(parts, dim=-1))
        shape = (*found.shape[:2], self._chunk)
        logits = None if self.next_phase is None else self.next_phase(found).reshape(*shape, self._sizes.phases)
        ways = None if self.choice is None else self.choice(self._by_phase(numbers, phase)[:, -1])
        actions = self.action(found)
        if self.straight is not None:
            actions = actions + self.straight(self._by_phase(numbers, phase))[:, -found.shape[1] :]
        return Foretold(actions.reshape(*shape, self._sizes.action), logits, ways)

    def _by_phase(self, numbers: Tensor, phase: Tensor | None) -> Tensor:
        """Returns (B, T, F * phases) the numbers where those of their phase are, and else 0."""
        if not self._told or phase is None:
            return numbers
        told = nn.functional.one_hot(phase, self._told).to(numbers.dtype)
        return (told[..., None] * numbers[..., None, :]).flatten(-2)


class _Perceptron(nn.Module):
    def __init__(self, form: NetworkForm, given: int) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for before in (given, *[form.width] * (form.layers - 1)):
            layers += [nn.Linear(before, form.width), nn.LayerNorm(form.width), nn.GELU(), nn.Dropout(form.dropout)]
        self.layers = nn.Sequential(*layers)

    def forward(self, frames: Tensor) -> Tensor:
        return self.layers(frames.flatten(1))[:, None]


class _CausalTransformer(nn.Module):
    def __init__(self, form: NetworkForm, given: int, frames: int) -> None:
        super().__init__()
        self.token = nn.Linear(given, form.width)
        self.place = nn.Parameter(0.02 * torch.randn(1, frames, form.width))
        layer = nn.TransformerEncoderLayer(
            form.width, form.heads, 4 * form.width, form.dropout, nn.functional.gelu, batch_first=True, norm_first=True
        )
        self.layers = nn.TransformerEncoder(layer, form.layers, nn.LayerNorm(form.width), enable_nested_tensor=False)
        self.register_buffer("ahead", torch.triu(torch.ones(frames, frames, dtype=torch.bool), 1), persistent=False)

    def forward(self, frames: Tensor) -> Tensor:
        return self.layers(self.token(frames) + self.place, mask=self.ahead)
