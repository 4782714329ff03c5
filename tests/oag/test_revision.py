"""Which revised flows may be run, and the records that the decision rests on."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import oag
from oag.measurements import (
    AtomMeasured,
    GripMeasured,
    JointMotion,
    MeasuredEvidence,
    MoveMeasured,
    OutOfReach,
    StageCount,
    SupportDrive,
    UnmeantContact,
    Unmet,
    Unplanned,
)
from oag.model.actions import ActionFlow, flow_from_json
from oag.model.diagnostics import HistoryFull, NoSuchSubtask, RecordError
from oag.revision import (
    Attempt,
    Critique,
    Hindsight,
    History,
    Revision,
    Tolerance,
    admissible,
    change_between,
    same_flow,
)
from tests.json_edits import altered
from tests.oag.paper import EVOLVED, assert_golden, scene, task_json

FAILED = [18, {"13": 0.4}, {"9": 0.1}, 5]
BETTER = [18, {"13": 0.3}, {"9": 0.45}, 5]


def task(name: str = "T1") -> oag.Task:
    """A task of the paper in its scene."""
    return oag.Task.from_json(task_json(name), scene=scene(name))


def history(flow: list[Any] = FAILED, revised: list[Any] = BETTER, times: int = 1) -> History:
    """A history in which one flow failed so many times."""
    critique = Critique(
        step=1,
        primitive=oag.Primitive.MOVE_BASE_FORWARD,
        motion_verified=False,
        state_reached=False,
        state_contrast="the door was open before and is ajar after",
        anomaly="the arm met the door",
        text="The base stopped 0.2 m short, since the arm met the door.",
        evidence=MeasuredEvidence(
            (OutOfReach(0.2, 0.2, 0.4, ("panda_joint4",)), UnmeantContact("panda_link5", "door", "door", 9.0))
        ),
    )
    attempt = Attempt(
        flow=flow_from_json(flow),
        outcome="failed",
        failed_step=1,
        failure="unexpected-contact",
        message="the arm met the door",
        critiques=(critique,),
        seed=7,
    )
    new = flow_from_json(revised)
    change = change_between(attempt.flow, new)
    revision = Revision(new, change, "Stay clear of the door.", cause="door in the way", cause_step=1)
    found = History(2)
    for _ in range(times):
        found = found.add(attempt, revision)
    return found


@pytest.mark.parametrize(("name", "index", "flow"), EVOLVED)
def test_the_papers_evolved_flows_are_admissible(name: str, index: int, flow: list[Any]) -> None:
    admission = admissible(task(name), index, flow)
    assert admission, str(admission)
    assert admission.report is not None and admission.report.certificate is not None


def test_a_flow_that_failed_is_not_run_again() -> None:
    admission = admissible(task(), 2, FAILED, history=history())
    assert not admission and admission.repeats == 1
    assert [finding.code for finding in admission.diagnostics] == ["revision/repeated"]
    assert_golden("revision_repeated", str(admission))


@pytest.mark.parametrize(
    ("flow", "repeats"),
    [
        ([18, {"13": 0.405}, {"9": 0.1}, 5], True),
        ([18, {"13": 0.2}, {"13": 0.2}, {"9": 0.1}, 5], True),
        ([18, {"13": 0.4}, {"8": 0.0}, {"9": 0.1}, 5], True),
        ([18, {"13": 0.4}, {"14": 0}, {"9": 0.1}, 5], True),
        ([18, 18, {"13": 0.4}, {"9": 0.1}, 5], True),
        ([18, {"13": 0.5}, {"14": 0.1}, {"9": 0.1}, 5], True),
        ([18, {"14": 0.1}, {"13": 0.5}, {"9": 0.1}, 5], True),
        ([18, {"13": 0.2}, {"20": 0.5}, {"21": 0.5}, {"13": 0.2}, {"9": 0.1}, 5], True),
        ([18, {"20": 180}, {"20": 180}, {"13": 0.4}, {"9": 0.1}, 5], True),
        ([18, {"20": 180}, {"20": 170}, {"13": 0.4}, {"9": 0.1}, 5], False),
        ([18, 6, {"13": 0.4}, {"9": 0.1}, 5], True),
        ([18, {"13": 0.4}, 6, {"9": 0.1}, 5], False),
        ([18, {"20": 30}, {"13": 0.4}, {"21": 30}, {"9": 0.1}, 5], False),
        ([18, {"13": 0.43}, {"9": 0.1}, 5], False),
        ([18, {"13": None}, {"9": 0.1}, 5], False),
        ([18, {"9": 0.1}, {"13": 0.4}, 5], False),
    ],
)
def test_what_counts_as_the_same_flow(flow: list[Any], repeats: bool) -> None:
    assert (admissible(task(), 2, flow, history=history()).repeats == 1) is repeats


def test_open_numbers_are_the_same_as_open_numbers_only() -> None:
    flow = [18, {"13": None}, 5]
    assert admissible(task(), 2, flow, history=history(flow)).repeats == 1


def test_a_wider_tolerance_repeats_more() -> None:
    flow = [18, {"13": 0.45}, {"9": 0.1}, 5]
    assert admissible(task(), 2, flow, history=history())
    assert not admissible(task(), 2, flow, history=history(), tolerance=Tolerance(distance_m=0.1))


@pytest.mark.parametrize("wrong", [-1.0, float("nan"), float("inf")])
def test_a_tolerance_with_which_nothing_repeats_is_refused(wrong: float) -> None:
    with pytest.raises(ValueError, match="a tolerance of 0 or more for angle_deg"):
        Tolerance(angle_deg=wrong)


@pytest.mark.parametrize(
    ("flow", "code"),
    [
        ([18, 99, 5], "flow/unknown-primitive"),
        ([18, {"13": 7.0}, 5], "flow/parameter"),
        ([18, {"13": -0.4}, 5], "flow/parameter"),
        ([18, {"13": "far"}, 5], "flow/parameter"),
        ("18, 5", "flow/parameter"),
        ([{"13": 0.4}, 5], "flow/precondition"),
        ([18, {"13": 0.4}], "flow/goal-not-reached"),
        ([18, 4, 5], "flow/kind"),
        ([18, *([{"9": 0.01}] * 60), 5], "revision/too-long"),
        ([], "flow/goal-not-reached"),
    ],
)
def test_what_is_refused_and_why(flow: Any, code: str) -> None:
    admission = admissible(task(), 2, flow)
    assert not admission
    assert code in {finding.code for finding in admission.diagnostics}, str(admission)


def test_a_flow_that_spoils_a_later_subtask_is_refused() -> None:
    admission = admissible(task(), 0, [17, 1, 2, 3, 4])
    assert not admission and admission.diagnostics[0].subtask == 1


def test_the_limit_on_revisions() -> None:
    full = history(times=5)
    assert full.exhausted and not full.solved and len(full.failures) == 5
    admission = admissible(task(), 2, BETTER, history=full)
    assert [finding.code for finding in admission.diagnostics] == ["revision/exhausted"]
    attempt, revision = full.iterations[0]
    with pytest.raises(HistoryFull, match="revised 5 times"):
        full.add(attempt, revision)
    ended = full.add(attempt)
    with pytest.raises(HistoryFull, match="ended with attempt 6"):
        ended.add(attempt)


def test_a_subtask_that_is_not_there() -> None:
    with pytest.raises(NoSuchSubtask, match="one of its 4 subtasks, from 0, got 4"):
        admissible(task(), 4, BETTER)


def test_the_history_of_another_subtask_is_misuse() -> None:
    with pytest.raises(RecordError, match="history of T3, and the revised flow is for T1"):
        admissible(task(), 0, [17, 1, 2, 3, 4, 5], history=history())


def test_a_mistake_elsewhere_is_said_to_be_elsewhere() -> None:
    """The flow is good, and the plan cannot be run all the same."""
    data = task_json("T1")
    data["sub_tasks"][3]["flow"].pop(2)
    broken = oag.Task.from_json(data, scene=scene("T1"))
    admission = admissible(broken, 2, BETTER)
    (finding,) = admission.diagnostics
    assert finding.subtask == 3 and finding.hint is not None and "with the flow as it was, too" in finding.hint
    own = admissible(broken, 2, [18, {"13": 0.4}]).diagnostics
    assert own[0].subtask == 2 and own[0].hint is None


def test_a_revision_may_not_assume_more_than_the_plan_did() -> None:
    """Whether the door is open is not known: to rely on it is another plan than to open it."""
    facts = ["(ontop glass_0 table_0)"]
    kitchen = oag.Scene.from_json({**scene("T1").to_json(), "closed": ["inside", "ontop"], "facts": facts})
    data = task_json("T1")
    data["sub_tasks"][0]["init"] = "(and)"
    data["sub_tasks"][0]["goal"] = "(and)"
    unknown = oag.Task.from_json(data, scene=kitchen)
    assert oag.compose(unknown).verify().verdict is oag.Verdict.PROVED
    (finding,) = admissible(unknown, 0, [17]).diagnostics
    assert finding.code == "revision/assumes" and "open(refrigerator_0)" in finding.message
    # What the plan rested on before, it may go on resting on.
    data["sub_tasks"][0]["flow"] = [17]
    admission = admissible(oag.Task.from_json(data, scene=kitchen), 2, BETTER)
    assert admission and admission.report is not None
    assert admission.report.verdict is oag.Verdict.CONDITIONAL


def test_a_success_can_be_blamed_for_a_later_failure() -> None:
    solved = history().add(Attempt(flow_from_json(BETTER), "succeeded", start="from here"))
    later = Hindsight(3, "slipped", "the glass slipped")
    attempt, before = solved.reopened(later)
    assert not attempt.succeeded and attempt.failure == "blamed-later" and attempt.hindsight == later
    assert "T4 failed because of it: the glass slipped" in attempt.message
    assert before == history()
    again = before.add(attempt, Revision(flow_from_json(FAILED), "parameters", "Otherwise."))
    assert History.from_json(json.loads(json.dumps(again.to_json()))) == again
    assert not admissible(task(), 2, BETTER, history=again), "what was blamed is not tried again"


@pytest.mark.parametrize("later", [0, 2])
def test_only_an_earlier_success_can_be_blamed(later: int) -> None:
    with pytest.raises(RecordError, match="cannot be blamed"):
        history().add(Attempt(flow_from_json(BETTER), "succeeded")).reopened(Hindsight(later, "slipped"))
    with pytest.raises(RecordError, match="cannot be blamed"):
        history().reopened(Hindsight(3, "slipped"))


def test_a_cause_in_an_earlier_subtask_costs_this_one_no_revision() -> None:
    attempt = Attempt(flow_from_json(FAILED), "failed", failure="slipped")
    elsewhere = Revision(flow_from_json([17, 1, 2, 3, {"7": 0.1}]), "parameters", "Hold it better.", subtask=1)
    found = history().add(attempt, elsewhere)
    assert found.revisions == history().revisions
    assert len(found.iterations) == 2


def test_what_failed_from_another_start_may_be_tried_again() -> None:
    here, there = (Attempt(flow_from_json(FAILED), "failed", start=start) for start in ("here", "there"))
    elsewhere = Revision(flow_from_json([17, 1, 2, 3, {"7": 0.1}]), "parameters", "Hold it better.", subtask=1)
    moved = History(2).add(here, elsewhere).add(replace(there, flow=flow_from_json(BETTER)))
    assert admissible(task(), 2, FAILED, history=moved)
    assert not admissible(task(), 2, FAILED, history=History(2).add(here))


def test_a_record_of_the_first_version_is_read() -> None:
    told = json.loads(json.dumps(history().to_json())) | {"schema": "scene2demo-history/1"}
    for iteration in told["iterations"]:
        del iteration["attempt"]["start"], iteration["attempt"]["hindsight"], iteration["revision"]["subtask"]
    assert History.from_json(told) == history()


def test_a_history_only_grows() -> None:
    one = history()
    two = one.add(Attempt(flow_from_json(BETTER), "succeeded"))
    assert len(one.iterations) == 1 and two.iterations[:1] == one.iterations
    assert two.solved and not two.exhausted and two.revisions == one.revisions


def test_critiques_find_fault() -> None:
    assert history().iterations[0].attempt.critiques[0].finds_fault
    assert not Critique(0, oag.Primitive.GRASP, motion_verified=True).finds_fault


def test_kinds_of_change() -> None:
    old, new = flow_from_json(FAILED), flow_from_json(BETTER)
    assert change_between(old, new) == "parameters"
    assert change_between(old, new[1:]) == "sequence"


numbers = st.one_of(st.none(), st.floats(0.0, 3.0))
actions = st.one_of(
    st.sampled_from([1, 2, 3, 5, 6, 17, 18]).map(lambda i: oag.Action(oag.Primitive(i))),
    st.builds(lambda i, n: oag.Action(oag.Primitive(i), n), st.integers(7, 16), numbers),
)
flows = st.lists(actions, max_size=6).map(tuple)
texts = st.text(max_size=20)
flags = st.sampled_from([None, True, False])
finite = st.floats(allow_nan=False, allow_infinity=False)
joints = st.builds(JointMotion, texts, texts, finite, finite, finite, finite)
# One of each set stands for a step: what is merged in a file is told apart by its keys.
measurements = st.one_of(
    st.just(()),
    st.tuples(st.builds(replace, joints, stages=st.one_of(st.none(), st.tuples(joints, joints)))),
    st.tuples(joints, st.builds(UnmeantContact, texts, texts, texts, finite), st.builds(StageCount, st.integers(1, 6))),
    st.tuples(st.builds(MoveMeasured, asked_m=finite, eef_moved_m=finite)),
    st.tuples(st.builds(SupportDrive, texts, finite, texts, finite, texts)),
    st.tuples(st.builds(GripMeasured, st.none(), st.integers(0, 2), finite, finite, finite)),
    st.tuples(st.builds(Unplanned, texts, in_the_way=st.dictionaries(texts, st.integers(1, 9)))),
)
unmet = st.lists(
    st.builds(
        Unmet, texts, st.builds(AtomMeasured, region=texts, centre_depth_m=finite, supported_by=st.tuples(texts))
    ),
    max_size=1,
).map(tuple)
critiques = st.builds(
    Critique,
    st.integers(0, 9),
    st.sampled_from(list(oag.Primitive)),
    flags,
    flags,
    texts,
    st.one_of(st.none(), texts),
    texts,
    st.builds(MeasuredEvidence, st.one_of(st.none(), measurements), texts, unmet=unmet, model_did_not_judge=texts),
    st.sampled_from(["measurements", "model", "both"]),
)
attempts = st.builds(
    Attempt,
    flows,
    st.sampled_from(["succeeded", "failed"]),
    st.one_of(st.none(), st.integers(0, 9)),
    texts,
    texts,
    st.lists(critiques, max_size=3).map(tuple),
    st.one_of(st.none(), flows),
    st.one_of(st.none(), st.integers(0, 10**6)),
    texts,
)
revisions = st.builds(
    Revision,
    flows,
    st.sampled_from(["sequence", "parameters"]),
    texts,
    texts,
    st.one_of(st.none(), st.integers(0, 9)),
    st.sampled_from(["measurements", "model", "both"]),
)


@given(st.lists(st.tuples(attempts, revisions), max_size=4), st.one_of(st.none(), attempts), st.integers(0, 9))
def test_records_survive_json(pairs: list[tuple[Any, Any]], last: Attempt | None, subtask: int) -> None:
    found = History(subtask)
    for attempt, revision in pairs:
        found = found.add(attempt, revision)
    if last is not None:
        found = found.add(last)
    assert History.from_json(json.loads(json.dumps(found.to_json()))) == found


@given(flows, flows)
def test_same_flow_is_symmetric_and_reflexive(one: ActionFlow, other: ActionFlow) -> None:
    assert same_flow(one, one)
    assert same_flow(one, other) is same_flow(other, one)


@given(flows, flows, st.integers(7, 16), st.integers(1, 20))
def test_a_motion_there_and_back_changes_no_flow(before: Any, after: Any, primitive: int, steps: int) -> None:
    """Coarse numbers, so that rounding never decides whether a sum is within the tolerance."""
    there, back = (oag.Action(oag.Primitive(number), 0.05 * steps) for number in (primitive, _opposite(primitive)))
    before, after = _coarse(before), _coarse(after)
    assert same_flow((*before, there, back, *after), (*before, *after))
    navigation = oag.Action(oag.Primitive.NAVIGATE_TO_TARGET)
    assert same_flow((*before, navigation, navigation, *after), (*before, navigation, *after))
    if before == after == ():
        assert not same_flow((there,), (back,))


def _opposite(primitive: int) -> int:
    """The IDs 7 to 16 are pairs, an odd one and the even one after it."""
    return primitive + 1 if primitive % 2 else primitive - 1


def _coarse(flow: ActionFlow) -> ActionFlow:
    return tuple(
        oag.Action(a.primitive, 0.05 * round(20 * a.parameter) if isinstance(a.parameter, float) else a.parameter)
        for a in flow
    )


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("schema",), "scene2demo-history/9", "expected 'scene2demo-history/1' or 'scene2demo-history/2', got"),
        (("iterations", 0, "attempt", "outcome"), "lost", "expected 'succeeded' or 'failed', got \"lost\""),
        (("iterations", 0, "attempt", "flow"), [99], "unknown primitive 99"),
        (("iterations", 0, "attempt", "critiques", 0, "primitive"), "FLY", "there is no primitive 'FLY'"),
        (("iterations", 0, "attempt", "critiques", 0, "motion_verified"), "yes", "expected true, false or null"),
        (("iterations", 0, "attempt", "failed_step"), -1, "expected a whole number from 0 up"),
        (("iterations", 0, "revision", "change"), ..., "the field 'change' is missing"),
        (("iterations", 0, "revision", "origin"), "magic", "expected 'measurements', 'model' or 'both'"),
    ],
)
def test_malformed_records_say_where(path: tuple[Any, ...], value: Any, message: str) -> None:
    data = json.loads(json.dumps(history().to_json()))
    with pytest.raises(RecordError) as caught:
        History.from_json(altered(data, path, value))
    assert message in str(caught.value)
    assert str(caught.value).startswith("record (mapping)")
