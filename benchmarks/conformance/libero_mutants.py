"""LIBERO's files with one parenthesis deleted or inserted: whether that is found, and on its line."""

from __future__ import annotations

import random
import re
from collections import Counter
from collections.abc import Iterator, Mapping

import bddl
from benchmarks.conformance.context import Measure
from benchmarks.conformance.mutants import Mutant

LEAST_LOCATED = 0.95
EDITS = 20
_INSTRUCTION = re.compile(r"\(\s*:language\b[^\n]*", re.IGNORECASE)


def libero_mutants(name: str, text: str, seed: int, edits: int = EDITS) -> Iterator[Mutant]:
    """Yield texts with one parenthesis deleted, and as many with one inserted beside a parenthesis.

    The line of the instruction is left alone, since an instruction may hold parentheses of its own.

    Args:
        name: Name of the file.
        text: Its text, which must be valid.
        seed: Decides where the edits are made.
        edits: How many of each kind.
    """
    rng = random.Random(f"{seed}/{name}")
    said = _INSTRUCTION.search(text)
    start, end = said.span() if said is not None else (0, 0)
    places = [found.start() for found in re.finditer(r"[()]", text) if not start <= found.start() < end]
    for _ in range(edits):
        place = rng.choice(places)
        line = (text.count("\n", 0, place) + 1,)
        yield Mutant("delete a parenthesis", name, text[:place] + text[place + 1 :], line)
        place = rng.choice(places)
        line = (text.count("\n", 0, place) + 1,)
        yield Mutant("insert a parenthesis", name, text[:place] + rng.choice("()") + text[place:], line)


def libero_measures(texts: Mapping[str, str], seed: int) -> tuple[tuple[Measure, ...], dict[str, object]]:
    """Return how many mutants of LIBERO's files are accepted and located, and everything behind the figures."""
    counts: Counter[str] = Counter()
    elsewhere: list[dict[str, object]] = []
    for name, text in texts.items():
        for mutant in libero_mutants(name, text, seed):
            errors = [found for found in bddl.check(mutant.text, profile="libero") if found.severity == "error"]
            counts["n"] += 1
            counts["accepted"] += not errors
            counts["located"] += bool(errors) and errors[0].line in mutant.lines
            counts["alone"] += len(errors) == 1
            if errors and errors[0].line not in mutant.lines:
                elsewhere.append({"kind": mutant.kind, "file": name, "lines": mutant.lines, "line": errors[0].line})
    n = max(1, counts["n"])
    located = counts["located"] / n
    measures = (
        Measure(f"LIBERO: of {n} mutants accepted", f"{counts['accepted'] / n:.2%}", "", "0%", not counts["accepted"]),
        Measure(
            "LIBERO: first diagnostic on the mutated line",
            f"{located:.2%}",
            "no places",
            f"at least {LEAST_LOCATED:.0%}",
            located >= LEAST_LOCATED,
        ),
        Measure("LIBERO: the only diagnostic", f"{counts['alone'] / n:.2%}"),
    )
    return measures, {"counts": dict(counts), "elsewhere": elsewhere}
