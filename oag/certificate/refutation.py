"""Why no run of a refuted plan gets past its failure, in the form that `recheck` reads.

What the plan itself forces is taken for given. Where that is not enough, cases are distinguished of the plan as a
whole: in each of them something that the plan needs, up to the failure, is false.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import takewhile
from typing import Any, NamedTuple

from bddl.semantics.members import spelled_out
from oag.checker.cases import Place, truth_of
from oag.checker.plan import Given, Impossible, PlanRun
from oag.checker.refutation import forced_by
from oag.model.facts import Fact
from oag.table.invariants import converse
from oag.table.state import facts_of

# Entries that a distinction may have times places that the plan has: following it for each case takes so long.
_MOST_WORK = 200_000
# So many parts of a formula take as long as a place.
_PARTS_A_PLACE = 20

# A case that is distinguished: a time and a fact that is unknown then, or None where a case ends.
Split = tuple[int, Fact] | None


class Refutation(NamedTuple):
    """What shows that a place fails in every run.

    Attributes:
        forced: What is assumed on the way, each forced by a place at its time.
        cases: The cases in preorder; None when none are needed, empty when there are too many to list.
    """

    forced: tuple[Given, ...]
    cases: tuple[Split, ...] | None


def refutation(data: Mapping[str, Any], stop: Place, candidates: Iterable[Given]) -> Refutation:
    """Returns why no run gets past a place.

    Args:
        data: Plan, scene and reset, as certificates have them.
        stop: The place that fails; where it is one without a flow, a search shows that it fails.
        candidates: What was assumed on the way, in order; some of it may be a choice, which shows nothing.
    """
    objects, run, left = data["scene"]["objects"], PlanRun(data), list(candidates)
    forced: list[Given] = []
    for place, wanted in run.places():
        while left and left[0][0] < run.time:
            del left[0]
        for given in [*takewhile(lambda given: given[0] == run.time, left)]:
            if run.last(given[1])[1] is None and forced_by(wanted, given[1], given[2], run.value, objects):
                run.take(*given)
                forced.append(given)
                left.remove(given)
        if place == stop:
            if place[0] == "no-flow" or truth_of(wanted, run.value, objects) is False:
                return Refutation(tuple(forced), None)
            break
    return Refutation((), _cases(data, stop))


def _cases(data: Mapping[str, Any], stop: Place) -> tuple[Split, ...]:
    """Returns cases in each of which a place up to the failure is false; none when they are too many."""
    tree: list[Split] = []
    pending: list[tuple[Given, ...]] = [()]
    work = 0
    while pending:
        case = pending.pop()
        found, places = _look(data, stop, case)
        work += places
        if found == () or work > _MOST_WORK:
            return ()
        tree.append(found)
        if found is not None:
            pending += [(*case, (*found, value)) for value in (False, True)]
    return tuple(tree)


def _look(data: Mapping[str, Any], stop: Place, case: tuple[Given, ...]) -> tuple[Any, int]:
    """Returns what to distinguish next in a case, and how many places were looked at.

    That is None when a place is false, or the case impossible; and () when nothing is left to distinguish. Preferred is
    what the failing place speaks of, then what stands in one place with what was distinguished before.
    """
    objects, run, places = data["scene"]["objects"], PlanRun(data, case), 0
    split = {fact for _, fact, _ in case}
    split |= {other for fact in split if (other := converse(fact)) is not None}
    tied: tuple[int, Fact] | None = None
    try:
        for place, wanted in run.places():
            places += 1
            truth = truth_of(wanted, run.value, objects)
            if not isinstance(wanted, tuple):
                # A formula takes as long as it has parts, of which a quantifier makes many.
                places += spelled_out(wanted, objects, _MOST_WORK) // _PARTS_A_PLACE
            if truth is False:
                return None, places
            facts = facts_of(wanted, objects) if truth is None and (tied is None or place == stop) else ()
            unknown = [(max(run.last(fact)[0], 0), fact) for fact in facts if run.last(fact)[1] is None]
            if place == stop:
                return unknown[0] if unknown else tied or (), places
            if unknown and tied is None and not split.isdisjoint(facts):
                tied = unknown[0]
    except Impossible:
        return None, places
    return (), places
