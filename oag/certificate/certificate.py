"""Certificates: why a verdict holds, as data that `recheck` can check without trusting `verify`.

A certificate repeats the plan and the start knowledge that it speaks of, and lists a causal link for everything that
the plan needs: the condition, and the write that decided it. A refutation ends at the first obligation that fails.

Source: docs/semantics.md, Certificates; `oag/certificate/certificate.schema.json` has the form.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, runtime_checkable

import bddl
from oag.certificate.contents import digest, plan_json, scene_json
from oag.certificate.refuted import Given, Place, RefutedPlan, refutation
from oag.flows.noflow import NoFlow
from oag.model.errors import EvidenceError
from oag.model.facts import HAND, ROBOT_FACTS, Fact, Value, fact_text, made_true
from oag.model.jsonfile import shown
from oag.model.scene import Scene
from oag.progression.compiled import compile_plan
from oag.progression.counterexample import given_run, unknown_since
from oag.progression.obligations import Assumption, CausalLink, Obligation
from oag.progression.progress import Trace
from oag.table.invariants import with_consequences
from oag.table.library import library_sha, needed
from oag.table.start import scene_facts
from oag.task.task import Task

SCHEMA = "scene2demo-certificate/3"


@runtime_checkable
class EvidenceLike(Protocol):
    """A measured probability, such as `oag.Evidence`, which is loaded only where something is measured."""

    def to_json(self) -> dict[str, object]:
        """Returns the slot that a certificate has for it."""


@dataclass(frozen=True, slots=True)
class Certificate:
    """The evidence for one verdict.

    Attributes:
        verdict: "PROVED", "CONDITIONAL" or "REFUTED".
        task_hash: SHA-256 of the plan.
        scene_sha: SHA-256 of the objects and the start knowledge.
        body: Everything else, as JSON values; `to_json` has all of it.
        evidence: EvidenceLike probabilities, each with its conditioning; they are no part of the verdict.
    """

    verdict: str
    task_hash: str
    scene_sha: str
    body: dict[str, object]
    evidence: tuple[Mapping[str, object], ...] = ()

    def __repr__(self) -> str:
        return f"<Certificate {self.verdict} of task {self.task_hash[:12]}, scene {self.scene_sha[:12]}>"

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

    def with_evidence(self, *slots: EvidenceLike | Mapping[str, object]) -> Certificate:
        """Returns the certificate with measured probabilities added to those that it has.

        Args:
            slots: What `chain_evidence` or `pooled_evidence` returned, or the JSON of it.

        Raises:
            EvidenceError: Something is neither.
        """
        return replace(self, evidence=(*self.evidence, *map(_slot, slots)))

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


def _slot(given: object) -> Mapping[str, object]:
    slot = given if isinstance(given, Mapping) else given.to_json() if isinstance(given, EvidenceLike) else {}
    if slot is not given and "conditioning" not in slot:
        raise EvidenceError(f"expected what oag.chain_evidence or oag.pooled_evidence returns, got {shown(given)}")
    return slot


def certify(task: Task, scene: Scene, verdict: str, trace: Trace, search: NoFlow | None = None) -> Certificate:
    """Returns the certificate of a decided plan; `search` shows that the subtask where it stopped has no flow."""
    plan, start = plan_json(task), scene_json(scene)
    failure: Place | None = None
    if trace.failures:
        search = None
        failure = trace.obligations[trace.failures[0].obligation][:3]
    elif search is not None:
        failure = ("no-flow", search.subtask, -1)
    last = trace.failures[0].obligation if trace.failures else len(trace.obligations) - 1
    reset = _reset(trace, scene, last, searched=search is not None)
    if failure is None:
        shown = _proof(trace)
    else:
        # The certificate lists of what the reset supplied only what is used, so a checker knows no more.
        left_out = {*ROBOT_FACTS} - {*reset, *(fact for fact, _ in scene_facts(scene))}
        known = trace.start.after(tuple((fact, None) for fact in left_out))
        subtasks = compile_plan(task.subtasks, scene)
        refuted = RefutedPlan(subtasks, needed(task.goal), known, scene.categories, failure)
        shown = _refutation(trace, refuted, last)
    supplied = [
        {"kind": "reset", "fact": list(fact), "value": value, "text": fact_text(fact, value)}
        for fact in reset
        for value in (trace.start.value(fact),)
    ]
    body: dict[str, object] = {
        "plan": plan,
        "scene": start,
        "assumptions": [*supplied, *shown.assumed],
        "links": shown.links,
        "cases": shown.cases,
        "failure": None if failure is None else list(failure),
        "counterexample": None if shown.run is None else [[time, list(fact), value] for time, fact, value in shown.run],
        "search": None if search is None else search.to_json(),
    }
    return Certificate(verdict, digest(plan), digest(start), body)


class _Shown(NamedTuple):
    """The parts of a certificate that show its verdict; `run` is one that misses something, if any does."""

    assumed: list[dict[str, object]]
    links: list[list[object]]
    cases: list[dict[str, object]]
    run: tuple[tuple[int, Fact, Value], ...] | None


def _proof(trace: Trace) -> _Shown:
    """Returns what shows that every run goes through of which what is assumed holds, and that not every one does."""
    miss = trace.miss
    first = trace.assumptions[0] if trace.assumptions else None
    if miss is None and first is not None and first.condition is not None:
        miss = ((unknown_since(trace, first), first.condition.fact, not made_true(first.condition)),)
    written = _written((a.time, a.condition.fact, made_true(a.condition)) for a in trace.assumptions if a.condition)
    return _Shown(
        [_unknown(trace, assumption) for assumption in trace.assumptions],
        [_link(obligation, link, written) for obligation in trace.obligations for link in obligation.links],
        [
            {"consumer": list(o[:3]), "tree": [None if fact is None else list(fact) for fact in o.cases]}
            for o in trace.obligations
            if o.cases is not None
        ],
        miss,
    )


def _refutation(trace: Trace, plan: RefutedPlan, number: int) -> _Shown:
    """Returns what shows that one run comes to the failure, and that none gets past it."""
    assumed: dict[Given, dict[str, object]] = {}
    for assumption in trace.assumptions:
        if assumption.obligation <= number and assumption.condition is not None:
            value = bool(made_true(assumption.condition))
            assumed[assumption.time, assumption.condition.fact, value] = _unknown(trace, assumption)
    shown = refutation(plan, assumed)
    # What only a choice made known is not known to a checker, who takes up what is forced.
    known = _written(shown.forced)
    failed = trace.obligations[number]
    links = [
        _link(failed, link, known)
        for link in (failed.links if trace.failures else ())
        if link.value is not None and (link.producer % 2 == 0 or (link.condition.fact, link.producer) in known)
    ]
    cases: list[dict[str, object]] = []
    if shown.cases is not None:
        tree = [None if split is None else [split[0], list(split[1])] for split in shown.cases]
        cases.append({"consumer": list(plan.failure), "tree": tree})
    return _Shown([assumed[given] for given in shown.forced], links, cases, given_run(trace, number))


def _written(assumed: Iterable[tuple[int, Fact, Value]]) -> set[tuple[Fact, int]]:
    """Return what (time, fact, value) write that are assumed: those facts and what they exclude, and when."""
    return {(stated, time) for time, fact, value in assumed for stated, _ in with_consequences(fact, value)}


def _link(obligation: Obligation, link: CausalLink, written: Container[tuple[Fact, int]]) -> list[object]:
    (fact, value, positive), producer, _ = link
    # All of a boundary comes after what is assumed there, which writes again what a step may have written before.
    last = obligation.time if (fact, obligation.time) in written else producer
    return [*obligation[:3], list(fact), value, positive, last]


def _reset(trace: Trace, scene: Scene, last: int, *, searched: bool) -> tuple[Fact, ...]:
    """Returns the robot's variables that the reset supplied, as far as the plan uses them up to an obligation.

    What the hand holds is always used, and a search that finds no flow uses all of it.
    """
    stated = {fact for fact, _ in scene_facts(scene)}
    used = {link.condition.fact for o in trace.obligations[: last + 1] for link in o.links if link.producer == 0}
    used.update(ROBOT_FACTS if searched else (HAND,))
    return tuple(f for f in ROBOT_FACTS if f in used and f not in stated and trace.start.value(f) is not None)


def _unknown(trace: Trace, assumption: Assumption) -> dict[str, object]:
    if assumption.condition is not None:
        fact, value = assumption.condition.fact, made_true(assumption.condition)
        text = fact_text(fact, value)
        return {"kind": "assumed", "time": assumption.time, "fact": list(fact), "value": value, "text": text}
    text = "" if assumption.formula is None else bddl.format(assumption.formula)
    consumer = list(trace.obligations[assumption.obligation][:3])
    return {"kind": "assumed", "formula": text, "consumer": consumer, "text": text}
