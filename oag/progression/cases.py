"""Case distinctions: why something holds, or fails, whichever values some unknown facts have.

A distinction is a list in preorder: an unknown fact stands before the case in which it is true and the case in which
it is false, and None ends a case. Three-valued evaluation decides each case, so that anybody can check it.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import bddl
from oag.model.facts import Fact, Value, condition_of
from oag.table.invariants import excluded
from oag.table.library import Needed

CaseTree: TypeAlias = tuple[Fact | None, ...]
# A distinction with more entries than this is not listed; the solver's word then stands alone.
LARGEST_TREE = 10_000
# So many facts are looked at for one distinction, which is some seconds: each case evaluates the whole formula.
MOST_READS = 300_000
TOO_MANY_CASES: CaseTree = ()

_Reader = Callable[[Fact], Value]


def case_tree(
    wanted: Needed, read: _Reader, objects: Mapping[str, str], largest: int = LARGEST_TREE
) -> tuple[bool, CaseTree] | None:
    """Returns the value that clauses or a formula have in every case, with the cases.

    Args:
        wanted: What is needed.
        read: What is known; None for unknown.
        objects: Categories of the scene's objects.
        largest: The most entries that a distinction may have.

    Returns:
        The value and its cases; None when the cases do not agree, or are too many, or take too long to look at.
    """
    reads = 0

    def counted(fact: Fact) -> Value:
        nonlocal reads
        reads += 1
        return known(fact)

    tree: list[Fact | None] = []
    result: bool | None = None
    pending: list[dict[Fact, bool] | None] = [{}]
    while pending:
        if len(tree) + len(pending) > largest or reads > MOST_READS:
            return None
        case = pending.pop()
        if case is None:
            tree.append(None)
            continue
        known = _with(read, case)
        truth, unknown = truth_of(wanted, counted, objects)
        if truth is not None:
            if result not in (None, truth):
                return None
            result = truth
            tree.append(None)
        elif unknown is None:
            return None
        else:
            tree.append(unknown)
            pending.append({**case, unknown: False})
            # None stands for a case that the invariants rule out.
            pending.append(None if excluded(unknown, known) else {**case, unknown: True})
    return None if result is None else (result, tuple(tree))


def truth_of(wanted: Needed, read: _Reader, objects: Mapping[str, str]) -> tuple[bool | None, Fact | None]:
    """Returns whether clauses or a formula hold as far as is known, and the first unknown fact that was looked at."""
    unknown: list[Fact] = []

    def known(atom: bddl.Atom) -> bool | None:
        condition = condition_of(atom, True)
        truth = condition.grade(read(condition.fact))
        if truth is None:
            unknown.append(condition.fact)
        return truth

    if isinstance(wanted, tuple):
        truth = _truth_of_clauses(wanted, read, unknown)
    else:
        truth = bddl.evaluate(wanted, known, objects)
    return truth, unknown[0] if unknown else None


def _truth_of_clauses(wanted: Needed, read: _Reader, unknown: list[Fact]) -> bool | None:
    """Returns whether all clauses hold, and adds what was unknown in those that are open."""
    result: bool | None = True
    for clause in wanted if isinstance(wanted, tuple) else ():
        grades = {condition.fact: condition.grade(read(condition.fact)) for condition in clause}
        if True in grades.values():
            continue
        if None not in grades.values():
            return False
        result = None
        unknown.extend(fact for fact, grade in grades.items() if grade is None)
    return result


def _with(read: _Reader, case: dict[Fact, bool]) -> _Reader:
    """Returns a reader to whom the facts of a case are known as well."""
    return lambda fact: case[fact] if fact in case else read(fact)
