"""Where things and handles are, told from a point cloud: what a policy of clouds looks at before it acts.

A first PointNet sees the whole cloud, from the base and from the hand, and says where everything is to some
centimetres. A second one looks again at what is around each place that was named, magnified, and corrects it. Both
learn from what demonstrations know of the simulator's state; at work the cloud and the robot's own joints are all.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from executor.policies.seen.features import HANDLE_NUMBERS, ROBOT_NUMBERS, THING_NUMBERS

_FROM_BASE, _FROM_HAND = 3, 3
_MAGNIFIED, _MOST = 10.0, 3.0
"""A centimetre around a place counts as ten; what is farther than 30 cm away, as so far away."""

_CORRECTION = 0.1  # Of what the second network says: it begins with little.
_HAND_M, _HAND_AXES = slice(8, 11), slice(11, 17)  # Among the robot's numbers.


class PointNet(nn.Module):
    """Points (..., P, N) -> numbers (..., W): each point by itself, then the most of each number."""

    def __init__(self, each: int, widths: tuple[int, ...]) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for before, after in zip((each, *widths), widths, strict=False):
            layers += [nn.Linear(before, after), nn.LayerNorm(after), nn.GELU()]
        self.points = nn.Sequential(*layers)

    def forward(self, cloud: Tensor) -> Tensor:
        """Returns what the cloud says as a whole."""
        return self.points(cloud).amax(dim=-2)


class Locator(nn.Module):
    """Clouds -> what `features.state_numbers` tells of things and handles.

    Args:
        things, handles: Of how many it tells.
        widths: Of what each point goes through.
        width: Of what follows.
    """

    def __init__(self, things: int, handles: int, widths: tuple[int, ...], width: int = 256) -> None:
        super().__init__()
        bars = things * THING_NUMBERS
        self._from_hand = [THING_NUMBERS * (row + 1) - 3 for row in range(things)]
        self._from_hand += [bars + HANDLE_NUMBERS * (row + 1) - 3 for row in range(handles)]
        self._from_base = [THING_NUMBERS * (row + 1) - 6 for row in range(things)]
        self._from_base += [bars + HANDLE_NUMBERS * (row + 1) - 6 for row in range(handles)]
        told = bars + handles * HANDLE_NUMBERS
        self.whole = PointNet(_FROM_BASE + 1 + _FROM_HAND, widths)
        self.trunk = nn.Sequential(nn.Linear(widths[-1] + ROBOT_NUMBERS, width), nn.LayerNorm(width), nn.GELU())
        self.first = nn.Linear(width, told)
        self.around = PointNet(_FROM_BASE + _FROM_HAND, widths)
        seen = widths[-1] * len(self._from_hand) + width + told
        self.correction = nn.Sequential(nn.Linear(seen, width), nn.LayerNorm(width), nn.GELU(), nn.Linear(width, told))

    def forward(self, cloud: Tensor, robot: Tensor) -> tuple[Tensor, Tensor]:
        """Returns (B, F) what it says at first, and (B, F) corrected, in m and shares.

        Args:
            cloud: (B, P, 4) x y z from the base (m), and 1 on the hand.
            robot: (B, ROBOT_NUMBERS) the robot, as `state_numbers` tells it.
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
                        (_MAGNIFIED * (from_hand_m - named[:, None, hand_at : hand_at + 3])).clamp(-_MOST, _MOST),
                        cloud[..., :3] - named[:, None, base_at : base_at + 3],
                    ],
                    dim=-1,
                )
            )
            for hand_at, base_at in zip(self._from_hand, self._from_base, strict=True)
        ]
        return first, named + _CORRECTION * self.correction(torch.cat([*looks, trunk, named], dim=-1))
