"""Rewards of the reference implementation; runs under its interpreter, never under this project's.

Reads one JSON request a line from standard input and writes one JSON answer a line. Requests:

    {"do": "ground", "activity": NAME, "atoms": [[P, A, B], ...]}
        -> {"options": how many, "seconds": for grounding, the best of three times, "error": what it raised or null}
    {"do": "reward", "activity": NAME, "states": [HEX, ...]}  -> the reward in each state, or null without options
    {"do": "time", "activity": NAME, "states": [HEX, ...]}    -> seconds that the rewards of all of them took, or null

A state is a number whose bit i is the value of the i-th atom.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

# Run as a script, this folder is where Python looks first.
from reference_goals import ANSWERS, Lookup, Thing

from bddl.activity import (
    Conditions,
    get_goal_conditions,
    get_ground_goal_state_options,
    get_object_scope,
    get_reward,
)


class Rewarded:
    """The ground options of an activity, evaluated through the backend that looks atoms up."""

    def __init__(self, activity: str, atoms: list[list[str]]) -> None:
        self.backend = Lookup()
        self.options: list[Any] = []
        self.error: str | None = None
        self.seconds = float("inf")
        conditions = Conditions(activity, 0, "omnigibson")
        scope = {name: Thing(name) for name in get_object_scope(conditions)}
        for _ in range(3):
            begin = time.perf_counter()
            try:
                goal = get_goal_conditions(conditions, self.backend, scope)
                self.options = get_ground_goal_state_options(conditions, self.backend, scope, goal)
            except Exception as problem:  # Whatever it raises is what there is to report.
                self.error = f"{type(problem).__name__}: {problem}"
            self.seconds = min(self.seconds, time.perf_counter() - begin)
        self.facts = [] if self.error else [(atom[0], *[scope[name] for name in atom[1:]]) for atom in atoms]

    def rewards(self, states: list[str]) -> list[float]:
        """Return the reward in each state."""
        found: list[float] = []
        for state in states:
            bits = int(state, 16)
            self.backend.true = {fact for index, fact in enumerate(self.facts) if bits >> index & 1}
            found.append(get_reward(self.options))
        return found


def answer(request: dict[str, Any], known: dict[str, Rewarded]) -> object:
    """Do what a request asks for."""
    activity = request["activity"]
    if request["do"] == "ground":
        known[activity] = Rewarded(activity, request["atoms"])
        found = known[activity]
        return {"options": len(found.options), "seconds": found.seconds, "error": found.error}
    if not known[activity].options:
        return None
    begin = time.perf_counter()
    rewards = known[activity].rewards(request["states"])
    return rewards if request["do"] == "reward" else time.perf_counter() - begin


def main() -> None:
    """Answers requests until standard input ends."""
    known: dict[str, Rewarded] = {}
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line), known)), file=ANSWERS, flush=True)


if __name__ == "__main__":
    main()
