"""Case distinctions: why something holds, or fails, whichever values some unknown facts have.

A distinction is a list in preorder: an unknown fact stands before the case in which it is true and the case in which
it is false, and None ends a case. Three-valued evaluation decides each case, so that anybody can check it.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

from oag.model.facts import Fact, Value
from oag.table.invariants import excluded
from oag.table.library import Needed
from oag.table.state import Reader, truth_of

CaseTree: TypeAlias = tuple[Fact | None, ...]
# A distinction with more entries than this is not listed; the solver's word then stands alone.
LARGEST_TREE = 10_000
# So many facts are looked at for one distinction, which is some seconds: each case evaluates the whole formula.
MOST_READS = 300_000
TOO_MANY_CASES: CaseTree = ()


def case_tree(
    wanted: Needed, read: Reader, objects: Mapping[str, str], largest: int = LARGEST_TREE
) -> tuple[bool, CaseTree] | None:
    """Returns the value that clauses or a formula have in every case, with the cases.

    Args:
        read: What is known; None for unknown.
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
        truth, unknown = _truth(wanted, counted, objects)
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


def _truth(wanted: Needed, read: Reader, objects: Mapping[str, str]) -> tuple[bool | None, Fact | None]:
    """Returns whether something holds as far as is known, and the first unknown fact on which that depends."""
    unknown: list[Fact] = []

    def noting(fact: Fact) -> Value:
        value = read(fact)
        if value is None:
            unknown.append(fact)
        return value

    if not isinstance(wanted, tuple):
        truth = truth_of(wanted, noting, objects)
    else:
        truth = truth_of(wanted, read, objects)
        undecided = next((clause for clause in wanted if truth_of((clause,), read, objects) is None), ())
        truth_of((undecided,), noting, objects)
    return truth, unknown[0] if unknown else None


def _with(read: Reader, case: dict[Fact, bool]) -> Reader:
    return lambda fact: case[fact] if fact in case else read(fact)
