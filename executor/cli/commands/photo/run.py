"""`scene2demo run --photo`: the scene is made of a photograph, once, and then the run is as any other.

By itself, so that a run in a scene that has a name goes nowhere near pictures.
"""

from __future__ import annotations

from dataclasses import replace

from executor.cli.commands import run
from executor.cli.commands.photo.given import scene_of_photograph
from executor.cli.errors import check
from executor.cli.words.running import RunOptions
from executor.results.run_folder import RunFolder


def execute(options: RunOptions) -> int:
    """Makes the scene where it is not kept from before, runs in it, and returns the run's exit code.

    Raises:
        BadOption: There is a scene as well, or what is beside the photograph is out of range.
        PhotoRefused, RoomRefused: The photograph makes no scene.
        ResultsExist, FolderUnusable: The folder.
    """
    check(options.scene is None, "--scene", options.scene, "none beside --photo, which makes one")
    if options.photo is None:
        return run.execute(options)
    # Fitting takes a while: that the folder cannot be used is said before.
    folder = RunFolder.prepare(options.out, force=options.force)
    scene = scene_of_photograph(options.photo, options.beside, folder.path / "photo", quiet=options.json)
    return run.execute(replace(options, scene=str(scene)))
