"""What `verify` makes of single mistakes in right plans: verdict, blamed place, fixes.

    python -m benchmarks.wrong_plans [TASK ...]

For the paper's T1 to T4, also with its evolved flows, and for tasks with drawers, several objects, two containers and
eight subtasks, every step and subtask is deleted, every two subtasks and every two roles are swapped, every object of a
role or condition is replaced by every other one, and every literal of an initial condition, a goal and the task goal is
negated. Columns:

    mutants     how many
    agree       verdicts that a simulation of the complete start state shares, which knows nothing of the package
    refuted     how many of them are refuted; the columns after this one count among these
    stop        the first error is where that simulation stops, or at the subtask that cannot be meant as written
    root        the first error points at the mistake itself: it stands at a changed place, names a step of one as the
                writer of what is wrong, or lacks what the changed part makes true in the right plan
    one         following the plan tells exactly one mistake from its consequences, fixes left aside
    shown       the printed report has one error: one change at one place mends all that following the plan finds
    fixed       a fix is offered that proves the plan; every one was verified once more
    inverse     the fixes have the plan itself among them: roles, conditions, steps that are not geometry alone
    first       it is the first of them
"""

from __future__ import annotations

import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from typing import Any

import oag
from tests.oag.mutants import Mutant, World0, ill_formed, is_root, is_stop, mutants, same_plan, simulated
from tests.oag.other_tasks import OTHERS
from tests.oag.paper import EVOLVED, NAMES, scene, task_json

COLUMNS = ("mutants", "agree", "refuted", "stop", "root", "one", "shown", "fixed", "inverse", "first")


def plans() -> dict[str, tuple[oag.Scene, dict[str, Any]]]:
    """Return the right plans by name, with their scenes."""
    found = {name: (scene(name), task_json(name)) for name in NAMES}
    for number, (name, index, flow) in enumerate(EVOLVED):
        data = task_json(name)
        data["sub_tasks"][index]["flow"] = flow
        found[f"{name} evolved {number + 1}"] = (scene(name), data)
    return found | {name: (oag.Scene.from_json(world), data) for name, (world, data) in OTHERS.items()}


def measure(
    mutant: Mutant, kitchen: oag.Scene, right_data: dict[str, Any], world: World0, times_s: list[float]
) -> Counter[str]:
    """Return what holds of one mutant, by column."""
    report = oag.compose(oag.Task.from_json(mutant.data, scene=kitchen)).verify()
    right = ill_formed(mutant.data, world) is False and simulated(mutant.data, world) is None
    found = Counter({"mutants": 1, "agree": int(bool(report) is right)})
    if report:
        return found
    began = time.perf_counter()
    fixes = report.fixes
    times_s.append(time.perf_counter() - began)
    proving = [fix for fix in fixes if fix.proves]
    for fix in fixes:
        after = oag.compose(fix.apply(report.task), fix.apply_to_scene(kitchen)).verify()
        if bool(after) is not fix.proves:
            raise SystemExit(f"a fix that was offered does not do what it says: {fix}")
    flows, original = mutant.kind != "subtask deleted", oag.Task.from_json(right_data, scene=kitchen)
    inverse = [same_plan(fix.apply(report.task), original, flows=flows) for fix in proving]
    found["refuted"] = 1
    found["stop"] = int(is_stop(mutant, report, world))
    found["root"] = int(is_root(mutant, report, right_data, world))
    found["one"] = int(len(report.errors) == 1)
    found["shown"] = int(sum(finding.severity == "error" for finding in report.findings) == 1)
    found["fixed"] = int(bool(proving))
    found["inverse"] = int(any(inverse))
    found["first"] = int(bool(inverse) and inverse[0])
    return found


def table(rows: dict[str, Counter[str]]) -> str:
    """Return counts as a table, the sum last."""
    total = sum(rows.values(), Counter[str]())
    lines = [row("", COLUMNS)]
    lines.extend(row(name, [counts[column] for column in COLUMNS]) for name, counts in (*rows.items(), ("all", total)))
    shares = [f"{100 * total[column] / total['refuted']:.1f}%" for column in COLUMNS[3:]]
    lines.append(row("", ["", f"{100 * total['agree'] / total['mutants']:.1f}%", "", *shares]))
    return "\n".join(lines)


def row(name: str, cells: Iterable[object]) -> str:
    """Return one line of a table."""
    return f"{name:28}" + "".join(f"{cell!s:>9}" for cell in cells)


def main(names: list[str]) -> None:
    """Print the tables for some plans, by default for all."""
    by_kind: dict[str, Counter[str]] = defaultdict(Counter)
    by_plan: dict[str, Counter[str]] = defaultdict(Counter)
    times_s: list[float] = []
    print(row("", COLUMNS))
    for name, (kitchen, data) in plans().items():
        if names and name not in names:
            continue
        world = World0.of(kitchen)
        for mutant in mutants(data, tuple(kitchen.objects)):
            found = measure(mutant, kitchen, data, world, times_s)
            by_kind[mutant.kind] += found
            by_plan[name] += found
        print(row(name, [by_plan[name][column] for column in COLUMNS]), flush=True)
    print(f"\n{table(by_kind)}")
    times_s.sort()
    shares = {"median": 0.5, "95 %": 0.95, "largest": 1.0}
    said = ", ".join(f"{key} {1e3 * times_s[int(share * (len(times_s) - 1))]:.0f}" for key, share in shares.items())
    print(f"\nsearch for fixes of a refuted plan, ms: {said}")


if __name__ == "__main__":
    main(sys.argv[1:])
