"""Certificates: why a verdict holds, as data that `recheck` can check without trusting `verify`.

A certificate repeats the plan and the start knowledge that it speaks of, and lists a causal link for everything that
the plan needs: the condition, and the write that decided it. A refutation ends at the first obligation that fails.

Source: docs/semantics.md, Certificates.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass

import bddl
from oag.actions import flow_to_json
from oag.categories import Kind
from oag.facts import HAND, ROBOT_FACTS, fact_text
from oag.library import library_sha
from oag.obligations import Obligation
from oag.progress import Trace
from oag.scene import Scene
from oag.start import RESET_REASONS, scene_facts
from oag.task import Task

SCHEMA = "scene2demo-certificate/1"


@dataclass(frozen=True, slots=True)
class Certificate:
    """The evidence for one verdict.

    Attributes:
        verdict: "PROVED", "CONDITIONAL" or "REFUTED".
        task_hash: SHA-256 of the plan.
        scene_sha: SHA-256 of the objects and the start knowledge.
        body: Everything else, as JSON values; `to_json` has all of it.
    """

    verdict: str
    task_hash: str
    scene_sha: str
    body: dict[str, object]

    @property
    def assumptions(self) -> tuple[dict[str, object], ...]:
        """What the verdict rests on beside the scene's facts: the reset, and for CONDITIONAL what is unknown."""
        listed = self.body["assumptions"]
        return tuple(listed) if isinstance(listed, list) else ()

    @property
    def links(self) -> tuple[list[object], ...]:
        """The causal links: [kind, subtask, step, fact, value, positive, producer]."""
        listed = self.body["links"]
        return tuple(listed) if isinstance(listed, list) else ()

    def to_json(self) -> dict[str, object]:
        """Returns the certificate as JSON values."""
        return {
            "schema": SCHEMA,
            "library_sha": library_sha(),
            "verdict": self.verdict,
            "task_hash": self.task_hash,
            "scene_sha": self.scene_sha,
            **self.body,
        }


def digest(value: object) -> str:
    """Returns the SHA-256 of a JSON value's canonical text."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def plan_json(task: Task) -> dict[str, object]:
    """Returns what a certificate repeats of a plan: roles, conditions, flows, and the task goal."""
    return {
        "goal": bddl.format(task.goal),
        "goal_given": task.goal_given,
        "subtasks": [
            {
                "target": subtask.target,
                "support_goal": subtask.support_goal,
                "init": bddl.format(subtask.init),
                "goal": bddl.format(subtask.goal),
                "flow": None if subtask.flow is None else flow_to_json(subtask.flow),
            }
            for subtask in task.subtasks
        ],
    }


def scene_json(scene: Scene) -> dict[str, object]:
    """Returns what a certificate repeats of a scene: categories, what can be taken or opened, and the start."""
    kinds = {key: thing.kind for key, thing in scene.objects.items()}
    return {
        "objects": {key: thing.category for key, thing in scene.objects.items()},
        "items": [key for key, kind in kinds.items() if kind is Kind.ITEM],
        "articulated": [key for key, kind in kinds.items() if kind is Kind.ARTICULATED],
        "start": [[list(fact), value] for fact, value in scene_facts(scene)],
    }


def certify(task: Task, scene: Scene, verdict: str, trace: Trace) -> Certificate:
    """Returns the certificate of a decided plan."""
    plan, start = plan_json(task), scene_json(scene)
    obligations = trace.obligations
    failure: list[object] | None = None
    if trace.failures:
        obligations = obligations[: trace.failures[0].obligation + 1]
        failure = _consumer(obligations[-1])
    body: dict[str, object] = {
        "plan": plan,
        "scene": start,
        "assumptions": [*_reset(obligations, trace, scene), *_unknown(trace, len(obligations))],
        "links": [
            [*_consumer(obligation), list(c.fact), c.value, c.positive, producer]
            for obligation in obligations
            for c, producer, _ in obligation.links
        ],
        "failure": failure,
    }
    return Certificate(verdict, digest(plan), digest(start), body)


def _consumer(obligation: Obligation) -> list[object]:
    """Returns the name of an obligation inside certificates."""
    return [obligation.kind, obligation.subtask, obligation.step]


def _reset(obligations: list[Obligation], trace: Trace, scene: Scene) -> list[dict[str, object]]:
    """Returns what the robot's reset supplied, as far as the plan uses it; what the hand holds is always used."""
    stated = {fact for fact, _ in scene_facts(scene)}
    used = {link.condition.fact for o in obligations for link in o.links if link.producer == 0} | {HAND}
    listed: list[dict[str, object]] = []
    for fact in ROBOT_FACTS:
        if fact in used and fact not in stated:
            value = next(iter(trace.knowledge.history(fact))).value
            entry = {"kind": "reset", "fact": list(fact), "value": value}
            listed.append({**entry, "text": fact_text(fact, value), "reason": RESET_REASONS[fact]})
    return listed


def _unknown(trace: Trace, count: int) -> list[dict[str, object]]:
    """Returns what was unknown and assumed for the first `count` obligations."""
    listed: list[dict[str, object]] = []
    for assumption in trace.assumptions:
        if assumption.obligation >= count:
            continue
        entry: dict[str, object] = {"kind": "assumed", "time": assumption.time}
        if assumption.condition is not None:
            condition = assumption.condition
            entry["fact"] = list(condition.fact)
            entry["value"] = condition.value if condition.positive else False
            entry["text"] = condition.text()
        elif assumption.formula is not None:
            entry["formula"] = bddl.format(assumption.formula)
            entry["consumer"] = _consumer(trace.obligations[assumption.obligation])
        listed.append(entry)
    return listed
