"""Propose tasks with a language model: ask modules 1 to 5, verify the plan, return findings to a module.

The plan is verified twice. After module 3 a search supplies the flows, so that a wrong decomposition is found
before any flow is requested. After module 5 the whole plan is verified. A refuted plan goes back with what
failed, where, since when, from which start state, and with the changes that were verified to work. `verify` sees
every proposal whole before it is returned.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import bddl
from llm.client.budget import Budget, Metered
from llm.client.transport import Image, Transport
from llm.errors import QueryError
from llm.offline.planner import LONGEST_QUERY, OfflinePlanner
from llm.offline.subtasks import check_sizes, problem, scale_factors
from llm.proposing.modules import decompose, instantiate, opens_its_target, plan, resize
from llm.proposing.proposal import Proposal
from llm.proposing.session import ModuleSession
from llm.proposing.understanding import Understood, understand
from llm.structured.ask import Log
from llm.structured.conversation import AnswersRefused, Conversation, PlanVerdict, Round, finding_key
from llm.structured.prompting import CHANGEABLE
from oag import Diagnostic, Fix, Report, Scene, SceneError, SimpleTask, Task, Verdict, compose
from oag.model.actions import ActionFlow
from oag.model.diagnostics import SCALES, TASK_GOAL
from oag.primitives.state import contradictions
from oag.sizes import TO_THE_AIM, Sizing, planned_resizings
from oag.verify.edits import (
    ChangeSubtask,
    DeleteSubtask,
    Edit,
    InsertSubtask,
    MoveSubtask,
    SetFlow,
    SetTaskGoal,
    SwapSubtasks,
)

# A finding of the graph goes to the modules that can correct it: by its verified fix, else by its code. A model cannot
# change facts of the scene. It can change the task goal only where no plan can reach it. Such fixes are not shown.
_NOT_OFFERED = frozenset({"add-fact", "change-task-goal"})
_BY_FIX = {
    "insert-subtask": 2,
    "delete-subtask": 2,
    "move-subtask": 2,
    "swap-subtasks": 2,
    "change-role": 2,
    "change-object": 3,
    "change-condition": 3,
    "change-scale": 4,
    "insert-step": 5,
    "delete-step": 5,
    "replace-step": 5,
    "move-step": 5,
    "set-flow": 5,
}
# The likeliest module first; the next one is asked if that one confirms its answer.
_BY_CODE = {
    "task/role-scope": (2, 3),
    "task/contradictory": (3,),
    "task/vacuous": (2, 3),
    "task/size": (4,),
    "flow/kind": (5, 2),
    "flow/no-flow": (2, 3),
    "context/start": (3, 2),
    "context/refuted": (2, 3),
    "context/open": (2, 3),
    "goal/not-reached": (2, 3, 1),
    "goal/undone": (2, 3, 1),
    "locality/outside-scope": (5, 2),
}
# Warnings worth a question; plans with the others work.
_DOUBTS = ("context/open", "task/vacuous")
_LAST_SYMBOLIC = 3
# Answers that are no answers say nothing about the subtasks.
_OF_FORM = ("answer/no-json", "answer/broken-json", "answer/cut-off", "answer/too-long", "answer/field")


@dataclass(frozen=True, slots=True)
class Charge:
    """A finding and the modules that can correct it, the likeliest first; empty if none can."""

    finding: Diagnostic
    modules: tuple[int, ...]


def charges(report: Report, *, searched: bool) -> tuple[Charge, ...]:
    """Return the findings of a verdict with the modules they are assigned to.

    Where a search supplied the flows (`searched`), only modules 1 to 3 can be at fault. Otherwise these have passed
    already, so that a failure is first of all one of a flow or a size.
    """
    if report.verdict is Verdict.REFUTED:
        offered = [fix for fix in report.fixes if _is_offered(fix)]
        # A fix of all mistakes together is shown with the first one.
        return tuple(
            _charge(error, [fix for fix in offered if (fix.cause or 0) == index], report.task, searched)
            for index, error in enumerate(report.errors)
        )
    doubts = [found for found in report.diagnostics if found.severity == "warning" and found.code in _DOUBTS]
    return tuple(_charge(found, (), report.task, searched) for found in doubts)


def _is_offered(fix: Fix) -> bool:
    given = any(isinstance(edit, SetTaskGoal) for edit in fix.edits)
    # One that leaves other mistakes leads away as often as not.
    return fix.kind not in _NOT_OFFERED and not fix.assumption and not given and not fix.remaining


def _modules_of(fix: Fix, task: Task) -> Iterator[int]:
    """Yield the module that wrote what a fix changes; of several changes the earliest."""
    edits = list(fix.edits)
    for one, other in pairwise(fix.edits):
        if _has_other_conditions(one, other, task):
            edits = [edit for edit in edits if edit is not one and edit is not other]
    changed = [edit for edit in edits if isinstance(edit, ChangeSubtask)]
    roles = any((edit.target, edit.support_init, edit.support_goal) != (None, None, None) for edit in changed)
    if roles or any(isinstance(edit, InsertSubtask | DeleteSubtask | MoveSubtask | SwapSubtasks) for edit in edits):
        yield 2
    elif fix.kind != "several":
        yield from filter(None, [_BY_FIX.get(fix.kind)])
    elif changed or len(edits) < len(fix.edits):
        yield 3
    elif any(isinstance(edit, SetFlow) for edit in edits):
        yield 5


def _has_other_conditions(one: Edit, other: Edit, task: Task) -> bool:
    """Decide whether two edits put a subtask of the same roles in the place of one."""
    if not (isinstance(one, DeleteSubtask) and isinstance(other, InsertSubtask) and one.subtask == other.subtask):
        return False
    return any(part.roles == other.inserted.roles for part in task.subtasks[one.subtask : one.subtask + 1])


def _charge(found: Diagnostic, fixes: Sequence[Fix], task: Task, searched: bool) -> Charge:
    # One is enough: a small model mixes the changes of several.
    finding = replace(found, fixes=tuple(map(str, fixes[:1])))
    if fixes and fixes[0].subtask != found.subtask:
        # More than the subtask of the finding is to be written again.
        finding = replace(finding, subtask=None)
    by_fix = [module for fix in fixes for module in _modules_of(fix, task)]
    by_code = _by_place(found) or _BY_CODE.get(found.code, (5,) if found.code.startswith("flow/") else ())
    named = (2, 3) if opens_its_target(found, task) else tuple(dict.fromkeys((*by_fix, *by_code)))
    if searched:
        # No plan reaches what no primitive changes.
        if not by_fix and found.place == TASK_GOAL and {a.predicate for a in bddl.atoms(task.goal)} - CHANGEABLE:
            return Charge(finding, (1,))
        known = tuple(module for module in named if module <= _LAST_SYMBOLIC)
        return Charge(finding, known or (3, 2))
    last = tuple(module for module in named if module > _LAST_SYMBOLIC)
    rest = tuple(module for module in named if module <= _LAST_SYMBOLIC)
    return Charge(finding, tuple(dict.fromkeys((*(last or (5,)), *rest))))


def _by_place(found: Diagnostic) -> tuple[int, ...]:
    """Return the module that wrote a malformed text, by its place."""
    if not found.code.startswith("bddl/"):
        return ()
    if found.subtask is not None and found.field is not None:
        return (3,)
    if found.place == SCALES:
        return (4,)
    return (1,) if found.place == TASK_GOAL else (2,)


# Modules whose answers depend on a module's answer, to be asked again with it. New conditions keep sizes and flows:
# the graph decides whether the flows still fit.
_RESTS_ON = {1: (2, 3, 4, 5), 2: (3, 4, 5), 3: (), 4: (), 5: ()}


@dataclass(frozen=True, slots=True)
class Draft:
    """Answers of modules 1 to 5 so far, in their order; None for a missing answer."""

    understood: Understood | None = None
    roles: tuple[SimpleTask, ...] | None = None
    conditions: tuple[tuple[bddl.Formula, bddl.Formula], ...] | None = None
    scales: Mapping[str, float] | None = None
    flows: tuple[ActionFlow, ...] | None = None

    def without(self, module: int) -> Draft:
        """Return the draft without a module's answer and all answers that depend on it."""
        names = ("understood", "roles", "conditions", "scales", "flows")
        return replace(self, **{names[number - 1]: None for number in (module, *_RESTS_ON[module])})

    @property
    def symbolic(self) -> Draft:
        """The draft without sizes and flows."""
        return replace(self, scales=None, flows=None)

    def with_roles(self, session: ModuleSession, expected: bddl.Formula | None) -> Draft:
        """Return the draft with the missing answers of modules 1 and 2."""
        understood = self.understood or understand(session, expected)
        roles = self.roles or decompose(session, understood)
        wanted = understood.expanded.task_name
        check_sizes((part.target for part in roles), session.scene, session.sizing, session.query, wanted)
        return replace(self, understood=understood, roles=roles)

    def with_conditions(self, session: ModuleSession) -> Draft:
        """Return a draft that has roles with the missing answer of module 3; raises as `ModuleSession.ask` does."""
        conditions = self.conditions
        if conditions is None and self.understood is not None and self.roles is not None:
            written = instantiate(session, self.understood, self.roles)
            conditions = tuple((part.init, part.goal) for part in written)
        return replace(self, conditions=conditions)

    def with_flows(self, session: ModuleSession) -> Draft:
        """Return the draft with the missing answers of modules 4 and 5; raises as `ModuleSession.ask` does."""
        subtasks = self._subtasks(searched=True)
        scales = self.scales if self.scales is not None else resize(session, subtasks)
        flows = self.flows
        if flows is None:
            flows = tuple(subtask.flow or () for subtask in plan(session, subtasks, scales))
        return replace(self, scales=scales, flows=flows)

    def _subtasks(self, *, searched: bool) -> tuple[SimpleTask, ...]:
        roles, conditions = self.roles or (), self.conditions or ()
        flows = (None,) * len(roles) if searched or self.flows is None else self.flows
        return tuple(
            replace(subtask, init=init, goal=goal, flow=flow)
            for subtask, (init, goal), flow in zip(roles, conditions, flows, strict=True)
        )

    def task(self, session: ModuleSession, *, searched: bool) -> Task:
        """Return the task that the answers define.

        Args:
            session: Has the scene.
            searched: True to leave the flows to a search, and the sizes to the rule.
        """
        if self.understood is None:
            raise ValueError("a draft has no task before module 1 has answered")
        subtasks = self._subtasks(searched=searched)
        by_rule = self.scales is None or searched
        targets = (subtask.target for subtask in subtasks)
        scales = scale_factors(targets, session.scene, session.sizing) if by_rule else self.scales
        return Task(
            name=self.understood.activity,
            detail=self.understood.expanded.task_message_detail,
            goal=self.understood.goal,
            goal_given=True,
            subtasks=subtasks,
            scales=dict(scales or {}),
            scene=session.scene,
        )


@dataclass(slots=True)
class Drafting:
    """One run from query to proposal.

    Attributes:
        session: State shared by the modules.
        expected: Goal of the literal reading of the query, if it can be read.
        revisions: How often the plan may still be returned to a module.
        draft: Answers so far.
        before: The draft with the disputed answer, restored if the model confirms it.
        cleared: Modules that confirmed their answers since the draft last changed.
        doubted: Warnings that the model was asked about; each is asked once.
        without_conditions: Why module 2 was asked again: module 3 found no conditions for its subtasks.
    """

    session: ModuleSession
    expected: bddl.Formula | None
    revisions: int
    draft: Draft = field(default_factory=Draft)
    before: Draft | None = None
    cleared: set[int] = field(default_factory=set)
    doubted: set[tuple[str, ...]] = field(default_factory=set)
    without_conditions: AnswersRefused | None = None

    def run(self) -> Proposal:
        """Return the first plan without findings."""
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
        pending = set(self.session.objections)
        try:
            self.draft = self.draft.with_roles(self.session, self.expected)
            self.draft = self.draft.with_conditions(self.session)
            if not searched:
                self.draft = self.draft.with_flows(self.session)
        except AnswersRefused as refusal:
            if refusal.module not in pending and self._returned_to_decomposition(refusal):
                return self._judged(searched=searched)
            if refusal.module == 2 and self.before is None and self.without_conditions is not None:
                raise self.without_conditions from refusal
            if self.before is None or refusal.module not in pending:
                raise
            # The model confirms its answer: it may be right, and another module wrong.
            self.cleared.add(refusal.module)
            self.draft, self.before = self.before, None
        else:
            if pending - set(self.session.objections):
                if self.draft != self.before:
                    self.cleared.clear()
                self.before = None
        return compose(self.draft.task(self.session, searched=searched), scene=self.session.scene).verify()

    def _returned_to_decomposition(self, refusal: AnswersRefused) -> bool:
        """Ask module 2 again, once, where module 3 finds no conditions: one may be none; return whether it was."""
        if refusal.module != _LAST_SYMBOLIC or self.revisions <= 0 or self.without_conditions is not None:
            return False
        if any(found.code in _OF_FORM for found in refusal.findings):
            return False
        self.revisions, self.without_conditions = self.revisions - 1, refusal
        findings = tuple(found for found in refusal.findings if found.code != "answer/repeated")
        self.session.log.conversation.entries.append(PlanVerdict("UNDECIDED", True, 2, findings))
        self.session.object_to(2, findings)
        self.before, self.draft = None, self.draft.without(2)
        return True

    def _sent_back(self, report: Report, *, searched: bool) -> bool:
        """Return the plan to the module that can correct it, if there are findings; return whether it was."""
        standing = self._standing(report, searched=searched)
        # A refuted plan with the model's flows is wrong even without findings about any module.
        wrong = report.verdict is Verdict.REFUTED and bool(standing or not searched)
        # The earliest module that is next for one of the findings; None when all confirmed their answers.
        lines = ([module for module in charge.modules if module not in self.cleared] for charge in standing)
        module = min((line[0] for line in lines if line), default=None)
        findings = tuple(charge.finding for charge in standing)
        conversation = self.session.log.conversation
        if wrong and (module is None or self.revisions <= 0):
            conversation.entries.append(PlanVerdict(report.verdict.value, searched, None, findings))
            last = module or next((charge.modules[0] for charge in standing), 5)
            raise AnswersRefused(conversation, last, findings, insists=module is None)
        if module is None or self.revisions <= 0:
            conversation.entries.append(PlanVerdict(report.verdict.value, searched))
            return False
        self.revisions -= 1
        objections = tuple(charge.finding for charge in standing if module in charge.modules)
        self.doubted.update(map(finding_key, objections))
        conversation.entries.append(PlanVerdict(report.verdict.value, searched, module, objections))
        self.session.object_to(module, objections)
        self.before, self.draft = self.draft, self.draft.without(module)
        return True

    def _standing(self, report: Report, *, searched: bool) -> list[Charge]:
        """Return the findings about the draft, without warnings that the model was asked about already."""
        held = charges(report, searched=searched)
        if report.verdict is not Verdict.REFUTED:
            return [charge for charge in held if finding_key(charge.finding) not in self.doubted]
        if searched and report.no_flow is None:
            # A search that gave up proves nothing: module 5 may find a flow.
            return [charge for charge in held if charge.finding.code != "flow/no-flow"]
        return list(held)

    def _proposal(self, report: Report) -> Proposal:
        task, scene, conversation = (
            self.draft.task(self.session, searched=False),
            self.session.scene,
            self.session.log.conversation,
        )
        if self.draft.understood is None:
            raise ValueError("a draft is no proposal before module 1 has answered")
        unknown = [found for found in report.diagnostics if found.code == "context/open"]
        notes = [f"the plan rests on something unknown: {found.literal or found.message}" for found in unknown]
        if self.expected is not None and not bddl.equivalent(task.goal, self.expected, scene.categories):
            wanted, goal = bddl.format(self.expected), bddl.format(task.goal)
            notes.append(f"word by word the query asks for {wanted}; the model stands by {goal}")
        return Proposal(
            query=self.session.query,
            expanded=self.draft.understood.expanded,
            task=task,
            problems=tuple(problem(part.name, part.init, part.goal, scene) for part in task.subtasks),
            notes=(*notes, *map(str, planned_resizings(task.scales, scene))),
            proposer=conversation.model,
            conversation=conversation,
        )


@dataclass(slots=True)
class ModelProposer:
    """Propose tasks by asking a language model.

    Attributes:
        transport: Transport to the model.
        name: Name of the model in proposals and records, such as "openai:gpt-5.2".
        budget: Limits for each proposal; None if the transport keeps its own, or none are wanted.
        rounds: Most questions for one answer, while form and names are checked.
        revisions: Most times that the plan as a whole is returned.
        images: Pictures of the scene for module 1.
        cross_check: Whether to ask the model once which reading is meant if its goal differs from the literal one of
            the query. A query that the offline planner cannot read is not compared.
        sizing: Rule for the sizes of manipulated objects; module 4 is asked unless they are kept.
        listen: Called with every round.
        conversation: Record of the last proposal, also after a failure.
    """

    transport: Transport
    name: str = "model"
    budget: Budget | None = None
    rounds: int = 4
    revisions: int = 6
    images: tuple[Image, ...] = ()
    cross_check: bool = True
    sizing: Sizing = TO_THE_AIM
    listen: Callable[[Round], None] | None = None
    conversation: Conversation | None = field(default=None, init=False)

    def propose(self, query: str, scene: Scene) -> Proposal:
        """Return a task that `verify` finds PROVED, or CONDITIONAL if no better one is obtained.

        A CONDITIONAL plan is returned once; its assumptions are then in the notes.

        Raises:
            SceneError: The scene's facts contradict each other; the model is not asked.
            QueryError: The query is empty or too long, or the model states that it cannot be executed here.
            AnswersRefused: The rounds are used up; the exception has the whole conversation.
            ModelError: The model did not reply, or the budget is spent.
        """
        if not query.strip():
            raise QueryError("empty", query, "it asks for nothing")
        if len(query) > LONGEST_QUERY:
            raise QueryError("too-long", query, f"it has {len(query)} characters, and the most are {LONGEST_QUERY}")
        broken = contradictions(tuple(literal for fact in scene.facts for literal in bddl.literals(fact) or ()))
        if broken is not None:
            hint = "mend the scene; no plan can start from there"
            raise SceneError(broken, source=scene.name, place="facts", hint=hint)
        self.conversation = Conversation(self.name, query, scene.name, listen=self.listen)
        transport = self.transport
        if self.budget is not None:
            transport = Metered(transport, name=self.name, budget=self.budget)
        session = ModuleSession(transport, query, scene, Log(self.conversation), self.rounds, self.images, self.sizing)
        expected = _word_by_word(query, scene) if self.cross_check else None
        return Drafting(session, expected, self.revisions).run()


def _word_by_word(query: str, scene: Scene) -> bddl.Formula | None:
    """Return the goal of the offline planner's literal reading, or None if it cannot read the query."""
    try:
        return OfflinePlanner().propose(query, scene).task.goal
    except QueryError:
        return None
