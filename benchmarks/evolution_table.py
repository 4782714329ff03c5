"""The tables of the benchmark of self-evolution, as Markdown: by task beside the paper's rows, by fault, by both."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from benchmarks.evolution_episode import FAULTS, SCENES
from oag.measurements import clopper_pearson

# Source: the paper's main table, in percent: primitive-only, and with self-evolution.
PAPER = {"T1": (0, 40), "T2": (0, 30), "T3": (40, 70), "T4": (0, 70)}

Results = Sequence[dict[str, Any]]


def tables(results: Results) -> Iterator[str]:
    """Yield the lines of all tables.

    An episode up to its first revision is what it is without evolution, so that one run gives both columns.
    """
    if not results:
        yield "no episodes yet"
        return
    yield from _table(
        ["task", "paper", *_HEAD], [[task, _paper(task), *_cells(_of(results, task=task))] for task in _tasks(results)]
    )
    yield ""
    yield from _table(
        ["fault", *_HEAD],
        [[kind, *_cells(_of(results, fault=kind))] for kind in FAULTS if _of(results, fault=kind)],
    )
    yield ""
    pairs = [(task, kind) for task in _tasks(results) for kind in FAULTS if _of(results, task=task, fault=kind)]
    yield from _table(
        ["task", "fault", *_HEAD],
        [[task, kind, *_cells(_of(results, task=task, fault=kind))] for task, kind in pairs],
    )
    yield from _failures(results)


_HEAD = (
    "n",
    "primitive-only",
    "with evolution",
    "revisions",
)


def _cells(results: Results) -> list[str]:
    return [
        str(len(results)),
        _share([result["before"] for result in results]),
        _share([result["after"] for result in results]),
        _revisions(results),
    ]


def _revisions(results: Results) -> str:
    """Return the mean number of revisions of the episodes that succeeded, and of those that needed any."""
    counts = [result["revisions"] for result in results if result["after"]]
    if not counts:
        return "-"
    some = [count for count in counts if count]
    mean = f"{sum(counts) / len(counts):.2f}"
    return f"{mean}; {sum(some) / len(some):.2f} where any ({len(some)})" if some else mean


def _share(outcomes: Sequence[bool]) -> str:
    if not outcomes:
        return "-"
    low, high = clopper_pearson(sum(outcomes), len(outcomes))
    percent = 100 * sum(outcomes) / len(outcomes)
    return f"{percent:.0f} %, {sum(outcomes)} of {len(outcomes)} [{100 * low:.0f}, {100 * high:.0f}]"


def _paper(task: str) -> str:
    before, after = PAPER[task]
    return f"{before} % to {after} %"


def _failures(results: Results) -> Iterator[str]:
    reasons = Counter(
        (
            result["task"],
            result["fault"],
            (result["gave_up"] or {}).get("cause", "") or "no cause found",
            (result["gave_up"] or {}).get("needed", ""),
        )
        for result in results
        if not result["after"]
    )
    if reasons:
        yield ""
    for (task, kind, cause, needed), count in sorted(reasons.items()):
        beyond = f"; no flow corrects it, it would take {needed}" if needed else ""
        yield f"not solved: {task} {kind}: {count} x {cause}{beyond}"


def _tasks(results: Results) -> list[str]:
    return [task for task in sorted(SCENES) if _of(results, task=task)]


def _of(results: Results, **wanted: str) -> Results:
    return [result for result in results if all(result[key] == value for key, value in wanted.items())]


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(head)} |"
    yield f"|{'---|' * len(head)}"
    yield from (f"| {' | '.join(row)} |" for row in rows)
