"""Evaluates goals with the reference implementation; runs under its interpreter, never under this project's.

Reads one JSON request a line from standard input and writes one JSON answer a line. Requests:

    {"do": "list"}                                              -> {name of activity: path of its definition}
    {"do": "load", "activity": NAME, "atoms": [[P, A, B], ...]} -> number of goal conditions
    {"do": "evaluate", "activity": NAME, "states": [HEX, ...]}  -> ["10", ...]: the conditions that hold in each state
    {"do": "time", "activity": NAME, "states": [HEX, ...]}      -> seconds that evaluating all of them took
    {"do": "cold", "activity": NAME}                            -> seconds for importing, parsing, compiling, evaluating

A state is a number whose bit i is the value of the i-th atom. The backend does nothing but look an atom up among the
true ones; the one that the reference ships has wrong predicates and prints every atom.
"""

from __future__ import annotations

import json
import os
import sys
import time
from typing import Any

# The reference prints what it does not recognise; the answers keep standard output for themselves.
ANSWERS = os.fdopen(os.dup(sys.stdout.fileno()), "w")
sys.stdout = sys.stderr

BEGIN = time.perf_counter()
from bddl.activity import Conditions, evaluate_goal_conditions, get_goal_conditions, get_object_scope  # noqa: E402
from bddl.config import ACTIVITY_CONFIGS_PATH  # noqa: E402
from bddl.logic_base import BinaryAtomicFormula, UnaryAtomicFormula  # noqa: E402
from bddl.parsing import parse_domain  # noqa: E402

IMPORTING = time.perf_counter() - BEGIN
DOMAIN = "omnigibson"
PREDICATES = parse_domain(DOMAIN)[-1]


class Thing:
    """An object of the simulator that there is not; known by its identity."""

    def __init__(self, name: str) -> None:
        self.name = name


class Lookup:
    """A backend whose predicates are true when (predicate, object, ...) is in `true`.

    With `known` set, atoms outside it are an error: every atom the reference asks about must be one of the goal's.
    """

    def __init__(self) -> None:
        self.true: set[tuple[object, ...]] = set()
        self.known: set[tuple[object, ...]] | None = None
        self._classes: dict[str, type] = {}

    def get_predicate_class(self, name: str) -> type:
        """Return the class of a predicate, as the reference asks its backends."""
        if name not in self._classes:
            self._classes[name] = self._made(name)
        return self._classes[name]

    def _made(self, name: str) -> type:
        backend = self

        def unary(_: object, thing: Thing) -> bool:
            return (name, thing) in backend.true

        def binary(_: object, first: Thing, second: Thing) -> bool:
            return (name, first, second) in backend.true

        def checked(_: object, *things: Thing) -> bool:
            if backend.known is not None and (name, *things) not in backend.known:
                raise KeyError(f"({name} {' '.join(thing.name for thing in things)}) is no atom of the goal")
            return (name, *things) in backend.true

        base = UnaryAtomicFormula if len(PREDICATES[name]) == 1 else BinaryAtomicFormula
        fast = unary if base is UnaryAtomicFormula else binary
        evaluate = checked if backend.known is not None else fast
        return type(name, (base,), {"STATE_NAME": name, "_evaluate": evaluate, "_sample": lambda *_: None})


class Goal:
    """A compiled goal of the reference, with the objects its atoms speak of."""

    def __init__(self, activity: str, atoms: list[list[str]] | None, checked: bool) -> None:
        self.backend = Lookup()
        conditions = Conditions(activity, 0, DOMAIN)
        scope = {name: Thing(name) for name in get_object_scope(conditions)}
        self.facts = [(atom[0], *[scope[name] for name in atom[1:]]) for atom in atoms or ()]
        self.backend.known = set(self.facts) if checked else None
        self.conditions = get_goal_conditions(conditions, self.backend, scope, generate_ground_options=False)

    def true_facts(self, state: str) -> set[tuple[object, ...]]:
        """Return the facts that are true in a state."""
        bits = int(state, 16)
        return {fact for index, fact in enumerate(self.facts) if bits >> index & 1}

    def evaluate(self, state: str) -> str:
        """Return a digit for each condition: 1 where it holds."""
        self.backend.true = self.true_facts(state)
        _, found = evaluate_goal_conditions(self.conditions)
        satisfied = set(found["satisfied"])
        return "".join("1" if number in satisfied else "0" for number in range(len(self.conditions)))

    def seconds(self, states: list[str]) -> float:
        """Return how long evaluating all conditions in all states took, the best of three times."""
        prepared = [self.true_facts(state) for state in states]
        best = float("inf")
        for _ in range(3):
            begin = time.perf_counter()
            for self.backend.true in prepared:
                evaluate_goal_conditions(self.conditions)
            best = min(best, time.perf_counter() - begin)
        return best


def answer(request: dict[str, Any], goals: dict[str, Goal]) -> object:
    """Do what a request asks for."""
    activity = request.get("activity", "")
    match request["do"]:
        case "list":
            names = sorted(os.listdir(ACTIVITY_CONFIGS_PATH))
            paths = {name: os.path.join(ACTIVITY_CONFIGS_PATH, name, "problem0.bddl") for name in names}
            return {name: path for name, path in paths.items() if os.path.isfile(path)}
        case "load":
            goals[activity] = Goal(activity, request["atoms"], request.get("checked", False))
            return len(goals[activity].conditions)
        case "evaluate":
            return [goals[activity].evaluate(state) for state in request["states"]]
        case "time":
            return goals[activity].seconds(request["states"])
        case "cold":
            begin = time.perf_counter()
            Goal(activity, None, False).seconds(["0"])
            return IMPORTING + time.perf_counter() - begin
    raise ValueError(request["do"])


def main() -> None:
    """Answers requests until standard input ends."""
    goals: dict[str, Goal] = {}
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line), goals)), file=ANSWERS, flush=True)


if __name__ == "__main__":
    main()
