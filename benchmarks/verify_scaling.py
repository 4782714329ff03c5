"""How `compose` and `verify` scale with the length of a plan, beside unified-planning where that is installed.

    python benchmarks/verify_scaling.py [K ...]

A chain of K subtasks puts K / 4 glasses into one refrigerator: open, pick, place, close, about five primitives each.
Prints milliseconds (best of several runs) and the ratio to the chain before. The peer gets the same plan at the
level of primitives, its problem built through its Python API.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import oag

LENGTHS = (4, 100, 1000)


def scene(glasses: int) -> oag.Scene:
    """Returns a kitchen with a refrigerator, a table and so many glasses on it."""
    things: dict[str, Any] = {
        "refrigerator_0": {"category": "fridge", "bbox_extent": [0.7, 0.7, 1.7]},
        "table_0": {"category": "table", "bbox_extent": [0.6, 0.9, 0.6]},
    }
    things |= {f"glass_{n}": {"category": "water_glass", "bbox_extent": [0.05, 0.05, 0.1]} for n in range(glasses)}
    facts = ["(not (open refrigerator_0))", *(f"(ontop glass_{n} table_0)" for n in range(glasses))]
    return oag.Scene.from_json({"objects": things, "facts": facts, "closed": ["ontop", "inside", "open"]})


def chain(length: int) -> oag.Task:
    """Returns a task of so many subtasks (a multiple of four)."""
    subtasks: list[dict[str, Any]] = []
    for number in range(length // 4):
        glass = f"glass_{number}"
        subtasks += [
            subtask(
                "refrigerator_0", None, "(not (open refrigerator_0))", "(open refrigerator_0)", [17, 1, 2, 3, 4, 5]
            ),
            subtask(
                glass, None, f"(ontop {glass} table_0)", f"(not (ontop {glass} table_0))", [17, 1, 2, 3, {"7": 0.2}]
            ),
            subtask(
                glass,
                "refrigerator_0",
                f"(inside {glass} gripper)",
                f"(inside {glass} refrigerator_0)",
                [18, {"13": 0.4}, {"9": 0.1}, 5],
            ),
            subtask(
                "refrigerator_0", None, "(open refrigerator_0)", "(not (open refrigerator_0))", [17, 1, 2, 3, 19, 5]
            ),
        ]
    goal = " ".join(f"(inside glass_{number} refrigerator_0)" for number in range(length // 4))
    task = {"goal": f"(and {goal} (not (open refrigerator_0)))", "sub_tasks": subtasks}
    return oag.Task.from_json(task, scene=scene(length // 4))


def subtask(target: str, support: str | None, init: str, goal: str, flow: list[Any]) -> dict[str, Any]:
    """Returns one subtask as task files have it."""
    return {"target": target, "support_goal": support, "init": init, "goal": goal, "flow": flow}


def best_ms(action: Callable[[], object], runs: int) -> float:
    """Returns the shortest of several runs in milliseconds."""
    shortest = float("inf")
    for _ in range(runs):
        begin = time.perf_counter()
        action()
        shortest = min(shortest, time.perf_counter() - begin)
    return 1000.0 * shortest


def peer(task: oag.Task) -> Callable[[], bool] | None:
    """Returns what builds and validates the same plan with unified-planning, or None when it is not installed."""
    try:
        import unified_planning.shortcuts as up
        from unified_planning.engines import SequentialPlanValidator, ValidationResultStatus
        from unified_planning.plans import ActionInstance, SequentialPlan
    except ImportError:
        return None
    up.get_environment().credits_stream = None

    def validate() -> bool:
        thing = up.UserType("thing")
        near, ready, at, held, grips, opened = (
            up.Fluent(name, up.BoolType(), x=thing) for name in ("near", "ready", "at", "held", "grips", "opened")
        )
        inside, ontop = (up.Fluent(name, up.BoolType(), x=thing, y=thing) for name in ("inside", "ontop"))
        empty = up.Fluent("handempty")
        problem = up.Problem("chain")
        for fluent in (near, ready, at, held, grips, opened, inside, ontop, empty):
            problem.add_fluent(fluent, default_initial_value=False)
        assert task.scene is not None
        things = {name: problem.add_object(name, thing) for name in task.scene.objects}
        problem.set_initial_value(empty, True)
        for name, glass in things.items():
            if name.startswith("glass"):
                problem.set_initial_value(ontop(glass, things["table_0"]), True)
                problem.add_goal(inside(glass, things["refrigerator_0"]))
        problem.add_goal(up.Not(opened(things["refrigerator_0"])))

        def action(name: str, pre: Any, effects: Any, count: int = 1) -> Any:
            made = up.InstantaneousAction(name, **{f"p{index}": thing for index in range(count)})
            for condition in pre(*made.parameters):
                made.add_precondition(condition)
            for fluent, value in effects(*made.parameters):
                made.add_effect(fluent, value)
            problem.add_action(made)
            return made

        go = action("go", lambda a, b: [], lambda a, b: [(near(a), False), (near(b), True)], 2)
        approach = action("approach", lambda x: [near(x)], lambda x: [(ready(x), True)])
        converge = action("converge", lambda x: [ready(x)], lambda x: [(ready(x), False), (at(x), True)])
        grasp = action("grasp", lambda x: [at(x), empty], lambda x: [(at(x), False), (held(x), True), (empty, False)])
        grip = action("grip", lambda x: [at(x), empty], lambda x: [(at(x), False), (grips(x), True), (empty, False)])
        open_ = action("open", lambda x: [grips(x)], lambda x: [(opened(x), True)])
        close = action("close", lambda x: [grips(x)], lambda x: [(opened(x), False)])
        let_go = action("let_go", lambda x: [grips(x)], lambda x: [(grips(x), False), (empty, True)])
        lift = action("lift", lambda x, y: [held(x), ontop(x, y)], lambda x, y: [(ontop(x, y), False)], 2)
        move = action("move", lambda x: [], lambda x: [])
        put = action(
            "put",
            lambda x, y: [held(x), near(y), opened(y)],
            lambda x, y: [(held(x), False), (empty, True), (inside(x, y), True)],
            2,
        )
        fridge, table = things["refrigerator_0"], things["table_0"]
        steps: list[Any] = []
        here = table
        for part in task.subtasks:
            x = things[part.target]
            door = part.target == "refrigerator_0"
            for step in part.flow or ():
                match int(step.primitive):
                    case 17 | 18 as number:
                        there = x if number == 17 else fridge
                        if there is not here:
                            steps.append(ActionInstance(go, (here, there)))
                        here = there
                    case 1:
                        steps.append(ActionInstance(approach, (x,)))
                    case 2:
                        steps.append(ActionInstance(converge, (x,)))
                    case 3:
                        steps.append(ActionInstance(grip if door else grasp, (x,)))
                    case 4:
                        steps.append(ActionInstance(open_, (x,)))
                    case 19:
                        steps.append(ActionInstance(close, (x,)))
                    case 5:
                        steps.append(ActionInstance(let_go, (x,)) if door else ActionInstance(put, (x, fridge)))
                    case 7:
                        steps.append(ActionInstance(lift, (x, table)))
                    case _:
                        steps.append(ActionInstance(move, (x,)))
        problem.set_initial_value(near(table), True)
        with SequentialPlanValidator() as validator:
            result = validator.validate(problem, SequentialPlan(steps))
        return bool(result.status == ValidationResultStatus.VALID)

    return validate


def row(length: int) -> tuple[float, str]:
    """Returns how long `verify` took for a chain in milliseconds, and the rest of its row."""
    task = chain(length)
    report = oag.compose(task).verify()
    if not report or report.certificate is None:
        raise SystemExit(f"the chain of {length} subtasks is not proved:\n{report}")
    certificate = json.loads(json.dumps(report.certificate.to_json()))
    runs = 20 if length <= 100 else 5
    verify_ms = best_ms(lambda: oag.compose(task).verify(), runs)
    others = (
        best_ms(lambda: oag.compose(task).verify().certificate, runs),
        best_ms(lambda: oag.recheck(certificate), runs),
        best_ms(lambda: oag.compose(task).graph, runs),
    )
    validate = peer(task)
    if validate is None:
        beside = "not installed, skipped"
    elif not validate():
        beside = "refused the plan"
    else:
        peer_ms = best_ms(validate, 3 if length > 100 else 5)
        beside = f"{peer_ms:.1f} ms, {peer_ms / verify_ms:.0f} times as long"
    cells = " ".join(f"{value:8.2f}" for value in others)
    return verify_ms, f"{cells}  {beside}"


def main(lengths: tuple[int, ...]) -> None:
    """Prints one row for each length."""
    print(f"{'K':>5} {'verify ms':>10} {'ratio':>6} {'+cert':>8} {'recheck':>8} {'graph':>8}  unified-planning")
    before: float | None = None
    for length in lengths:
        verify_ms, rest = row(length)
        ratio = verify_ms / before if before else 1.0
        print(f"{length:5d} {verify_ms:10.2f} {ratio:6.1f} {rest}")
        before = verify_ms


if __name__ == "__main__":
    main(tuple(map(int, sys.argv[1:])) or LENGTHS)
