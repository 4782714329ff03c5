"""`scene2demo scenes`: the scenes that come with the package."""

from __future__ import annotations

from executor.cli.errors import DONE
from executor.cli.options import Scenes
from executor.cli.output import print_json, say
from executor.scenes import library


def execute(options: Scenes) -> int:
    """Prints each scene with its objects; returns 0."""
    scenes = [library.load(name) for name in library.names()]
    if options.json:
        listed = [
            {"name": scene.name, "objects": {key: thing.category for key, thing in scene.objects.items()}}
            for scene in scenes
        ]
        print_json({"ok": True, "scenes": listed})
        return DONE
    width = max((len(scene.name) for scene in scenes), default=0)
    for scene in scenes:
        say(f"{scene.name:{width}}  {', '.join(scene.objects)}")
    return DONE
