"""What somebody says stands in a picture, against what is seen there: so much is there, and through so much one sees.

A guess that explains the pixels it was fitted to may claim others as well: an open shelf in front of a wall explains
whatever stands out there, and the wall is seen through it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from executor.geometry import Array
from executor.machine.extras import require
from executor.photo.space.observation import Observation
from executor.photo.space.standing_out import box_of
from llm.sight.forms import Box, overlap

_MODEL_M = 0.01  # What a model differs from a thing even where it is the right one.
_SIGMAS = 3.0
_MOST_THROUGH = 0.15
"""Share of the pixels of a thing through which something farther off may be seen. On ten rooms right fits had at most
0.04, and wrong ones from 0.08 on."""

_SEEN_THROUGH = 0.5  # Of what a box has a name for, which may be open, or fitted to depths that are bent.
_LEAST_SEEN = 0.25
"""Share of a thing that is seen: of less, at the picture's border or behind something, any plane could be one."""

_PLENTY, _LEVEL_M = 0.02, 0.1
"""Share of the picture from which on it does not matter how much more there would be where what is seen is level: of a
table before the camera little more than a corner is in the picture. Walls are not level, nor is noise."""

_LEAST_FREE = 2.0  # So many of its pixels are seen for one that something unknown hides.
_LEAST_COMMON = 0.5  # Of two boxes, as for matching detections with things (COCO's AP50).


@dataclass(frozen=True)
class Claim:
    """The pixels that a guess says it shows, by what is seen in them.

    Attributes:
        right_px: Seen where the guess says.
        through_px: Seen farther off, so that the guess cannot be there.
        before_px: Hidden by something nearer that nobody knows.
        box_px: Around the pixels that are right; None where none is.
        seen_share: Of all that it would show with nothing before it and no border.
        level_share: What is right of it, of the whole picture, where that is of one height; else 0.
    """

    right_px: int
    through_px: int
    before_px: int
    box_px: Box | None
    seen_share: float
    level_share: float

    @classmethod
    def of(cls, seen: Observation, depth_m: Array, other_m: Array, corners_m: Array) -> Claim:
        """Returns what a guess claims.

        Args:
            seen: The picture, with depth.
            depth_m: (H, W) depth of the guess, infinite where it is not.
            other_m: (H, W) depth of everything else that is known.
            corners_m: (8, 3) of its box in the level frame.
        """
        shown = seen.measured & (depth_m < other_m)
        off_m = np.where(shown, seen.z_m - depth_m, 0.0)
        slack_m = _MODEL_M + _SIGMAS * seen.bent_m
        right = shown & (np.abs(off_m) < slack_m)
        through = shown & (off_m >= slack_m)
        share = int(right.sum()) / max(1, int(np.isfinite(depth_m).sum())) * _share_in_picture(seen, corners_m)
        before = int(shown.sum()) - int(right.sum()) - int(through.sum())
        box_px = box_of(right) if right.any() else None
        level = float(right.mean()) if _is_level(seen.points_m[right][:, 2]) else 0.0
        return cls(int(right.sum()), int(through.sum()), before, box_px, share, level)

    @property
    def through_share(self) -> float:
        """Share of what should be seen of it through which something farther off is seen."""
        return self.through_px / max(1, self.right_px + self.through_px)

    @property
    def seen_through(self) -> bool:
        """Whether more is seen through it than through what is right."""
        return self.through_share > _MOST_THROUGH

    def is_borne_out(self, least_px: int, *, boxed: bool = False) -> bool:
        """Decides whether enough is seen of it, more than what nobody knows hides, and hardly anything through it.

        Args:
            least_px: Fewer pixels are too few.
            boxed: Whether somebody has drawn a box around it: something unknown may then hide as much of it.
        """
        enough = self.seen_share >= _LEAST_SEEN or self.level_share >= _PLENTY
        free = self.right_px >= max(least_px, self.before_px * (1.0 if boxed else _LEAST_FREE))
        return enough and free and not self.seen_through

    def is_refuted(self, box_px: Box) -> bool:
        """Decides whether it cannot be what a box was drawn around, whatever that is called."""
        return self.through_share > _SEEN_THROUGH and not self.fills(box_px)

    def fills(self, box_px: Box) -> bool:
        """Decides whether it is what a box was drawn around: the two boxes have half of their area in common."""
        return self.box_px is not None and overlap(self.box_px, box_px) >= _LEAST_COMMON


def _is_level(heights_m: Array) -> bool:
    low, high = np.percentile(heights_m, [25.0, 95.0]) if len(heights_m) else (0.0, np.inf)
    return bool(high - low < _LEVEL_M)


def _share_in_picture(seen: Observation, corners_m: Array) -> float:
    """Share of the outline of a box (8, 3) that is inside the picture; 0 where it reaches behind the camera."""
    pixels = seen.pixels(corners_m)
    if not np.isfinite(pixels).all():
        return 0.0
    geometry = require("shapely.geometry", "photo")
    outline = geometry.MultiPoint(pixels).convex_hull
    return float(outline.intersection(geometry.box(0.0, 0.0, *seen.size_px)).area / max(outline.area, 1e-9))
