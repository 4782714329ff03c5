"""An independent check of certificates, from their own JSON and the primitive table alone.

It rebuilds all writes from the table, and checks that each thing needed has a link, whose write gives the value, with
no write in between. It knows the language and the table of primitives, and nothing of `verify`.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

import hashlib
import json
from bisect import bisect_right
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import bddl
from oag.facts import EEF, EMPTY, HAND, HOME, NEAR, Condition, Fact, Value, condition_of, generalisations
from oag.library import Context, Needed, effect, library_sha, needed, placement_of, requirements
from oag.primitives import Primitive

_Consumer = tuple[str, int, int]


@dataclass(frozen=True, slots=True)
class RecheckResult:
    """True when a certificate bears out its verdict; `reason` says what was confirmed, or what is wrong."""

    ok: bool
    reason: str

    def __bool__(self) -> bool:
        return self.ok


class _Rejected(Exception):
    """The certificate does not bear out its verdict."""


def _require(condition: bool, reason: str) -> None:
    if not condition:
        raise _Rejected(reason)


def recheck(certificate: Any) -> RecheckResult:
    """Decides whether a `Certificate`, or its JSON mapping, bears out its verdict; a malformed one is rejected."""
    try:
        data = certificate if isinstance(certificate, Mapping) else certificate.to_json()
        return RecheckResult(True, _Checker(data).check())
    except _Rejected as problem:
        return RecheckResult(False, str(problem))
    except (KeyError, TypeError, ValueError, IndexError, AttributeError, RecursionError) as problem:
        return RecheckResult(False, f"malformed certificate: {type(problem).__name__}: {problem}")


class _Checker:
    """One certificate under check; `writes` lists who wrote a fact when, in order."""

    def __init__(self, data: Mapping[str, Any]) -> None:
        self.data, self.plan, self.scene = data, data["plan"], data["scene"]
        self.assumed = [entry for entry in data["assumptions"] if entry["kind"] != "reset"]
        self.writes: dict[Fact, list[tuple[int, Value]]] = {tuple(f): [(0, value)] for f, value in self.scene["start"]}
        self.links: dict[_Consumer, list[tuple[Condition, int]]] = {}
        for kind, subtask, step, fact, value, positive, producer in data["links"]:
            _require(type(positive) is bool and type(producer) is int, "a link has a field of the wrong type")
            self.links.setdefault((kind, subtask, step), []).append((Condition(tuple(fact), value, positive), producer))

    def check(self) -> str:
        """Returns what was confirmed, or raises _Rejected."""
        data = self.data
        _require(data["schema"] == "scene2demo-certificate/1", f"unknown schema {data['schema']!r}")
        _require(data["library_sha"] == library_sha(), "it was made with another table of primitives")
        for key, part in (("task_hash", self.plan), ("scene_sha", self.scene)):
            text = json.dumps(part, sort_keys=True, separators=(",", ":"))
            _require(data[key] == hashlib.sha256(text.encode()).hexdigest(), f"{key} is of something else")
        shown = "REFUTED" if data["failure"] is not None else "CONDITIONAL" if self.assumed else "PROVED"
        _require(data["verdict"] == shown, f"the evidence is for {shown}, the verdict says {data['verdict']}")
        formulas = {tuple(entry["consumer"]) for entry in self.assumed if "formula" in entry}
        stop = data["failure"] and tuple(data["failure"])
        self._write_reset()
        for consumer, time, wanted in self._needs():
            if consumer == stop:
                _require(self._truth(consumer, time, wanted) is False, f"{consumer} is not shown to be false")
                return f"{consumer} fails, as claimed"
            accepted = (True, None) if consumer in formulas else (True,)
            _require(self._truth(consumer, time, wanted) in accepted, f"the links do not give {consumer}")
        _require(stop is None, "the obligation said to fail does not exist")
        return f"{len(data['links'])} links confirmed"

    def _write_reset(self) -> None:
        """Writes what the robot's reset may add to the scene's facts."""
        supplied = [(EEF, HOME), (HAND, EMPTY), *((NEAR, subtask["target"]) for subtask in self.plan["subtasks"][:1])]
        for fact, value in ((tuple(e["fact"]), e["value"]) for e in self.data["assumptions"] if e["kind"] == "reset"):
            _require(fact not in self.writes and (fact, value) in supplied, f"the reset does not supply {fact}")
            self.writes[fact] = [(0, value)]

    def _last(self, fact: Fact, time: int) -> tuple[Value, int]:
        """Returns the value that a fact has at a time, and when it was written (-1: never)."""
        best: tuple[Value, int] = (None, -1)
        for written in filter(None, map(self.writes.get, generalisations(fact))):
            index = bisect_right(written, time, key=itemgetter(0)) - 1
            if index >= 0 and written[index][0] > best[1]:
                best = (written[index][1], written[index][0])
        return best

    def _needs(self) -> Iterator[tuple[_Consumer, int, Needed]]:
        """Yields what is needed where and when, in order, while the writes of every step are rebuilt."""
        time, articulated = 1, tuple(self.scene["articulated"])
        pending = sorted((entry for entry in self.assumed if "fact" in entry), key=lambda entry: -entry["time"])
        for index, subtask in enumerate(self.plan["subtasks"]):
            target, goal = subtask["target"], bddl.parse_formula(subtask["goal"])
            is_item, support = target in self.scene["items"], subtask["support_goal"]
            context = Context(target, support, placement_of(goal, target), is_item, articulated)
            self._assume(pending, time)
            yield ("init", index, -1), time, needed(bddl.parse_formula(subtask["init"]))
            for position, item in enumerate(subtask["flow"]):
                self._assume(pending, time)
                hand = self._last(HAND, time)[0]
                primitive = Primitive(int(next(iter(item)) if isinstance(item, Mapping) else item))
                yield ("precondition", index, position), time, requirements(primitive, context, hand)
                for fact, value in effect(primitive, context, hand):
                    self.writes.setdefault(fact, []).append((time + 1, value))
                time += 2
            self._assume(pending, time)
            yield ("goal", index, -1), time, needed(goal)
        self._assume(pending, time)
        yield ("task-goal", len(self.plan["subtasks"]), -1), time, needed(bddl.parse_formula(self.plan["goal"]))

    def _assume(self, pending: list[Any], time: int) -> None:
        """Writes the assumptions of a time, each of which must speak of something unknown."""
        while pending and pending[-1]["time"] <= time:
            fact, value = tuple(pending[-1]["fact"]), pending.pop()["value"]
            _require(self._last(fact, time)[0] is None, f"{fact} is assumed though it is known")
            self.writes.setdefault(fact, []).append((time, value))

    def _truth(self, consumer: _Consumer, time: int, wanted: Needed) -> bool | None:
        """Returns whether the links of a place make what it needs true or false; raises for a link that is wrong."""
        truths: dict[Condition, bool | None] = {}
        for condition, producer in self.links.get(consumer, ()):
            value, written = self._last(condition.fact, time)
            _require(written == producer, f"{consumer}: {condition.fact} is written at {written}, not {producer}")
            truths[condition] = condition.grade(value)
        if isinstance(wanted, tuple):
            if any(all(truths.get(condition) is False for condition in clause) for clause in wanted):
                return False
            return all(any(truths.get(condition) for condition in clause) for clause in wanted) or None
        known = {(c.fact, c.value): truth is c.positive for c, truth in truths.items() if truth is not None}
        return bddl.evaluate(wanted, lambda atom: known.get(condition_of(atom, True)[:2]), self.scene["objects"])
