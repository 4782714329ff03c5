"""The loop of modules 1 to 5 and the graph: ask, judge the plan, send it back to the module that can mend it.

The plan is judged twice: after module 3 with flows that a search supplies, so that a wrong decomposition is found
before any flow is asked for, and whole after module 5.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import bddl
from llm.blame import Charge, charges
from llm.conversation import PlanVerdict
from llm.draft import Draft
from llm.errors import AnswersRefused
from llm.findings import said_by
from llm.modules.context import Context
from llm.modules.understand import same_goal
from llm.proposal import Proposal
from oag import Report, Verdict, compose


@dataclass(slots=True)
class Drafting:
    """One run from question to proposal.

    Attributes:
        context: Who is asked.
        expected: The goal that the query has word by word, if it can be read so.
        revisions: How often the plan may still be sent back.
        draft: What was said so far.
        before: The draft with the answer that was objected to, to go back to if the model stands by it.
        cleared: Modules that stood by their answers since the draft last changed.
        doubted: What the model was asked about that is no error; it is asked once.
    """

    context: Context
    expected: bddl.Formula | None
    revisions: int
    draft: Draft = field(default_factory=Draft)
    before: Draft | None = None
    cleared: set[int] = field(default_factory=set)
    doubted: set[tuple[str, ...]] = field(default_factory=set)

    def run(self) -> Proposal:
        """Returns the first plan against which nothing is held.

        Raises:
            QueryError: The model says that the query cannot be done here.
            AnswersRefused: Rounds or revisions are used up.
            ModelError: There is no reply.
        """
        passed: Draft | None = None
        while True:
            if passed is None or self.draft.symbolic != passed:
                if self._sent_back(self._judged(searched=True), searched=True):
                    continue
                passed = self.draft.symbolic
            report = self._judged(searched=False)
            if not self._sent_back(report, searched=False):
                return self.draft.proposal(self.context, self._notes(report))

    def _judged(self, *, searched: bool) -> Report:
        """Returns the verdict on the draft, after what is missing in it was asked for."""
        pending = set(self.context.objections)
        try:
            self.draft = self.draft.with_conditions(self.context, self.expected)
            if not searched:
                self.draft = self.draft.with_flows(self.context)
        except AnswersRefused as refusal:
            if self.before is None or refusal.module not in pending:
                raise
            # The model stands by its answer: it may be right, and another module wrong.
            self.cleared.add(refusal.module)
            self.draft, self.before = self.before, None
        else:
            if pending - set(self.context.objections):
                if self.draft != self.before:
                    self.cleared.clear()
                self.before = None
        return compose(self.draft.task(self.context, searched=searched), scene=self.context.scene).verify()

    def _sent_back(self, report: Report, *, searched: bool) -> bool:
        """Decides whether something is held against the draft; if so, the module that can mend it will be asked.

        Raises:
            AnswersRefused: Something is wrong, and nobody can be asked any more.
        """
        standing = self._standing(report, searched=searched)
        # With flows of its own a refuted plan is wrong even if nothing is held against any module.
        wrong = report.verdict is Verdict.REFUTED and bool(standing or not searched)
        module = self._next_module(standing)
        findings = tuple(charge.finding for charge in standing)
        if wrong and (module is None or self.revisions <= 0):
            self._record(PlanVerdict(report.verdict.value, searched, None, findings))
            last = module or next((charge.modules[0] for charge in standing), 5)
            raise AnswersRefused(self.context.log.conversation, last, findings, insists=module is None)
        if module is None or self.revisions <= 0:
            self._record(PlanVerdict(report.verdict.value, searched))
            return False
        self.revisions -= 1
        told = tuple(charge.finding for charge in standing if module in charge.modules)
        self.doubted.update(map(said_by, told))
        self._record(PlanVerdict(report.verdict.value, searched, module, told))
        self.context.object_to(module, told)
        self.before, self.draft = self.draft, self.draft.without(module)
        return True

    def _standing(self, report: Report, *, searched: bool) -> list[Charge]:
        """Returns what is held against the draft, without doubts that the model was asked about already."""
        held = charges(report, searched=searched)
        if report.verdict is not Verdict.REFUTED:
            return [charge for charge in held if said_by(charge.finding) not in self.doubted]
        if searched and report.no_flow is None:
            # A search that gave up proves nothing: module 5 may know a flow.
            return [charge for charge in held if charge.finding.code != "flow/no-flow"]
        return list(held)

    def _next_module(self, standing: list[Charge]) -> int | None:
        """Returns the earliest module that is next in line for one of the findings; None when all stood by theirs."""
        lines = ([module for module in charge.modules if module not in self.cleared] for charge in standing)
        return min((line[0] for line in lines if line), default=None)

    def _record(self, verdict: PlanVerdict) -> None:
        self.context.log.conversation.entries.append(verdict)

    def _notes(self, report: Report) -> tuple[str, ...]:
        """Returns what a user should know of a plan that was taken."""
        unknown = [found for found in report.diagnostics if found.code == "context/open"]
        notes = [f"the plan rests on something unknown: {found.literal or found.message}" for found in unknown]
        goal = None if self.draft.understood is None else self.draft.understood.goal
        if goal is not None and self.expected is not None and not same_goal(goal, self.expected):
            notes.append(
                f"word by word the query asks for {bddl.format(self.expected)}; the model stands by {bddl.format(goal)}"
            )
        return tuple(notes)
