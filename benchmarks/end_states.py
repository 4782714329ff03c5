"""What proofs say of the end of a plan, against the detectors after it ran in physics.

    python -m benchmarks.end_states [--plans 40] [--cargo 20] [--seed 74000] [--units FILE]

Each unit draws a kitchen of the long-horizon tasks and a wish that it admits, and plans it. A unit with cargo fills a
vessel, and then puts the vessel elsewhere. All that the proof knows to be true or false at the end becomes the goal of
the task, so that the rollout reads every fact at rest: where each thing is and is not, what it is next to, touches and
is under as far as that is known, and which doors are open.

A unit counts unless a step failed. A subtask whose goal does not hold ends the plan: its readings count then, and
those that do not hold are contradictions. Plans have at most two subtasks, with cargo four. Printed are the facts on
which proof and detectors agree, each contradiction, and the units in which a step failed, with the reason. A plan is
gone through by geometry first, as `run` does. Where it is infeasible, it is counted apart, and another wish is taken.
With `--units` each unit becomes a line of a file, and a later call goes on after those that the file has.
"""

from __future__ import annotations

import argparse
import json
import random
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import permutations
from pathlib import Path

import bddl
from bddl.errors import Scene2DemoError
from executor.campaign.versions import outcome_version
from executor.records import FailureKind, Rollout
from executor.rollouts.feasibility import feasible
from executor.rollouts.rollout import rollout
from executor.scenes.file import with_neighbours
from executor.scenes.generators import long_horizon
from oag import Scene, Task, compose, plan
from oag.model.symbols import GRIPPER, Kind
from oag.primitives.cargo import RESTING, VAGUE
from oag.sizes import Sizing
from oag.verify.outcome import PlanState
from oag.wish_list import KINDS, WishKind, wishes

FAMILIES = ("T1", "T2", "T3", "T4")
MOST_SUBTASKS = {False: 2, True: 4}
_MOST_WISHES = 5  # Of one kitchen, before another one is drawn.


def end_literals(state: PlanState, scene: Scene) -> Iterator[bddl.Formula]:
    """Yield every literal about places, doors and the hand that is known at a moment of a plan."""
    items = [name for name, thing in scene.objects.items() if thing.kind is Kind.ITEM]
    atoms = [bddl.Atom("open", (name,)) for name, thing in scene.objects.items() if thing.kind is Kind.ARTICULATED]
    atoms += [bddl.Atom("inside", (name, GRIPPER)) for name in items]
    pairs = [pair for pair in permutations(scene.objects, 2) if pair[0] in items]
    atoms += [bddl.Atom(predicate, pair) for predicate in (*RESTING, *VAGUE) for pair in pairs]
    for atom in atoms:
        value = state.holds(atom)
        if value is not None:
            yield atom if value else bddl.Not(atom)


def drawn_plans(scene: Scene, seed: int, *, cargo: bool) -> Iterator[Task]:
    """Yield plans of random wishes in a scene; with cargo, a vessel is filled first."""
    draw, sizing = random.Random(f"{seed} {cargo}"), Sizing(seed)
    kinds: tuple[WishKind, ...] = ("fill",) if cargo else KINDS
    first = list(wishes(scene, kinds, sizing=sizing))
    draw.shuffle(first)
    for wish in first:
        found = plan(scene, wish.goal, sizing=sizing)
        if found.task is None or found.report is None or not found.task.subtasks:
            continue
        if not cargo:
            yield found.task
            continue
        state = found.report.state_after(len(found.task.subtasks))
        if state is None:
            continue
        # What is next to what plays no part in a plan.
        then = replace(scene, facts=tuple(map(bddl.parse_formula, state.facts)), closed=scene.closed - set(VAGUE))
        then_kinds: tuple[WishKind, ...] = ("put-into", "put-onto")
        moves = [each for each in wishes(then, then_kinds, sizing=sizing) if each.targets == (wish.place,)]
        for move in draw.sample(moves, len(moves)):
            rest = plan(then, move.goal, sizing=sizing)
            if rest.task is not None:
                subtasks = (*found.task.subtasks, *rest.task.subtasks)
                scales = {**rest.task.scales, **found.task.scales}
                yield replace(found.task, subtasks=subtasks, scales=scales)
                break


@dataclass(frozen=True)
class LeftOut:
    """Why a plan is not run."""

    reason: str
    infeasible: bool = False


@dataclass(frozen=True)
class Compared:
    """What came of a plan: how many facts were read, how many of them are true by the proof, and which do not hold."""

    facts: int
    true: int
    contradictions: tuple[str, ...]
    ended_early: str = ""


def compared(ran: Rollout, facts: tuple[bddl.Formula, ...]) -> Compared:
    """Return the readings of a rollout against the proof; where a step failed, there is nothing to compare."""
    failure = ran.failure
    if failure is not None and failure.kind is not FailureKind.GOAL_NOT_REACHED:
        return Compared(0, 0, (), failure.message)
    of_subtasks = [reading for subtask in ran.subtasks for reading in subtask.readings]
    broken = dict.fromkeys(str(reading) for reading in of_subtasks if not reading.satisfied)
    if failure is not None:
        return Compared(len(of_subtasks), sum(reading.wanted for reading in of_subtasks), tuple(broken))
    broken |= dict.fromkeys(str(reading) for reading in ran.goal_readings if not reading.satisfied)
    return Compared(len(facts), sum(isinstance(fact, bddl.Atom) for fact in facts), tuple(broken))


def run_unit(scene: Scene, task: Task, seed: int) -> Compared | LeftOut:
    """Run a feasible plan whose goal is all that is known of its end, and compare; or return why it is not run."""
    report = compose(task, scene=scene).verify()
    state = report.state_after(len(task.subtasks)) if report else None
    if state is None:
        return LeftOut(f"not proved: {report.verdict.value}")
    facts = tuple(end_literals(state, scene))
    graph = compose(replace(task, goal=bddl.And(facts), goal_given=True), scene=scene)
    try:
        # A repaired plan has another end.
        found = feasible(graph, scene, seed, vary=False, most_repairs=0)
        if not found:
            return LeftOut(found.reason, infeasible=True)
        return compared(rollout(graph, scene, seed, vary=False, conditions=found.conditions()), facts)
    except Scene2DemoError as problem:
        return LeftOut(str(problem))


def unit(seed: int, *, cargo: bool) -> dict[str, object]:
    """Return what came of the first feasible wish of a drawn kitchen."""
    began = time.process_time()
    family = "T3" if cargo else random.Random(seed).choice(FAMILIES)
    drawn = long_horizon.draw(family, seed).scene
    scene = with_neighbours(replace(drawn, closed=drawn.closed | set(VAGUE)))
    passed: list[LeftOut] = []
    for task in drawn_plans(scene, seed, cargo=cargo):
        if len(task.subtasks) > MOST_SUBTASKS[cargo]:
            continue
        done = run_unit(scene, task, seed)
        if isinstance(done, LeftOut):
            passed.append(done)
            if len(passed) == _MOST_WISHES:
                break
            continue
        return {
            "seed": seed,
            "family": family,
            "cargo": cargo,
            "plan": [subtask.name for subtask in task.subtasks],
            **asdict(done),
            **_left_out(passed),
            "cpu_s": round(time.process_time() - began, 1),
        }
    skipped = {"skipped": [one.reason for one in passed[:3]], **_left_out(passed)}
    return {"seed": seed, "family": family, "cargo": cargo, **skipped, "cpu_s": time.process_time() - began}


def _left_out(passed: list[LeftOut]) -> dict[str, int]:
    return {"passed_over": len(passed), "infeasible": sum(one.infeasible for one in passed)}


def finished_units(path: Path | None) -> dict[tuple[int, bool], dict[str, object]]:
    """Print and return the finished units of this version; a line that was cut by a kill is no unit."""
    if path is None or not path.is_file():
        return {}
    version = outcome_version()
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    if lines and not lines[-1].endswith("\n"):
        path.write_text("".join(lines[:-1]), encoding="utf-8")
    units = [json.loads(line) for line in lines if line.endswith("\n")]
    kept = {(each["seed"], each["cargo"]): each for each in units if each.get("version") == version}
    for each in kept.values():
        print(json.dumps(each), flush=True)
    return kept


def _run_and_keep(seed: int, path: Path | None, *, cargo: bool) -> dict[str, object]:
    found = {"version": outcome_version(), **unit(seed, cargo=cargo)}
    line = json.dumps(found)
    print(line, flush=True)
    if path is not None:
        with path.open("a", encoding="utf-8") as lines:
            lines.write(f"{line}\n")
    return found


def main() -> None:
    """Print a line for each unit, then the agreement."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--plans", type=int, default=40, help="units without cargo that ran to their end")
    parser.add_argument("--cargo", type=int, default=20, help="units with cargo that ran to their end")
    parser.add_argument("--seed", type=int, default=74000, help="of the first kitchen")
    parser.add_argument("--units", type=Path, help="file of finished units, which are not run again")
    args = parser.parse_args()
    path: Path | None = args.units
    if path is not None and not (path.is_file() or (path.parent.is_dir() and not path.exists())):
        parser.error(f"--units {path}: expected a file, or a name for one in a folder that exists")
    finished = finished_units(args.units)
    ran: list[dict[str, object]] = []
    early = infeasible = 0
    for cargo, count in ((False, args.plans), (True, args.cargo)):
        seed, done = args.seed, 0
        while done < count:
            found = finished.get((seed, cargo)) or _run_and_keep(seed, args.units, cargo=cargo)
            seed += 1
            infeasible += int(str(found["infeasible"]))
            if "skipped" in found:
                continue
            if found["ended_early"]:
                early += 1
                continue
            done += 1
            ran.append(found)
    facts = sum(int(str(each["facts"])) for each in ran)
    true = sum(int(str(each["true"])) for each in ran)
    wrong = sum(len(each["contradictions"]) for each in ran if isinstance(each["contradictions"], list | tuple))
    print(f"{len(ran)} plans ({args.cargo} with cargo): {facts} facts, {true} of them true; {wrong} contradicted")
    print(f"agreement {100.0 * (facts - wrong) / max(facts, 1):.2f} %; {early} further units ended early")
    print(f"{infeasible} infeasible plans were left out")


if __name__ == "__main__":
    main()
