"""M: single-edit mutants, how many are accepted, and whether the first diagnostic stands where the edit was made."""

from __future__ import annotations

from collections import Counter
from typing import Any

import bddl
from benchmarks.conformance.context import Context, Measure, Result
from benchmarks.conformance.libero_mutants import libero_measures
from benchmarks.conformance.mutants import OMISSIONS, Mutant, mutants

MOST_ACCEPTED = 0.005
LEAST_LOCATED = 0.95
# In a quick run only every so many activities are mutated.
QUICK_STEP = 25


def check_mutants(context: Context) -> Result:
    """Mutates every legal activity in every way that it allows, and asks strict mode and the reference about it."""
    counts: dict[str, Counter[str]] = {}
    accepted: list[dict[str, object]] = []
    elsewhere: list[dict[str, object]] = []
    escaped: list[str] = []
    verified = _verified(context)
    for position, (name, text) in enumerate(context.legal.items()):
        if context.quick and position % QUICK_STEP:
            continue
        for mutant in mutants(name, text, context.seed):
            count = counts.setdefault(mutant.kind, Counter())
            count["n"] += 1
            found = _first_error(mutant, escaped)
            if found is None:
                count["accepted"] += 1
                accepted.append({"kind": mutant.kind, "activity": name})
            elif found.line in mutant.lines:
                count["located"] += 1
            else:
                elsewhere.append(
                    {
                        "kind": mutant.kind,
                        "activity": name,
                        "lines": mutant.lines,
                        "line": found.line,
                        "code": found.code,
                    }
                )
            theirs: Any = context.peer.ask("judge", activity=name, text=mutant.text)
            count["reference_parses"] += theirs["parse"]
            count["reference_accepts"] += theirs["compile"]
            if name in verified:
                count["verifiable"] += 1
                count["reference_verifies"] += theirs["verify"]
    total = sum(counts.values(), Counter[str]())
    theirs_too = _libero_texts(context)
    measures, found_there = libero_measures(theirs_too, context.seed) if theirs_too else ((), {})
    return Result(
        (*_measures(total, counts, escaped), *measures),
        {
            "seed": context.seed,
            "kinds": {kind: dict(count) for kind, count in counts.items()},
            "total": dict(total),
            "activities_that_pass_verification": len(verified),
            "accepted": accepted,
            "elsewhere": elsewhere,
            "escaped": escaped,
            "libero": found_there,
        },
    )


def _measures(total: Counter[str], counts: dict[str, Counter[str]], escaped: list[str]) -> tuple[Measure, ...]:
    n = total["n"]
    omitted: Counter[str] = sum((counts[kind] for kind in OMISSIONS if kind in counts), Counter())
    present, located = n - omitted["n"], total["located"] - omitted["located"]
    verifies = total["reference_verifies"] / max(1, total["verifiable"])
    return (
        Measure(
            f"of {n} mutants accepted",
            f"{total['accepted'] / n:.2%}",
            f"{total['reference_accepts'] / n:.1%}; with its verification {verifies:.1%}",
            f"at most {MOST_ACCEPTED:.1%}",
            total["accepted"] / n <= MOST_ACCEPTED,
        ),
        Measure(
            "first diagnostic on a mutated line",
            f"{total['located'] / n:.2%}",
            "no places",
            f"at least {LEAST_LOCATED:.0%}",
            total["located"] / n >= LEAST_LOCATED,
        ),
        Measure("the same, omitted lines left out", f"{located / max(1, present):.2%}", "no places"),
        Measure("exceptions of another type", str(len(escaped)), goal="0", holds=not escaped),
    )


def _libero_texts(context: Context) -> dict[str, str]:
    """Return LIBERO's files below the folder that was given, in a quick run every so many."""
    paths = sorted(context.libero.rglob("*.bddl")) if context.libero is not None else []
    return {str(path): path.read_text(encoding="utf-8") for path in paths[:: QUICK_STEP if context.quick else 1]}


def _verified(context: Context) -> frozenset[str]:
    """Return the activities that pass the reference's own verification as they are."""
    judged: dict[str, Any] = {
        name: context.peer.ask("judge", activity=name, text=text) for name, text in context.legal.items()
    }
    return frozenset(name for name, found in judged.items() if found["verify"])


def _first_error(mutant: Mutant, escaped: list[str]) -> bddl.Diagnostic | None:
    """Return the first diagnostic of strict mode that is an error, or None when the mutant is accepted."""
    try:
        bddl.parse(mutant.text, profile="behavior")
    except bddl.BDDLError as error:
        return next(found for found in error.diagnostics if found.severity == "error")
    except Exception as error:
        escaped.append(f"{mutant.kind}, {mutant.activity}: {type(error).__name__}: {error}")
    return None
