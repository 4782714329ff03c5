"""Module 1: what a query means in a scene, and the task goal G, which no later module can change.

Source: the paper's Semantic Expansion; G is a departure (docs/proposition.md).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from pydantic import Field

import bddl
from llm.answers.base import ActivityName, Answer, Line, MaybeText, Remark, Text, says_nothing
from llm.answers.conversation import finding
from llm.answers.describe import predicate_table
from llm.answers.prompting import fenced
from llm.errors import QueryError
from llm.modules.context import Asked, bare_task
from llm.proposal import Expanded
from oag import Diagnostic, Scene, Verdict, compose
from oag.model.diagnostic import TASK_GOAL
from oag.model.facts import GRIPPER
from oag.task.reading import syntax_issues
from oag.task.wellformed import check as check_form

# Words that look like ids of a scene: letters, an underscore and a number.
_ID = re.compile(r"\b[A-Za-z][A-Za-z0-9_]*_\d+\b")
# Who says that a query cannot be done has no task to name.
_NO_TASK = {"task_name": "nothing", "task_activity_name": "nothing", "task_message_detail": "", "goal": ""}


class Understanding(Answer):
    """The query in terms of the scene.

    The fields stand in the order of thinking: a model that is asked for a problem first finds one before it has read
    the scene.

    Attributes:
        task_name: The wish with every object named by its id, such as "put glass_0 into refrigerator_0".
        task_activity_name: The same as an identifier.
        task_message_detail: The description, step by step.
        goal: The task goal G as a BDDL formula; empty when there is a problem.
        problem: Why the query cannot be done here, in one sentence; empty when it can.
    """

    task_name: Line = Field(description="the wish in one line, every object named by its id")
    task_activity_name: ActivityName = Field(description="the same in words joined by underscores")
    task_message_detail: Text = Field(description="where things are and what is done, step by step")
    goal: MaybeText = Field(default="", description="BDDL formula that holds when the wish is fulfilled")
    problem: Remark = Field(
        default="", description="why the query cannot be done in this scene, one sentence; empty if it can"
    )

    @classmethod
    def _as_asked(cls, data: Mapping[str, object]) -> dict[str, object]:
        """Returns an object in the form asked for: with a problem, nothing else is needed."""
        plain = super()._as_asked(data)
        problem = plain.get("problem")
        if isinstance(problem, str) and not says_nothing(problem):
            return {**_NO_TASK, **{key: value for key, value in plain.items() if value not in ("", None)}}
        return plain


@dataclass(frozen=True, slots=True)
class Understood:
    """What a query means.

    Attributes:
        expanded: The query in terms of the scene.
        activity: The task's name as an identifier.
        goal: The task goal G.
    """

    expanded: Expanded
    activity: str
    goal: bddl.Formula

    def text(self) -> str:
        """Returns what module 1 said, for the prompts of the later modules."""
        lines = [
            f"task_name: {self.expanded.task_name}",
            f"task_message_detail: {self.expanded.task_message_detail}",
            f"goal: {bddl.format(self.goal)}",
        ]
        return fenced("task", "\n".join(lines))


def understand(asked: Asked, expected: bddl.Formula | None = None) -> Understood:
    """Returns what the query means, by the model's answer.

    Args:
        asked: Who is asked, and what.
        expected: The goal that reading the query word by word gives, if it can be read so. A model that says something
            else is asked once whether it means it.

    Raises:
        QueryError: The model says that the query cannot be done here.
        AnswersRefused, ModelError: As `Asked.ask` does.
    """

    def check(answer: Understanding) -> Iterator[Diagnostic]:
        if answer.problem and answer.goal:
            hint = "leave problem empty if the request can be fulfilled; otherwise leave goal empty"
            yield finding("answer/contradictory", "a problem and a goal are given", "problem", hint=hint)
        elif not answer.problem:
            yield from _wrong(answer, asked.scene, expected)
        elif expected is not None:
            message = f"word by word the request asks for {bddl.format(expected)}, which can be planned in this scene"
            yield finding("answer/other-reading", message, "problem", severity="warning")

    places = {"query": fenced("request", asked.query), "predicates": predicate_table()}
    answer = asked.ask(1, Understanding, check, places, asked.images)
    if answer.problem:
        said = " ".join(answer.problem.split()).rstrip(".")[:400]
        raise QueryError("model-declined", asked.query, f"the model says: {said}")
    expanded = Expanded(answer.task_name, answer.task_message_detail)
    return Understood(expanded, answer.task_activity_name, bddl.parse_formula(answer.goal))


def _wrong(answer: Understanding, scene: Scene, expected: bddl.Formula | None) -> Iterator[Diagnostic]:
    """Yields what is wrong with an answer that says that the query can be done."""
    for name in dict.fromkeys(_ID.findall(answer.task_name)):
        if name not in scene.objects:
            near = bddl.near_names(name, scene.objects)
            hint = f"did you mean {' or '.join(near)}?" if near else f"the scene has {', '.join(scene.objects)}"
            message = f"the scene {scene.name[:80]} has no object {name!r}"
            yield finding("bddl/unknown-object", message, "task_name", hint=hint)
    if not answer.goal:
        yield finding("answer/empty-goal", "neither a goal nor a problem is given", "goal")
        return
    try:
        goal = bddl.parse_formula(answer.goal)
    except bddl.BDDLError as error:
        yield from syntax_issues(error, TASK_GOAL)
        return
    malformed = check_form(bare_task(scene, goal=goal), scene)
    yield from malformed
    if malformed:
        return
    if not bddl.atoms(goal):
        yield finding("answer/empty-goal", "the task goal speaks of nothing", TASK_GOAL)
    elif compose(bare_task(scene, goal=goal), scene=scene).verify().verdict is Verdict.PROVED:
        hint = "say what has to change; if the request asks for what is so already, say that under problem"
        yield finding("answer/empty-goal", f"{bddl.format(goal)} holds at the start already", TASK_GOAL, hint=hint)
    named = {name for atom in bddl.atoms(goal) for name in atom.args if name in scene.objects and name != GRIPPER}
    said = f"{answer.task_name} {answer.task_message_detail}"
    for name in sorted(named):
        if not re.search(rf"(?<![\w.-]){re.escape(name)}(?![\w-])", said):
            message = f"the goal speaks of {name}, which neither task_name nor task_message_detail mentions"
            yield finding("answer/unnamed-object", message, TASK_GOAL)
    if expected is not None and not same_goal(goal, expected):
        message = f"word by word the request asks for {bddl.format(expected)}, and the goal is {bddl.format(goal)}"
        hint = "check it against the request; names and categories of objects ask for nothing"
        yield finding("answer/other-reading", message, TASK_GOAL, hint=hint, severity="warning")


def same_goal(first: bddl.Formula, second: bddl.Formula) -> bool:
    """Decides whether two goals ask for the same, whatever the order of what they ask."""
    return _conjuncts(first) == _conjuncts(second)


def _conjuncts(formula: bddl.Formula) -> frozenset[str]:
    literals = bddl.literals(formula)
    if literals is None:
        return frozenset(bddl.format(part) for part in bddl.conjuncts(formula))
    return frozenset(f"{literal.value} {bddl.format(literal.atom)}" for literal in literals)
