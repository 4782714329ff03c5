"""Findings of the graph go back to the module that can mend them."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

import bddl
import llm
import oag
from llm.client.transport import ChatReply, ChatRequest
from llm.proposing import model_proposer
from llm.proposing.model_proposer import ModelProposer, charges
from oag.model.actions import flow_from_json
from tests.json_edits import altered
from tests.llm.scripted_modules import (
    QUERIES,
    Script,
    Wrong,
    module_of,
    right_answers,
    scene_of,
    task_of,
    without_subtask,
)

T1 = task_of("T1")


def with_subtask(index: int, **changes: object) -> oag.Task:
    """Return T1 with one subtask changed."""
    subtasks = list(T1.subtasks)
    subtasks[index] = replace(subtasks[index], **changes)  # type: ignore[arg-type]
    return replace(T1, subtasks=tuple(subtasks))


def without(index: int) -> oag.Task:
    """Return T1 without one subtask."""
    return replace(T1, subtasks=T1.subtasks[:index] + T1.subtasks[index + 1 :])


def formula(text: str) -> bddl.Formula:
    """Return a formula."""
    return bddl.parse_formula(text)


FAULTS = {
    "no opening": (without(0), 2),
    "no picking up": (without(1), 2),
    "no closing": (without(3), 2),
    "a false init": (with_subtask(2, init=formula("(ontop glass_0 table_0)")), 3),
    "no place to put it": (with_subtask(2, support_goal=None), 2),
    "a table to be opened": (
        with_subtask(0, target="table_0", init=formula("(not (open table_0))"), goal=formula("(open table_0)")),
        2,
    ),
    "a wrong place": (with_subtask(2, goal=formula("(inside glass_0 table_0)")), 3),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_before_flows_are_asked_for_modules_1_to_3_are_at_fault(fault: str) -> None:
    task, module = FAULTS[fault]
    bare = replace(task, subtasks=tuple(replace(part, flow=None) for part in task.subtasks))
    charged = charges(oag.compose(bare).verify(), searched=True)
    assert charged[0].modules[0] == module
    assert all(number <= 3 for charge in charged for number in charge.modules)


class Follower(Script):
    """A module 3 that follows the roles that it is given, right or wrong."""

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the scripted answer, with the conditions of the target that is to be opened."""
        reply = super().complete(request)
        if module_of(request) == 3 and "open_refrigerator | target table_0" in str(request.messages[0].parts[0]):
            return replace(reply, text=reply.text.replace("(open refrigerator_0)", "(open table_0)", 2))
        return reply


ROLES = right_answers("T1")[2]
OPENING = ROLES["sub_tasks"][0]["task_activity_name"]
TABLE = altered(ROLES, ("sub_tasks", 0, "target"), "table_0")
SLIPS = {
    "no place to put it": (altered(ROLES, ("sub_tasks", 2, "support_goal"), ""), "answer/not-put", [2]),
    "another place to put it": (altered(ROLES, ("sub_tasks", 2, "support_goal"), "table_0"), "answer/not-put", [2]),
    "a table to be opened": (altered(TABLE, ("sub_tasks", 0, "bddl_category"), ...), "has no door", [2]),
    "a thing that is not picked up": (without_subtask(right_answers("T1"), 2, 1), "answer/not-held", [2]),
    "the same thing twice": (altered(ROLES, ("sub_tasks", 3, "task_activity_name"), OPENING), "answer/same-again", [2]),
}


@pytest.mark.parametrize("slip", SLIPS)
def test_roles_that_no_condition_can_mend_go_back_to_module_2_at_once(slip: str) -> None:
    roles, until, asked = SLIPS[slip]
    script = Follower(right_answers("T1"), {2: [Wrong(roles, until)]})
    proposal = ModelProposer(script, cross_check=False).propose(QUERIES["T1"], scene_of("T1"))
    assert oag.compose(proposal.task).verify().verdict is oag.Verdict.PROVED
    assert [module_of(request) for request in script.asked] == [1, *asked, 2, 3, 4, 5]


def test_a_flow_that_does_not_get_there_is_module_5s() -> None:
    flow = flow_from_json([17, 1, 2, {"7": 0.2}])
    charged = charges(oag.compose(with_subtask(1, flow=flow)).verify(), searched=False)
    assert charged[0].modules[0] == 5
    assert any("insert GRASP in T2" in text for text in charged[0].finding.fixes)


def test_a_size_is_module_4s() -> None:
    charged = charges(oag.compose(replace(T1, scales={})).verify(), searched=False)
    assert [charge.finding.code for charge in charged] == ["task/size"]
    assert charged[0].modules[0] == 4


def test_a_goal_that_no_primitive_can_reach_is_module_1s() -> None:
    goal = formula("(and (inside glass_0 refrigerator_0) (frozen glass_0))")
    charged = charges(oag.compose(replace(T1, goal=goal)).verify(), searched=True)
    assert [charge.modules for charge in charged if "frozen" in (charge.finding.literal or "")] == [(1,)]


def test_fixes_of_the_goal_and_of_the_world_are_left_out() -> None:
    goal = formula("(and (ontop glass_0 refrigerator_0) (not (open refrigerator_0)))")
    report = oag.compose(replace(T1, goal=goal)).verify()
    assert "change-task-goal" in {fix.kind for fix in report.fixes}
    shown = [text for charge in charges(report, searched=True) for text in charge.finding.fixes]
    assert shown
    assert not any("task goal" in text for text in shown)


def test_nothing_is_held_against_a_plan_that_is_proved() -> None:
    report = oag.compose(T1).verify()
    assert report.verdict is oag.Verdict.PROVED
    assert {found.code for found in report.diagnostics} >= {"context/goal-gap"}
    assert charges(report, searched=False) == ()


def test_every_kind_of_fix_is_known() -> None:
    described = oag.Fix.__doc__ or ""
    listed = re.search(r"kind: What it does: (.*?), or several", described, re.DOTALL)
    assert listed is not None
    kinds = set(re.sub(r"\s+", " ", listed[1]).split(", "))
    assert kinds == {*model_proposer._BY_FIX, *model_proposer._NOT_OFFERED}


def test_a_subtask_that_no_condition_fits_goes_back_to_module_2() -> None:
    """Module 3 was asked until its rounds were used up, and the run ended."""
    right = right_answers("T1")
    walk = {**right[2]["sub_tasks"][0], "task_activity_name": "go_to_refrigerator", "task_detail_message": "It drives."}
    entries = [walk, *right[2]["sub_tasks"]]
    extra = {"sub_tasks": [{**entry, "sub_task": number} for number, entry in enumerate(entries, start=1)]}
    near = [{"sub_task": 1, "init": "(not (open refrigerator_0))", "goal": "(visited refrigerator_0)"}]
    conditions = {"sub_tasks": near + [{**entry, "sub_task": entry["sub_task"] + 1} for entry in right[3]["sub_tasks"]]}
    script = Script(right, {2: [Wrong(extra, "visited")], 3: [Wrong(conditions, None)]})
    asked: list[int] = []

    class Asked:
        def complete(self, request: ChatRequest) -> ChatReply:
            asked.append(module_of(request))
            if asked.count(2) == 2:
                script._given.pop(3, None)
            return script.complete(request)

    proposal = ModelProposer(Asked(), cross_check=False).propose(QUERIES["T1"], scene_of("T1"))
    assert oag.compose(proposal.task).verify() and len(proposal.task.subtasks) == 4
    assert asked == [1, 2, 3, 3, 3, 2, 3, 4, 5]
    assert proposal.conversation is not None and "UNDECIDED" in proposal.conversation.story()


def test_a_decomposition_that_is_confirmed_leaves_the_fault_with_module_3() -> None:
    right = right_answers("T1")
    script = Script(right, {3: [Wrong(altered(right[3], ("sub_tasks", 0, "goal"), "(visited table_0)"), None)]})
    with pytest.raises(llm.AnswersRefused) as caught:
        ModelProposer(script, cross_check=False).propose(QUERIES["T1"], scene_of("T1"))
    assert caught.value.module == 3 and [module_of(request) for request in script.asked].count(2) == 3


def test_a_flow_of_wrong_form_comes_back_with_one_that_works() -> None:
    flows = right_answers("T1")[5]
    wrong = altered(flows, ("sub_tasks", 3, "flow", 0), {"id": 18})
    script = Script(right_answers("T1"), {5: [Wrong(wrong, 'T4: the flow ["NAVIGATE_TO_TARGET')]})
    proposal = ModelProposer(script, cross_check=False).propose(QUERIES["T1"], scene_of("T1"))
    assert oag.compose(proposal.task).verify().verdict is oag.Verdict.PROVED
    assert [module_of(request) for request in script.asked] == [1, 2, 3, 4, 5, 5]
