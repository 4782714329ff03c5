"""`scene2demo doctor`: report what works on this machine."""

from __future__ import annotations

from dataclasses import dataclass

from executor.cli.errors import DONE, FAILED
from executor.cli.options import CommonOptions
from executor.cli.output import print_json, say


@dataclass(frozen=True)
class Options(CommonOptions):
    """Examine this machine: what works, what is missing, what to do."""


_MARKS = {"ok": ("ok", "green"), "note": ("note", "yellow"), "problem": ("problem", "red")}


def execute(options: Options) -> int:
    """Print the findings and their remedies; return 1 when something is a problem, else 0."""
    from executor.system.doctor import examine, healthy

    findings = examine()
    good = healthy(findings)
    if options.json:
        print_json({"ok": good, "findings": [finding.to_json() for finding in findings]})
        return DONE if good else FAILED
    width = max(len(finding.topic) for finding in findings)
    for finding in findings:
        mark, style = _MARKS[finding.status]
        say(f"{mark:8} {finding.topic:{width}}  {finding.detail}", style=style if finding.status != "ok" else None)
        if finding.remedy:
            say(f"{'':8} {'':{width}}  {finding.remedy}")
    return DONE if good else FAILED
