"""`scene2demo run --photo`: make the scene of a photograph, once, and run in it.

A file of its own, so that a run in a named scene loads nothing about pictures.
"""

from __future__ import annotations

from dataclasses import replace

from executor.cli.command_options import RunOptions
from executor.cli.commands import run
from executor.cli.commands.photo import scene_of_photograph
from executor.cli.errors import check
from executor.reports.run_folder import RunFolder


def execute(options: RunOptions) -> int:
    """Make the scene unless it is kept from before, run in it, and return the run's exit code.

    Raises:
        BadOption: There is a scene as well, or a value for the photograph is out of range.
        PhotoRefused, RoomRefused: The photograph makes no scene.
        ResultsExist, FolderUnusable: The folder.
    """
    check(options.scene is None, "--scene", options.scene, "none beside --photo, which makes one")
    if options.photo is None:
        return run.execute(options)
    # Fitting takes a while: refuse an unusable folder before it.
    folder = RunFolder.prepare(options.out, force=options.force)
    scene = scene_of_photograph(options.photo, options.photo_inputs, folder.path / "photo", quiet=options.json)
    return run.execute(replace(options, scene=str(scene)))
