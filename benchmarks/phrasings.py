"""What the offline planner makes of the phrasings, family by family, the held-out ones apart.

    python -m benchmarks.phrasings

Columns:

    goals       phrasings that should give a goal
    right       of them, the goal is the intended one
    proved      of these, the plan is PROVED in its scene
    refused     of the goals, refused
    refusals    phrasings that should be refused
    clear       of them, refused, and with the code that says why
    wrong       plans for something else than what was meant: another goal, or any goal where none was meant
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

import llm
import oag
from tests.llm.kitchens import FAMILIES, LATER, ORDINARY, SCENES, STRANGERS, Phrasing, conjuncts

COLUMNS = ("goals", "right", "proved", "refused", "refusals", "clear", "wrong")


def judged(phrasing: Phrasing) -> tuple[str, ...]:
    """Return the columns that a phrasing counts in."""
    kind = "goals" if phrasing.goal is not None else "refusals"
    try:
        task = llm.propose(phrasing.query, SCENES[phrasing.scene]).task
    except llm.QueryError as error:
        if phrasing.goal is not None:
            return kind, "refused"
        # "refuse" stands for any code.
        return (kind, "clear") if phrasing.refuse in (error.code, "refuse") else (kind,)
    if conjuncts(task.goal) != phrasing.wanted:
        return kind, "wrong"
    proved = oag.compose(task).verify().verdict is oag.Verdict.PROVED
    return (kind, "right", "proved") if proved else (kind, "right")


def counted(phrasings: Iterable[Phrasing]) -> dict[str, Counter[str]]:
    """Return the columns by family."""
    table: dict[str, Counter[str]] = {}
    for phrasing in phrasings:
        table.setdefault(phrasing.family, Counter()).update(judged(phrasing))
    return table


def printed(title: str, table: Mapping[str, Counter[str]]) -> None:
    """Print a table with its sums."""
    rows: Sequence[tuple[str, Counter[str]]] = (*table.items(), ("together", sum(table.values(), Counter())))
    print(f"{title:<24}" + "".join(f"{column:>10}" for column in COLUMNS))
    for family, counts in rows:
        print(f"{family:<24}" + "".join(f"{counts[column]:>10}" for column in COLUMNS))
    print()


if __name__ == "__main__":
    tables = {
        "seen": counted(phrasing for phrasing in FAMILIES if not phrasing.held_out),
        "held out": counted(phrasing for phrasing in FAMILIES if phrasing.held_out),
        "written later": counted(LATER),
        "strangers": counted(STRANGERS),
        "ordinary": counted(ORDINARY),
    }
    for name, found in tables.items():
        printed(name, found)
    sys.exit(any(counts["wrong"] for found in tables.values() for counts in found.values()))
