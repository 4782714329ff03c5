"""Compatible mode on damaged activities: it accepts what the reference accepts, and reads it as the reference does."""

from __future__ import annotations

from typing import Any

import bddl
from benchmarks.conformance.context import Context, Measure, Result
from benchmarks.conformance.mutants import mutants
from benchmarks.conformance.reading import as_reference, without_marks

STEP = 10
QUICK_STEP = 100


def check_tolerance(context: Context) -> Result:
    """Mutates some activities and compares what compatible mode and the reference make of them."""
    step = QUICK_STEP if context.quick else STEP
    tried = both = 0
    narrower: list[str] = []
    wider: list[str] = []
    unequal: list[str] = []
    for name, text in list(context.legal.items())[::step]:
        for mutant in mutants(name, text, context.seed):
            tried += 1
            theirs: Any = context.peer.ask("judge", activity=name, text=mutant.text)
            ours = _read(mutant.text)
            where = f"{mutant.kind}, {name}"
            if ours is None and theirs["compile"]:
                narrower.append(where)
            elif ours is not None and not theirs["compile"]:
                wider.append(where)
            elif ours is not None:
                both += 1
                if as_reference(ours) != without_marks(context.peer.ask("read", text=mutant.text)):
                    unequal.append(where)
    return Result(
        (
            Measure(
                f"of {tried} mutants rejected that the reference accepts",
                str(len(narrower)),
                goal="0",
                holds=not narrower,
            ),
            Measure(f"of {both} that both accept, read otherwise", str(len(unequal)), goal="0", holds=not unequal),
            Measure("accepted that the reference rejects", str(len(wider))),
        ),
        {"rejected": narrower, "read_otherwise": unequal, "accepted_alone": wider},
    )


def _read(text: str) -> bddl.Problem | None:
    try:
        return bddl.parse(text, profile="behavior-compat")
    except bddl.BDDLError:
        return None
