"""Scenes and tasks written in Python: kinds, computed conditions, states between subtasks, and what is missing."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import bddl
import oag
from oag import testing
from oag.model.diagnostics import NoSuchSubtask
from oag.model.symbols import Kind
from oag.task_definition import default_goal
from tests.bruteforce import Kinds, Literal, Part, World, act, allowed

KITCHEN = {"drawer_0": "drawer", "apple_0": "apple", "bowl_0": "bowl", "table_0": "table"}
FACTS = ["(ontop apple_0 table_0)", "(inside bowl_0 drawer_0)"]
STORED = "(and (inside apple_0 drawer_0) (not (open drawer_0)))"
STEPS = (
    oag.open("drawer_0"),
    oag.pick("apple_0"),
    oag.place("apple_0", inside="drawer_0"),
    oag.close("drawer_0"),
)
FEW = settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))


def kitchen(**given: Any) -> oag.Scene:
    return oag.scene(**({"objects": KITCHEN, "facts": FACTS, "closed": "all"} | given))


def report_of(*steps: oag.authoring.PlanStep, goal: str | None = STORED, scene: oag.Scene | None = None) -> oag.Report:
    return oag.compose(oag.task(scene or kitchen(), goal=goal, steps=steps)).verify()


def test_a_scene_of_categories_has_kinds_and_no_sizes() -> None:
    scene = kitchen()
    kinds = {key: thing.kind for key, thing in scene.objects.items()}
    assert kinds == {
        "drawer_0": Kind.ARTICULATED, "apple_0": Kind.ITEM, "bowl_0": Kind.ITEM, "table_0": Kind.SUPPORT
    }  # fmt: skip
    assert not any(thing.has_box for thing in scene.objects.values())
    assert scene.closed == frozenset(bddl.PREDICATES)
    assert oag.Scene.from_json(scene.to_json()) == scene


def test_objects_with_boxes_can_stand_among_others() -> None:
    boxed = oag.SceneObject("piano_0", "piano", "piano", (0, 0, 0.5), (1, 0, 0, 0), (1.5, 0.6, 1.0))
    scene = kitchen(objects={**KITCHEN, "piano_0": boxed})
    assert scene["piano_0"] is boxed


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"objects": {"x_0": "gizmo"}, "facts": []}, ("objects.x_0", "gizmo", "bbox_extent")),
        ({"objects": {"a b": "apple"}, "facts": []}, ("objects.a b", "cannot be used")),
        ({"objects": {"robot": "apple"}, "facts": []}, ("reserved",)),
        ({"objects": {"a_0": 3}, "facts": []}, ("objects.a_0", "category")),
        ({"objects": ["a_0"], "facts": []}, ("objects", "mapping")),
        ({"closed": "everything"}, ("closed", '"all"')),
        ({"closed": ["ontopp"]}, ("closed[0]", "ontop")),
        ({"facts": ["(ontop apple_1 table_0)"]}, ("facts[0]", "apple_0")),
    ],
)
def test_what_cannot_be_a_scene_is_refused_by_place(given: dict[str, Any], words: tuple[str, ...]) -> None:
    with pytest.raises(oag.SceneError) as refused:
        kitchen(**given)
    assert all(word in str(refused.value) for word in words)


def test_a_list_of_steps_is_a_proved_task_with_computed_conditions() -> None:
    report = report_of(*STEPS)
    assert report, report
    assert [bddl.format(subtask.init) for subtask in report.task.subtasks] == [
        "(not (open drawer_0))", "(ontop apple_0 table_0)", "(inside apple_0 gripper)", "(open drawer_0)"
    ]  # fmt: skip
    assert [subtask.support_init for subtask in report.task.subtasks] == [None, "table_0", None, None]
    assert oag.recheck(report.certificate, task=report.task).ok
    planned = oag.plan(kitchen(), STORED).task
    assert planned is not None
    assert oag.canonical_digest(report.task) == oag.canonical_digest(planned)


def test_conditions_and_flows_can_be_given_and_simple_tasks_stand_among_steps() -> None:
    opening = report_of(*STEPS).task.subtasks[0]
    shut = oag.close("drawer_0", init="(and (open drawer_0) (inside bowl_0 drawer_0))", flow=[17, 1, 2, 3, 19, 5])
    report = report_of(opening, shut, goal=None)  # type: ignore[arg-type]
    assert report, report
    assert report.task.subtasks[0] is opening and len(report.task.subtasks[1].flow or ()) == 6
    assert len(list(bddl.conjuncts(report.task.subtasks[1].init))) == 2
    assert not report.task.goal_given and bddl.format(report.task.goal) == "(not (open drawer_0))"


def test_what_is_unknown_is_not_assumed_by_a_condition() -> None:
    scene = kitchen(facts=[], closed=())
    task = oag.task(scene, steps=STEPS)
    empty = [bddl.format(subtask.init) for subtask in task.subtasks[:2]]
    assert empty == ["(and)", "(and)"]
    # Opening a drawer that may be open does no harm; using one that may be shut does.
    assert oag.compose(task).verify()
    assert report_of(*STEPS[1:], scene=scene).verdict is oag.Verdict.CONDITIONAL


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: oag.place("apple_0"), ("neither", "inside=")),
        (lambda: oag.place("apple_0", inside="bowl_0", ontop="table_0"), ("both",)),
        (lambda: oag.open(3), ("open", "id")),
        (lambda: oag.open("drawer_0", init="(open"), ("init",)),
        (lambda: oag.task(kitchen(), steps=[oag.open("drawer_7")]), ("drawer_7", "drawer_0")),
        (lambda: oag.task(kitchen(), steps=["open drawer_0"]), ("steps[0]", "oag.pick")),
        (lambda: oag.task(kitchen(), goal="(inside"), ("goal",)),
        (lambda: oag.task("kitchen", steps=[]), ("Scene",)),
    ],
)
def test_misuse_is_one_clear_error(make: Any, words: tuple[str, ...]) -> None:
    with pytest.raises(oag.OagError) as refused:
        make()
    assert all(word in str(refused.value) for word in words), refused.value


def test_states_between_subtasks_answer_formulas() -> None:
    report = report_of(*STEPS)
    states = [report.state_after(number) for number in range(5)]
    assert all(states)
    held = [state.holds("(inside apple_0 gripper)") for state in states if state is not None]
    assert held == [False, False, True, False, False]
    some_open = "(exists (?d - drawer) (open ?d))"
    assert [state.holds(some_open) for state in states if state is not None] == [False, True, True, True, False]
    assert states[4] is not None and "(inside apple_0 drawer_0)" in states[4].facts
    for wrong in (5, -1, 1.5):
        with pytest.raises(NoSuchSubtask):
            report.state_after(wrong)  # type: ignore[arg-type]


def test_there_is_no_state_beyond_a_failure_and_what_is_missing_is_named() -> None:
    report = report_of(*STEPS[1:])
    assert report.verdict is oag.Verdict.REFUTED
    assert [report.state_after(number) is None for number in range(4)] == [False, False, True, True]
    (missing,) = report.missing
    assert missing.literal == "open(drawer_0)" and missing.place == "T2.4" and missing.known_false
    assert report_of(*STEPS).missing == ()
    unknown = report_of(*STEPS[1:], scene=kitchen(facts=[], closed=["ontop"])).missing
    assert unknown and not any(one.known_false for one in unknown)


def test_a_subtask_without_a_flow_is_what_is_missing() -> None:
    picked = replace(report_of(*STEPS).task.subtasks[2], init=bddl.And(()), flow=None)
    report = report_of(picked)  # type: ignore[arg-type]
    assert report.no_flow is not None
    assert "obligation hold up to T1, and no flow reaches its goal" in str(report)
    assert [one.literal for one in report.missing] == ["(inside apple_0 drawer_0)"]
    assert report.state_after(0) is not None and report.state_after(1) is None


def test_what_is_too_large_is_undecided_and_not_refuted() -> None:
    many = {f"apple_{number}": "apple" for number in range(30)}
    goal = "(forall (?a - apple) (forall (?b - apple) (forall (?c - apple) (not (ontop ?a ?b)))))"
    report = oag.compose(oag.task(oag.scene(many, closed="all"), goal=goal)).verify()
    assert report.verdict is oag.Verdict.CONDITIONAL and report.undecided and "undecided" in str(report)
    assert not report_of(*STEPS).undecided and not report_of(*STEPS[1:]).undecided


def test_impossible_things_are_known_to_be_false() -> None:
    scene = kitchen(facts=[], closed=())
    report = oag.compose(oag.task(scene, goal="(and (not (open table_0)) (not (inside apple_0 table_0)))")).verify()
    assert report, report


def test_a_notebook_sees_graph_and_verdict() -> None:
    strange = {"drawer_0": "drawer"}
    for steps in (STEPS, STEPS[1:]):
        report = report_of(*steps)
        for shown in (report._repr_html_(), oag.compose(report.task)._repr_html_()):
            drawn = ET.fromstring(shown[shown.index("<svg") : shown.index("</svg>") + 6])
            boxes = [box for box in drawn.iter("rect") if "node" in (box.get("class") or "")]
            assert len(boxes) == sum(len(subtask.flow or ()) for subtask in report.task.subtasks)
            assert f">{report.verdict.value}</b>" in shown
            assert any("failed" in str(box.get("class")) for box in boxes) is not bool(report)
    named = replace(oag.task(oag.scene(strange, closed="all"), steps=[oag.open("drawer_0")]), name="<script>")
    assert "<script>" not in oag.compose(named)._repr_html_()


def test_a_picture_of_a_malformed_task_has_its_findings() -> None:
    task = replace(report_of(*STEPS).task, goal="(open table_0)")  # type: ignore[arg-type]
    assert "bddl/kind" in oag.compose(task)._repr_html_()


def literals(formula: bddl.Formula) -> tuple[Literal, ...]:
    return tuple(((found.atom.predicate, *found.atom.args), found.value) for found in bddl.literals(formula) or ())


def direct(facts: Any) -> frozenset[tuple[str, ...]]:
    """Facts as the oracle has them; what the hand holds is no fact there."""
    return frozenset(
        (atom.predicate, *atom.args) for atom in map(bddl.parse_formula, facts)
        if isinstance(atom, bddl.Atom) and atom.args[-1] != "gripper"
    )  # fmt: skip


@given(st.data())
@FEW
def test_states_are_those_of_a_simulation_of_complete_states(data: st.DataObject) -> None:
    """Each primitive is simulated by an oracle that shares no code with the package."""
    # Nothing stands in or on what is carried: what becomes of cargo is for other tests.
    scene = data.draw(testing.scenes(items=("apple", "book")))
    task = data.draw(testing.tasks(scene))
    report = oag.compose(task).verify()
    assert report, report
    kinds = Kinds(
        frozenset(key for key, thing in scene.objects.items() if thing.kind is Kind.ITEM),
        frozenset(key for key, thing in scene.objects.items() if thing.kind is Kind.ARTICULATED),
    )
    start = frozenset(fact for formula in scene.facts for fact, value in literals(formula) if value)
    world = World(start, base=task.subtasks[0].target if task.subtasks else None)
    for number, subtask in enumerate(task.subtasks):
        state = report.state_after(number)
        assert state is not None and direct(state.facts) == world.true
        flow = tuple((int(action.primitive), action.parameter) for action in subtask.flow or ())
        part = Part(subtask.target, subtask.support_goal, literals(subtask.init), literals(subtask.goal), flow)
        assert all(map(world.holds, part.init))
        for action in part.flow:
            assert allowed(world, part, action, kinds)
            world = act(world, part, action, kinds)
        assert all(map(world.holds, part.goal))
    assert bddl.conjuncts(task.goal) == bddl.conjuncts(default_goal(task.subtasks))


def test_what_is_carried_twice_is_taken_from_where_it_was_put() -> None:
    scene = oag.scene(
        {"desk_0": "desk", "table_0": "table", "apple_0": "apple"}, ["(ontop apple_0 desk_0)"], closed="all"
    )
    there, back = oag.place("apple_0", ontop="table_0"), oag.place("apple_0", ontop="desk_0")
    task = oag.task(scene, steps=[oag.pick("apple_0"), there, oag.pick("apple_0"), back])
    assert bddl.format(task.subtasks[2].init) == "(ontop apple_0 table_0)"
    assert oag.compose(task).verify().verdict is oag.Verdict.PROVED
