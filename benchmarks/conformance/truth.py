"""D2: the truth of goals. Equal to the reference's in its semantics, and to an oracle's in the semantics of matchings.

For each activity, states of its goal's atoms are drawn, from almost nothing true to almost everything true, and a few
in which the goal was made true as far as possible. Every condition of the goal is evaluated in each state: by the
reference, and here by `evaluate`, by the compiled goal and by its batch.
"""

from __future__ import annotations

import random
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

import bddl
from benchmarks.compiled_goals import compile_goal
from benchmarks.conformance.context import Context, Measure, Result
from benchmarks.conformance.goal_oracle import oracle
from benchmarks.conformance.goal_peer import GoalPeer
from benchmarks.conformance.goal_states import draw

STATES = 64
QUICK_STATES = 4


@dataclass
class Outcome:
    """What was compared, and where it differed.

    Attributes:
        activities: How many activities were compared.
        vectors: How many states, each with one truth value for every condition.
        values: How many truth values.
        goals_true: In how many states the whole goal held.
        unequal: Activities where this project in the reference's semantics and the reference differ.
        self_unequal: Activities where `evaluate`, the compiled goal and the batch differ from each other.
        oracle_unequal: Activities where the semantics of matchings and the oracle differ.
        matching_differs: Activities where matchings and the reference differ, with the largest `forpairs` in each.
    """

    activities: int = 0
    vectors: int = 0
    values: int = 0
    goals_true: int = 0
    unequal: list[str] = field(default_factory=list)
    self_unequal: list[str] = field(default_factory=list)
    oracle_unequal: list[str] = field(default_factory=list)
    matching_differs: dict[str, int] = field(default_factory=dict)


def check_truth(context: Context) -> Result:
    """Compare all activities on random states of the context's seed."""
    outcome = Outcome()
    states = QUICK_STATES if context.quick else STATES
    with GoalPeer(context.interpreter) as peer:
        for name, text in context.corpus.items():
            problem = bddl.parse(text, profile="behavior-compat")
            _compare(name, problem, peer, random.Random(f"{context.seed} {name}"), states, outcome)
    total = outcome.activities
    differ = outcome.matching_differs
    return Result(
        (
            Measure(
                f"truth of conditions, reference semantics ({outcome.vectors} states, {outcome.values} values)",
                f"{total - len(outcome.unequal)} of {total} activities equal",
                goal=f"{total} of {total}",
                holds=not outcome.unequal,
            ),
            Measure(
                "evaluate = compiled = batch",
                f"{total - len(outcome.self_unequal)} of {total} activities",
                goal=f"{total} of {total}",
                holds=not outcome.self_unequal,
            ),
            Measure(
                "matchings equal to networkx",
                f"{total - len(outcome.oracle_unequal)} of {total} activities",
                goal=f"{total} of {total}",
                holds=not outcome.oracle_unequal,
            ),
            Measure(
                "activities where matchings and the reference's count differ",
                f"{len(differ)}, smallest largest forpairs {min(differ.values(), default=0)}",
                goal="only with forpairs of 3 or more",
                holds=all(pairs >= 3 for pairs in differ.values()),
            ),
        ),
        asdict(outcome),
    )


def _compare(
    name: str, problem: bddl.Problem, peer: GoalPeer, source: random.Random, states: int, outcome: Outcome
) -> None:
    objects = {thing.name: thing.category for thing in problem.objects}
    ours = compile_goal(problem.goal, objects, pairs="reference")
    drawn = list(draw(ours, bddl.ground(problem.goal, objects).root, source, states))
    conditions = peer.load(name, ours.atoms, checked=True)
    theirs = peer.ask("evaluate", activity=name, states=[hex(state) for state in drawn])
    width = len(ours.atoms)
    rows = [[bool(state >> index & 1) for index in range(width)] for state in drawn]
    found = [tuple(row) for row in ours.evaluate_batch(rows or [[]]).tolist()]
    known = [dict(zip(ours.atoms, row, strict=True)) for row in rows]
    slowly = [
        tuple(bddl.evaluate(part, state, objects, pairs="reference") for part in ours.conditions) for state in known
    ]
    if conditions != len(ours.conditions) or theirs != ["".join("01"[value] for value in row) for row in found]:
        outcome.unequal.append(name)
    if not found == slowly == [ours.evaluate_conditions(state) for state in drawn]:
        outcome.self_unequal.append(name)
    if any(isinstance(node, bddl.ForPairs) for node in problem.goal.walk()):
        matching = compile_goal(problem.goal, objects)
        paired = [matching.evaluate_conditions(state) for state in drawn]
        expected = [tuple(oracle(part, state, objects) for part in matching.conditions) for state in known]
        batch = [tuple(row) for row in matching.evaluate_batch(rows).tolist()]
        if not paired == expected == batch:
            outcome.oracle_unequal.append(name)
        if paired != found:
            outcome.matching_differs[name] = largest_pairing(problem.goal, objects)
    outcome.activities += 1
    outcome.vectors += len(drawn)
    outcome.values += len(drawn) * len(ours.conditions)
    outcome.goals_true += sum(map(all, found))


def largest_pairing(goal: bddl.Formula, objects: Mapping[str, str]) -> int:
    """Return how many pairs the largest `forpairs` of a goal asks for."""
    categories = list(objects.values())
    return max(
        min(categories.count(binder.category) for binder in node.binders) if node.number is None else node.number
        for node in goal.walk()
        if isinstance(node, bddl.ForPairs)
    )
