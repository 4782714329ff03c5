"""What certificates need beyond links: three-valued truth, and distinctions of cases at one place.

Part of the independent check: it knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import bddl
from oag.model.facts import ANY, ROBOT_FACTS, Fact, Value, condition_of
from oag.table.invariants import excluded
from oag.table.library import Needed

# Kind, subtask and step of what is needed.
Place = tuple[str, int, int]
# Facts that are looked at for one distinction of cases; what writes certificates gives up before.
MOST_READS = 400_000
Reader = Callable[[Fact], Value]


class Rejected(Exception):
    """The certificate does not bear out its verdict."""


def require(condition: bool, reason: str) -> None:
    """Raises Rejected with a reason unless a condition is met."""
    if not condition:
        raise Rejected(reason)


def truth_of(wanted: Needed, read: Reader, objects: Mapping[str, str]) -> bool | None:
    """Returns whether clauses or a formula hold for what a reader knows; None when that does not decide it."""
    if not isinstance(wanted, tuple):

        def known(atom: bddl.Atom) -> bool | None:
            condition = condition_of(atom, True)
            return condition.grade(read(condition.fact))

        return bddl.evaluate(wanted, known, objects)
    grades = [[condition.grade(read(condition.fact)) for condition in clause] for clause in wanted]
    if any(all(grade is False for grade in clause) for clause in grades):
        return False
    return all(True in clause for clause in grades) or None


def truth_by_cases(wanted: Needed, tree: list[Any], read: Reader, objects: Mapping[str, str]) -> bool | None:
    """Returns the one value that clauses or a formula have in every case of a distinction.

    Args:
        wanted: What is needed.
        tree: The cases in preorder: an unknown fact stands before its case true and its case false, null ends a case.
        read: What is known.
        objects: Category of each object.

    Raises:
        Rejected: A fact that is known is distinguished, or one that is not true or false; a case is missing; or the
            cases disagree.
    """
    reads = 0

    def counted(fact: Fact) -> Value:
        nonlocal reads
        reads += 1
        return read(fact)

    pending: list[dict[Fact, bool] | None] = [{}]
    results: set[bool | None] = set()
    for split in tree:
        require(bool(pending), "a case distinction has too many cases")
        case = pending.pop()
        if split is not None:
            fact = tuple(split)
            two_cases = fact not in ROBOT_FACTS and ANY not in fact
            require(two_cases, f"{fact} is the robot's, or a pattern: it has no two cases")
            known = with_values(read, case or {})
            require(known(fact) is None, f"{fact} is known, and cases of it are distinguished")
            pending.append(None if case is None else {**case, fact: False})
            # None stands for a case that no state is in.
            pending.append(None if case is None or excluded(fact, known) else {**case, fact: True})
        elif case is not None:
            results.add(truth_of(wanted, with_values(counted, case), objects))
            require(reads <= MOST_READS, "a case distinction takes too long to look at")
    require(not pending and len(results) == 1, "the cases of a distinction disagree, or one is missing")
    return results.pop()


def with_values(read: Reader, case: Mapping[Fact, Value]) -> Reader:
    """Returns a reader to whom some facts have other values: those of a case, or None for what is not to be used."""
    return lambda fact: case[fact] if fact in case else read(fact)
