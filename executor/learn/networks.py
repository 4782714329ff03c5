"""Policy networks: a causal transformer or a perceptron over frames, a PointNet, and a locator of things in clouds.

The locator tells things and handles from a point cloud. A first PointNet gets the whole cloud, from base and hand, and
locates everything to some centimetres. A second one gets the surroundings of each located place, magnified, and
corrects it. Both learn from the simulator's state in demonstrations; at work they need the cloud and the robot's joints
alone.

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

from executor.learn.observations import HANDLE_NUMBERS, THING_NUMBERS, Numbers
from executor.learn.settings import NetworkForm, PolicySettings

_FROM_BASE, _FROM_HAND = 3, 3
_MAGNIFIED, _MOST_MAGNIFIED = 10.0, 3.0
"""Magnification around a place, and clipping at 30 cm."""

_CORRECTION = 0.1  # Scale of the second network's output: it starts small.
_HAND_M, _HAND_AXES = slice(-9, -6), slice(-6, None)  # Indices in the robot's numbers.


class PointNet(nn.Module):
    """Points (..., P, N) -> numbers (..., W): each point by itself, then the maximum of each number."""

    def __init__(self, each: int, widths: tuple[int, ...]) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for before, after in zip((each, *widths), widths, strict=False):
            layers += [nn.Linear(before, after), nn.LayerNorm(after), nn.GELU()]
        self.points = nn.Sequential(*layers)

    def forward(self, cloud: Tensor) -> Tensor:
        """Return the features of whole clouds."""
        return self.points(cloud).amax(dim=-2)


class Locator(nn.Module):
    """Clouds -> the things and handles of `observations.state_numbers`.

    Args:
        robot: Length of the robot's numbers.
    """

    def __init__(self, robot: int, things: int, handles: int, widths: tuple[int, ...], width: int = 256) -> None:
        super().__init__()
        bars = things * THING_NUMBERS
        self._from_hand = [THING_NUMBERS * (row + 1) - 3 for row in range(things)]
        self._from_hand += [bars + HANDLE_NUMBERS * (row + 1) - 3 for row in range(handles)]
        self._from_base = [THING_NUMBERS * (row + 1) - 6 for row in range(things)]
        self._from_base += [bars + HANDLE_NUMBERS * (row + 1) - 6 for row in range(handles)]
        output_size = bars + handles * HANDLE_NUMBERS
        self.whole = PointNet(_FROM_BASE + 1 + _FROM_HAND, widths)
        self.trunk = nn.Sequential(nn.Linear(widths[-1] + robot, width), nn.LayerNorm(width), nn.GELU())
        self.first = nn.Linear(width, output_size)
        self.around = PointNet(_FROM_BASE + _FROM_HAND, widths)
        input_size = widths[-1] * len(self._from_hand) + width + output_size
        self.correction = nn.Sequential(
            nn.Linear(input_size, width), nn.LayerNorm(width), nn.GELU(), nn.Linear(width, output_size)
        )

    def forward(self, cloud: Tensor, robot: Tensor) -> tuple[Tensor, Tensor]:
        """Return (B, F) the first estimate, and (B, F) the corrected one, in m and shares.

        Args:
            cloud: (B, P, 4) x y z from the base (m), and 1 on the hand.
            robot: (B, R) the robot, from `state_numbers`.
        """
        across, along = robot[:, _HAND_AXES].reshape(-1, 3, 2).unbind(dim=-1)
        hand = torch.stack([across, along, torch.linalg.cross(across, along)], dim=-1)
        from_hand_m = (cloud[..., :3] - robot[:, None, _HAND_M]) @ hand
        trunk = self.trunk(torch.cat([self.whole(torch.cat([cloud, from_hand_m], dim=-1)), robot], dim=-1))
        first = self.first(trunk)
        named = first.detach()
        looks = [
            self.around(
                torch.cat(
                    [
                        (_MAGNIFIED * (from_hand_m - named[:, None, hand_at : hand_at + 3])).clamp(
                            -_MOST_MAGNIFIED, _MOST_MAGNIFIED
                        ),
                        cloud[..., :3] - named[:, None, base_at : base_at + 3],
                    ],
                    dim=-1,
                )
            )
            for hand_at, base_at in zip(self._from_hand, self._from_base, strict=True)
        ]
        return first, named + _CORRECTION * self.correction(torch.cat([*looks, trunk, named], dim=-1))


_POINT = 4
_MODE_CHOICE_WIDTH = 64  # Width of the choice among a few grasp modes: each demonstration shows one choice.


class Prediction(NamedTuple):
    """Prediction of a network from B times T frames.

    T is the number of frames for a transformer, which predicts from each, and 1 for a perceptron.

    Attributes:
        actions: (B, T, H, A) chunks of normalised actions.
        phases: (B, T, H, phases) logits of the running phase after each action; None where phases are not observed.
        grasp_modes: (B, modes) logits of the grasp modes; None where it does not choose.
    """

    actions: Tensor
    phases: Tensor | None
    grasp_modes: Tensor | None


@dataclass(frozen=True, slots=True)
class NetworkSizes:
    """Sizes that follow from the data.

    Attributes:
        numbers: Observed numbers, without points.
        phases: Number of primitives that occur.
        robot: Length of the robot's numbers, which come first.
    """

    numbers: int
    action: int
    phases: int
    grasp_modes: int
    robot: int


class PolicyNetwork(nn.Module):
    """Frames -> chunks of normalised actions, by one network or the mean of several.

    Where a few demonstrations leave the action open, networks with other initial weights and batches differ, and their
    mean is nearer to the right action than most of them.
    """

    def __init__(self, settings: PolicySettings, sizes: NetworkSizes) -> None:
        super().__init__()
        self.members = nn.ModuleList(_Member(settings, sizes) for _ in range(settings.network.members))
        sees, widths = settings.sees, settings.network.point_widths
        self.locator = Locator(sizes.robot, sees.things, sees.handles, widths) if sees.locates else None

    def forward(
        self,
        numbers: Tensor,
        phase: Tensor | None = None,
        cloud: Tensor | None = None,
        grasp_mode: Tensor | None = None,
    ) -> Prediction:
        """Return the prediction.

        In training each member gets its own part of a batch; else all get all of it, and their mean counts.

        Args:
            numbers: (B, T, F) normalised.
            phase: (B, T) the running primitive, where it is observed.
            cloud: (B, T, P, 4), where it is observed.
            grasp_mode: (B, T) the grasp mode, where it is observed.
        """
        given = (numbers, phase, cloud, grasp_mode)
        if not self.training:
            parts = zip(*(member(*given) for member in self.members), strict=True)
            return Prediction(*(None if part[0] is None else torch.stack(part).mean(dim=0) for part in parts))
        count = len(self.members)
        shares = [[None] * count if part is None else part.tensor_split(count) for part in given]
        found = [member(*share) for member, share in zip(self.members, zip(*shares, strict=True), strict=True)]
        return Prediction(*(None if part[0] is None else torch.cat(part) for part in zip(*found, strict=True)))

    def located(self, robot: Numbers, cloud: NDArray) -> Numbers:
        """Return (N, F) the robot's numbers, followed by the located things and handles.

        Args:
            robot: (N, R) the robot.
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
        self._phase_inputs = sizes.phases if sees.phase else 0
        self._grasp_modes = sizes.grasp_modes if sees.way else 0
        self.cloud = None if sees.places else PointNet(_POINT, form.point_widths)
        each = (
            sizes.numbers
            + self._phase_inputs
            + self._grasp_modes
            + (form.point_widths[-1] if self.cloud is not None else 0)
        )
        self.trunk: nn.Module = (
            _CausalTransformer(form, each, sees.frames)
            if form.kind == "transformer"
            else _Perceptron(form, each * sees.frames)
        )
        straight = sizes.numbers * max(self._phase_inputs, 1)
        self.straight = nn.Linear(straight, acts.chunk * sizes.action) if form.linear else None
        last = nn.Linear(form.width, acts.chunk * sizes.action)
        first = (nn.Linear(form.width, form.width), nn.GELU()) if form.kind == "transformer" else ()
        self.action = nn.Sequential(*first, last)
        self.next_phase = nn.Linear(form.width, acts.chunk * sizes.phases) if self._phase_inputs else None
        self.choice = (
            nn.Sequential(
                nn.Linear(sizes.numbers * max(self._phase_inputs, 1), _MODE_CHOICE_WIDTH),
                nn.GELU(),
                nn.Linear(_MODE_CHOICE_WIDTH, sizes.grasp_modes),
            )
            if sees.chooses
            else None
        )

    def forward(
        self,
        numbers: Tensor,
        phase: Tensor | None = None,
        cloud: Tensor | None = None,
        grasp_mode: Tensor | None = None,
    ) -> Prediction:
        parts = [numbers]
        if self.cloud is not None and cloud is not None:
            parts.append(self.cloud(cloud))
        if self._phase_inputs and phase is not None:
            parts.append(nn.functional.one_hot(phase, self._phase_inputs).to(numbers.dtype))
        if self._grasp_modes and grasp_mode is not None:
            parts.append(nn.functional.one_hot(grasp_mode, self._grasp_modes).to(numbers.dtype))
        found = self.trunk(torch.cat(parts, dim=-1))
        shape = (*found.shape[:2], self._chunk)
        logits = None if self.next_phase is None else self.next_phase(found).reshape(*shape, self._sizes.phases)
        grasp_modes = None if self.choice is None else self.choice(self._by_phase(numbers, phase)[:, -1])
        actions = self.action(found)
        if self.straight is not None:
            actions = actions + self.straight(self._by_phase(numbers, phase))[:, -found.shape[1] :]
        return Prediction(actions.reshape(*shape, self._sizes.action), logits, grasp_modes)

    def _by_phase(self, numbers: Tensor, phase: Tensor | None) -> Tensor:
        """Return (B, T, F * phases) the numbers at their phase's place, and else 0."""
        if not self._phase_inputs or phase is None:
            return numbers
        one_hot = nn.functional.one_hot(phase, self._phase_inputs).to(numbers.dtype)
        return (one_hot[..., None] * numbers[..., None, :]).flatten(-2)


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
