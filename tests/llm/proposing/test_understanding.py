"""Module 1: which of two readings of a query is meant, and a goal whose parts are repeated."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass, field
from typing import Any

import pytest

import bddl
import llm
from llm.client.transport import ChatReply, ChatRequest
from llm.proposing.modules import Decomposition
from llm.proposing.session import ModuleSession
from llm.proposing.understanding import Understood, understand
from llm.structured.ask import Log
from llm.structured.conversation import Conversation
from tests.llm.scripted_modules import QUERIES, right_answers, scene_of

T1 = right_answers("T1")
SCENE = scene_of("T1")
SHUT = "(and (inside glass_0 refrigerator_0) (not (open refrigerator_0)))"
LITERAL = "(inside glass_0 refrigerator_0)"


@dataclass
class Answers:
    """A model that gives the answers of a list."""

    listed: list[dict[str, Any]]
    asked: list[ChatRequest] = field(default_factory=list)

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the next answer."""
        self.asked.append(request)
        return ChatReply(json.dumps(self.listed[min(len(self.asked), len(self.listed)) - 1]))


def understood(*answers: dict[str, Any], expected: str | None = LITERAL) -> tuple[Understood, Answers]:
    """Return what module 1 makes of T1's query with some answers, and the model."""
    model = Answers([*answers])
    log = Log(Conversation("model", QUERIES["T1"], SCENE.name))
    session = ModuleSession(model, QUERIES["T1"], SCENE, log, 3)
    return understand(session, None if expected is None else bddl.parse_formula(expected)), model


@pytest.mark.parametrize(
    ("chosen", "goal", "asked"),
    [
        ({"asked": "glass into refrigerator", "goal": LITERAL}, LITERAL, 2),
        ({"asked": "and shut it", "goal": SHUT}, SHUT, 2),
        # Neither of the two.
        ({"goal": "(open refrigerator_0)"}, "(open refrigerator_0)", 2),
        # No choice: the goal stands.
        ({"goal": ""}, SHUT, 2),
        # One that the scene does not have is asked for again, and then the goal stands.
        ({"goal": "(inside glass_0 toaster_0)"}, SHUT, 4),
    ],
)
def test_of_two_readings_the_model_chooses(chosen: dict[str, str], goal: str, asked: int) -> None:
    found, model = understood(T1[1], chosen)
    assert bddl.format(found.goal) == goal
    assert len(model.asked) == asked
    # The words of an answer are about its own goal.
    assert (found.expanded.task_message_detail == QUERIES["T1"]) is (goal != SHUT)


def test_a_reading_that_is_the_goal_is_not_asked_about() -> None:
    assert len(understood(T1[1], expected=SHUT)[1].asked) == 1
    assert len(understood(T1[1], expected=None)[1].asked) == 1


def test_the_question_about_readings_is_short_and_admits_the_two() -> None:
    _, model = understood(T1[1], {"goal": SHUT})
    first, second = (request.messages[0].parts[0] for request in model.asked)
    assert isinstance(first, str) and isinstance(second, str)
    assert len(second) < len(first) / 3 and "table_0" not in second
    schema = model.asked[1].json_schema
    assert schema is not None
    pattern = schema["properties"]["goal"]["pattern"]  # type: ignore[index]
    matching = [text for text in (LITERAL, SHUT, "", "(open refrigerator_0)") if re.search(pattern, text)]
    assert matching == [LITERAL, SHUT, ""]


def test_a_model_that_declines_what_can_be_read_is_asked_once() -> None:
    declined = {"problem": "There is no glass.", "goal": ""}
    found, model = understood(declined, {"asked": "put the glass away", "goal": LITERAL})
    assert bddl.format(found.goal) == LITERAL and found.expanded.task_name == "put the glass away"
    assert "it cannot be done: There is no glass" in str(model.asked[1].messages[0].parts[0])
    with pytest.raises(llm.QueryError, match="There is no glass"):
        understood(declined, {"goal": ""})
    # In its own words, which are no formula.
    with pytest.raises(llm.QueryError, match="There is no glass"):
        understood(declined, {"goal": "it cannot be done: There is no glass"})
    with pytest.raises(llm.QueryError, match="There is no glass"):
        understood(declined, expected=None)


def test_a_part_of_a_goal_counts_once() -> None:
    repeated = f"(and {LITERAL} {LITERAL} (not (open refrigerator_0)) {LITERAL})"
    found, model = understood({**T1[1], "goal": repeated}, expected=SHUT)
    assert bddl.format(found.goal) == SHUT and len(model.asked) == 1


@pytest.mark.parametrize(
    ("entries", "roles"),
    [
        # Picked up and put down in one entry: two subtasks.
        ([("glass_0", "table_0", "refrigerator_0")], [("table_0", None), (None, "refrigerator_0")]),
        # What is held already, from where it was taken: one.
        (
            [("glass_0", "table_0", ""), ("glass_0", "table_0", "refrigerator_0")],
            [("table_0", None), (None, "refrigerator_0")],
        ),
        # From somewhere else: the entry may mean another pick.
        (
            [("glass_0", "table_0", ""), ("glass_0", "cabinet_0", "refrigerator_0")],
            [("table_0", None), ("cabinet_0", None), (None, "refrigerator_0")],
        ),
    ],
)
def test_where_a_thing_is_taken_from_is_read_once(
    entries: list[tuple[str, str, str]], roles: list[tuple[str | None, str | None]]
) -> None:
    listed = [
        {"sub_task": n, "task_activity_name": "move", "target": one, "support_init": start, "support_goal": end}
        for n, (one, start, end) in enumerate(entries, start=1)
    ]
    found = Decomposition.model_validate({"sub_tasks": listed}).subtasks()
    assert [(part.support_init, part.support_goal) for part in found] == roles
