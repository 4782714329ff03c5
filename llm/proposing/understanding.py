"""Module 1 (Semantic Expansion): the query in terms of the scene, and the task goal G, which later modules keep.

G is a departure (docs/semantics.md). Where the query can be read word by word and the model's goal is another one, the
model chooses between the two, in a short question without the scene. It writes the formula, and that of the words
comes first. Qwen2.5-Coder-1.5B named the first of two readings by its letter in 20 of 20 draws, whichever that was. Of
written ones it chose that of the words in 7 of 7 draws where it is right, and in 2 of 3 where it is not.

Source: the paper's module 1.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

from pydantic import Field

import bddl
from llm.errors import QueryError
from llm.proposing.handling import bare_task, distinct, stakes
from llm.proposing.proposal import Expanded
from llm.proposing.session import ModuleSession
from llm.structured.conversation import AnswersRefused, finding
from llm.structured.prompting import fenced, predicate_table
from llm.structured.schema import (
    LONGEST_NAME,
    UNASKED,
    ActivityName,
    Answer,
    Line,
    MaybeFormula,
    MaybeLine,
    Remark,
    Text,
    is_empty_remark,
)
from oag import Diagnostic, Scene, Verdict, compose
from oag.model.diagnostics import TASK_GOAL
from oag.model.reading import syntax_issues
from oag.wellformed import check as check_form

# Pattern of ids of a scene: letters, an underscore and a number.
_ID = re.compile(r"\b[A-Za-z][A-Za-z0-9_]*_\d+\b")
# Defaults for an answer that declares the query infeasible: it has no task to name.
_NO_TASK = {"task_name": "nothing", "task_activity_name": "nothing", "task_message_detail": "", "goal": ""}


class Understanding(Answer):
    """The query in terms of the scene.

    The fields are in the order of reasoning: a model that is asked for a problem first finds one before it has read
    the scene, and a small one that has just written where things are writes that as the goal.
    """

    task_message_detail: Text = Field(
        default="", description="where things are, one sentence", json_schema_extra={"maxLength": 240}
    )
    task_name: Line = Field(description="the wish in one line, every object named by its id")
    task_activity_name: ActivityName = Field(default="", json_schema_extra=UNASKED)
    goal: MaybeFormula = Field(default="", description="BDDL formula that holds when the wish is fulfilled")
    problem: Remark = Field(
        default="", description="why the query cannot be done in this scene, one sentence; empty if it can"
    )

    @classmethod
    def _as_asked(cls, data: Mapping[str, object]) -> dict[str, object]:
        """Convert an object to the requested form: with a problem, no other field is needed.

        The paper calls the description `task_detail_message`, and its name is the activity's in words.
        """
        plain = super()._as_asked(data)
        if "task_message_detail" not in plain and "task_detail_message" in plain:
            plain["task_message_detail"] = plain["task_detail_message"]
            plain.setdefault("task_name", str(plain.get("task_activity_name", "")).replace("_", " "))
        if isinstance(plain.get("task_name"), str):
            plain.setdefault("task_activity_name", _activity(str(plain["task_name"])))
        problem = plain.get("problem")
        if isinstance(problem, str) and not is_empty_remark(problem):
            return {**_NO_TASK, **{key: value for key, value in plain.items() if value not in ("", None)}}
        return plain


def _activity(sentence: str) -> str:
    """Return a sentence as the name of an activity: put_the_cup_into_the_drawer."""
    words = "_".join(re.findall(r"[a-z0-9]+", sentence.lower()))[:LONGEST_NAME].strip("_")
    return words if words[:1].isalpha() else f"task_{words}"


@dataclass(frozen=True, slots=True)
class Understood:
    """Meaning of a query."""

    expanded: Expanded
    activity: str
    goal: bddl.Formula

    def about(self, scene: Scene) -> set[str]:
        """Return the names that the goal at stake has once its quantifiers are expanded."""
        goal = stakes(self.goal, scene)
        return {name for atom in bddl.ground(goal, scene.categories).atoms for name in atom.args}

    def text(self, scene: Scene) -> str:
        """Return module 1's answer as text for the prompts of the later modules."""
        lines = [
            f"task_name: {self.expanded.task_name}",
            f"task_message_detail: {self.expanded.task_message_detail}",
            f"goal: {bddl.format(stakes(self.goal, scene))}",
        ]
        return fenced("task", "\n".join(lines))


class Reading(Answer):
    """The reading of a query that is meant."""

    asked: MaybeLine = Field(
        default="", description="what the request asks for, in a few words", json_schema_extra={"maxLength": 160}
    )
    goal: MaybeFormula = Field(default="", description="the formula that says it")


def understand(session: ModuleSession, expected: bddl.Formula | None = None) -> Understood:
    """Ask module 1 for the meaning of the query.

    Args:
        session: State shared by the modules.
        expected: Goal of the literal reading of the query, if it can be read. A model with another goal, or without
            one, is asked once which of the two is meant.

    Raises:
        QueryError: The model states that the query cannot be fulfilled here.
        AnswersRefused, ModelError: As `ModuleSession.ask` does.
    """

    def check(answer: Understanding) -> Iterator[Diagnostic]:
        if answer.problem and answer.goal:
            hint = "leave problem empty if the request can be fulfilled; otherwise leave goal empty"
            yield finding("answer/contradictory", "a problem and a goal are given", "problem", hint=hint)
        elif answer.goal or not answer.problem:
            yield from _understanding_findings(answer, session.scene)

    places = {"query": fenced("request", session.query), "predicates": predicate_table()}
    answer = session.ask(1, Understanding, check, places, session.images)
    reason = " ".join(answer.problem.split()).rstrip(".")[:400]
    goal = distinct(bddl.parse_formula(answer.goal)) if answer.goal else None
    if expected is not None and (goal is None or not bddl.equivalent(goal, expected, session.scene.categories)):
        meant = _meant(session, expected, goal, reason)
        chosen = distinct(bddl.parse_formula(meant.goal)) if meant.goal else goal
        if chosen is not None and chosen != goal:
            # The words of an answer are about its own goal.
            query = " ".join(session.query.split())
            name = meant.asked or query[:LONGEST_NAME]
            return Understood(Expanded(name, query), _activity(name), chosen)
    if goal is None:
        raise QueryError("model-declined", session.query, f"the model says: {reason}")
    expanded = Expanded(answer.task_name, answer.task_message_detail)
    return Understood(expanded, answer.task_activity_name, goal)


def _meant(session: ModuleSession, expected: bddl.Formula, own: bddl.Formula | None, reason: str) -> Reading:
    """Ask which of two readings is meant; without a goal in the answer, the model stands by its own, or its refusal."""

    def check(answer: Reading) -> Iterator[Diagnostic]:
        if answer.goal not in ("", *formulas):
            yield from _goal_findings(answer.goal, session.scene)

    formulas = [bddl.format(goal) for goal in (expected, own) if goal is not None]
    shown = formulas if own is not None else [*formulas, f"it cannot be done: {reason}"]
    places = {"query": fenced("request", session.query), "readings": fenced("readings", "\n".join(shown))}
    # A model that cannot answer this has answered the question itself.
    with suppress(AnswersRefused):
        return session.ask(1, Reading, check, places, template="module_1_reading", readings=formulas)
    return Reading()


def _understanding_findings(answer: Understanding, scene: Scene) -> Iterator[Diagnostic]:
    for name in dict.fromkeys(_ID.findall(answer.task_name)):
        if name not in scene.objects:
            near = bddl.near_names(name, scene.objects)
            hint = f"did you mean {' or '.join(near)}?" if near else f"the scene has {', '.join(scene.objects)}"
            message = f"the scene {scene.name[:80]} has no object {name!r}"
            yield finding("bddl/unknown-object", message, "task_name", hint=hint)
    if answer.goal:
        yield from _goal_findings(answer.goal, scene)
    else:
        yield finding("answer/empty-goal", "neither a goal nor a problem is given", "goal")


def _goal_findings(text: str, scene: Scene) -> Iterator[Diagnostic]:
    try:
        goal = bddl.parse_formula(text)
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
