"""Certificates: why a verdict holds, as data that `recheck` can check without trusting `verify`.

A certificate repeats the plan and the start knowledge that it speaks of, and lists a causal link for everything that
the plan needs: the condition, and the write that decided it. A refutation ends at the first obligation that fails.

Source: docs/semantics.md, Certificates; `oag/certificate.schema.json` has the form.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import bddl
from oag.actions import flow_to_json
from oag.categories import Kind
from oag.checker.recheck import SCHEMA
from oag.exact.counterexample import given_run
from oag.facts import HAND, ROBOT_FACTS, fact_text, made_true
from oag.library import library_sha
from oag.obligations import Obligation
from oag.progress import Trace
from oag.scene import Scene
from oag.start import scene_facts
from oag.task import Task


class SearchProof(Protocol):
    """What shows that a subtask has no flow; see `oag.noflow`."""

    @property
    def subtask(self) -> int:
        """Index of the subtask."""

    def to_json(self) -> dict[str, object]:
        """Returns the proof as JSON values."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """The evidence for one verdict.

    Attributes:
        verdict: "PROVED", "CONDITIONAL" or "REFUTED".
        task_hash: SHA-256 of the plan.
        scene_sha: SHA-256 of the objects and the start knowledge.
        body: Everything else, as JSON values; `to_json` has all of it.
        evidence: Measured probabilities, each with its conditioning; they are no part of the verdict.
    """

    verdict: str
    task_hash: str
    scene_sha: str
    body: dict[str, object]
    evidence: tuple[Mapping[str, object], ...] = ()

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

    def with_evidence(self, *slots: Mapping[str, object]) -> Certificate:
        """Returns the certificate with measured probabilities added to those that it has."""
        return replace(self, evidence=(*self.evidence, *slots))

    def to_json(self) -> dict[str, object]:
        """Returns the certificate as JSON values."""
        return {
            "schema": SCHEMA,
            "library_sha": library_sha(),
            "verdict": self.verdict,
            "task_hash": self.task_hash,
            "scene_sha": self.scene_sha,
            **self.body,
            "evidence": [dict(slot) for slot in self.evidence],
        }


def digest(value: object) -> str:
    """Returns the SHA-256 of a JSON value's canonical text."""
    return hashlib.sha256(json.dumps(value, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def condition_json(formula: bddl.Formula) -> list[object] | str:
    """Returns a condition as certificates have it: [atom, value] for each literal, else the formula's text.

    Example:
        >>> import bddl
        >>> condition_json(bddl.parse_formula("(not (open box_0))"))
        [[['open', 'box_0'], False]]
    """
    literals = bddl.literals(formula)
    if literals is None:
        return bddl.format(formula)
    return [[[literal.atom.predicate, *literal.atom.args], literal.value] for literal in literals]


def plan_json(task: Task) -> dict[str, object]:
    """Returns what a certificate repeats of a plan: roles, conditions, flows, and the task goal."""
    return {
        "goal": condition_json(task.goal),
        "goal_given": task.goal_given,
        "subtasks": [
            {
                "target": subtask.target,
                "support_goal": subtask.support_goal,
                "init": condition_json(subtask.init),
                "goal": condition_json(subtask.goal),
                "flow": None if subtask.flow is None else flow_to_json(subtask.flow),
            }
            for subtask in task.subtasks
        ],
    }


def scene_json(scene: Scene) -> dict[str, object]:
    """Returns what a certificate repeats of a scene: categories, what can be taken or opened, and the start."""
    kinds = {key: thing.kind for key, thing in scene.objects.items()}
    return {
        "objects": scene.categories,
        "items": [key for key, kind in kinds.items() if kind is Kind.ITEM],
        "articulated": [key for key, kind in kinds.items() if kind is Kind.ARTICULATED],
        "start": [[list(fact), value] for fact, value in scene_facts(scene)],
    }


def certify(task: Task, scene: Scene, verdict: str, trace: Trace, search: SearchProof | None = None) -> Certificate:
    """Returns the certificate of a decided plan.

    Args:
        task: The plan.
        scene: Its scene.
        verdict: What was decided.
        trace: How.
        search: The proof that the subtask at which the trace stopped has no flow.
    """
    plan, start = plan_json(task), scene_json(scene)
    obligations = trace.obligations
    failure: list[object] | None = None
    if trace.failures:
        search = None
        obligations = obligations[: trace.failures[0].obligation + 1]
        failure = _consumer(obligations[-1])
    elif search is not None:
        failure = ["no-flow", search.subtask, -1]
    run = [[time, list(fact), value] for time, fact, value in given_run(trace, len(obligations) - 1)]
    body: dict[str, object] = {
        "plan": plan,
        "scene": start,
        "assumptions": [*_reset(obligations, trace, scene, search), *_unknown(trace, len(obligations))],
        "links": [
            [kind, subtask, step, list(fact), value, positive, producer]
            for kind, subtask, step, _, _, links, _ in obligations
            for (fact, value, positive), producer, _ in links
        ],
        "cases": [
            {"consumer": _consumer(o), "tree": [None if fact is None else list(fact) for fact in o.cases]}
            for o in obligations
            if o.cases is not None
        ],
        "failure": failure,
        "counterexample": None if failure is None else run,
        "search": None if search is None else search.to_json(),
    }
    return Certificate(verdict, digest(plan), digest(start), body)


def _consumer(obligation: Obligation) -> list[object]:
    """Returns the name of an obligation inside certificates."""
    return [obligation.kind, obligation.subtask, obligation.step]


def _reset(
    obligations: list[Obligation], trace: Trace, scene: Scene, search: SearchProof | None
) -> list[dict[str, object]]:
    """Returns what the robot's reset supplied, as far as the plan uses it.

    What the hand holds is always used, and a search that finds no flow uses all of it.
    """
    stated = {fact for fact, _ in scene_facts(scene)}
    used = {link.condition.fact for o in obligations for link in o.links if link.producer == 0} | {HAND}
    if search is not None:
        used.update(ROBOT_FACTS)
    listed: list[dict[str, object]] = []
    for fact in ROBOT_FACTS:
        if fact in used and fact not in stated:
            value = trace.knowledge.at_start(fact)
            listed.append({"kind": "reset", "fact": list(fact), "value": value, "text": fact_text(fact, value)})
    return listed


def _unknown(trace: Trace, count: int) -> list[dict[str, object]]:
    """Returns what was unknown and assumed for the first `count` obligations."""
    listed: list[dict[str, object]] = []
    for assumption in trace.assumptions:
        if assumption.obligation >= count:
            continue
        entry: dict[str, object] = {"kind": "assumed"}
        if assumption.condition is not None:
            fact, value = assumption.condition.fact, made_true(assumption.condition)
            entry |= {"time": assumption.time, "fact": list(fact), "value": value, "text": fact_text(fact, value)}
        elif assumption.formula is not None:
            text = bddl.format(assumption.formula)
            consumer = _consumer(trace.obligations[assumption.obligation])
            entry |= {"formula": text, "consumer": consumer, "text": text}
        listed.append(entry)
    return listed
