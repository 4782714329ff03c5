"""Fixes of several changes: a plan that no smaller fix proves is repaired as a whole, changed as little as possible.

Source: docs/semantics.md, Fixes.
"""

from __future__ import annotations

from oag.edit_script import edit_script
from oag.flows import complete
from oag.planning import repair
from oag.verify.edits import Fix
from oag.verify.fixes import aims_elsewhere, find_fixes
from oag.verify.verify import Report, verify


def find_all_fixes(report: Report) -> tuple[Fix, ...]:
    """Return the verified repairs of a refuted plan, as `find_fixes` does.

    Where each of them leaves an error of a well-formed plan, a repair of the whole plan comes first, if the scene
    admits one. It reaches the task goal, or what the subtasks aim at where none is given.
    """
    fixes = find_fixes(report)
    # A fix that leaves no error, only unknown facts, does not invent what the plan did not rest on.
    enough = any(fix.proves or not fix.remaining for fix in fixes)
    if enough or report.trace is None:
        return fixes
    planned = repair(report.task, report.scene)
    if planned.task is None:
        return fixes
    script = edit_script(report.task, planned.task, flows=True)
    whole = Fix("several", "; then ".join(script.words), None, None, script.edits, None, proves=True)
    repaired = complete(whole.apply(report.task), report.scene).task
    proved = bool(verify(repaired, report.scene)) and not aims_elsewhere(report, repaired, report.scene)
    return (whole, *fixes) if proved else fixes
