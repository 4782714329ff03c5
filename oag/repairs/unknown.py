"""Whether a changed plan rests on more of the unknown than the plan before the change.

Source: docs/semantics.md, Fixes.
"""

from __future__ import annotations

from collections.abc import Iterator

import bddl
from oag.model.facts import ANY, GRIPPER, Fact, overlap
from oag.report import Report


def rests_on_no_more(before: Report, after: Report, *, inserted: bool) -> bool:
    """Decides whether what a changed plan leaves open was open in the plan before it, too.

    Args:
        before: On the plan.
        after: On the changed plan, CONDITIONAL.
        inserted: Whether the change only inserts a subtask, which may need to know more of the start than the rest.

    A formula of the plan that was false, or open as a whole, may be met in several ways once a mistake is mended, and
    then rests on some of its literals. That is not more, as long as no step of either plan brings such a literal about:
    a change that takes away what brings it about, and assumes it, mends nothing.
    """
    if before.trace is None or after.trace is None:
        return False
    listed = {(assumption.condition, assumption.formula) for assumption in before.trace.assumptions}
    more = [a for a in after.trace.assumptions if (a.condition, a.formula) not in listed]
    facts = [assumption.condition.fact for assumption in more if assumption.condition is not None]
    if len(facts) < len(more):
        return False
    if inserted:
        return all(assumption.about_start for assumption in more)
    written = [fact for trace in (before.trace, after.trace) for step in trace.steps for fact, _ in step.effect]
    spoken = list(_spoken_of(before))
    return all(
        any(overlap(fact, other) for other in spoken) and not any(overlap(fact, other) for other in written)
        for fact in facts
    )


def _spoken_of(report: Report) -> Iterator[Fact]:
    """Yields what the conditions of a plan that are no conjunctions of literals speak of; `*` stands for a variable."""
    task, names = report.task, {*report.scene.objects, GRIPPER}
    for formula in (task.goal, *(side for part in task.subtasks for side in (part.init, part.goal))):
        if bddl.literals(formula) is None:
            for atom in bddl.atoms(formula):
                yield (atom.predicate, *(name if name in names else ANY for name in atom.args))
