"""Repair: for every mistake of a refuted plan, small changes that were verified to remove it.

Nothing is offered unverified, and the search is bounded by a number of verifications, so it gives the same answer on
every machine.

Source: docs/semantics.md, Fixes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from oag.model.errors import FixError
from oag.model.scene import Scene
from oag.repairs.candidates import Candidate
from oag.repairs.search import FixSearch, Judge, mistakes
from oag.report import Report, Verdict
from oag.task.edits import Fix
from oag.task.task import Task

# Of a plan with very many mistakes, the first ones are worked on.
_MOST_CAUSES = 10
# A plan with several mistakes is repaired as a whole by at most so many fixes together.
_MOST_TOGETHER = 10
# Steps that are followed in looking for these: in a long plan fewer are looked for.
_MOST_STEPS = 100_000


def find_fixes(report: Report, judge: Judge) -> tuple[Fix, ...]:
    """Returns the verified repairs of a refuted plan.

    Returns:
        Those that make the plan PROVED first, the smallest change first; at most `MOST_FIXES` for each error, each of
        another kind. Where no single change proves a plan with several mistakes, the first one mends them all.
    """
    found = mistakes(report)[:_MOST_CAUSES]
    offered = [offer for mistake in found for offer in FixSearch(report, judge).offers(mistake)]
    offered.sort(key=lambda offer: offer.order)
    fixes = list(_distinct(report, (offer.fix for offer in offered)))
    if any(fix.proves for fix in fixes):
        return tuple(fixes)
    parts = _together(report, judge, fixes)
    if not parts:
        return tuple(fixes)
    whole = Fix(
        "several",
        "; then ".join(fix.summary for fix in parts),
        None,
        None,
        tuple(edit for fix in parts for edit in fix.edits),
        None,
        proves=True,
        assumption=any(fix.assumption for fix in parts),
    )
    return (whole, *_distinct(report, _alone(report, judge, parts, fixes)))


def _distinct(report: Report, fixes: Iterable[Fix]) -> Iterator[Fix]:
    """Yields the fixes without those that lead to the plan of an earlier one, whatever words they have for it."""
    seen: list[tuple[Task, Scene]] = []
    for fix in fixes:
        repaired = fix.apply(report.task), fix.apply_to_scene(report.scene)
        if repaired not in seen:
            seen.append(repaired)
            yield fix


def _together(report: Report, judge: Judge, fixes: list[Fix]) -> list[Fix]:
    """Returns fixes that mend several mistakes one after the other, or none when they do not prove the plan."""
    chosen: list[Fix] = []
    task, scene, left = report.task, report.scene, _MOST_STEPS
    for _ in range(_MOST_TOGETHER):
        if not fixes:
            return []
        chosen.append(fixes[0])
        task, scene = fixes[0].apply(task), fixes[0].apply_to_scene(scene)
        current = judge(task, scene)
        if current:
            return chosen
        if current.verdict is not Verdict.REFUTED:
            return []
        search = FixSearch(current, judge)
        fixes = [offer.fix for offer in search.offers(mistakes(current)[0])]
        left -= search.checks * sum(len(subtask.flow or ()) for subtask in task.subtasks)
        if left < 0:
            return []
    return []


def _alone(report: Report, judge: Judge, parts: list[Fix], fixes: list[Fix]) -> Iterator[Fix]:
    """Yields for every mistake the part that mends it together with the others, else the fixes found for it alone."""
    for mistake in mistakes(report):
        for part in parts:
            edits = Candidate(0, part.kind, part.summary, part.edits, part.subtask, part.step)
            offer = FixSearch(report, judge).checked(mistake, edits) if _fits(report, part) else None
            if offer is not None:
                yield offer.fix
                break
        else:
            yield from (fix for fix in fixes if fix.cause == mistake.number)


def _fits(report: Report, part: Fix) -> bool:
    """Decides whether a fix that was made for a changed plan can be applied to the plan itself."""
    try:
        part.apply(report.task)
    except FixError:
        return False
    return True
