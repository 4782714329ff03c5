"""How fast goals are evaluated, beside the reference implementation of BDDL, on all goals of its corpus.

    python -m benchmarks.bddl_evaluation [--reference-python PYTHON] [--rounds N] [--seed N]

Both sides evaluate every condition of every goal in the same 20 random states, in turns, one goal at a time; each
goal's time is the best of the rounds. The reference gets its state as a set of true facts and a backend that does
nothing but look a fact up. This side is measured with each form of state that it takes:

    packed    the state is a number already, as for a caller who keeps it so or asks several goals of it
    facts     a set of true facts, the same as the reference's; packing is part of the time
    values    a list of values in the order of the atoms; packing is part of the time
    atoms     a set of true atoms; packing is part of the time

Batches are timed with 1,024 states; a cold start is a fresh process that imports, reads one activity, compiles its goal
and evaluates one state.
"""

from __future__ import annotations

import argparse
import os
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

import bddl
from benchmarks.compiled_goals import compile_goal
from benchmarks.conformance.context import Context, Measure, Result, reference_interpreter
from benchmarks.conformance.goal_peer import GoalPeer

ROUNDS = 7
STATES = 20
BATCH = 1024
COLD_RUNS = 7
# How many times faster than the reference each form is meant to be at least.
GOALS = {"packed": 1, "facts": 0.75, "batch": 15}

COLD = """
import time; begin = time.perf_counter()
import bddl, pathlib, sys
from benchmarks.compiled_goals import compile_goal
problem = bddl.parse(pathlib.Path(sys.argv[1]).read_text(), profile="behavior-compat")
goal = compile_goal(problem.goal, {thing.name: thing.category for thing in problem.objects})
goal.evaluate_conditions(0)
print(time.perf_counter() - begin)
"""


def seconds(action: Callable[[Any], object], states: Iterable[Any]) -> float:
    """Return how long an action took on all of the states, the best of three times."""
    best = float("inf")
    for _ in range(3):
        begin = time.perf_counter()
        for state in states:
            action(state)
        best = min(best, time.perf_counter() - begin)
    return best


class Contest:
    """One goal, its states in every form, and the best times so far."""

    def __init__(self, name: str, problem: bddl.Problem, source: random.Random) -> None:
        self.name = name
        objects = {thing.name: thing.category for thing in problem.objects}
        begin = time.perf_counter()
        self.goal = goal = compile_goal(problem.goal, objects)
        self.compile_seconds = time.perf_counter() - begin
        width = len(goal.atoms)
        densities = [number / (STATES - 1) for number in range(STATES)]
        values = [[source.random() < density for _ in range(width)] for density in densities]
        true = [[atom for atom, value in zip(goal.atoms, row, strict=True) if value] for row in values]
        packed = [goal.pack(row) for row in values]
        self.hexes = [hex(state) for state in packed]
        self.batch = np.random.default_rng(source.randrange(2**32)).random((BATCH, width)) < 0.5

        conditions = goal.evaluate_conditions
        self.runs: dict[str, Callable[[], float]] = {
            "packed": lambda: seconds(conditions, packed),
            "facts": lambda: seconds(conditions, facts),
            "values": lambda: seconds(conditions, values),
            "atoms": lambda: seconds(conditions, atoms),
            "packed, whole goal": lambda: seconds(goal.evaluate, packed),
            "batch": lambda: seconds(goal.evaluate_batch, [self.batch]) * STATES / BATCH,
        }
        facts = [{atom.label for atom in row} for row in true]
        atoms = [set(row) for row in true]
        self.best = dict.fromkeys(("reference", *self.runs), float("inf"))

    def run(self, peer: GoalPeer) -> None:
        """Run one round: the reference, then this side."""
        theirs = peer.ask("time", activity=self.name, states=self.hexes)
        self.best["reference"] = min(self.best["reference"], theirs)
        for form, run in self.runs.items():
            self.best[form] = min(self.best[form], run())


def rows(contests: list[Contest]) -> dict[str, tuple[float, float, float, float, float]]:
    """Return for each form: mean and median microseconds a goal, and how many times faster than the reference it was.

    The three ratios are that of the sums, the median of the goals', and that of the goal with the least gain.
    """
    reference = [contest.best["reference"] for contest in contests]
    found = {}
    for form in contests[0].best:
        ours = [contest.best[form] for contest in contests]
        ratios = [theirs / mine for theirs, mine in zip(reference, ours, strict=True)]
        mean, middle = (1e6 / STATES * seconds for seconds in (sum(ours) / len(ours), median(ours)))
        found[form] = (mean, middle, sum(reference) / sum(ours), median(ratios), min(ratios))
    return found


def cold_starts(interpreter: Path, path: str, name: str) -> None:
    """Print the best time from import to the first answer, of both sides, each in fresh processes, in turns."""
    ours, theirs = [], []
    for _ in range(COLD_RUNS):
        done = subprocess.run([sys.executable, "-c", COLD, path], capture_output=True, text=True, check=True)
        ours.append(float(done.stdout))
        with GoalPeer(interpreter) as peer:
            theirs.append(float(peer.ask("cold", activity=name)))
    print(f"cold start to the first answer: {min(ours):.3f} s, reference {min(theirs):.3f} s")


def contend(interpreter: Path, corpus: Mapping[str, str], rounds: int, seed: int) -> list[Contest]:
    """Run the contest on all activities; returns it with the best times of all rounds."""
    source = random.Random(seed)
    with GoalPeer(interpreter) as peer:
        problems = {name: bddl.parse(text, profile="behavior-compat") for name, text in corpus.items()}
        contests = [Contest(name, problem, source) for name, problem in problems.items()]
        for contest in contests:
            peer.load(contest.name, contest.goal.atoms)
        for _ in range(rounds):
            for contest in contests:
                contest.run(peer)
    return contests


def check_evaluation(context: Context) -> Result:
    """Times goals in all forms of states, and batches, beside the reference."""
    contests = contend(context.interpreter, context.corpus, 1 if context.quick else ROUNDS, context.seed)
    table = rows(contests)
    reference = f"{table['reference'][0]:.2f} us"
    measures = [
        Measure(
            f"evaluating all conditions of a goal, state: {form}",
            f"{mean:.3f} us, {ratio:.1f} x faster",
            reference,
            f"{goal} x" if goal else "",
            ratio >= goal,
        )
        for form, (mean, _, ratio, _, _) in table.items()
        if form != "reference"
        for goal in (GOALS.get(form, 0),)
    ]
    return Result(tuple(measures), {form: list(figures) for form, figures in table.items()})


def main() -> None:
    """Run the contest and prints its tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--reference-python", type=Path, default=os.environ.get("REFERENCE_PYTHON"))
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    interpreter = Path(options.reference_python) if options.reference_python else reference_interpreter()
    with GoalPeer(interpreter) as peer:
        paths = peer.ask("list")
    corpus = {name: Path(path).read_text(encoding="utf-8") for name, path in paths.items()}
    contests = contend(interpreter, corpus, options.rounds, options.seed)
    print(f"{'form of state':20} {'mean us':>9} {'median us':>10} {'in sum':>9} {'median':>9} {'worst':>9}")
    for form, (mean, middle, *ratios) in rows(contests).items():
        print(f"{form:20} {mean:9.3f} {middle:10.3f}" + "".join(f" {ratio:8.1f}x" for ratio in ratios))
    compiling = sum(contest.compile_seconds for contest in contests)
    print(f"compiling all {len(contests)} goals: {compiling:.3f} s")
    name, path = next(iter(paths.items()))
    cold_starts(interpreter, path, name)


if __name__ == "__main__":
    main()
