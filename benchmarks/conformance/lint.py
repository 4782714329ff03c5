"""What the analyser finds in the corpus, kind by kind, beside what is known to be there.

The known findings were counted apart from the analyser, and each was looked at.
`behavior-compat` is used, so that the two activities that are no legal BDDL are examined too.
"""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Mapping
from types import MappingProxyType

import bddl
from benchmarks.conformance.context import Context, Measure, Result

# By code: how many findings, in how many activities.
KNOWN: Mapping[str, tuple[int, int]] = MappingProxyType(
    {
        "impossible-goal": (1, 1),
        "goal-holds-at-start": (1, 1),
        "unused-variable": (13, 12),
        "shadowed-variable": (1, 1),
        "mixed-instance": (22, 17),
        "reflexive-atom": (16, 11),
        "swapped-roles": (1, 1),
        "repeated-object": (2, 1),
        "repeated-literal": (8, 5),
        "several-formulas": (1, 1),
        "bad-section": (1, 1),
        "idle-real": (29, 15),
        "counted-wildcard": (19, 14),
        "unchecked-goal": (14, 14),
    }
)
# Of kinds with one or two, the very activities.
NAMED: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "impossible-goal": frozenset({"stacking_wood"}),
        "goal-holds-at-start": frozenset({"clean_a_stainless_steel_dishwasher"}),
        "shadowed-variable": frozenset({"clean_snap_peas"}),
        "swapped-roles": frozenset({"clearing_table_after_breakfast"}),
        "repeated-object": frozenset({"passing_out_drinks"}),
        "several-formulas": frozenset({"loading_the_car"}),
        "bad-section": frozenset({"wash_a_baseball_cap"}),
    }
)


def check_lint(context: Context) -> Result:
    """Run the analyser over the corpus and compares what it finds with what is known."""
    names = sorted(context.corpus)
    if context.quick:
        names = sorted({*names[::20], *(name for known in NAMED.values() for name in known)})
    found: dict[str, dict[str, int]] = defaultdict(dict)
    begin = time.perf_counter()
    for name in names:
        counts = Counter(item.code for item in bddl.analyse(context.corpus[name], "behavior-compat"))
        for code, count in counts.items():
            found[code][name] = count
    seconds = time.perf_counter() - begin
    measures = [
        _measure(code, found.get(code, {}), whole=not context.quick)
        for code in sorted({*KNOWN, *found}, key=list(bddl.CODES).index)
    ]
    measures.append(Measure(f"{len(names)} activities read and examined, z3 included", f"{seconds:.2f} s"))
    return Result(tuple(measures), {"findings": {code: dict(where) for code, where in found.items()}})


def _measure(code: str, where: Mapping[str, int], *, whole: bool) -> Measure:
    """Return the figure of one kind; a sample is compared by name only."""
    findings, activities = KNOWN.get(code, (0, 0))
    named = NAMED.get(code)
    holds = named is None or set(where) == named
    if whole:
        holds = holds and (sum(where.values()), len(where)) == (findings, activities)
    names = f": {', '.join(sorted(where))}" if 0 < len(where) <= 2 else ""
    return Measure(
        code,
        f"{sum(where.values())} in {len(where)}{names}",
        "",
        f"{findings} in {activities}" if whole else "",
        holds,
    )
