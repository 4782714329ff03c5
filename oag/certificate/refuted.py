"""Why no run of a refuted plan gets past its failure, in the form that `recheck` reads.

What the plan itself forces is taken for given. Where that is not enough, cases are distinguished of the plan as a
whole: in each of them something that the plan needs, up to the failure, is false.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import NamedTuple

from bddl.semantics.members import spelled_out
from oag.model.facts import Fact
from oag.progression.compiled import CompiledSubtask
from oag.table.invariants import converse, excluded, with_consequences
from oag.table.library import Needed
from oag.table.state import State, facts_of, step, truth_of

# Entries that a distinction may have times places that the plan has: following it for each case takes so long.
_MOST_WORK = 200_000
# So many parts of a formula take as long as a place.
_PARTS_A_PLACE = 20

# Kind, subtask and step of what is needed.
Place = tuple[str, int, int]
# What something unknown has for a value: a time, a fact, and the value.
Given = tuple[int, Fact, bool]
# A case that is distinguished: a time and a fact that is unknown then, or None where a case ends.
Split = tuple[int, Fact] | None


class _Impossible(Exception):
    """What is taken for given breaks an invariant, so that no state is meant."""


@dataclass(frozen=True, slots=True)
class RefutedPlan:
    """A plan that fails, as its certificate has it.

    Attributes:
        subtasks: Its subtasks.
        goal: The task goal.
        start: What the scene states and, of what the reset supplies, the plan uses.
        objects: Category of each object.
        failure: The place that fails; where it is one without a flow, a search shows that it fails.
    """

    subtasks: tuple[CompiledSubtask, ...]
    goal: Needed
    start: State
    objects: Mapping[str, str]
    failure: Place


class Refutation(NamedTuple):
    """What shows that a place fails in every run.

    Attributes:
        forced: What is assumed on the way, each forced by a place at its time.
        cases: The cases in preorder; None when none are needed, empty when there are too many to list.
    """

    forced: tuple[Given, ...]
    cases: tuple[Split, ...] | None


def refutation(plan: RefutedPlan, candidates: Iterable[Given]) -> Refutation:
    """Returns why no run of a plan gets past its failure.

    Args:
        plan: The plan.
        candidates: What was assumed on the way, in order; some of it may be a choice, which shows nothing.
    """
    run, left = _Run(plan), list(candidates)
    forced: list[Given] = []
    for place, wanted in run.places():
        while left and left[0][0] < run.time:
            del left[0]
        for given in [*takewhile(lambda given: given[0] == run.time, left)]:
            if run.state.value(given[1]) is None and run.forces(wanted, given[1], given[2]):
                run.take(*given)
                forced.append(given)
                left.remove(given)
        if place == plan.failure:
            if place[0] == "no-flow" or truth_of(wanted, run.state.value, plan.objects) is False:
                return Refutation(tuple(forced), None)
            break
    return Refutation((), _cases(plan))


class _Run:
    """A plan followed from its start, with some of what is unknown taken for given.

    Attributes:
        state: What is known where it stands.
        time: When that is; what is written at an earlier time counts.
    """

    def __init__(self, plan: RefutedPlan, given: Iterable[Given] = ()) -> None:
        self.state, self.time = plan.start, 1
        self._plan = plan
        # Of one time, what stands first is taken first: what comes later may follow from it, not the other way round.
        self._given = sorted(given, key=lambda entry: entry[0])

    def places(self) -> Iterator[tuple[Place, Needed]]:
        """Yields what is needed where, in order, up to a subtask without a flow, whose place is called so."""
        for index, subtask in enumerate(self._plan.subtasks):
            self._take_due()
            yield ("init", index, -1), subtask.init
            if subtask.flow is None:
                yield ("no-flow", index, -1), subtask.goal
                return
            for position, action in enumerate(subtask.flow):
                self._take_due()
                wanted = subtask.rows.row(action.primitive, self.state.hand, action.parameter)[0]
                if wanted:
                    yield ("precondition", index, position), wanted
                _, self.state = step(self.state, subtask.rows, action.primitive, action.parameter, self.time + 1)
                self.time += 2
            self._take_due()
            yield ("goal", index, -1), subtask.goal
        self._take_due()
        yield ("task-goal", len(self._plan.subtasks), -1), self._plan.goal

    def take(self, time: int, fact: Fact, value: bool) -> None:
        """Takes something unknown for given; raises _Impossible when it breaks an invariant."""
        if value and excluded(fact, self.state.value):
            raise _Impossible
        self.state = self.state.after(with_consequences(fact, value), time)

    def forces(self, wanted: Needed, fact: Fact, value: bool) -> bool:
        """Decides whether clauses or a formula can only hold here if a fact has a value."""
        otherwise = self.state.after(with_consequences(fact, not value), self.time)
        return truth_of(wanted, otherwise.value, self._plan.objects) is False

    def _take_due(self) -> None:
        while self._given and self._given[0][0] <= self.time:
            self.take(*self._given.pop(0))


def _cases(plan: RefutedPlan) -> tuple[Split, ...]:
    """Returns cases in each of which a place up to the failure is false; none when they are too many."""
    tree: list[Split] = []
    pending: list[tuple[Given, ...]] = [()]
    work = 0
    while pending:
        case = pending.pop()
        found, places = _look(plan, case)
        work += places
        if found == () or work > _MOST_WORK:
            return ()
        tree.append(found or None)
        if found:
            pending += [(*case, (*found, value)) for value in (False, True)]
    return tuple(tree)


def _look(plan: RefutedPlan, case: tuple[Given, ...]) -> tuple[Split | tuple[()], int]:
    """Returns what to distinguish next in a case, and how many places were looked at.

    That is None when a place is false, or the case impossible; and () when nothing is left to distinguish. Preferred is
    what the failing place speaks of, then what stands in one place with what was distinguished before.
    """
    run, places = _Run(plan, case), 0
    split = {fact for _, fact, _ in case}
    split |= {other for fact in split if (other := converse(fact)) is not None}
    tied: tuple[int, Fact] | None = None
    try:
        for place, wanted in run.places():
            places += 1
            truth = truth_of(wanted, run.state.value, plan.objects)
            if not isinstance(wanted, tuple):
                # A formula takes as long as it has parts, of which a quantifier makes many.
                places += spelled_out(wanted, plan.objects, _MOST_WORK) // _PARTS_A_PLACE
            if truth is False:
                return None, places
            facts = facts_of(wanted, plan.objects) if truth is None and (tied is None or place == plan.failure) else ()
            entries = [(fact, run.state.read(fact)) for fact in facts]
            unknown = [(max(entry.time, 0), fact) for fact, entry in entries if entry.value is None]
            if place == plan.failure:
                return unknown[0] if unknown else tied or (), places
            if unknown and tied is None and not split.isdisjoint(facts):
                tied = unknown[0]
    except _Impossible:
        return None, places
    return (), places
