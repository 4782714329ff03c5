"""The one error of this room: a picture, or what was given beside it, from which no scene can be made."""

from __future__ import annotations

from pathlib import Path


class PhotoRefused(ValueError):
    """A photograph, or what was given beside it, cannot be used.

    Attributes:
        kind: What is wrong, in a word, for programs: "picture", "depth", "camera", "boxes", "label", "floor"
            or "nothing".
    """

    def __init__(self, kind: str, source: str | Path, problem: str, hint: str = "") -> None:
        self.kind = kind
        super().__init__(f"{source}: {problem}" + (f"; {hint}" if hint else ""))
