"""The primitives as plain STRIPS actions, for validators that know nothing of this project; imports nothing.

The model says what the table of docs/semantics.md says of these plans: what each primitive needs and writes on items
that rest on a table and go into one refrigerator. Base, arm and hand are predicates here.
"""

from __future__ import annotations

from typing import NamedTuple

# A predicate, its arguments as positions of the action's parameters, and whether it holds.
Literal = tuple[str, tuple[int, ...], bool]

PREDICATES = {
    "near": 1,
    "ready": 1,
    "at": 1,
    "held": 1,
    "grips": 1,
    "opened": 1,
    "inside": 2,
    "ontop": 2,
    "handempty": 0,
}


class Action(NamedTuple):
    """One action: how many parameters it has, what it needs, and what it writes."""

    arity: int
    needs: tuple[Literal, ...]
    writes: tuple[Literal, ...]


ACTIONS = {
    "go": Action(2, (("near", (0,), True),), (("near", (0,), False), ("near", (1,), True))),
    "stay": Action(1, (("near", (0,), True),), ()),
    "approach": Action(1, (("near", (0,), True),), (("ready", (0,), True),)),
    "converge": Action(1, (("ready", (0,), True),), (("ready", (0,), False), ("at", (0,), True))),
    "grasp": Action(
        1,
        (("at", (0,), True), ("handempty", (), True)),
        (("at", (0,), False), ("held", (0,), True), ("handempty", (), False)),
    ),
    "grip": Action(
        1,
        (("at", (0,), True), ("handempty", (), True)),
        (("at", (0,), False), ("grips", (0,), True), ("handempty", (), False)),
    ),
    "pull": Action(1, (("grips", (0,), True),), (("opened", (0,), True),)),
    "push": Action(1, (("grips", (0,), True),), (("opened", (0,), False),)),
    "let_go": Action(1, (("grips", (0,), True),), (("grips", (0,), False), ("handempty", (), True))),
    "lift": Action(2, (("held", (0,), True), ("ontop", (0, 1), True)), (("ontop", (0, 1), False),)),
    "move": Action(1, (), ()),
    "put": Action(
        2,
        (("held", (0,), True), ("near", (1,), True), ("opened", (1,), True)),
        (("held", (0,), False), ("handempty", (), True), ("inside", (0, 1), True)),
    ),
}


class Plan(NamedTuple):
    """A ground problem and its plan.

    Attributes:
        objects: All names.
        start: The atoms that hold at the start; all others do not.
        goal: Atoms with the value they must have at the end.
        steps: Action and arguments, in order.
    """

    objects: list[str]
    start: list[list[str]]
    goal: list[tuple[list[str], bool]]
    steps: list[list[str]]


def pddl(plan: Plan) -> tuple[str, str, str]:
    """Return domain, problem and plan as PDDL."""
    names = [f"?p{index}" for index in range(2)]
    predicates = " ".join(f"({' '.join((name, *names[:arity]))})" for name, arity in PREDICATES.items())
    actions = "\n".join(
        f"(:action {name} :parameters ({' '.join(names[: action.arity])})\n"
        f" :precondition (and {' '.join(_said(literal, names) for literal in action.needs)})\n"
        f" :effect (and {' '.join(_said(literal, names) for literal in action.writes)}))"
        for name, action in ACTIONS.items()
    )
    domain = f"(define (domain primitives) (:requirements :strips)\n(:predicates {predicates})\n{actions})\n"
    goal = " ".join(_signed(f"({' '.join(atom)})", value) for atom, value in plan.goal)
    start = " ".join(f"({' '.join(atom)})" for atom in plan.start)
    problem = (
        f"(define (problem chain) (:domain primitives)\n(:objects {' '.join(plan.objects)})\n"
        f"(:init {start})\n(:goal (and {goal})))\n"
    )
    return domain, problem, "\n".join(f"({' '.join(step)})" for step in plan.steps) + "\n"


def _said(literal: Literal, names: list[str]) -> str:
    name, positions, value = literal
    return _signed(f"({' '.join((name, *(names[position] for position in positions)))})", value)


def _signed(atom: str, value: bool) -> str:
    return atom if value else f"(not {atom})"
