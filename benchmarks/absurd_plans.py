"""What a plan validator says of physically absurd plans: the table of `tests/oag/absurd.py` in plain STRIPS.

`python -m benchmarks.absurd_plans write FILE` writes the plans as PDDL, one JSON line each. `... judge FILE` runs in
the environment of unified-planning, and prints its answer to each. The domain is what a planner's user would write:
open, close, pick up and put, with the hand, doors and places; cargo, sizes and kinds have no word in it.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

DOMAIN = """(define (domain household)
  (:requirements :strips :negative-preconditions)
  (:predicates (open ?f) (inside ?x ?y) (ontop ?x ?y) (held ?x) (handempty))
  (:action pull_open :parameters (?f) :precondition (and (handempty) (not (open ?f))) :effect (open ?f))
  (:action push_shut :parameters (?f) :precondition (and (handempty) (open ?f)) :effect (not (open ?f)))
  (:action pick_from :parameters (?x ?s) :precondition (and (handempty) (ontop ?x ?s))
    :effect (and (held ?x) (not (handempty)) (not (ontop ?x ?s))))
  (:action pick_out_of :parameters (?x ?f) :precondition (and (handempty) (inside ?x ?f) (open ?f))
    :effect (and (held ?x) (not (handempty)) (not (inside ?x ?f))))
  (:action pick_out_of_vessel :parameters (?x ?v) :precondition (and (handempty) (inside ?x ?v))
    :effect (and (held ?x) (not (handempty)) (not (inside ?x ?v))))
  (:action put_on :parameters (?x ?s) :precondition (held ?x)
    :effect (and (ontop ?x ?s) (handempty) (not (held ?x))))
  (:action put_in :parameters (?x ?f) :precondition (and (held ?x) (open ?f))
    :effect (and (inside ?x ?f) (handempty) (not (held ?x))))
  (:action put_in_vessel :parameters (?x ?v) :precondition (held ?x)
    :effect (and (inside ?x ?v) (handempty) (not (held ?x)))))
"""


def _action(step: str, fixtures: frozenset[str]) -> str:
    verb, target, *rest = step.partition(" with ")[0].split()
    if not rest:
        return f"({'pull_open' if verb == 'open' else 'push_shut'} {target})"
    name = f"{verb}_{rest[0]}"
    vessel = "_vessel" if name in ("pick_out_of", "put_in") and rest[1] not in fixtures else ""
    return f"({name}{vessel} {target} {rest[1]})"


def write(path: Path) -> None:
    """Write every plan of the table as a JSON line: its name, whether it is absurd, and PDDL."""
    import bddl
    from oag.model.symbols import Kind
    from tests.oag.absurd import ABSURD, SOUND

    lines = []
    for plan in (*ABSURD, *SOUND):
        scene = plan.scene()
        fixtures = frozenset(key for key, thing in scene.objects.items() if thing.kind is Kind.ARTICULATED)
        facts = [f"({fact})" for fact in plan.facts if not fact.startswith("not ")]
        goal = bddl.format(bddl.And(tuple(bddl.conjuncts(plan.task().goal))))
        goal = re.sub(r"\(inside (\S+) gripper\)", r"(held \1)", goal)
        problem = (
            f"(define (problem p) (:domain household) (:objects {plan.things})\n"
            f"  (:init (handempty) {' '.join(facts)})\n  (:goal {goal}))"
        )
        steps = [_action(step, fixtures) for step in plan.steps]
        lines.append(json.dumps({"name": plan.name, "absurd": plan in ABSURD, "problem": problem, "plan": steps}))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def judge(path: Path) -> dict[str, dict[str, Any]]:
    """Return unified-planning's answer to each plan: VALID, INVALID, or the name of its exception."""
    import unified_planning.shortcuts as up
    from unified_planning.engines import SequentialPlanValidator
    from unified_planning.io import PDDLReader

    up.get_environment().credits_stream = None
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines():
        entry = json.loads(line)
        try:
            problem = PDDLReader().parse_problem_string(DOMAIN, entry["problem"])
            plan = PDDLReader().parse_plan_string(problem, "\n".join(entry["plan"]))
            with SequentialPlanValidator() as validator:
                answer = validator.validate(problem, plan).status.name
        except Exception as problem_found:
            answer = type(problem_found).__name__
        found[entry["name"]] = {"absurd": entry["absurd"], "answer": answer}
    return found


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mode", choices=("write", "judge"))
    parser.add_argument("file", type=Path)
    options = parser.parse_args()
    if options.mode == "write":
        write(options.file)
    elif options.file.is_file():
        print(json.dumps(judge(options.file), indent=1))
    else:
        parser.error(f"{options.file} is no file; `write` makes one")
