"""Certificates that say something else of a plan, with links that fit: what a forger with the checker would try."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import bddl
from oag.certificate import check_plan
from oag.certificate.check_plan import Rejected
from oag.model.symbols import known_as
from oag.primitives.state import facts_of
from tests.forgeries import rehashed

_BROKEN = (KeyError, IndexError, TypeError, AttributeError, ValueError, Rejected, bddl.BDDLError)
_OTHERS = (["near"], ["eef"], ["inside", "cup_0", "fridge_0"])


def framings(original: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Every verdict at every place, with and without resets, by nothing, one assumption or two cases, and some run."""
    # A forged certificate may have lost its assumptions, or something else in their place: then it has none.
    listed = original.get("assumptions")
    stated = [entry for entry in listed if isinstance(entry, dict)] if isinstance(listed, list) else []
    resets = [entry for entry in stated if entry.get("kind") == "reset"]
    for some in (resets, *([entry for entry in resets if entry is not left] for left in resets)):
        data = {**original, "assumptions": some, "cases": [], "failure": None, "search": None, "counterexample": None}
        yield from _fitting({**data, "verdict": "PROVED"})
        for place, time, facts in _survey(data):
            for fact, value, later in product((*facts, *_OTHERS), (True, False), (False, True)):
                run = [[0, fact, value]]
                yield from _refutations(data, place, time if later else 1, run)
                assumed = {"kind": "assumed", "time": time if later else 1, "fact": fact, "value": value}
                for kept in ([], [entry for entry in stated if entry.get("kind") == "assumed"]):
                    given = sorted(
                        [*kept, assumed], key=lambda entry: entry["time"] if type(entry.get("time")) is int else 0
                    )
                    for missed in (run, [[0, fact, not value]]):
                        said = {"verdict": "CONDITIONAL", "assumptions": [*some, *given], "counterexample": missed}
                        yield from _fitting({**data, **said})


def _time(entry: dict[str, Any]) -> int:
    """When something is assumed; what was forged may say no time."""
    time = entry.get("time")
    return time if isinstance(time, int) else 0


def _refutations(data: dict[str, Any], place: list[Any], time: int, run: list[Any]) -> Iterator[dict[str, Any]]:
    """A place is said to fail in a run, by what is known, by an assumption either way, or by cases."""
    refuted = {**data, "verdict": "REFUTED", "failure": place, "counterexample": run}
    yield from _fitting(refuted)
    (_, fact, _) = run[0]
    for value in (True, False):
        assumed = {"kind": "assumed", "time": time, "fact": fact, "value": value}
        yield from _fitting({**refuted, "assumptions": [*data["assumptions"], assumed]})
    for split in (fact, [0, fact], [time, fact]):
        yield from _fitting({**refuted, "cases": [{"consumer": place, "tree": [split, None, None]}]})


def _survey(data: dict[str, Any]) -> list[tuple[list[Any], int, list[list[str]]]]:
    """Every place of a plan, with its time and what it reads, as far as it can be followed."""
    found = []
    try:
        run = check_plan.PlanRun(data)
        for place, wanted in run.places():
            facts = [list(fact) for fact in facts_of(wanted, data["scene"]["objects"])]
            found.append((list(place), run.time, facts))
    except _BROKEN:
        pass
    return found


def _fitting(data: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """The certificate without links, and with links to the last writes of what is needed."""
    yield rehashed({**data, "links": []})
    links: list[list[Any]] = []
    try:
        assumed = [entry for entry in data["assumptions"] if entry["kind"] == "assumed"]
        run = check_plan.PlanRun(data, [(entry["time"], entry["fact"], entry["value"]) for entry in assumed])
        settled = [entry["consumer"] for entry in data["cases"]]
        for place, wanted in run.places():
            if data["failure"] not in (None, list(place)):
                continue
            read = [(fact, run.value(fact)) for fact in facts_of(wanted, data["scene"]["objects"])]
            conditions = [known_as(fact, value) for fact, value in read if value is not None]
            if isinstance(wanted, tuple) and list(place) not in settled:
                conditions = [next((c for c in clause if c.grade(run.value(c.fact))), clause[0]) for clause in wanted]
            links += [[*place, list(c.fact), c.value, c.positive, run.last(c.fact)[0]] for c in conditions]
    except _BROKEN:
        pass
    yield rehashed({**data, "links": links})
