"""How `compose` and `verify` scale with the length of a plan, beside unified-planning and VAL in the same run.

    python -m benchmarks.verify_scaling [--lengths 4 10 100 1000] [--runs 7] [--cpu] [--exact] [--val PATH]

A chain of K subtasks puts glasses into one refrigerator: open, pick, place, close, about five primitives each. K = 4 is
the paper's T1. All times are milliseconds, each the best of several runs; rounds of all tools take turns, so that a
machine that slows down does so for all. Ratios are of the same round of measurements.

unified-planning 1.3.0 runs in an environment of its own, `.venv-peers`, which is made when it is missing. It builds the
same plan at the level of primitives through its Python API and validates it with `sequential_plan_validator`. VAL is
used when its `Validate` is named or on the path; it reads the same plan from PDDL files, process and parsing included.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import oag
from benchmarks.primitive_model import Plan, pddl
from oag.verify.verify import verify

ROOT = Path(__file__).parent.parent
PEERS = ROOT / ".venv-peers"
PEER = "unified-planning==1.3.0"
FRIDGE, TABLE = "refrigerator_0", "table_0"
_COLUMNS = ("compose+verify", "explain", "certify", "recheck", "exact", "up build", "up validate", "val")


def scene(glasses: int) -> oag.Scene:
    """Return a kitchen with a refrigerator, a table and so many glasses on it."""
    things: dict[str, Any] = {
        FRIDGE: {"category": "fridge", "bbox_extent": [0.7, 0.7, 1.7]},
        TABLE: {"category": "table", "bbox_extent": [0.6, 0.9, 0.6]},
    }
    things |= {f"glass_{n}": {"category": "water_glass", "bbox_extent": [0.05, 0.05, 0.1]} for n in range(glasses)}
    facts = [f"(not (open {FRIDGE}))", *(f"(ontop glass_{n} {TABLE})" for n in range(glasses))]
    return oag.Scene.from_json({"objects": things, "facts": facts, "closed": ["ontop", "inside", "open"]})


def chain(length: int) -> oag.Task:
    """Return a task of so many subtasks; beyond the last multiple of four a door is opened, or opened and shut."""
    subtasks: list[dict[str, Any]] = []
    for number in range((length + 3) // 4):
        glass = f"glass_{number}"
        on_table, in_fridge = f"(ontop {glass} {TABLE})", f"(inside {glass} {FRIDGE})"
        subtasks += [
            _subtask(FRIDGE, None, f"(not (open {FRIDGE}))", f"(open {FRIDGE})", [17, 1, 2, 3, 4, 5]),
            _subtask(glass, None, on_table, f"(not {on_table})", [17, 1, 2, 3, {"7": 0.2}]),
            _subtask(glass, FRIDGE, f"(inside {glass} gripper)", in_fridge, [18, {"13": 0.4}, {"9": 0.1}, 5]),
            _subtask(FRIDGE, None, f"(open {FRIDGE})", f"(not (open {FRIDGE}))", [17, 1, 2, 3, 19, 5]),
        ]
    whole = length - length % 4
    subtasks = subtasks[:whole] + [subtasks[0], subtasks[3]][: length % 4]
    goal = " ".join(f"(inside glass_{number} {FRIDGE})" for number in range(length // 4))
    task = {"goal": f"(and {goal})", "sub_tasks": subtasks}
    return oag.Task.from_json(task, scene=scene((length + 3) // 4))


def _subtask(target: str, support: str | None, init: str, goal: str, flow: list[Any]) -> dict[str, Any]:
    """Return one subtask as task files have it."""
    return {"target": target, "support_goal": support, "init": init, "goal": goal, "flow": flow}


def strips(task: oag.Task) -> Plan:
    """Return a chain as the peers have it: one action for each primitive."""
    names = list(task.scene.objects) if task.scene is not None else []
    glasses = [name for name in names if name.startswith("glass")]
    start = [["handempty"], ["near", task.subtasks[0].target], *(["ontop", glass, TABLE] for glass in glasses)]
    goal = [(["inside", subtask.target, FRIDGE], True) for subtask in task.subtasks if subtask.support_goal]
    steps, here = [], task.subtasks[0].target
    for subtask in task.subtasks:
        target, door = subtask.target, subtask.target == FRIDGE
        for action in subtask.flow or ():
            match int(action.primitive):
                case 17 | 18 as number:
                    there = target if number == 17 else FRIDGE
                    steps.append(["stay", here] if there == here else ["go", here, there])
                    here = there
                case 1:
                    steps.append(["approach", target])
                case 2:
                    steps.append(["converge", target])
                case 3:
                    steps.append(["grip" if door else "grasp", target])
                case 4:
                    steps.append(["pull", target])
                case 19:
                    steps.append(["push", target])
                case 5:
                    steps.append(["let_go", target] if door else ["put", target, FRIDGE])
                case 7:
                    steps.append(["lift", target, TABLE])
                case _:
                    steps.append(["move", target])
    return Plan(names, start, goal, steps)


def best_ms(action: Callable[[], object], runs: int, clock: Callable[[], float] = time.perf_counter) -> float:
    """Return the shortest of several runs in milliseconds; what a run made is freed outside of the measurement."""
    shortest = float("inf")
    for _ in range(runs):
        begin = clock()
        kept = action()
        shortest = min(shortest, clock() - begin)
        del kept
    return 1000.0 * shortest


class UnifiedPlanning:
    """The peer in its own environment, which answers a plan with its times."""

    def __init__(self) -> None:
        python = PEERS / "bin" / "python"
        if not python.exists():
            subprocess.run([sys.executable, "-m", "venv", str(PEERS)], check=True)
            subprocess.run([str(python), "-m", "pip", "install", "--quiet", PEER], check=True)
        command = [str(python), "-m", "benchmarks.peer_unified_planning"]
        self._process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def measure(self, plan: Plan, runs: int, cpu: bool) -> dict[str, float]:
        """Return the shortest times to build the problem and to validate the plan."""
        if self._process.stdin is None or self._process.stdout is None:
            raise SystemExit("the peer has no pipes")
        self._process.stdin.write(json.dumps({"plan": plan, "runs": runs, "cpu": cpu}).encode() + b"\n")
        self._process.stdin.flush()
        answer = json.loads(self._process.stdout.readline())
        if not answer["valid"]:
            raise SystemExit("unified-planning finds the plan invalid: the two models differ")
        return {"up build": answer["build_ms"], "up validate": answer["validate_ms"]}

    def close(self) -> None:
        """End the process."""
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait()


def measure_val(binary: str, plan: Plan, runs: int) -> dict[str, float]:
    """Return the shortest time of VAL on a plan, process and parsing included."""
    with tempfile.TemporaryDirectory() as folder:
        paths = [os.path.join(folder, name) for name in ("domain.pddl", "problem.pddl", "plan.txt")]
        for path, text in zip(paths, pddl(plan), strict=True):
            Path(path).write_text(text, encoding="utf-8")
        done = subprocess.run([binary, *paths], capture_output=True, text=True, check=False)
        if "Plan valid" not in done.stdout:
            raise SystemExit(f"VAL finds the plan invalid:\n{done.stdout[-500:]}{done.stderr[-500:]}")
        return {"val": best_ms(lambda: subprocess.run([binary, *paths], capture_output=True, check=False), runs)}


def measure(task: oag.Task, runs: int, exact: bool, cpu: bool) -> dict[str, float]:
    """Return the shortest times of our own steps."""
    report = oag.compose(task).verify()
    if not report or report.certificate is None:
        raise SystemExit(f"the chain is not proved:\n{report}")
    certificate = json.loads(json.dumps(report.certificate.to_json()))
    if not oag.recheck(certificate):
        raise SystemExit(oag.recheck(certificate).reason)
    reports = [oag.compose(task).verify() for _ in range(2 * runs)]
    clock = time.process_time if cpu else time.perf_counter
    explained, certified = iter(reports[:runs]), iter(reports[runs:])
    times = {
        "compose+verify": best_ms(lambda: oag.compose(task).verify(), runs, clock),
        "explain": best_ms(lambda: next(explained).diagnostics, runs, clock),
        "certify": best_ms(lambda: next(certified).certificate, runs, clock),
        "recheck": best_ms(lambda: oag.recheck(certificate), runs, clock),
    }
    if exact:
        times["exact"] = best_ms(lambda: verify(task, oag.compose(task).scene, exact=True), runs, clock)
    return times


def row(task: oag.Task, args: argparse.Namespace, peer: UnifiedPlanning | None, val: str | None) -> dict[str, float]:
    """Return the best times of all tools on one chain; rounds of the tools take turns."""
    best: dict[str, float] = {}
    for _ in range(args.rounds):
        found = measure(task, args.runs, args.exact, args.cpu)
        # A round of the peer is long: its runs are spread over the rounds.
        each = max(1, round(args.runs / args.rounds))
        if peer is not None:
            found |= peer.measure(strips(task), each, args.cpu)
        if val is not None:
            found |= measure_val(val, strips(task), each)
        for name, value in found.items():
            best[name] = min(value, best.get(name, value))
    return best


def main() -> None:
    """Print one row for each length, then the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--lengths", type=int, nargs="+", default=[4, 10, 100, 1000])
    parser.add_argument("--runs", type=int, default=7, help="runs of each step in a round")
    parser.add_argument("--rounds", type=int, default=3, help="rounds of all tools in turn")
    parser.add_argument("--cpu", action="store_true", help="processor time, for a busy machine; VAL has wall time")
    parser.add_argument("--exact", action="store_true", help="also decide everything by the solver")
    parser.add_argument("--val", help="path of VAL's Validate")
    parser.add_argument("--no-peers", action="store_true", help="leave unified-planning out")
    args = parser.parse_args()
    val = args.val or shutil.which("Validate") or shutil.which("validate")
    peer = None if args.no_peers else UnifiedPlanning()
    rows = {length: row(chain(length), args, peer, val) for length in args.lengths}
    if peer is not None:
        peer.close()
    shown = [name for name in _COLUMNS if any(name in times for times in rows.values())]
    print(f"{'K':>5} {'steps':>6} " + " ".join(f"{name:>14}" for name in shown))
    for length, times in rows.items():
        steps = sum(len(subtask.flow or ()) for subtask in chain(length).subtasks)
        print(f"{length:5d} {steps:6d} " + " ".join(f"{times[name]:14.3f}" for name in shown))
    for length, times in rows.items():
        ours = times["compose+verify"]
        lines = [f"recheck / verify {times['recheck'] / ours:.2f}"]
        if "up build" in times:
            theirs = times["up build"] + times["up validate"]
            lines.append(f"unified-planning / verify {theirs / ours:.1f}")
            lines.append(f"unified-planning / (verify + explain + certify) {theirs / _all(times):.1f}")
        if "val" in times:
            lines.append(f"verify / VAL {ours / times['val']:.2f}")
        print(f"K = {length}: {', '.join(lines)}")
    if {100, 1000} <= rows.keys():
        print(f"t(1000) / t(100): {rows[1000]['compose+verify'] / rows[100]['compose+verify']:.1f}")
    if val is None:
        print("VAL was not found; --val names its Validate")


def _all(times: dict[str, float]) -> float:
    return times["compose+verify"] + times["explain"] + times["certify"]


if __name__ == "__main__":
    main()
