"""A plan in the making: what each module has said so far, what has to be asked anew, and the task that comes of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import bddl
from llm.instantiate import problem
from llm.modules.context import Context
from llm.modules.decompose import decompose
from llm.modules.instantiate import instantiate
from llm.modules.plan import plan
from llm.modules.resize import resize
from llm.modules.understand import Understood, understand
from llm.proposal import Proposal
from llm.resize import check_sizes, scale_factors
from oag import ActionFlow, SimpleTask, Task
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

    def with_conditions(self, context: Context, expected: bddl.Formula | None) -> Draft:
        """Returns the draft with what modules 1 to 3 still have to say.

        Args:
            context: Who is asked.
            expected: The goal that the query has word by word, if it can be read so.

        Raises:
            QueryError: The model says that the query cannot be done here, or something is too large for the gripper.
            AnswersRefused: A module got no answer that holds.
            ModelError: There is no reply.
        """
        understood = self.understood or understand(context, expected)
        roles = self.roles or decompose(context, understood)
        check_sizes((part.target for part in roles), context.scene, context.query, understood.expanded.task_name)
        conditions = self.conditions
        if conditions is None:
            conditions = tuple((part.init, part.goal) for part in instantiate(context, understood, roles))
        return replace(self, understood=understood, roles=roles, conditions=conditions)

    def with_flows(self, context: Context) -> Draft:
        """Returns the draft with what modules 4 and 5 still have to say.

        Raises:
            AnswersRefused: A module got no answer that holds.
            ModelError: There is no reply.
        """
        subtasks = self.subtasks(searched=True)
        scales = self.scales if self.scales is not None else resize(context, subtasks)
        flows = self.flows
        if flows is None:
            flows = tuple(subtask.flow or () for subtask in plan(context, subtasks, scales))
        return replace(self, scales=scales, flows=flows)

    def subtasks(self, *, searched: bool) -> tuple[SimpleTask, ...]:
        """Returns the simple tasks as far as they are known.

        Args:
            searched: True to leave the flows to a search.
        """
        roles, conditions = self.roles or (), self.conditions or ()
        flows = (None,) * len(roles) if searched or self.flows is None else self.flows
        return tuple(
            replace(subtask, init=init, goal=goal, flow=flow)
            for subtask, (init, goal), flow in zip(roles, conditions, flows, strict=True)
        )

    def task(self, context: Context, *, searched: bool) -> Task:
        """Returns the task that the answers make.

        Args:
            context: Has the scene.
            searched: True to leave the flows to a search, and the sizes to the rule.

        Raises:
            ValueError: Module 1 has not said what is wanted.
        """
        if self.understood is None:
            raise ValueError("a draft has no task before module 1 has answered")
        subtasks = self.subtasks(searched=searched)
        by_rule = self.scales is None or searched
        scales = scale_factors((subtask.target for subtask in subtasks), context.scene) if by_rule else self.scales
        return Task(
            name=self.understood.activity,
            detail=self.understood.expanded.task_message_detail,
            goal=self.understood.goal,
            goal_given=True,
            subtasks=subtasks,
            scales=dict(scales or {}),
            scene=context.scene,
        )

    def proposal(self, context: Context, notes: tuple[str, ...]) -> Proposal:
        """Returns the proposal that the answers make.

        Raises:
            ValueError: Module 1 has not said what is wanted.
        """
        task = self.task(context, searched=False)
        if self.understood is None:
            raise ValueError("a draft is no proposal before module 1 has answered")
        return Proposal(
            query=context.query,
            expanded=self.understood.expanded,
            task=task,
            problems=tuple(problem(part.name, part.init, part.goal, context.scene) for part in task.subtasks),
            notes=(*notes, *map(str, resizings(task.scales, context.scene))),
            proposer=context.log.conversation.model,
            conversation=context.log.conversation,
        )
