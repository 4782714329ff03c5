"""A model that answers modules 1 to 5 by script: rightly for T1 to T4, or wrongly until it is told what is wrong."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import oag
from llm.client.transport import ChatReply, ChatRequest
from llm.proposing.modules import Conditions, Decomposition, Flows, Sizes
from llm.proposing.understanding import Understanding
from llm.structured.schema import Answer
from oag.sizes import PAPER_GRIPPER, scale_factor

DATA = Path(__file__).resolve().parent.parent / "data"
TASKS = ("T1", "T2", "T3", "T4")
QUERIES = {
    "T1": "put the glass into the refrigerator",
    "T2": "put the apple into the refrigerator",
    "T3": "put the apple into the bowl",
    "T4": "put the glass on the table",
}
SCHEMAS: dict[int, type[Answer]] = {1: Understanding, 2: Decomposition, 3: Conditions, 4: Sizes, 5: Flows}
Answers = dict[int, dict[str, Any]]


def scene_of(name: str) -> oag.Scene:
    """Return the scene of T1 to T4."""
    return oag.Scene.from_json(DATA / f"{name}_scene.json")


def task_of(name: str) -> oag.Task:
    """Return the plan that the scripted answers are taken from."""
    return oag.Task.from_json(DATA / f"{name}.json", scene=scene_of(name))


def right_answers(name: str) -> Answers:
    """Return the right answer to each module for T1 to T4, from the plans that the formal core is tested with."""
    scene, data = scene_of(name), json.loads((DATA / f"{name}.json").read_text(encoding="utf-8"))
    subtasks = list(enumerate(data["sub_tasks"], start=1))
    factors = {part["target"]: scale_factor(scene[part["target"]], PAPER_GRIPPER) for _, part in subtasks}
    involved = {key for _, part in subtasks for key in (part["target"], part["support_goal"]) if key}
    return {
        1: {
            "problem": "",
            "task_name": f"{QUERIES[name]}: {' and '.join(sorted(involved))}",
            "task_activity_name": data["task_activity_name"],
            "task_message_detail": data["task_detail_message"],
            "goal": data["goal"],
        },
        2: {
            "sub_tasks": [
                {
                    "sub_task": number,
                    **{key: part[key] for key in ("task_activity_name", "task_detail_message", "target")},
                    "support_init": part["support_init"] or "",
                    "support_goal": part["support_goal"] or "",
                    "bddl_category": scene[part["target"]].category,
                }
                for number, part in subtasks
            ]
        },
        3: {"sub_tasks": [{"sub_task": n, "init": part["init"], "goal": part["goal"]} for n, part in subtasks]},
        4: {
            "sub_tasks": [
                {"sub_task": n, "target": part["target"], "scale": factors[part["target"]]} for n, part in subtasks
            ]
        },
        5: {"sub_tasks": [{"sub_task": n, "flow": part["flow"]} for n, part in subtasks]},
    }


def without_subtask(answers: Answers, module: int, index: int) -> dict[str, Any]:
    """Return an answer that lacks a subtask, numbered as if there had been none."""
    entries = [entry for position, entry in enumerate(answers[module]["sub_tasks"]) if position != index]
    return {"sub_tasks": [{**entry, "sub_task": number} for number, entry in enumerate(entries, start=1)]}


def module_of(request: ChatRequest) -> int:
    """Return which module asks."""
    found = re.match(r"Module (\d) of 5", str(request.messages[0].parts[0]))
    assert found is not None
    return int(found[1])


def told(request: ChatRequest) -> str:
    """Return what the model was told of its earlier answer; empty when it is asked for the first time."""
    text = str(request.messages[-1].parts[0])
    return text if len(request.messages) > 1 else "".join(text.partition("one more question")[1:])


def as_reply(answer: object) -> str:
    """Return an answer as models write it."""
    return answer if isinstance(answer, str) else json.dumps(answer)


@dataclass(frozen=True)
class Wrong:
    """An answer that is given until the model is told something.

    Attributes:
        reply: The answer, or its text.
        until: What the findings have to say before the right answer is given; None: never.
    """

    reply: object
    until: str | None = None


@dataclass
class Script:
    """Answers each module rightly, except where something wrong is scripted; it corrects itself only when told how.

    The right answers of modules 3 to 5 are about the subtasks that the prompt lists, so a decomposition that drops one
    is followed faithfully.

    Attributes:
        right: The right answer to each module.
        wrong: For a module, wrong answers in their order.
        around: What is written around a right answer.
        asked: Every request.
    """

    right: Answers
    wrong: Mapping[int, Iterable[Wrong]] = field(default_factory=dict)
    around: Callable[[str], str] = str
    asked: list[ChatRequest] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._wrong = {module: list(replies) for module, replies in self.wrong.items()}
        self._given: dict[int, Wrong] = {}

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the scripted answer."""
        self.asked.append(request)
        module, findings = module_of(request), told(request)
        given = self._given.get(module)
        if given is not None and (given.until is None or given.until not in findings):
            return ChatReply(as_reply(given.reply), 100, 20)
        self._given.pop(module, None)
        if self._wrong.get(module):
            self._given[module] = self._wrong[module].pop(0)
            return ChatReply(as_reply(self._given[module].reply), 100, 20)
        return ChatReply(self.around(as_reply(self._right(module, request))), 100, 20)

    def _right(self, module: int, request: ChatRequest) -> dict[str, Any]:
        """Return the right answer, about the subtasks that the prompt lists."""
        answer = copy.deepcopy(self.right[module])
        if module < 3:
            return answer
        names = re.findall(r"^\d+ \| (\S+) \| target", str(request.messages[0].parts[0]), re.MULTILINE)
        known = [entry["task_activity_name"] for entry in self.right[2]["sub_tasks"]]
        picked = [copy.deepcopy(answer["sub_tasks"][known.index(name)]) for name in names if name in known]
        return {"sub_tasks": [{**entry, "sub_task": number} for number, entry in enumerate(picked, start=1)]}

    def count(self, module: int) -> int:
        """Return how often a module was asked."""
        return sum(module_of(request) == module for request in self.asked)
