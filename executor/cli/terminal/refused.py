"""What is said, and how a command ends, when a plan is not proved and so nothing is moved."""

from __future__ import annotations

from executor.cli.terminal.errors import FAILED
from executor.cli.terminal.output import print_json, say, tell
from oag import Report


def refuse(report: Report, *, as_json: bool) -> int:
    """Prints why a plan is not executed, and returns the exit code."""
    if as_json:
        print_json({"ok": False, "exit_code": FAILED, **report.to_json()})
    else:
        say(str(report))
        tell(f"scene2demo: the plan is {report.verdict.value.lower()}, not proved; nothing was moved", style="red")
    return FAILED
