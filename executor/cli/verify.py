"""`scene2demo verify`: the verdict about a task file, and the task with one of its fixes applied."""

from __future__ import annotations

from executor.cli.bad_option import BadOption
from executor.cli.errors import DONE, FAILED
from executor.cli.inputs import refuse_existing, task_and_scene
from executor.cli.options import Verify
from executor.cli.output import print_json, say, tell
from executor.files import write_json
from oag import Fix, Report, compose


def execute(options: Verify) -> int:
    """Prints the verdict with its findings, and writes the repaired task where that is asked for.

    Returns:
        0 when the plan is proved, or a repaired one that is has been written; else 1.

    Raises:
        BadOption: A fix is asked for and no file is named, the file exists, or there is no fix of that number.
    """
    if options.apply is not None and options.out is None:
        raise BadOption("--apply", options.apply, "--out with the file that the repaired task goes to")
    if options.out is not None:
        refuse_existing(options.out, force=options.force)
    task, scene = task_and_scene(options.task, options.scene)
    report = compose(task, scene=scene).verify()
    fix = None if options.out is None or report else _chosen(report, options.apply)
    if options.json:
        print_json({"ok": bool(report), **report.to_json()})
    else:
        say(str(report))
    if fix is None or options.out is None:
        return DONE if report else FAILED
    write_json(options.out, fix.apply(report.task).to_json())
    tell(f"\nwritten to {options.out}: {fix}")
    return DONE if fix.proves else FAILED


def _chosen(report: Report, number: int | None) -> Fix | None:
    """Returns the fix of a number, counted from 1; None when none is offered and none was named."""
    if number is None and not report.fixes:
        tell("no fix was found, so nothing is written")
        return None
    index = 0 if number is None else number - 1
    if not 0 <= index < len(report.fixes):
        count = len(report.fixes)
        raise BadOption("--apply", number, f"a number from 1 to {count}" if count else "nothing: no fix was found")
    fix = report.fixes[index]
    if fix.assumption:
        tell("the fix states a fact of the scene: add it to the scene's file if it is so; nothing is written")
        return None
    return fix
