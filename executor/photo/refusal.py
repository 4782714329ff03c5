"""The errors of this room: what makes no scene, and a scene that cannot be."""

from __future__ import annotations

from pathlib import Path


class PhotoRefused(ValueError):
    """A photograph, or what was given beside it, cannot be used.

    Attributes:
        kind: What is wrong, in a word, for programs: "picture", "depth", "camera", "scale", "boxes", "label",
            "floor", "weights" or "nothing".
    """

    def __init__(self, kind: str, source: str | Path, problem: str, hint: str = "") -> None:
        self.kind = kind
        super().__init__(f"{source}: {problem}" + (f"; {hint}" if hint else ""))


class RoomRefused(ValueError):
    """What was reconstructed cannot stand as it is, or cannot be worked in."""

    def __init__(self, source: str | Path, reason: str, folder: Path) -> None:
        super().__init__(f"{source}: what was reconstructed is no scene to work in: {reason}; {folder} has its report")
