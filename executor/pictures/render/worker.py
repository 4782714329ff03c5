"""A process that draws: reads requests as JSON lines, writes pictures into arrays on disk, answers as JSON lines.

Run as `python -m executor.pictures.render.worker`. The first picture of a process compiles shaders for seconds; it is
drawn before the first request, and the pool keeps workers for many rollouts.
"""

from __future__ import annotations

from pathlib import Path
from typing import TextIO

from executor.machine import vulkan
from executor.machine.workers.process import answer, requests, take_stdout
from executor.pictures.render.frames import open_frames
from executor.pictures.render.job import read_job
from executor.pictures.render.stage import Stage, warm_up
from executor.world.world import World

_REPORT_EVERY = 10


def main() -> None:
    """Serves requests until standard input ends."""
    answers = take_stdout()
    try:
        renderer = vulkan.activate()
    except vulkan.RendererNotFound as error:
        answer(answers, error=str(error))
        return
    # Compiled shaders live as long as a scene that uses them, so this one stays until the process ends.
    shaders = warm_up()
    answer(answers, ready=renderer.why)
    for request in requests():
        try:
            _draw(Path(request["folder"]), request["first"], request["step"], request["skip"], answers)
        except Exception as error:
            # The parent gets the sentence and decides; a traceback of a child helps nobody who runs a command.
            answer(answers, error=f"{type(error).__name__}: {error}")
    del shaders


def _draw(folder: Path, first: int, step: int, skip: int, answers: TextIO) -> None:
    """Draws the states first, first + step, ... of a job, leaving out the `skip` ones that are there already."""
    job = read_job(folder)
    pictures = {camera.name: open_frames(folder, camera.name) for camera in job.cameras}
    rows = range(first, len(job.states), step)[skip:]
    with World(job.scene, visual=True) as world:
        stage = Stage(world, job.cameras, job.sizes, shadows=job.shadows)
        for done, row in enumerate(rows, start=1):
            for name, picture in stage.show(job.states[row].tobytes()).items():
                pictures[name][row] = picture
            if done % _REPORT_EVERY == 0:
                answer(answers, done=skip + done)
        del stage
    answer(answers, finished=skip + len(rows))


if __name__ == "__main__":
    main()
