"""`scene2demo verify`: the verdict about a task file."""

from __future__ import annotations

from executor.cli.errors import DONE, FAILED
from executor.cli.inputs import task_and_scene
from executor.cli.options import Verify
from executor.cli.output import print_json, say
from oag import compose


def execute(options: Verify) -> int:
    """Prints the verdict with its findings; returns 0 when the plan is proved, else 1."""
    task, scene = task_and_scene(options.task, options.scene)
    report = compose(task, scene=scene).verify()
    if options.json:
        print_json({"ok": bool(report), **report.to_json()})
    else:
        say(str(report))
    return DONE if report else FAILED
