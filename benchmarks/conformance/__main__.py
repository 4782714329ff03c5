"""Compares this project's BDDL with the reference implementation (PyPI bddl 3.6.0) on its own corpus.

    python -m benchmarks.conformance [--only CHECK ...] [--seed N] [--quick] [--out FILE] [--libero FOLDER]
                                    [--reference-python PYTHON]

Without `--reference-python` the reference is installed into `.venv-reference` when it is not there yet. Exit code 1
says that a promised figure was not reached.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from dataclasses import asdict
from pathlib import Path

from rich.console import Console
from rich.table import Table

from benchmarks.conformance.context import SCRIPT, Context, Result, load_corpus, reference_interpreter
from benchmarks.conformance.goal_peer import GoalPeer
from benchmarks.conformance.registry import CHECKS


def main() -> int:
    """Run the checks that were asked for; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.conformance", description=__doc__.split("\n")[0])
    parser.add_argument("--only", nargs="+", choices=sorted(CHECKS), default=list(CHECKS), metavar="CHECK")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="a small sample of everything")
    parser.add_argument("--out", type=Path, help="where the figures go, as JSON")
    parser.add_argument("--libero", type=Path, help="a folder with LIBERO's files, such as the installed package")
    parser.add_argument("--reference-python", type=Path, default=os.environ.get("REFERENCE_PYTHON"))
    options = parser.parse_args()
    interpreter = Path(options.reference_python) if options.reference_python else reference_interpreter()
    console = Console(width=160)
    results: dict[str, Result] = {}
    seconds: dict[str, float] = {}
    with GoalPeer(interpreter, SCRIPT) as peer:
        context = Context(interpreter, peer, load_corpus(peer), options.seed, options.quick, options.libero)
        for name in options.only:
            begin = time.perf_counter()
            with console.status(name):
                results[name] = CHECKS[name](context)
            seconds[name] = time.perf_counter() - begin
            # A long run that is broken off leaves what it has found.
            _write(options.out, options.seed, results, seconds)
    console.print(_table(results))
    if "mutants" in results:
        console.print(_kinds(results["mutants"]))
    return int(any(not measure.holds for result in results.values() for measure in result.measures))


def _write(out: Path | None, seed: int, results: dict[str, Result], seconds: dict[str, float]) -> None:
    if out is not None:
        out.parent.mkdir(parents=True, exist_ok=True)
        figures = {name: asdict(result) | {"seconds": seconds[name]} for name, result in results.items()}
        out.write_text(json.dumps({"seed": seed, "checks": figures}, indent=1), encoding="utf-8")


def _table(results: dict[str, Result]) -> Table:
    table = Table("check", "measure", "this project", "reference", "goal", "", title="BDDL beside the reference")
    for name, result in results.items():
        for measure in result.measures:
            mark = "" if not measure.goal else "yes" if measure.holds else "[bold red]no"
            table.add_row(name, measure.name, measure.ours, measure.reference, measure.goal, mark)
    return table


def _kinds(result: Result) -> Table:
    table = Table("mutants", "n", "accepted", "located", "reference accepts", "with verification", title="By kind")
    kinds = result.details["kinds"]
    if isinstance(kinds, dict):
        for kind, count in kinds.items():
            n = count["n"]
            table.add_row(
                kind,
                str(n),
                str(count.get("accepted", 0)),
                f"{count.get('located', 0) / n:.1%}",
                f"{count['reference_accepts'] / n:.1%}",
                f"{count.get('reference_verifies', 0) / max(1, count.get('verifiable', 0)):.1%}",
            )
    return table


if __name__ == "__main__":
    raise SystemExit(main())
