"""Builds and validates plans with unified-planning's Python API; runs in that package's own environment.

Reads a JSON line for each plan from standard input, and answers with one: the shortest times in milliseconds to build
the problem and to validate the plan, and whether it was found valid.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import unified_planning.shortcuts as up
from unified_planning.engines import SequentialPlanValidator, ValidationResultStatus
from unified_planning.plans import ActionInstance, SequentialPlan

from benchmarks.primitive_model import ACTIONS, PREDICATES, Plan


def build(plan: Plan) -> tuple[Any, Any]:
    """Return a plan's problem and its sequence of actions."""
    thing = up.UserType("thing")
    fluents = {
        name: up.Fluent(name, up.BoolType(), **{f"x{index}": thing for index in range(arity)})
        for name, arity in PREDICATES.items()
    }
    problem = up.Problem("chain")
    for fluent in fluents.values():
        problem.add_fluent(fluent, default_initial_value=False)
    things = {name: problem.add_object(name, thing) for name in plan.objects}
    for name, *arguments in plan.start:
        problem.set_initial_value(fluents[name](*(things[each] for each in arguments)), True)
    for (name, *arguments), value in plan.goal:
        atom = fluents[name](*(things[each] for each in arguments))
        problem.add_goal(atom if value else up.Not(atom))
    actions = {}
    for name, (arity, needs, writes) in ACTIONS.items():
        action = up.InstantaneousAction(name, **{f"p{index}": thing for index in range(arity)})
        for predicate, positions, value in needs:
            atom = fluents[predicate](*(action.parameters[position] for position in positions))
            action.add_precondition(atom if value else up.Not(atom))
        for predicate, positions, value in writes:
            action.add_effect(fluents[predicate](*(action.parameters[position] for position in positions)), value)
        problem.add_action(action)
        actions[name] = action
    steps = [ActionInstance(actions[name], tuple(things[each] for each in rest)) for name, *rest in plan.steps]
    return problem, SequentialPlan(steps)


def measure(plan: Plan, runs: int, cpu: bool) -> dict[str, Any]:
    """Return the shortest times of several runs, and whether the plan was found valid in all."""
    clock = time.process_time if cpu else time.perf_counter
    build_ms, validate_ms, valid = float("inf"), float("inf"), True
    for _ in range(runs):
        begin = clock()
        problem, steps = build(plan)
        built = clock()
        with SequentialPlanValidator() as validator:
            result = validator.validate(problem, steps)
        end = clock()
        build_ms, validate_ms = min(build_ms, 1000.0 * (built - begin)), min(validate_ms, 1000.0 * (end - built))
        valid = valid and result.status == ValidationResultStatus.VALID
    return {"build_ms": build_ms, "validate_ms": validate_ms, "valid": valid}


def main() -> None:
    """Answers until the input ends."""
    up.get_environment().credits_stream = None
    for line in sys.stdin:
        request = json.loads(line)
        print(json.dumps(measure(Plan(*request["plan"]), request["runs"], request["cpu"])), flush=True)


if __name__ == "__main__":
    main()
