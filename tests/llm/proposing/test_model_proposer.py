"""Modules 1 to 5 behind a model: right answers become proved tasks, wrong ones go back with what is wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import bddl
import llm
import oag
from llm.client.budget import Budget
from llm.client.connect import connect
from llm.client.recording import Recorder
from llm.client.transport import Image
from llm.errors import BudgetSpent
from llm.proposing.model_proposer import ModelProposer
from tests.json_edits import altered
from tests.llm.kitchens import noted
from tests.llm.scripted_modules import (
    QUERIES,
    TASKS,
    Script,
    Wrong,
    right_answers,
    scene_of,
    task_of,
    told,
    without_subtask,
)

T1 = right_answers("T1")
SCENE = scene_of("T1")
SECOND = ("sub_tasks", 1)


def proposer(script: Any, **settings: Any) -> ModelProposer:
    """Return a proposer that asks a script, and does not compare with the offline planner."""
    return ModelProposer(script, name="script", **{"cross_check": False, **settings})


def propose(script: Any, **settings: Any) -> llm.Proposal:
    """Return what comes of T1's query."""
    return proposer(script, **settings).propose(QUERIES["T1"], SCENE)


@pytest.mark.parametrize("name", TASKS)
def test_right_answers_give_the_papers_tasks_proved(name: str) -> None:
    script = Script(right_answers(name))
    proposal = proposer(script).propose(QUERIES[name], scene_of(name))
    report = oag.compose(proposal.task).verify()
    assert report.verdict is oag.Verdict.PROVED
    assert oag.recheck(report.certificate).ok if report.certificate else False
    assert len(script.asked) == 5
    mine, wanted = oag.canonical(proposal.task), oag.canonical(task_of(name))
    assert mine.goal == wanted.goal
    assert [replace(part, name="", detail="") for part in mine.subtasks] == [
        replace(part, name="", detail="") for part in wanted.subtasks
    ]
    assert proposal.proposer == "script"
    assert oag.Task.from_json(json.loads(json.dumps(proposal.to_json())), scene=scene_of(name)) == proposal.task


@pytest.mark.parametrize(
    "around",
    [
        "```json\n%s\n```",
        "Sure! Here is the plan:\n%s\nLet me know if you need {more}.",
        '<think>first {"goal": 1} then</think>%s',
    ],
    ids=["fence", "prose", "thoughts"],
)
def test_what_stands_around_the_json_does_not_matter(around: str) -> None:
    script = Script(T1, around=lambda text: around % text)
    assert propose(script).task.subtasks[0].target == "refrigerator_0"
    assert len(script.asked) == 5


# What is wrong, in which module's answer, and what the model must be told before it gives the right one.
SLIPS = {
    "prose instead of JSON": (1, "I would open the refrigerator first.", "answer/no-json"),
    "broken JSON": (1, '{"problem": "", "task_name": "put', "answer/broken-json"),
    "a field too few": (1, altered(T1[1], ("task_name",), ...), "answer/field"),
    "an invented object in the name": (1, altered(T1[1], ("task_name",), "put glass_9 away"), "did you mean glass_0?"),
    "an invented object in the goal": (1, altered(T1[1], ("goal",), "(inside glas_0 refrigerator_0)"), "glass_0"),
    "an unreadable goal": (1, altered(T1[1], ("goal",), "(inside glass_0 ...)"), "bddl/syntax"),
    "a contradictory goal": (
        1,
        altered(T1[1], ("goal",), "(and (open refrigerator_0) (not (open refrigerator_0)))"),
        "task/contradictory",
    ),
    "a goal that holds already": (1, altered(T1[1], ("goal",), "(ontop glass_0 table_0)"), "answer/empty-goal"),
    "a goal that asks for nothing": (1, altered(T1[1], ("goal",), "(and)"), "answer/empty-goal"),
    "a goal out of reach": (
        1,
        altered(
            {**T1[1], "task_message_detail": "Onto table_0."},
            ("goal",),
            "(and (inside glass_0 refrigerator_0) (ontop table_0 refrigerator_0))",
        ),
        "goal/not-reached",
    ),
    "an invented target": (2, altered(T1[2], (*SECOND, "target"), "mug_0"), "bddl/unknown-object"),
    "the gripper as a support": (2, altered(T1[2], (*SECOND, "support_init"), "gripper"), "task/role-scope"),
    "swapped roles": (
        2,
        altered(altered(T1[2], (*SECOND, "target"), "table_0"), (*SECOND, "support_init"), "glass_0"),
        "answer/category",
    ),
    "a wrong category": (2, altered(T1[2], (*SECOND, "bddl_category"), "wineglass"), "answer/category"),
    "two subtasks of one number": (2, altered(T1[2], (*SECOND, "sub_task"), 1), "answer/numbering"),
    "a dropped subtask": (2, without_subtask(T1, 2, 3), 'insert "close refrigerator_0" at the end'),
    "a dropped opening": (2, without_subtask(T1, 2, 0), 'insert "open refrigerator_0" before T1'),
    "an invented predicate": (
        3,
        altered(T1[3], (*SECOND, "init"), "(hovering glass_0 table_0)"),
        "bddl/unknown-predicate",
    ),
    "a formula with two parentheses too few": (
        3,
        altered(T1[3], (*SECOND, "goal"), "(not (open table_0"),
        "bddl/syntax",
    ),
    "a contradictory condition": (
        3,
        altered(T1[3], (*SECOND, "init"), "(and (ontop glass_0 table_0) (not (ontop glass_0 table_0)))"),
        "task/contradictory",
    ),
    "a condition about something else": (
        3,
        altered(T1[3], (*SECOND, "goal"), "(open refrigerator_0)"),
        "answer/off-target",
    ),
    "an init that is false by then": (
        3,
        altered(T1[3], ("sub_tasks", 2, "init"), "(ontop glass_0 table_0)"),
        "context/refuted",
    ),
    "conditions for too few subtasks": (3, without_subtask(T1, 3, 3), "4 is missing"),
    "an unscaled glass": (4, altered(T1[4], (*SECOND, "scale"), 1.0), "write 0.71"),
    "a scaled refrigerator": (4, altered(T1[4], ("sub_tasks", 0, "scale"), 0.5), "it is of type A"),
    "a factor of zero": (4, altered(T1[4], (*SECOND, "scale"), 0), "answer/field"),
    "another object's factor": (4, altered(T1[4], (*SECOND, "target"), "table_0"), "answer/target"),
    "an invented primitive": (5, altered(T1[5], (*SECOND, "flow", 3), 99), "flow/unknown-primitive"),
    "a primitive by a wrong name": (5, altered(T1[5], (*SECOND, "flow", 3), "GRAB"), "flow/unknown-primitive"),
    "a distance out of range": (5, altered(T1[5], (*SECOND, "flow", 4), {"7": 20}), "flow/parameter"),
    "a lift beyond the arm": (5, altered(T1[5], (*SECOND, "flow", 4), {"7": 2.0}), "flow/parameter"),
    "a push beyond the arm": (5, altered(T1[5], ("sub_tasks", 2, "flow", 2), {"9": 1.5}), "flow/parameter"),
    "a goal of a thing on itself": (1, {**T1[1], "goal": "(ontop glass_0 glass_0)"}, "nothing can be ontop itself"),
    "a condition of a thing in itself": (
        3,
        altered(T1[3], (*SECOND, "init"), "(inside glass_0 glass_0)"),
        "nothing can be inside itself",
    ),
    "a number where none belongs": (5, altered(T1[5], (*SECOND, "flow", 3), {"3": 0.4}), "takes no parameter"),
    "grasping nothing": (5, altered(T1[5], (*SECOND, "flow"), [17, 1, 2, {"7": 0.2}]), "insert GRASP in T2"),
    "never letting go": (5, altered(T1[5], ("sub_tasks", 2, "flow"), [18, {"13": 0.4}]), "flow/goal-not-reached"),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_a_wrong_answer_is_mended_once_it_is_said_what_is_wrong(slip: str) -> None:
    module, reply, until = SLIPS[slip]
    script = Script(T1, {module: [Wrong(reply, until)]})
    proposal = propose(script)
    assert oag.compose(proposal.task).verify().verdict is oag.Verdict.PROVED
    assert script.count(module) == 2
    assert any(until in told(request) for request in script.asked)


@pytest.mark.parametrize("slip", SLIPS)
def test_a_wrong_answer_that_stays_is_never_taken(slip: str) -> None:
    module, reply, until = SLIPS[slip]
    asked = proposer(Script(T1, {module: [Wrong(reply, None)]}), rounds=3)
    with pytest.raises(llm.AnswersRefused) as caught:
        asked.propose(QUERIES["T1"], SCENE)
    findings = [str(found) for entry in caught.value.conversation.entries for found in entry.findings]
    assert any(until in text for text in findings)
    assert caught.value.conversation is asked.conversation


def test_a_module_that_stands_by_its_answer_may_be_right() -> None:
    """The goal of a pick is wrong; the decomposition is blamed first, stays, and the conditions are asked for."""
    wrong = altered(T1[3], ("sub_tasks", 2, "goal"), "(ontop glass_0 refrigerator_0)")
    script = Script(T1, {3: [Wrong(wrong, "goal/not-reached")]})
    proposal = propose(script)
    assert oag.compose(proposal.task).verify().verdict is oag.Verdict.PROVED
    assert proposal.conversation is not None
    assert script.count(3) >= 2


def test_an_answer_that_comes_again_is_not_taken_and_not_asked_for_endlessly() -> None:
    script = Script(T1, {5: [Wrong(altered(T1[5], (*SECOND, "flow"), [17]), None)]})
    with pytest.raises(llm.AnswersRefused) as caught:
        propose(script, rounds=20)
    assert caught.value.insists
    assert script.count(5) < 10
    assert any(found.code == "answer/repeated" for found in caught.value.conversation.rounds[-1].findings)


def test_what_is_said_of_a_refused_plan_has_everything() -> None:
    script = Script(T1, {2: [Wrong(without_subtask(T1, 2, 0), "flow/no-flow")]})
    propose(script)
    said = next(told(request) for request in script.asked if told(request))
    for part in ("1. flow/no-flow", "T2 put_glass_into_refrigerator", "checked: all obligations hold"):
        assert part in said
    assert said.index("<<<findings") < said.index("flow/no-flow") < said.index("findings>>>") < said.index("<<<change")


def test_neither_the_goal_nor_the_facts_are_offered_for_change() -> None:
    script = Script(T1, {2: [Wrong(without_subtask(T1, 2, 3), "goal/not-reached")]})
    propose(script)
    said = "".join(told(request) for request in script.asked)
    assert "change the task goal" not in said
    assert 'insert "close refrigerator_0"' in said


def test_the_models_own_refusal_is_a_query_error() -> None:
    answer = {**T1[1], "problem": "There is no toaster here.", "goal": ""}
    with pytest.raises(llm.QueryError, match="the model says: There is no toaster here") as caught:
        proposer(Script({**T1, 1: answer})).propose("toast the bread", SCENE)
    assert caught.value.code == "model-declined"


@pytest.mark.parametrize("rest", [{}, dict.fromkeys(T1[1], ""), dict.fromkeys(T1[1])], ids=["nothing", "empty", "null"])
def test_a_query_that_cannot_be_done_needs_no_task(rest: dict[str, object]) -> None:
    script = Script(T1, {1: [Wrong({**rest, "problem": "There is no cat."})]})
    with pytest.raises(llm.QueryError, match="the model says: There is no cat") as caught:
        propose(script)
    assert caught.value.code == "model-declined" and len(script.asked) == 1


@pytest.mark.parametrize(("query", "code"), [("  ", "empty"), ("put " * 1000, "too-long")])
def test_queries_without_a_question_are_not_asked(query: str, code: str) -> None:
    script = Script(T1)
    with pytest.raises(llm.QueryError) as caught:
        proposer(script).propose(query, SCENE)
    assert caught.value.code == code
    assert not script.asked


def test_a_goal_that_the_words_do_not_say_is_asked_about_once_and_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "llm.proposing.model_proposer._word_by_word", lambda *_: bddl.parse_formula("(inside glass_0 gripper)")
    )
    script = Script(T1)
    proposal = propose(script, cross_check=True)
    assert script.count(1) == 2
    shown = told(script.asked[1])
    assert "which reading of the request is meant" in shown and "table_0" not in shown
    assert shown.index("(inside glass_0 gripper)") < shown.index("(inside glass_0 refrigerator_0)")
    assert noted(proposal) == (
        "word by word the query asks for (inside glass_0 gripper); the model stands by "
        "(and (inside glass_0 refrigerator_0) (not (open refrigerator_0)))",
    )


def test_a_plan_that_rests_on_something_unknown_goes_back_once_and_is_noted() -> None:
    scene = replace(
        SCENE, facts=(bddl.parse_formula("(ontop glass_0 table_0)"),), closed=frozenset({"ontop", "inside"})
    )
    script = Script(T1)
    proposal = proposer(script).propose(QUERIES["T1"], scene)
    report = oag.compose(proposal.task).verify()
    assert report.verdict is oag.Verdict.CONDITIONAL
    assert any("something unknown" in note for note in proposal.notes)
    assert any("context/open" in told(request) for request in script.asked)
    assert len(script.asked) < 12


def test_pictures_go_to_module_1_and_again_with_every_round() -> None:
    picture = Image(b"\x89PNG not really")
    script = Script(T1, {1: [Wrong("no", "answer/no-json")]})
    propose(script, images=(picture,))
    assert [len(request.images) for request in script.asked] == [1, 1, 0, 0, 0, 0]


def test_the_budget_of_a_proposal_is_kept() -> None:
    script = Script(T1)
    asked = proposer(script, budget=Budget(requests=3))
    with pytest.raises(BudgetSpent):
        asked.propose(QUERIES["T1"], SCENE)
    assert len(script.asked) == 3
    assert asked.conversation is not None
    assert len(asked.conversation.rounds) == 3


def test_the_conversation_is_json_and_tells_the_story() -> None:
    script = Script(T1, {2: [Wrong(without_subtask(T1, 2, 3), "goal/not-reached")]})
    conversation = propose(script).conversation
    assert conversation is not None
    data = json.loads(json.dumps(conversation.to_json()))
    assert data["schema"] == "scene2demo/conversation/1"
    kinds = [entry["kind"] for entry in data["entries"]]
    assert kinds.count("round") == len(script.asked) == 7
    refuted = next(entry for entry in data["entries"] if entry["kind"] == "verdict")
    assert (refuted["verdict"], refuted["blamed"], refuted["searched"]) == ("REFUTED", 2, True)
    assert refuted["findings"][0]["fixes"]
    assert sum(entry.input_tokens or 0 for entry in conversation.rounds) == 700
    assert sum(entry.output_tokens or 0 for entry in conversation.rounds) == 140
    assert "verdict  REFUTED, module 2 asked again: goal/not-reached" in conversation.story()


def test_a_recorded_proposal_replays_from_its_file(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    script = Script(T1, {5: [Wrong(altered(T1[5], (*SECOND, "flow"), [17]), "flow/goal-not-reached")]})
    first = propose(Recorder(script, file))
    assert propose(connect(f"replay:{file}")) == first


def test_propose_takes_a_configuration_string(tmp_path: Path) -> None:
    file = tmp_path / "run.jsonl"
    first = propose(Recorder(Script(T1), file))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("llm.proposing.model_proposer._word_by_word", lambda *_: None)
        replayed = llm.propose(QUERIES["T1"], SCENE, model=f"replay:{file}")
    assert replayed.task == first.task
    assert replayed.proposer == f"replay:{file}"
    with pytest.raises(llm.ModelError):
        llm.propose(QUERIES["T1"], SCENE, model="no-such-provider:x")


def test_a_scene_that_contradicts_itself_is_found_before_the_model_is_asked() -> None:
    scene = scene_of("T1")
    objects = {**scene.objects, "glass_1": replace(scene["glass_0"], id="glass_1")}
    facts = tuple(map(bddl.parse_formula, ("(inside glass_0 gripper)", "(inside glass_1 gripper)")))
    script = Script(right_answers("T1"))
    with pytest.raises(oag.SceneError, match="the gripper holds one thing at a time, not glass_0 and glass_1"):
        ModelProposer(script).propose(QUERIES["T1"], replace(scene, objects=objects, facts=facts))
    assert script.asked == []
