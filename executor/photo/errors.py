"""Errors of reconstructions from photographs."""

from __future__ import annotations

from enum import Enum
from pathlib import Path

from bddl.errors import Scene2DemoError


class LostCause(Enum):
    """Why something with a box is not in the scene; the value is half a sentence for people."""

    NO_ROOM = "the scene cannot be with it"
    STANDS = "nothing level is below its box, and what has its name stands on the floor"
    NO_TIME = "it was not fitted before Ctrl-C"


class PhotoRefused(Scene2DemoError, ValueError):
    """A photograph or one of its auxiliary inputs cannot be used.

    Attributes:
        kind: The faulty input, for programs: "picture", "depth", "camera", "scale", "boxes", "label", "floor",
            "weights" or "nothing"; "missing" for inputs that are not there.
        problem: What is wrong, without source and hint.
    """

    def __init__(self, kind: str, source: str | Path, problem: str, hint: str = "") -> None:
        self.kind, self.problem = kind, problem
        super().__init__(f"{source}: {problem}" + (f"; {hint}" if hint else ""))


class RoomRefused(Scene2DemoError, ValueError):
    """A reconstruction is physically impossible, or leaves no room for the robot."""

    exit_code = 1

    def __init__(self, source: str | Path, reason: str, folder: Path) -> None:
        super().__init__(f"{source}: what was reconstructed is no scene to work in: {reason}; {folder} has its report")
