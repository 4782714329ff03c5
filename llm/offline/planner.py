"""The offline planner: modules 1 to 5 in their order, by lexicon, grammar and templates."""

from __future__ import annotations

from dataclasses import dataclass, field

from llm.decompose import Step, decompose
from llm.errors import QueryError
from llm.flows import flow_for
from llm.instantiate import problem, states
from llm.narrate import narrative, subtask_detail, subtask_name, task_name
from llm.offline.lexicon import Lexicon, built_in
from llm.proposal import Expanded, Proposal
from llm.resize import check_sizes, scale_factors
from llm.surroundings import Surroundings
from llm.understand import understand
from oag import Scene, SimpleTask, Task, Verdict, compose
from oag.task.sizes import resizings


@dataclass(frozen=True, slots=True)
class OfflinePlanner:
    """Proposes tasks without a model; equal queries and scenes give equal proposals.

    Attributes:
        lexicon: The words and categories it knows; `llm.offline.lexicon.load` reads another one from a file.
    """

    lexicon: Lexicon = field(default_factory=built_in)

    def propose(self, query: str, scene: Scene) -> Proposal:
        """Returns the task for a query in a scene.

        Args:
            query: English, one wish or several in order.
            scene: Where it is to be done.

        Raises:
            QueryError: The query is not understood, can mean several things, or cannot be done in the scene; code
                "too-large" where something would have to be scaled by too much, "unproved" where a plan was found that
                cannot succeed.
        """
        understood = understand(query, scene, self.lexicon)
        around, request = understood.around, understood.request
        steps = decompose(request, around)
        check_sizes((step.target for step in steps), scene, query, str(request))
        subtasks = tuple(_subtask(step, around) for step in steps)
        detail = narrative(request, steps, around)
        task = Task(
            name=task_name(request, steps, around),
            detail=detail,
            goal=understood.goal,
            goal_given=True,
            subtasks=subtasks,
            scales=scale_factors((step.target for step in steps), scene),
            scene=scene,
        )
        _check_proof(query, task, str(request))
        return Proposal(
            query=query,
            expanded=Expanded(str(request), detail),
            task=task,
            problems=tuple(problem(subtask.name, subtask.init, subtask.goal, scene) for subtask in subtasks),
            notes=(*understood.notes, *map(str, resizings(task.scales, scene))),
        )


def _check_proof(query: str, task: Task, understood: str) -> None:
    """Raises a QueryError for a plan that cannot succeed; what the scene leaves open is not held against it."""
    report = compose(task).verify()
    if report.verdict is Verdict.REFUTED:
        reason = report.errors[0].message
        problem = f"no plan was found for it that goes through: {reason}"
        raise QueryError("unproved", query, problem, understood=understood)


def _subtask(step: Step, around: Surroundings) -> SimpleTask:
    """Returns a simple task with its formulas, texts and flow."""
    init, goal = states(step)
    return SimpleTask(
        name=subtask_name(step, around),
        detail=subtask_detail(step),
        target=step.target,
        support_init=None if step.start is None else step.start.object_id,
        support_goal=None if step.end is None else step.end.object_id,
        init=init,
        goal=goal,
        flow=flow_for(step),
    )
