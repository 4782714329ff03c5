"""Search for fixes: for every mistake of a refuted plan, small changes that were verified to remove it.

Candidates are tried in the order of size, and each is verified before it counts. The search is bounded by a number of
verifications, so it gives the same answer on every machine.

Source: docs/semantics.md, Fixes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from operator import itemgetter

import bddl
from oag.flows import complete
from oag.model.diagnostics import Diagnostic, FixError
from oag.model.scene import Scene
from oag.model.symbols import ANY, GRIPPER, Fact, Primitive, held_by, overlap
from oag.progression import Grade, Obligation
from oag.task_definition import SimpleTask, Task
from oag.verify.edits import ChangeSubtask, DeleteSubtask, Fix, InsertSubtask
from oag.verify.fix_candidates import Candidate, Mistake, numbered
from oag.verify.fix_conditions import (
    condition_candidates,
    fact_candidates,
    goal_candidates,
    object_candidates,
    role_candidates,
)
from oag.verify.fix_flows import step_candidates
from oag.verify.fix_form import form_candidates
from oag.verify.fix_subtasks import deletion_candidates, insertion_candidates, order_candidates
from oag.verify.verify import Report, Verdict, verify

# Most verifications for one mistake; in long plans, as many as follow this number of steps for all mistakes together.
MOST_CHECKS = 300
_MOST_STEPS_FOLLOWED = 20_000
_FEWEST_CHECKS = 15
# A changed task goal is tried last, so that it is among the fixes.
_LAST_CHECKS = 8
# Fixes offered for one mistake.
MOST_FIXES = 4
_MOST_PARTIAL = 2
# Changes that cost this much more than the smallest working one are not tried.
_MUCH_MORE = 3
# Of an unreadable condition, only the text can be repaired.
_UNREADABLE = ("bddl/syntax", "bddl/arity", "bddl/unknown-predicate", "bddl/unknown-category")

_Key = tuple[object, ...]

# Mistakes of form come first.
_GENERATORS = (
    form_candidates,
    order_candidates,
    insertion_candidates,
    role_candidates,
    object_candidates,
    condition_candidates,
    deletion_candidates,
    fact_candidates,
    goal_candidates,
)


def mistakes(report: Report) -> tuple[Mistake, ...]:
    """Return the errors of a report as mistakes, in their order."""
    found = [Mistake(*numbered, report.task, report.scene, report.trace) for numbered in enumerate(report.errors)]
    if report.trace is None:
        return tuple(found)
    for number, (obligation, condition, formula, entry, _) in enumerate(report.trace.failures):
        at = report.trace.obligations[obligation]
        found[number] = replace(found[number], obligation=at, condition=condition, formula=formula, entry=entry)
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Offer:
    """A fix with its place among the others; an idle one leaves a subtask without anything to do."""

    fix: Fix
    order: tuple[bool, bool, int, int, int]
    idle: bool


@dataclass
class FixSearch:
    """The search for repairs of one mistake."""

    report: Report
    most: int = MOST_CHECKS
    checks: int = 0
    # What kept an inserted subtask from working at the latest place that was tried for it.
    too_late: dict[str, Diagnostic] = field(default_factory=dict)

    def offers(self, mistake: Mistake) -> list[Offer]:
        """Return the fixes for one mistake, the best of each kind; partial ones only where none proves the plan."""
        best: dict[str, Offer] = {}
        limit: int | None = None
        most = self.most
        for found in _candidates(mistake, in_turn=most < MOST_CHECKS):
            candidate = _with_open_flow(found, self.report)
            settled = best.get(candidate.kind)
            if settled is not None and settled.order[:2] == (False, False):
                continue
            last_resort = candidate.kind == "change-task-goal" and self.checks < most + _LAST_CHECKS
            if not last_resort and (self.checks >= most or (limit is not None and candidate.cost > limit)):
                continue
            offer = self.checked(mistake, candidate)
            if offer is None:
                continue
            if settled is None or offer.order < settled.order:
                best[candidate.kind] = offer
            if offer.order[:2] == (False, False):
                limit = min(candidate.cost + _MUCH_MORE, limit or candidate.cost + _MUCH_MORE)
        ordered = sorted(best.values(), key=lambda offer: offer.order)
        proving = [offer for offer in ordered if offer.fix.proves]
        if proving:
            return ([offer for offer in proving if not offer.idle] or proving)[:MOST_FIXES]
        return [offer for offer in ordered if offer.fix.kind != "delete-subtask"][:_MOST_PARTIAL] or ordered[:1]

    def checked(self, mistake: Mistake, candidate: Candidate) -> Offer | None:
        """Return the fix of a candidate, or None when it does not remove its mistake or adds new ones."""
        self.checks += 1
        before = self.report
        draft = candidate.as_fix(mistake.number)
        task, scene = draft.apply(before.task), draft.apply_to_scene(before.scene)
        after = _verified(task, scene)
        part = candidate.inserted
        if after.verdict is Verdict.REFUTED and part is not None and after.errors[0].subtask == candidate.subtask:
            self.too_late.setdefault(part.name, after.errors[0])
        if not self._helps(mistake, candidate, after) or not self._keeps_goal(candidate, task, scene, after):
            return None
        if _dropped(after) > _dropped(before):
            return None
        fix = replace(draft, proves=bool(after), remaining=len(after.errors), remark=self._remark(part))
        idle = after.trace is not None and bool(after.trace.vacuous)
        worse = idle or candidate.assumption or self._aims_elsewhere(candidate, task, scene, after)
        order = (not fix.proves, worse, int(candidate.cost), mistake.number, candidate.rank)
        return Offer(fix, order, idle)

    def _helps(self, mistake: Mistake, candidate: Candidate, after: Report) -> bool:
        """Decide whether a changed plan is without the mistake, and without new ones."""
        if after.verdict is Verdict.PROVED:
            return True
        if after.verdict is Verdict.CONDITIONAL:
            inserted = candidate.kind == "insert-subtask"
            return self.report.trace is None or rests_on_no_more(self.report, after, inserted=inserted)
        if self.report.trace is None and after.trace is not None:
            # What the plan does could not be followed before, so these mistakes are not new.
            return True
        left = Counter(_keys(self.report))
        left.subtract([_key_of(self.report, mistake)])
        return not Counter(_keys(after)) - left

    def _keeps_goal(self, candidate: Candidate, task: Task, scene: Scene, after: Report) -> bool:
        """Decide whether a default goal still holds after subtasks were added or removed."""
        if task.goal_given or not after or candidate.kind.startswith("change-"):
            return True
        return bool(_verified(replace(task, goal=self.report.task.goal), scene))

    def _aims_elsewhere(self, candidate: Candidate, task: Task, scene: Scene, after: Report) -> bool:
        """Decide whether a change makes the plan one for something else.

        Where no goal is given, another object or condition moves the goal with it. A closed door or a full hand is no
        sign that something else was meant.
        """
        return bool(after) and candidate.kind.startswith("change-") and aims_elsewhere(self.report, task, scene)

    def _remark(self, inserted: SimpleTask | None) -> str:
        """Return why an insertion would not work later in the plan."""
        finding = None if inserted is None else self.too_late.get(inserted.name)
        if finding is None or finding.subtask is None:
            return ""
        last = finding.subtask >= len(self.report.task.subtasks)
        where = "at the end" if last else f"before {numbered(finding.subtask)}"
        return f"not {where}: {finding.message.splitlines()[0].partition(';')[0]}"


def aims_elsewhere(report: Report, task: Task, scene: Scene) -> bool:
    """Decide whether a changed plan without a given goal does not reach what the plan of a report aims at."""
    if task.goal_given or report.trace is None:
        return False
    return not _verified(replace(task, goal=report.task.goal), scene)


def _with_open_flow(candidate: Candidate, report: Report) -> Candidate:
    """Return a candidate that leaves open the flow that was searched for conditions which it changes."""
    edit = candidate.edits[0]
    if len(candidate.edits) > 1 or not isinstance(edit, ChangeSubtask) or edit.subtask not in report.searched:
        return candidate
    if edit.init is None and edit.goal is None:
        return candidate
    bare = replace(edit.apply(report.task).subtasks[edit.subtask], flow=None)
    return replace(candidate, edits=(DeleteSubtask(edit.subtask), InsertSubtask(edit.subtask, bare)))


def _verified(task: Task, scene: Scene) -> Report:
    """Return the report of a changed plan; the missing flow of a subtask is searched."""
    return verify(complete(task, scene).task, scene)


def most_checks(task: Task, steps: int) -> int:
    """Return how many verifications one mistake of a plan is worth, where so many steps may be followed."""
    return min(MOST_CHECKS, max(_FEWEST_CHECKS, steps // (_length(task) + 1)))


def _length(task: Task) -> int:
    return sum(len(subtask.flow or ()) for subtask in task.subtasks)


def _candidates(mistake: Mistake, *, in_turn: bool) -> list[Candidate]:
    """Return all candidates for one mistake, the smallest change first; or the first of each kind, then the second."""
    generators = _GENERATORS[:1] if mistake.finding.code in _UNREADABLE else _GENERATORS
    generated: list[Iterator[Candidate]] = [generator(mistake) for generator in generators]
    if mistake.trace is not None:
        generated.append(step_candidates(mistake))
    found = sorted(
        (candidate for generator in generated for candidate in generator),
        key=lambda candidate: (candidate.cost, candidate.rank),
    )
    if not in_turn:
        return found
    before: Counter[str] = Counter()
    turns: list[int] = []
    for candidate in found:
        turns.append(before[candidate.kind])
        before[candidate.kind] += 1
    return [candidate for _, candidate in sorted(zip(turns, found, strict=True), key=itemgetter(0))]


def _keys(report: Report) -> list[_Key]:
    """Return the identity of each failure, independent of its subtask's position, consequences included."""
    if report.trace is None:
        return [_key_of(report, mistake) for mistake in mistakes(report)]
    failing = (obligation for obligation in report.trace.obligations if obligation.grade is Grade.FAILS)
    return [_key(report, obligation) for obligation in failing]


def _key_of(report: Report, mistake: Mistake) -> _Key:
    if mistake.obligation is not None:
        return _key(report, mistake.obligation)
    finding = mistake.finding
    name = "" if finding.subtask is None else report.task.subtasks[finding.subtask].name
    return finding.code, finding.field, name


def _key(report: Report, obligation: Obligation) -> _Key:
    wrong = [link.condition.text() for link in obligation.links if link.condition.grade(link.value) is False]
    at_goal = obligation.kind == "task-goal"
    return obligation.kind, ", ".join(wrong), "" if at_goal else report.task.subtasks[obligation.subtask].name


def _dropped(report: Report) -> int:
    """Return how many steps drop their target, which no fix may do."""
    steps = () if report.trace is None else report.trace.steps
    targets = [subtask.target for subtask in report.task.subtasks]
    released = (s for s in steps if s.primitive is Primitive.UNGRASP and len(s.effect) == 1)
    return sum(held_by(step.hand) == targets[step.subtask] for step in released)


def rests_on_no_more(before: Report, after: Report, *, inserted: bool) -> bool:
    """Decide whether everything that a changed plan leaves open was open in the plan before it.

    A formula of the plan that was false, or open as a whole, may be met in several ways once a mistake is removed. It
    then rests on some of its literals. These do not count, as long as no step of either plan writes such a literal. A
    change that removes the step that writes it, and then assumes it, repairs nothing. One that only inserts a subtask
    may need more facts of the start than the rest.
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
    spoken = list(_facts_of_formulas(before))
    return all(
        any(overlap(fact, other) for other in spoken) and not any(overlap(fact, other) for other in written)
        for fact in facts
    )


def _facts_of_formulas(report: Report) -> Iterator[Fact]:
    """Yield the facts of conditions that are no conjunctions of literals; `*` stands for a variable."""
    task, names = report.task, {*report.scene.objects, GRIPPER}
    for formula in (task.goal, *(side for part in task.subtasks for side in (part.init, part.goal))):
        if bddl.literals(formula) is None:
            for atom in bddl.atoms(formula):
                yield (atom.predicate, *(name if name in names else ANY for name in atom.args))


# Most mistakes for which fixes are searched, the first ones.
_MOST_CAUSES = 10
# Most fixes that together repair a plan with several mistakes.
_MOST_TOGETHER = 20
# Most steps that are followed in that search: in a long plan fewer fixes are tried.
_MOST_STEPS_TOGETHER = 15_000


def find_fixes(report: Report) -> tuple[Fix, ...]:
    """Return the verified repairs of a refuted plan: those that make it PROVED first, the smallest change first.

    There are at most `MOST_FIXES` for each error, each of another kind. Where no single change proves a plan with
    several mistakes, the first fix removes them all.
    """
    found = mistakes(report)[:_MOST_CAUSES]
    most = most_checks(report.task, _MOST_STEPS_FOLLOWED // max(len(found), 1))
    offered = [offer for mistake in found for offer in FixSearch(report, most).offers(mistake)]
    offered.sort(key=lambda offer: offer.order)
    fixes = list(_distinct(report, (offer.fix for offer in offered)))
    if any(fix.proves for fix in fixes):
        return tuple(fixes)
    parts = _together(report, fixes)
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
    return (whole, *_distinct(report, _alone(report, parts, fixes)))


def _distinct(report: Report, fixes: Iterable[Fix]) -> Iterator[Fix]:
    """Yield the fixes without those that lead to the same plan as an earlier one."""
    visited: list[tuple[Task, Scene]] = []
    for fix in fixes:
        repaired = fix.apply(report.task), fix.apply_to_scene(report.scene)
        if repaired not in visited:
            visited.append(repaired)
            yield fix


def _together(report: Report, fixes: list[Fix]) -> list[Fix]:
    """Return fixes that remove several mistakes one after the other; empty when they do not prove the plan."""
    chosen: list[Fix] = []
    task, scene, left = report.task, report.scene, _MOST_STEPS_TOGETHER
    for _ in range(_MOST_TOGETHER):
        if not fixes:
            return []
        chosen.append(fixes[0])
        task, scene = fixes[0].apply(task), fixes[0].apply_to_scene(scene)
        current = _verified(task, scene)
        if current:
            # Each change keeps what the plan before it aims at; all of them have to keep what the given one does.
            elsewhere = aims_elsewhere(report, task, scene)
            return [] if elsewhere else chosen
        if current.verdict is not Verdict.REFUTED:
            return []
        found = mistakes(current)
        search = FixSearch(current, most_checks(task, left // len(found)))
        fixes = [offer.fix for offer in search.offers(found[0])]
        left -= search.checks * _length(task)
        if left < 0:
            return []
    return []


def _alone(report: Report, parts: list[Fix], fixes: list[Fix]) -> Iterator[Fix]:
    """Yield for every mistake the part that removes it together with the others, else the fixes for it alone."""
    for mistake in mistakes(report):
        for part in parts:
            edits = Candidate(0, part.kind, part.summary, part.edits, part.subtask, part.step)
            offer = FixSearch(report).checked(mistake, edits) if _fits(report, part) else None
            if offer is not None:
                yield offer.fix
                break
        else:
            yield from (fix for fix in fixes if fix.cause == mistake.number)


def _fits(report: Report, part: Fix) -> bool:
    """Decide whether a fix that was made for a changed plan can be applied to the plan itself."""
    try:
        part.apply(report.task)
    except FixError:
        return False
    return True
