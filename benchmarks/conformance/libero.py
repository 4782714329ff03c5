"""LIBERO's files, from a folder that the user gives: all are read, as LIBERO's own parser reads them."""

from __future__ import annotations

from collections import Counter
from itertools import groupby
from pathlib import Path
from typing import Any

import bddl
from benchmarks.conformance.context import Context, Measure, Result
from benchmarks.conformance.goal_peer import GoalPeer

SCRIPT = Path(__file__).with_name("reference_libero.py")
# Texts on which LIBERO's own parser raises, misreads, or calls `eval`.
_HEAD = "(define (problem p) (:domain robosuite) (:language {language}) (:regions {regions}) (:fixtures t - table)"
_TAIL = " (:objects c - cup) (:init) (:goal (and (on c t))))"
BROKEN = {
    "instruction with parentheses": (_HEAD.format(language="lift (slowly) it", regions=""), True),
    "instruction with a semicolon": (_HEAD.format(language="lift it; then wait", regions=""), True),
    "yaw that is Python": (_HEAD.format(language="go", regions="(r (:target t) (:yaw_rotation ((0 2**3))))"), False),
    "region without a target": (_HEAD.format(language="go", regions="(r (:ranges ((0 0 1 1))))"), False),
    "scene properties": (_HEAD.format(language="go", regions="") + " (:scene_properties (k (:floor wood)))", True),
}


def check_libero(context: Context) -> Result:
    """Read every file below the folder, compares with LIBERO's parser where it lies there too, and prints it back."""
    if context.libero is None:
        return Result((Measure("LIBERO's files", "not read: --libero FOLDER gives them"),))
    paths = sorted(context.libero.rglob("*.bddl"))
    texts = {path: path.read_text(encoding="utf-8") for path in paths}
    problems = {path: _read(text) for path, text in texts.items()}
    read = {path: problem for path, problem in problems.items() if problem is not None}
    kept = sum(bddl.parse(bddl.format(problem), profile="libero") == problem for problem in read.values())
    warnings = Counter(finding.code for problem in read.values() for finding in problem.warnings)
    measures = [
        Measure("files read", f"{len(read)} of {len(paths)}", "", "all", len(read) == len(paths)),
        Measure("equal after printing and reading again", f"{kept} of {len(read)}", "", "all", kept == len(read)),
        Measure("warnings", ", ".join(f"{count} {code}" for code, count in warnings.items()) or "none"),
        *_broken(),
    ]
    different: list[str] = []
    parser = next(iter(sorted(context.libero.rglob("bddl_utils.py"))), None)
    if parser is not None:
        with GoalPeer(context.interpreter, SCRIPT) as peer:
            peer.ask("use", parser=str(parser.absolute()))
            theirs = {path: peer.ask("read", path=str(path.absolute())) for path in read}
        different = [path.name for path, problem in read.items() if _as_libero(problem) != _comparable(theirs[path])]
        equal = len(read) - len(different)
        measures.append(
            Measure("equal to LIBERO's parser", f"{equal} of {len(read)}", f"{len(read)}", "all", not different)
        )
    return Result(tuple(measures), {"different": different, "warnings": dict(warnings)})


def _broken() -> list[Measure]:
    """Return whether the texts that break LIBERO's parser are read, or refused with a place."""
    right = 0
    for head, legal in BROKEN.values():
        try:
            right += isinstance(bddl.parse(head + _TAIL, profile="libero"), bddl.LiberoProblem) is legal
        except bddl.BDDLError as error:
            right += not legal and all(finding.line for finding in error.diagnostics)
    figure = f"{right} of {len(BROKEN)}"
    return [Measure("texts that break LIBERO's parser: read, or refused", figure, "", "all", right == len(BROKEN))]


def _read(text: str) -> bddl.LiberoProblem | None:
    try:
        problem = bddl.parse(text, profile="libero")
    except bddl.BDDLError:
        return None
    return problem if isinstance(problem, bddl.LiberoProblem) else None


def _as_libero(problem: bddl.LiberoProblem) -> dict[str, Any]:
    """Return a problem in the form that LIBERO's parser gives; it lower-cases everything."""
    return {
        "problem_name": problem.name.lower(),
        "fixtures": _by_type(problem.fixtures),
        "objects": _by_type(problem.objects),
        "regions": {
            region.key: {
                "target": region.target,
                "ranges": [[each.x_min_m, each.y_min_m, each.x_max_m, each.y_max_m] for each in region.ranges],
                "yaw_rotation": list(region.yaw_rad or (0, 0)),
            }
            for region in problem.regions
        },
        "initial_state": [[*atom.label] for atom in problem.init if isinstance(atom, bddl.Atom)],
        "goal_state": [[*atom.label] for atom in bddl.conjuncts(problem.goal) if isinstance(atom, bddl.Atom)],
        "language_instruction": problem.language.lower().split(),
        "obj_of_interest": list(problem.objects_of_interest),
    }


def _comparable(theirs: dict[str, Any]) -> dict[str, Any]:
    """Return what LIBERO's parser gave, without the parts that it fills with constants."""
    kept = {key: value for key, value in theirs.items() if key != "scene_properties"}
    kept["regions"] = {
        key: {part: region[part] for part in ("target", "ranges", "yaw_rotation")}
        for key, region in theirs.get("regions", {}).items()
    }
    return kept


def _by_type(things: tuple[bddl.TypedObject, ...]) -> dict[str, list[str]]:
    """Return names by type; as in LIBERO's parser, of two lines with one type the later one counts."""
    return {kind: [thing.name for thing in group] for kind, group in groupby(things, key=lambda thing: thing.category)}
