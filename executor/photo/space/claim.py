"""What somebody says stands in a picture, against what is seen there: so much is there, and through so much one sees.

A guess that explains the pixels it was fitted to may claim others as well: an open shelf in front of a wall explains
whatever stands out there, and the wall is seen through it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from executor.geometry import Array
from executor.photo.space.observation import Observation
from executor.photo.space.standing_out import Box, box_of

_MODEL_M = 0.01  # What a model differs from a thing even where it is the right one.
_SIGMAS = 3.0
_MOST_THROUGH = 0.15
"""Share of the pixels of a thing through which something farther off may be seen. On ten rooms right fits had at most
0.04, and wrong ones from 0.08 on."""

_LEAST_COMMON = 0.5  # Of two boxes, as for matching detections with things (COCO's AP50).


@dataclass(frozen=True)
class Claim:
    """The pixels that a guess says it shows, by what is seen in them.

    Attributes:
        right_px: Seen where the guess says.
        through_px: Seen farther off, so that the guess cannot be there.
        box_px: Around the pixels that are right; None where none is.
    """

    right_px: int
    through_px: int
    box_px: Box | None

    @classmethod
    def of(cls, seen: Observation, depth_m: Array, other_m: Array) -> Claim:
        """Returns what a guess claims.

        Args:
            seen: The picture, with depth.
            depth_m: (H, W) depth of the guess, infinite where it is not.
            other_m: (H, W) depth of everything else that is known.
        """
        shown = seen.measured & (depth_m < other_m)
        off_m = np.where(shown, seen.z_m - depth_m, 0.0)
        slack_m = _MODEL_M + _SIGMAS * seen.sigma_m
        right = shown & (np.abs(off_m) < slack_m)
        through = shown & (off_m >= slack_m)
        return cls(int(right.sum()), int(through.sum()), box_of(right) if right.any() else None)

    def is_borne_out(self, least_px: int) -> bool:
        """Decides whether enough is seen of it, and hardly anything through it."""
        return self.right_px >= least_px and self.through_px <= _MOST_THROUGH * (self.right_px + self.through_px)

    def fills(self, box_px: Box) -> bool:
        """Decides whether it is what a box was drawn around: the two boxes have half of their area in common."""
        if self.box_px is None:
            return False
        low = np.maximum(self.box_px[:2], box_px[:2])
        high = np.minimum(self.box_px[2:], box_px[2:])
        common = float(np.prod(np.maximum(high - low, 0.0)))
        both = sum((x1 - x0) * (y1 - y0) for x0, y0, x1, y1 in (self.box_px, box_px)) - common
        return common >= _LEAST_COMMON * both
