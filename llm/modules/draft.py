"""The loop of modules 1 to 5 and the graph: ask, judge the plan, send it back to the module that can mend it.

The plan is judged twice: after module 3 with flows that a search supplies, so that a wrong decomposition is found
before any flow is asked for, and whole after module 5.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import bddl
from llm.answers.conversation import AnswersRefused, PlanVerdict, said_by
from llm.modules.blame import Charge, charges
from llm.modules.context import Asked
from llm.modules.decompose import decompose
from llm.modules.instantiate import instantiate
from llm.modules.plan import plan
from llm.modules.resize import resize
from llm.modules.understand import Understood, same_goal, understand
from llm.offline.steps import check_sizes, problem, scale_factors
from llm.proposal import Proposal
from oag import ActionFlow, Report, SimpleTask, Task, Verdict, compose
from oag.task.sizes import resizings

# What rests on a module's answer and has to be asked again with it. New conditions leave sizes and flows as they are:
# whether the flows still fit is decided by the graph.
_RESTS_ON = {1: (2, 3, 4, 5), 2: (3, 4, 5), 3: (), 4: (), 5: ()}


@dataclass(frozen=True, slots=True)
class Draft:
    """What modules 1 to 5 have said; None for what is still to be asked.

    Attributes:
        understood: Module 1.
        roles: Module 2: the simple tasks, without conditions and flows.
        conditions: Module 3: initial state and goal of each.
        scales: Module 4.
        flows: Module 5.
    """

    understood: Understood | None = None
    roles: tuple[SimpleTask, ...] | None = None
    conditions: tuple[tuple[bddl.Formula, bddl.Formula], ...] | None = None
    scales: Mapping[str, float] | None = None
    flows: tuple[ActionFlow, ...] | None = None

    def without(self, module: int) -> Draft:
        """Returns the draft without a module's answer and all that rests on it."""
        names = ("understood", "roles", "conditions", "scales", "flows")
        return replace(self, **{names[number - 1]: None for number in (module, *_RESTS_ON[module])})

    @property
    def symbolic(self) -> Draft:
        """The draft without sizes and flows."""
        return replace(self, scales=None, flows=None)

    def with_conditions(self, asked: Asked, expected: bddl.Formula | None) -> Draft:
        """Returns the draft with what modules 1 to 3 still have to say.

        Raises:
            QueryError: The model says that the query cannot be done here, or something is too large for the gripper.
            AnswersRefused, ModelError: As `Asked.ask` does.
        """
        understood = self.understood or understand(asked, expected)
        roles = self.roles or decompose(asked, understood)
        wanted = understood.expanded.task_name
        check_sizes((part.target for part in roles), asked.scene, asked.sizing, asked.query, wanted)
        conditions = self.conditions
        if conditions is None:
            conditions = tuple((part.init, part.goal) for part in instantiate(asked, understood, roles))
        return replace(self, understood=understood, roles=roles, conditions=conditions)

    def with_flows(self, asked: Asked) -> Draft:
        """Returns the draft with what modules 4 and 5 still have to say, or raises as `Asked.ask` does."""
        subtasks = self._subtasks(searched=True)
        scales = self.scales if self.scales is not None else resize(asked, subtasks)
        flows = self.flows
        if flows is None:
            flows = tuple(subtask.flow or () for subtask in plan(asked, subtasks, scales))
        return replace(self, scales=scales, flows=flows)

    def _subtasks(self, *, searched: bool) -> tuple[SimpleTask, ...]:
        roles, conditions = self.roles or (), self.conditions or ()
        flows = (None,) * len(roles) if searched or self.flows is None else self.flows
        return tuple(
            replace(subtask, init=init, goal=goal, flow=flow)
            for subtask, (init, goal), flow in zip(roles, conditions, flows, strict=True)
        )

    def task(self, asked: Asked, *, searched: bool) -> Task:
        """Returns the task that the answers make.

        Args:
            asked: Has the scene.
            searched: True to leave the flows to a search, and the sizes to the rule.

        Raises:
            ValueError: Module 1 has not said what is wanted.
        """
        if self.understood is None:
            raise ValueError("a draft has no task before module 1 has answered")
        subtasks = self._subtasks(searched=searched)
        by_rule = self.scales is None or searched
        targets = (subtask.target for subtask in subtasks)
        scales = scale_factors(targets, asked.scene, asked.sizing) if by_rule else self.scales
        return Task(
            name=self.understood.activity,
            detail=self.understood.expanded.task_message_detail,
            goal=self.understood.goal,
            goal_given=True,
            subtasks=subtasks,
            scales=dict(scales or {}),
            scene=asked.scene,
        )


@dataclass(slots=True)
class Drafting:
    """One run from question to proposal.

    Attributes:
        asked: Who is asked.
        expected: The goal that the query has word by word, if it can be read so.
        revisions: How often the plan may still be sent back.
        draft: What was said so far.
        before: The draft with the answer that was objected to, to go back to if the model stands by it.
        cleared: Modules that stood by their answers since the draft last changed.
        doubted: What the model was asked about that is no error; it is asked once.
    """

    asked: Asked
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
                return self._proposal(report)

    def _judged(self, *, searched: bool) -> Report:
        """Returns the verdict on the draft, after what is missing in it was asked for."""
        pending = set(self.asked.objections)
        try:
            self.draft = self.draft.with_conditions(self.asked, self.expected)
            if not searched:
                self.draft = self.draft.with_flows(self.asked)
        except AnswersRefused as refusal:
            if self.before is None or refusal.module not in pending:
                raise
            # The model stands by its answer: it may be right, and another module wrong.
            self.cleared.add(refusal.module)
            self.draft, self.before = self.before, None
        else:
            if pending - set(self.asked.objections):
                if self.draft != self.before:
                    self.cleared.clear()
                self.before = None
        return compose(self.draft.task(self.asked, searched=searched), scene=self.asked.scene).verify()

    def _sent_back(self, report: Report, *, searched: bool) -> bool:
        """Decides whether something is held against the draft; if so, the module that can mend it will be asked.

        Raises:
            AnswersRefused: Something is wrong, and nobody can be asked any more.
        """
        standing = self._standing(report, searched=searched)
        # With flows of its own a refuted plan is wrong even if nothing is held against any module.
        wrong = report.verdict is Verdict.REFUTED and bool(standing or not searched)
        # The earliest module that is next in line for one of the findings; None when all stood by their answers.
        lines = ([module for module in charge.modules if module not in self.cleared] for charge in standing)
        module = min((line[0] for line in lines if line), default=None)
        findings = tuple(charge.finding for charge in standing)
        conversation = self.asked.log.conversation
        if wrong and (module is None or self.revisions <= 0):
            conversation.entries.append(PlanVerdict(report.verdict.value, searched, None, findings))
            last = module or next((charge.modules[0] for charge in standing), 5)
            raise AnswersRefused(conversation, last, findings, insists=module is None)
        if module is None or self.revisions <= 0:
            conversation.entries.append(PlanVerdict(report.verdict.value, searched))
            return False
        self.revisions -= 1
        told = tuple(charge.finding for charge in standing if module in charge.modules)
        self.doubted.update(map(said_by, told))
        conversation.entries.append(PlanVerdict(report.verdict.value, searched, module, told))
        self.asked.object_to(module, told)
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

    def _proposal(self, report: Report) -> Proposal:
        task, scene, conversation = (
            self.draft.task(self.asked, searched=False),
            self.asked.scene,
            self.asked.log.conversation,
        )
        if self.draft.understood is None:
            raise ValueError("a draft is no proposal before module 1 has answered")
        unknown = [found for found in report.diagnostics if found.code == "context/open"]
        notes = [f"the plan rests on something unknown: {found.literal or found.message}" for found in unknown]
        if self.expected is not None and not same_goal(task.goal, self.expected):
            wanted, goal = bddl.format(self.expected), bddl.format(task.goal)
            notes.append(f"word by word the query asks for {wanted}; the model stands by {goal}")
        return Proposal(
            query=self.asked.query,
            expanded=self.draft.understood.expanded,
            task=task,
            problems=tuple(problem(part.name, part.init, part.goal, scene) for part in task.subtasks),
            notes=(*notes, *map(str, resizings(task.scales, scene))),
            proposer=conversation.model,
            conversation=conversation,
        )
