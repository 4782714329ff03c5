"""Writer of certificates: the evidence for a verdict, as data that `recheck` can check without trusting `verify`.

A certificate repeats the plan and the start knowledge, and lists a causal link for everything that the plan needs: the
condition, and the write that decided it. A refutation ends at the first obligation that fails. It shows why no run gets
past the failure. Conditions that the plan itself forces are assumed. Where these do not suffice, cases of the whole
plan are distinguished: in each of them a need of the plan, up to the failure, is false.

Source: docs/semantics.md, Certificates; `oag/certificate/certificate.schema.json` has the form.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import takewhile
from typing import NamedTuple

import bddl
from bddl.grounding import count_ground_parts
from oag.certificate.recheck import digest, plan_json, scene_json
from oag.compilation import CompiledSubtask, compile_plan
from oag.exact import given_run, unknown_since
from oag.flows import NoFlow
from oag.model.domain import BUILT_IN, Domain
from oag.model.scene import Scene
from oag.model.symbols import HAND, ROBOT_FACTS, Fact, Value, fact_text, satisfying_value
from oag.primitives.cargo import NOTHING_CARRIED, Starts, is_place
from oag.primitives.state import NEVER, State, facts_of, scene_facts, step, truth_of
from oag.primitives.table import Needed, converse, excluded, library_sha, needed, with_consequences
from oag.progression import Assumption, CausalLink, Obligation, Trace
from oag.task_definition import Task

# Most entries of a distinction times places of the plan: the time to follow the plan in every case.
_MOST_WORK = 200_000
# Parts of a formula that take as long as one place.
_PARTS_A_PLACE = 20

# Kind, subtask and step of what is needed.
Place = tuple[str, int, int]
# Value of an unknown fact: time, fact, and value.
Given = tuple[int, Fact, bool]
# A case that is distinguished: a time and a fact that is unknown then, or None where a case ends.
Split = tuple[int, Fact] | None


class _Impossible(Exception):
    """An assumption breaks an invariant, so that no state satisfies it."""


@dataclass(frozen=True, slots=True)
class RefutedPlan:
    """A plan that fails, as its certificate has it.

    Attributes:
        start: What the scene states and, of what the reset supplies, the plan uses.
        objects: Category of each object.
        failure: The place that fails; where it is one without a flow, a search shows that it fails.
        starts: What can be so where the plan starts.
    """

    subtasks: tuple[CompiledSubtask, ...]
    goal: Needed
    start: State
    objects: Mapping[str, str]
    failure: Place
    starts: Starts


class Refutation(NamedTuple):
    """Proof that a place fails in every run.

    Attributes:
        forced: Assumptions on the way, each forced by a place at its time.
        cases: The cases in preorder; None when none are needed, empty when there are too many to list.
    """

    forced: tuple[Given, ...]
    cases: tuple[Split, ...] | None


def refutation(plan: RefutedPlan, candidates: Iterable[Given]) -> Refutation:
    """Return the proof that no run of a plan gets past its failure.

    `candidates` are assumptions made on the way, in order; some may be choices, which prove nothing.
    """
    run, left = _Run(plan), list(candidates)
    forced: list[Given] = []
    for place, wanted in run.places():
        while left and left[0][0] < run.time:
            del left[0]
        for given in [*takewhile(lambda given: given[0] == run.time, left)]:
            forced_here = run.state.value(given[1]) is None and run.forces(wanted, given[1], given[2])
            if forced_here and run.can_start_with(given[1], given[2]):
                run.take(*given)
                forced.append(given)
                left.remove(given)
        if place == plan.failure:
            if place[0] == "no-flow" or truth_of(wanted, run.state.value, plan.objects) is False:
                return Refutation(tuple(forced), None)
            break
    return Refutation((), _cases(plan))


class _Run:
    """A plan followed from its start under some assumptions.

    Attributes:
        state: What is known at the current place.
        time: Time of the current place; earlier writes count.
    """

    def __init__(self, plan: RefutedPlan, given: Iterable[Given] = ()) -> None:
        self.state, self.time = plan.start, 1
        self._sure = plan.start
        self._plan, self._about_start = plan, dict[Fact, Value]()
        # Stable by time: a later entry may follow from an earlier one of the same time, not the other way round.
        self._given = sorted(given, key=lambda entry: entry[0])

    def places(self) -> Iterator[tuple[Place, Needed]]:
        """Yield the needs of each place in order, up to a subtask without a flow, whose place is `no-flow`."""
        for index, subtask in enumerate(self._plan.subtasks):
            self._take_due()
            yield ("init", index, -1), subtask.init
            if subtask.flow is None:
                yield ("no-flow", index, -1), subtask.goal
                return
            for position, action in enumerate(subtask.flow):
                self._take_due()
                wanted = subtask.rows.row(action.primitive, self.state.hand, action.parameter)[0]
                if wanted:
                    yield ("precondition", index, position), wanted
                number, sure = action.parameter, self._sure.value
                written, self.state = step(self.state, subtask.rows, action.primitive, number, self.time + 1, sure)
                self._sure = self._sure.after(written, self.time + 1)
                self.time += 2
            self._take_due()
            yield ("goal", index, -1), subtask.goal
        self._take_due()
        yield ("task-goal", len(self._plan.subtasks), -1), self._plan.goal

    def take(self, time: int, fact: Fact, value: bool) -> None:
        """Assume a value of an unknown fact; raises _Impossible when it breaks an invariant."""
        if (value and excluded(fact, self.state.value)) or not self.can_start_with(fact, value):
            raise _Impossible
        if self.state.read(fact).time == NEVER:
            self._about_start[fact] = value
        self.state = self.state.after(with_consequences(fact, value), time)

    def can_start_with(self, fact: Fact, value: bool) -> bool:
        """Decide whether a start has a value of a fact, unless a step left it open."""
        written = self.state.read(fact).time != NEVER
        return written or not self._plan.starts.exclude(fact, value, self._about_start)

    def forces(self, wanted: Needed, fact: Fact, value: bool) -> bool:
        """Decide whether clauses or a formula can only hold here if a fact has a value."""
        otherwise = self.state.after(with_consequences(fact, not value), self.time)
        return truth_of(wanted, otherwise.value, self._plan.objects) is False

    def _take_due(self) -> None:
        while self._given and self._given[0][0] <= self.time:
            self.take(*self._given.pop(0))


def _cases(plan: RefutedPlan) -> tuple[Split, ...]:
    """Return cases in each of which a place up to the failure is false; empty when they are too many."""
    tree: list[Split] = []
    pending: list[tuple[Given, ...]] = [()]
    work = 0
    while pending:
        case = pending.pop()
        found, places = _look(plan, case)
        work += places
        if found == () or work > _MOST_WORK:
            return ()
        tree.append(found or None)
        if found:
            pending += [(*case, (*found, value)) for value in (False, True)]
    return tuple(tree)


def _look(plan: RefutedPlan, case: tuple[Given, ...]) -> tuple[Split | tuple[()], int]:
    """Return the next fact to distinguish in a case, and how many places were visited.

    It is None when a place is false, or the case impossible; () when nothing is left to distinguish. Facts of the
    failing place come first, then facts that share a place with one distinguished before.
    """
    run, places = _Run(plan, case), 0
    split = {fact for _, fact, _ in case}
    split |= {other for fact in split if (other := converse(fact)) is not None}
    # What carries what ties all places.
    carries = plan.starts.carriage != NOTHING_CARRIED and any(map(is_place, split))
    tied: tuple[int, Fact] | None = None
    try:
        for place, wanted in run.places():
            places += 1
            truth = truth_of(wanted, run.state.value, plan.objects)
            if not isinstance(wanted, tuple):
                # A formula takes as long as it has parts, of which a quantifier makes many.
                places += count_ground_parts(wanted, plan.objects, _MOST_WORK) // _PARTS_A_PLACE
            if truth is False:
                return None, places
            facts = facts_of(wanted, plan.objects) if truth is None and (tied is None or place == plan.failure) else ()
            entries = [(fact, run.state.read(fact)) for fact in facts]
            unknown = [(max(entry.time, 0), fact) for fact, entry in entries if entry.value is None]
            if place == plan.failure:
                return unknown[0] if unknown else tied or (), places
            if unknown and tied is None and not split.isdisjoint(facts):
                tied = unknown[0]
            if carries and tied is None:
                tied = next((each for each in unknown if is_place(each[1])), None)
    except _Impossible:
        return None, places
    return (), places


SCHEMA = "scene2demo-certificate/3"


@dataclass(frozen=True, slots=True)
class Certificate:
    """The evidence for one verdict.

    Attributes:
        verdict: "PROVED", "CONDITIONAL" or "REFUTED".
        scene_sha: SHA-256 of the objects and the start knowledge.
        domain: What the plan is described in.
        body: Everything else, as JSON values; `to_json` has all of it.
    """

    verdict: str
    task_hash: str
    scene_sha: str
    body: dict[str, object]
    domain: Domain = BUILT_IN

    def __repr__(self) -> str:
        return f"<Certificate {self.verdict} of task {self.task_hash[:12]}, scene {self.scene_sha[:12]}>"

    @property
    def assumptions(self) -> tuple[dict[str, object], ...]:
        """Premises of the verdict in addition to the scene's facts: the reset, and for CONDITIONAL what is unknown."""
        listed = self.body["assumptions"]
        return tuple(listed) if isinstance(listed, list) else ()

    @property
    def links(self) -> tuple[list[object], ...]:
        """The causal links: [kind, subtask, step, fact, value, positive, producer]."""
        listed = self.body["links"]
        return tuple(listed) if isinstance(listed, list) else ()

    def to_json(self) -> dict[str, object]:
        """Return the certificate as JSON values."""
        return {
            "schema": SCHEMA,
            "library_sha": library_sha(self.domain),
            **({} if self.domain.built_in else {"domain": self.domain.to_json()}),
            "verdict": self.verdict,
            "task_hash": self.task_hash,
            "scene_sha": self.scene_sha,
            **self.body,
            # Kept for readers of the schema: no evidence is measured that could stand here.
            "evidence": [],
        }


def certify(task: Task, scene: Scene, verdict: str, trace: Trace, search: NoFlow | None = None) -> Certificate:
    """Return the certificate of a decided plan; `search` shows that the subtask where it stopped has no flow."""
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
        refuted = RefutedPlan(subtasks, needed(task.goal), known, scene.categories, failure, trace.starts)
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
    return Certificate(verdict, digest(plan), digest(start), body, scene.domain)


class _Shown(NamedTuple):
    """The parts of a certificate that show its verdict; `run` is one that misses something, if any does."""

    assumed: list[dict[str, object]]
    links: list[list[object]]
    cases: list[dict[str, object]]
    run: tuple[tuple[int, Fact, Value], ...] | None


def _proof(trace: Trace) -> _Shown:
    """Return what shows that every run that meets the assumptions succeeds, and that some other run does not."""
    miss = trace.miss
    first = trace.assumptions[0] if trace.assumptions else None
    if miss is None and first is not None and first.condition is not None:
        miss = ((unknown_since(trace, first), first.condition.fact, not satisfying_value(first.condition)),)
    written = _written(
        (a.time, a.condition.fact, satisfying_value(a.condition)) for a in trace.assumptions if a.condition
    )
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
    """Return what shows that one run reaches the failure, and that none gets past it."""
    assumed: dict[Given, dict[str, object]] = {}
    for assumption in trace.assumptions:
        if assumption.obligation <= number and assumption.condition is not None:
            value = bool(satisfying_value(assumption.condition))
            assumed[assumption.time, assumption.condition.fact, value] = _unknown(trace, assumption)
    shown = refutation(plan, assumed)
    # A fact known only by a choice is unknown to the checker, which assumes only what is forced.
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
    """Return the writes of assumptions: the assumed facts and what they exclude, each with its time."""
    return {(stated, time) for time, fact, value in assumed for stated, _ in with_consequences(fact, value)}


def _link(obligation: Obligation, link: CausalLink, written: Container[tuple[Fact, int]]) -> list[object]:
    (fact, value, positive), producer, _ = link
    # All of a boundary comes after what is assumed there, which writes again what a step may have written before.
    last = obligation.time if (fact, obligation.time) in written else producer
    return [*obligation[:3], list(fact), value, positive, last]


def _reset(trace: Trace, scene: Scene, last: int, *, searched: bool) -> tuple[Fact, ...]:
    """Return the robot's variables that the reset supplied, as far as the plan uses them up to an obligation.

    The hand is always used; a search without a result uses all three variables.
    """
    stated = {fact for fact, _ in scene_facts(scene)}
    used = {link.condition.fact for o in trace.obligations[: last + 1] for link in o.links if link.producer == 0}
    used.update(ROBOT_FACTS if searched else (HAND,))
    return tuple(f for f in ROBOT_FACTS if f in used and f not in stated and trace.start.value(f) is not None)


def _unknown(trace: Trace, assumption: Assumption) -> dict[str, object]:
    if assumption.condition is not None:
        fact, value = assumption.condition.fact, satisfying_value(assumption.condition)
        text = fact_text(fact, value)
        return {"kind": "assumed", "time": assumption.time, "fact": list(fact), "value": value, "text": text}
    text = "" if assumption.formula is None else bddl.format(assumption.formula)
    consumer = list(trace.obligations[assumption.obligation][:3])
    return {"kind": "assumed", "formula": text, "consumer": consumer, "text": text}
