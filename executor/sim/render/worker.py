"""Rendering jobs: written to a folder by the caller, drawn by worker processes that run this module.

A job's folder has the scene, the cameras and the packed states. Workers run `python -m executor.sim.render.worker` and
get paths and numbers as JSON lines. Nothing is pickled, and a worker that dies takes no state with it. The first
picture of a process compiles shaders for seconds. It is drawn before the first request, and the pool keeps workers for
many rollouts.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.lib.format import open_memmap

from executor.sim.render.cameras import Camera
from executor.sim.render.frames import JOB_CAMERAS, JOB_OVERVIEW, JOB_SCENE, JOB_STATES, frames_path
from executor.sim.render.home import home_of
from executor.sim.render.stage import DAYLIGHT, Stage, warm_up
from executor.sim.world import World
from executor.system import vulkan
from executor.system.workers import answer, requests, take_stdout
from oag import Scene

_REPORT_EVERY = 10  # Pictures from one answer to the next.


def main() -> None:
    """Serve requests until standard input ends."""
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
            # The parent gets the sentence and decides; a traceback of a child helps no user of a command.
            answer(answers, error=f"{type(error).__name__}: {error}")
    del shaders


def _draw(folder: Path, first: int, step: int, skip: int, answers: TextIO) -> None:
    """Draw the states first, first + step, ... of a job, leaving out the `skip` ones that are there already."""
    described = json.loads((folder / JOB_CAMERAS).read_text(encoding="utf-8"))
    cameras = [Camera(**{**c, "T_mount_camera": np.array(c["T_mount_camera"])}) for c in described["cameras"]]
    pictures = {camera.name: open_memmap(frames_path(folder, camera.name), mode="r+") for camera in cameras}
    states = np.load(folder / JOB_STATES)
    rows = range(first, len(states), step)[skip:]
    scene, overview = Scene.from_json(folder / JOB_SCENE), folder / JOB_OVERVIEW
    poses = np.load(overview) if overview.is_file() else None
    home = None if described["plain"] else home_of(scene)
    surfaces, lights = (None, DAYLIGHT) if home is None else (home.surfaces, home.lights)
    with World(scene, visual=True, paint=None if surfaces is None else surfaces.paint()) as world:
        stage = Stage(world, cameras, described["sizes"], lights=lights, materials=surfaces)
        for done, row in enumerate(rows, start=1):
            if poses is not None:
                stage.aim("global", poses[row])
            for name, picture in stage.show(states[row].tobytes()).items():
                pictures[name][row] = picture
            if done % _REPORT_EVERY == 0:
                answer(answers, drawn=skip + done, finished=False)
        del stage
    answer(answers, drawn=skip + len(rows), finished=True)


if __name__ == "__main__":
    main()
