"""What draws the attempts of an evolution for its report, where pictures are wanted and can be drawn."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from executor.cli.terminal.output import tell
from executor.evolution.frames import AttemptFrames
from executor.machine import vulkan


@contextmanager
def attempt_frames(drawing: AttemptFrames | None, *, wanted: bool) -> Iterator[AttemptFrames | None]:
    """Gives what draws attempts, or None; a machine that cannot draw tells so, and everything else is done.

    Args:
        drawing: What draws for a model already, and is closed by somebody else; its pictures serve the report too.
        wanted: Whether pictures are wanted in the report.
    """
    if drawing is not None or not wanted:
        yield drawing
        return
    renderer = vulkan.find_renderer()
    if not renderer:
        tell(f"no pictures: {renderer.why} {renderer.remedy}".strip(), style="yellow")
        yield None
        return
    with AttemptFrames() as frames:
        yield frames
