"""Own domains: declared as data, proved, searched, mended and rechecked like the built-in one; PDDL out and in."""

from __future__ import annotations

import json
import pickle
import re
from dataclasses import replace
from datetime import date
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import bddl
import oag
from executor.skills.library import MissingSkill, require_skills
from oag import pddl
from oag.model.actions import flow_to_json
from oag.model.diagnostics import RecordError
from oag.model.domain import DomainError
from oag.model.infeasible import Infeasible
from oag.model.symbols import Kind
from oag.planning_estimate import Estimate
from oag.revision import Attempt, Critique, History, Revision, admissible
from tests.oag.paper import DATA, scene, task_json
from tests.source_tree import ROOT

NEXT_TO = oag.Domain.from_toml(ROOT / "examples" / "domains" / "next_to.toml")
GOAL = "(and (nextto apple_0 cup_0) (not (open drawer_0)))"
STEPS: list[Any] = [oag.open("drawer_0"), oag.pick("apple_0"), "PLACE_NEXT_TO apple_0 table_0 cup_0"]
# By planners of unified-planning 1.3, from the exported texts.
PLANS: dict[str, dict[str, list[str]]] = json.loads((DATA / "pddl_plans.json").read_text(encoding="utf-8"))


def kitchen(domain: oag.Domain = NEXT_TO) -> oag.Scene:
    """An apple in a drawer and a cup on a table."""
    things = {"apple_0": "apple", "cup_0": "cup", "table_0": "table", "drawer_0": "drawer"}
    return oag.scene(things, ["(ontop cup_0 table_0)", "(inside apple_0 drawer_0)"], "all", domain=domain)


def confirmed(report: oag.Report | None) -> bool:
    """The recheck of a report, against its own task and scene."""
    assert report is not None
    return bool(oag.recheck(report.certificate, task=report.task, scene=report.scene))


def test_a_declared_primitive_is_proved_planned_mended_and_searched() -> None:
    here = kitchen()
    task = oag.task(here, goal="(nextto apple_0 cup_0)", steps=[*STEPS, "PUSH cup_0 apple_0 table_0"])
    report = oag.compose(task).verify()
    assert report and confirmed(report)
    assert oag.Task.from_json(task.to_json(), scene=here).subtasks == task.subtasks
    assert oag.canonical_digest(task) == oag.canonical_digest(oag.canonical(task))
    planned = oag.plan(here, GOAL)
    assert planned.task is not None and len(planned.task.subtasks) == 4 and confirmed(planned.report)
    wrong = oag.compose(oag.task(here, goal="(nextto apple_0 cup_0)", steps=STEPS[1:])).verify()
    assert not wrong and confirmed(wrong) and wrong.sure_fix is not None
    mended = oag.compose(wrong.sure_fix.apply(wrong.task)).verify()
    assert mended and confirmed(mended)
    searched = replace(task, subtasks=tuple(replace(subtask, flow=None) for subtask in task.subtasks))
    assert confirmed(oag.compose(searched).verify())
    left = oag.repair(task, ["(ontop cup_0 table_0)", "(inside apple_0 gripper)", "(open drawer_0)"])
    assert left.edits == 0 and left.task is not None and len(left.task.subtasks) == 2


@pytest.mark.parametrize("goal", ["(nextto apple_0 cup_0)", "(not (nextto apple_0 box_0))", "(nextto bowl_0 cup_0)"])
def test_what_rides_on_a_pushed_thing_has_no_known_neighbours(goal: str) -> None:
    things = {"apple_0": "apple", "bowl_0": "bowl", "box_0": "box", "cup_0": "cup", "table_0": "table"}
    standing = [f"(ontop {name} table_0)" for name in ("bowl_0", "box_0", "cup_0")]
    pairs = [("apple_0", "cup_0"), ("bowl_0", "cup_0")]
    near = [f"(nextto {one} {other})" for pair in pairs for one, other in (pair, pair[::-1])]
    here = oag.scene(things, [*standing, "(inside apple_0 bowl_0)", *near], "all", domain=NEXT_TO)
    pushed = oag.task(here, goal=goal, steps=["PUSH bowl_0 box_0 table_0"])
    report = oag.compose(pushed).verify()
    assert report.verdict is oag.Verdict.CONDITIONAL and confirmed(report)
    settled = replace(pushed, goal=bddl.parse_formula("(and (nextto box_0 bowl_0) (inside apple_0 bowl_0))"))
    assert oag.compose(settled).verify()


def test_a_thing_put_down_next_to_another_is_next_to_it_both_ways() -> None:
    here = kitchen()
    assert oag.compose(oag.task(here, goal="(nextto cup_0 apple_0)", steps=STEPS)).verify()


def test_a_flow_that_no_row_allows_is_refuted_with_a_proof() -> None:
    here = replace(kitchen(), facts=(bddl.parse_formula("(inside apple_0 drawer_0)"),))
    goal = bddl.parse_formula("(nextto apple_0 cup_0)")
    subtask = oag.SimpleTask("", "", "apple_0", None, "table_0", here.facts[0], goal)
    report = oag.compose(oag.Task("", "", goal, True, (subtask,), scene=here)).verify()
    assert report.verdict is oag.Verdict.REFUTED and report.no_flow is not None and confirmed(report)


def test_a_certificate_is_of_its_domain_alone() -> None:
    here = kitchen()
    report = oag.compose(oag.task(here, goal="(nextto apple_0 cup_0)", steps=STEPS)).verify()
    assert report.certificate is not None
    data = json.loads(json.dumps(report.certificate.to_json()))
    assert oag.recheck(data, scene=here)
    row = data["domain"]["primitives"]["PLACE_NEXT_TO"]
    row["needs"] = row["needs"][:1]
    assert not oag.recheck(data)
    loose = oag.Domain.from_json(data["domain"])
    forged = oag.compose(oag.task(kitchen(loose), goal="(nextto apple_0 cup_0)", steps=STEPS)).verify()
    assert oag.recheck(forged.certificate) and not oag.recheck(forged.certificate, scene=here)
    mine, theirs = (f"next_to ({domain.digest[:8]})" for domain in (NEXT_TO, loose))
    result = oag.recheck(forged.certificate, domain=NEXT_TO)
    assert result.reason == f"it is about another domain than {mine}: {theirs}"
    row["objects"].reverse()
    assert oag.Domain.from_json(data["domain"]).digest != loose.digest


def test_a_scene_s_json_has_its_domain_and_no_other_is_accepted() -> None:
    here = kitchen()
    data = json.loads(json.dumps(here.to_json()))
    assert oag.Scene.from_json(data) == oag.Scene.from_json(data, NEXT_TO) == here
    other = replace(NEXT_TO, name="other")
    with pytest.raises(oag.SceneError, match="next_to, and another one was given: other"):
        oag.Scene.from_json(data, other)
    namesake = replace(NEXT_TO, kinds={"lamp": Kind.ITEM})
    with pytest.raises(oag.SceneError) as caught:
        oag.Scene.from_json(data, namesake)
    assert all(f"next_to ({domain.digest[:8]})" in str(caught.value) for domain in (NEXT_TO, namesake))
    data["domain"]["primitives"]["PUSH"]["needs"] = ["(flies ?thing)"]
    with pytest.raises(DomainError, match="flies"):
        oag.Scene.from_json(data)
    assert "domain" not in scene("T1").to_json()


def test_a_history_and_a_revision_are_read_in_their_domain() -> None:
    task = oag.task(kitchen(), goal="(nextto apple_0 cup_0)", steps=STEPS)
    flow = task.subtasks[-1].flow
    assert flow is not None
    critique = Critique(2, flow[2].primitive, motion_verified=False)
    tried = History(2).add(Attempt(flow, "failed", 2, critiques=(critique,)), Revision(flow[2:], "sequence", "shorter"))
    assert History.from_json(json.loads(json.dumps(tried.to_json())), NEXT_TO) == tried
    with pytest.raises(RecordError, match="PLACE_NEXT_TO"):
        History.from_json(tried.to_json())
    written = flow_to_json(flow)
    assert admissible(task, 2, written).flow == flow


def test_a_domain_and_its_primitives_travel_between_processes() -> None:
    task = oag.task(kitchen(), steps=STEPS)
    assert pickle.loads(pickle.dumps(task)) == task
    assert oag.Domain.from_json(NEXT_TO.to_json()) == NEXT_TO


_ROW = {"objects": {"?a": "item"}, "needs": ["(open ?a)"], "writes": ["(lit ?a)"]}
_PAIR = {"objects": {"?a": "item", "?b": "item"}, "unknown": ["(nextto ?any ?b)"]}
_WRITES, _UNKNOWN = "primitives.LIGHT.writes", "primitives.LIGHT.unknown"


@pytest.mark.parametrize(
    ("change", "place", "words"),
    [
        ({"name": 3}, "name", "expected a name"),
        ({"colour": 1}, "colour", "no such field"),
        ({"predicates": {"open": ["thing"]}}, "predicates.open", "inherited"),
        ({"predicates": {"near": []}}, "predicates.near", "inherited"),
        ({"kinds": {"puck": "thing"}}, "kinds.puck", "one of item, support, fixture"),
        ({"primitives": {"push": _ROW}}, "primitives.push", "in capitals"),
        ({"primitives": {"GRASP": _ROW}}, "primitives.GRASP", "none of the 21"),
        ({"primitives": {"LIGHT": {**_ROW, "objects": {}}}}, "primitives.LIGHT.objects", "the target"),
        ({"primitives": {"LIGHT": {**_ROW, "needs": ["(open ?b)"]}}}, "primitives.LIGHT.needs", "?b is none"),
        ({"primitives": {"LIGHT": {**_ROW, "needs": ["(lighted ?a)"]}}}, "primitives.LIGHT.needs", "lighted"),
        ({"primitives": {"LIGHT": {**_ROW, "writes": ["(lit ?any)"]}}}, "primitives.LIGHT.writes", "every object"),
        ({"primitives": {"LIGHT": {**_ROW, "writes": ["(not (handempty))"]}}}, "primitives.LIGHT.writes", "robot"),
        ({"primitives": {"LIGHT": {**_ROW, "number": [1, 0, "m"]}}}, "primitives.LIGHT.number", "least, most"),
        ({"primitives": {"LIGHT": {**_ROW, "number": [0, 10**400, "m"]}}}, "primitives.LIGHT.number", "least, most"),
        ({"primitives": {"LIGHT": {**_ROW, "needs": 5}}}, "primitives.LIGHT.needs", "a list of texts"),
        ({"primitives": {"LIGHT": {**_ROW, "writes": True}}}, "primitives.LIGHT.writes", "a list of texts"),
        ({"primitives": {"LIGHT": {**_ROW, "flow": [99]}}}, "primitives.LIGHT.flow[0]", "a step"),
        ({"primitives": {"LIGHT": {**_ROW, "flow": [date(2020, 1, 1)]}}}, "primitives.LIGHT.flow[0]", "a step"),
        ({"primitives": {"LIGHT": {**_ROW, "objects": {"?a": "itme"}}}}, "primitives.LIGHT.objects[0]", "item"),
        ({"primitives": {"LIGHT": {**_ROW, "needs": ["(ontop ?a gripper)"]}}}, "primitives.LIGHT.needs", "inside"),
        ({"primitives": {"LIGHT": {**_ROW, "writes": ["(lit ?a)", "(not (lit ?a))"]}}}, _WRITES, "two values"),
        ({"primitives": {"LIGHT": {**_ROW, "unknown": ["(lit ?a)"]}}}, _WRITES, "two values"),
        ({"primitives": {"LIGHT": {**_PAIR, "writes": ["(not (nextto ?a ?any))"]}}}, _UNKNOWN, "in common"),
        ({"primitives": {"LIGHT": {**_ROW, "writes": ["(not (tied ?a ?any ?a))"]}}}, _WRITES, "some places"),
        ({"primitives": {"LIGHT": {**_PAIR, "writes": ["(ontop ?a ?b)", "(ontop ?b ?a)"]}}}, _WRITES, "one thing"),
        ({"primitives": {"LIGHT": {**_ROW, "writes": ["(inside ?a gripper)", "(handempty)"]}}}, _WRITES, "the hand"),
        ({"predicates": {"forall": ["a"]}}, "predicates.forall", "word of formulas"),
        ({"kinds": {"cup": ["item"]}}, "kinds.cup", "one of item, support, fixture"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_malformed_domain_is_refused_by_its_place(change: dict[str, Any], place: str, words: str) -> None:
    predicates = {"lit": ["lamp"], "tied": ["a", "b", "c"]}
    data = {"name": "lamps", "predicates": predicates, "primitives": {"LIGHT": _ROW}}
    assert oag.Domain.from_json(data).rows
    change = {**change, "predicates": {**predicates, **change.get("predicates", {})}}
    with pytest.raises(DomainError) as caught:
        oag.Domain.from_json({**data, **change})
    assert isinstance(caught.value, oag.OagError)
    assert caught.value.place == place and words in str(caught.value)


_MOVES = {
    "PUSH_IN": {"objects": {"?a": "item", "?b": "fixture"}, "writes": ["(inside ?a ?b)", "(not (ontop ?a ?any))"]},
    "PULL_OUT": {"objects": {"?a": "item", "?b": "support"}, "writes": ["(ontop ?a ?b)", "(not (inside ?a ?any))"]},
    "SNATCH": {"objects": {"?a": "item"}, "writes": ["(inside ?a gripper)", "(not (inside ?a ?any))"]},
    "FORCE": {"objects": {"?f": "fixture"}, "writes": ["(open ?f)"]},
}


@pytest.mark.parametrize("is_open", [True, False])
@pytest.mark.parametrize(
    ("place", "step", "goal"),
    [
        ("(ontop cup_0 table_0)", "PUSH_IN cup_0 drawer_0", "(inside cup_0 drawer_0)"),
        ("(inside cup_0 drawer_0)", "PULL_OUT cup_0 table_0", "(ontop cup_0 table_0)"),
        ("(inside cup_0 drawer_0)", "SNATCH cup_0", "(inside cup_0 gripper)"),
    ],
)
def test_no_row_moves_a_thing_through_what_is_shut(is_open: bool, place: str, step: str, goal: str) -> None:
    domain = oag.Domain.from_json({"name": "moves", "primitives": _MOVES})
    door = "(open drawer_0)" if is_open else "(not (open drawer_0))"
    things = {"cup_0": "cup", "drawer_0": "drawer", "table_0": "table"}
    here = oag.scene(things, [place, door], "all", domain=domain)
    report = oag.compose(oag.task(here, steps=[step], goal=goal)).verify()
    assert bool(report) is is_open and confirmed(report)


@pytest.mark.parametrize(
    ("kind", "place", "step", "goal"),
    [
        ("ontop", "table_0", "PULL_OUT cup_0 table_0", "(ontop cup_0 table_0)"),
        ("take", None, "SNATCH cup_0", "(inside cup_0 gripper)"),
        ("open", None, "FORCE cup_0", "(open drawer_0)"),
    ],
)
@pytest.mark.parametrize("given", [(), ("(nextto cup_0 drawer_0)",)])
def test_no_row_does_what_is_found_impossible(kind: Any, place: str | None, step: str, goal: str, given: Any) -> None:
    domain = oag.Domain.from_json({"name": "moves", "primitives": _MOVES})
    things, facts = {"cup_0": "cup", "drawer_0": "drawer", "table_0": "table"}, ["(nextto cup_0 drawer_0)"]
    thing = "drawer_0" if kind == "open" else "cup_0"
    found = Infeasible(kind, thing, place, tuple(map(bddl.parse_formula, given)))
    here = oag.scene(things, facts, "all", domain=domain)
    task = oag.task(here, steps=[step.replace("FORCE cup_0", "FORCE drawer_0")], goal=goal)
    assert oag.compose(task).verify()
    assert not oag.compose(replace(task, scene=here.knowing([found]))).verify()


def test_a_step_that_does_not_fit_its_row_is_found() -> None:
    here = kitchen()
    subtask: dict[str, Any] = {"target": "table_0", "support_goal": "cup_0", "init": "(and)", "goal": "(and)"}
    report = oag.compose(
        oag.Task.from_json({"sub_tasks": [{**subtask, "flow": ["PUSH table_0"]}]}, scene=here)
    ).verify()
    assert [error.code for error in report.errors] == ["flow/kind"]
    number = oag.task(here, steps=["PUSH cup_0 apple_0 table_0"]).subtasks[0].to_json()
    number["flow"] = [{"PUSH table_0": 0.9}]
    report = oag.compose(oag.Task.from_json({"sub_tasks": [number]}, scene=here)).verify()
    assert "0.01 to 0.5 m" in report.errors[0].message


@pytest.mark.parametrize(("name", "engine"), [(name, engine) for name in PLANS for engine in PLANS[name]])
def test_a_planner_s_plan_for_an_exported_task_is_proved(name: str, engine: str) -> None:
    here = kitchen() if name == "next_to" else scene(name)
    goal = GOAL if name == "next_to" else oag.Task.from_json(task_json(name), scene=here).goal
    report = oag.compose(pddl.export(here, goal).task(PLANS[name][engine])).verify()
    assert report and confirmed(report)


@pytest.mark.parametrize(
    ("change", "refused"),
    [
        ("(:requirements :adl)", ":adl"),
        ("(:functions (cost))", ":functions"),
        ("(:constants c)", ":constants"),
        ("(:action b :parameters (?x) :precondition (or (p ?x) (q)) :effect (q))", "b: (or ...)"),
        ("(:action b :parameters (?x) :effect (forall (?y) (p ?y)))", "b: (forall ...)"),
        ("(:action b :parameters (?x) :effect (when (q) (p ?x)))", "b: (when ...)"),
        ("(:action b :parameters () :effect (q))", "b: an action without parameters"),
    ],
)
def test_what_is_no_strips_is_refused_by_name(change: str, refused: str) -> None:
    domain = "(define (domain d) {} (:predicates (p ?x) (q)) {} (:action a :parameters (?x) :effect (p ?x)))"
    problem = "(define (problem e) (:domain d) (:objects o) (:init (q)) (:goal (p o)))"
    here, goal = pddl.read(domain.format("", ""), problem)
    assert oag.plan(here, goal)
    first = change.startswith(("(:requirements", "(:constants"))
    with pytest.raises(pddl.PddlError) as caught:
        pddl.read(domain.format(change if first else "", "" if first else change), problem)
    assert refused in caught.value.refused


_TYPED = """(define (domain d) (:types mug - cup cup table)
    (:predicates (full ?x - cup) (on ?x - cup ?t - table) (by ?x ?y))
    (:action put :parameters (?x - cup ?t - table) :precondition (full ?x) :effect (on ?x ?t)))"""
_TYPED_PROBLEM = """(define (problem e) (:domain d) (:objects c - cup m - mug t - table)
    (:init (full c)
           {})
    (:goal {}))"""


@pytest.mark.parametrize(
    ("start", "goal", "refused"),
    [
        ("(full t)", "(on c t)", "line 3, column 12: (full t): t is table, and cup is expected (c, m)"),
        ("(full gripper)", "(on c t)", "line 3, column 12: (full gripper): gripper is object, and cup"),
        ("", "(and (full m) (on c m))", "line 4, column 26: (on c m): m is mug, and table is expected (t)"),
        ("", "(forall (?c - table) (full ?c))", "line 4, column 33: (full ?c): c is table, and cup"),
    ],
)
def test_atoms_have_the_types_of_their_predicates(start: str, goal: str, refused: str) -> None:
    with pytest.raises(pddl.PddlError) as caught:
        pddl.read(_TYPED, _TYPED_PROBLEM.format(start, goal))
    assert len(caught.value.refused) == 1 and caught.value.refused[0].startswith(refused)


def test_a_goal_that_is_read_keeps_quantifiers_and_alternatives() -> None:
    for goal, steps in (("(forall (?x - cup) (on ?x t))", 2), ("(and (by m t) (or (on c t) (on m t)))", 1)):
        planned = oag.plan(*pddl.read(_TYPED, _TYPED_PROBLEM.format("(full m) (by m t)", goal)))
        assert planned.task is not None and len(planned.task.subtasks) == steps and confirmed(planned.report)


def test_what_cannot_be_exported_is_refused_by_name() -> None:
    with pytest.raises(pddl.PddlError, match="no conjunction"):
        pddl.export(kitchen(), "(or (open drawer_0) (nextto apple_0 cup_0))")
    here = oag.scene({"apple_0": "apple", "bowl_0": "bowl", "table_0": "table"}, ["(inside apple_0 bowl_0)"], "all")
    with pytest.raises(pddl.PddlError, match="apple_0 may be carried by bowl_0"):
        pddl.export(here, "(ontop bowl_0 table_0)")
    with pytest.raises(pddl.PddlError, match="is no action"):
        pddl.export(kitchen(), GOAL).task(["fly"])


_ONE = "(define (domain d) (:predicates (on ?x)) {})"
_PROBLEM = "(define (problem p) (:domain d) (:objects a) (:init) (:goal (on a)))"
_GO = "(:action go{} :parameters (?x) :effect (on ?x))"


def test_plans_with_comments_and_variables_with_our_words_are_read() -> None:
    taking = "(:action take :parameters (?gripper ?any) :effect (and (on ?gripper) (not (on ?any))))"
    here, goal = pddl.read(_ONE.format(taking), _PROBLEM.replace("objects a", "objects a b"))
    exported = pddl.export(here, goal)
    assert confirmed(oag.compose(exported.task(["(take a b)", "", "; cost = 1 (unit cost)"])).verify())
    for actions, refused in (
        (_GO.format("-to") + _GO.format("_to"), "two actions GO_TO"),
        ("(:action go :parameters (?x) :effect ((on ?x)))", "a list where"),
    ):
        with pytest.raises(pddl.PddlError, match=refused):
            pddl.read(_ONE.format(actions), _PROBLEM)
    with pytest.raises(pddl.PddlError, match="geometry found"):
        pddl.export(kitchen().knowing([Infeasible("open", "drawer_0")]), "(open drawer_0)")


def test_a_certificate_of_a_domain_is_compared_with_a_task_s_json_without_a_scene() -> None:
    task = oag.task(kitchen(), goal=GOAL, steps=STEPS)
    certificate = oag.compose(task).verify().certificate
    assert oag.recheck(certificate, task=task.to_json())
    assert not oag.recheck(certificate, task=oag.task(kitchen(), steps=STEPS[:1]).to_json())


def test_a_denial_of_every_object_helps_a_plan() -> None:
    rows = {"DRY": {"objects": {"?f": "support"}, "writes": ["(not (wet ?any))"]}}
    domain = oag.Domain.from_json({"name": "d", "predicates": {"wet": ["a"]}, "primitives": rows})
    here = oag.scene({"cup_0": "cup", "table_0": "table"}, ["(wet cup_0)"], "all", domain=domain)
    assert confirmed(oag.plan(here, "(not (wet cup_0))").report)


def test_the_robot_has_no_skill_for_an_own_row() -> None:
    with pytest.raises(MissingSkill, match="PLACE_NEXT_TO"):
        require_skills(oag.task(kitchen(), goal=GOAL, steps=STEPS))


# Random domains without the robot, and an oracle of sets that shares nothing with the verifier.
_PREDICATES = {"lit": ["a"], "joined": ["a", "b"], "calm": []}
_VARIABLES = ("x", "y", "z")


@st.composite
def _rows(draw: st.DrawFn) -> dict[str, Any]:
    variables = _VARIABLES[: draw(st.integers(1, 3))]

    def literal() -> tuple[str, bool]:
        name = draw(st.sampled_from(sorted(_PREDICATES)))
        names = [f"?{draw(st.sampled_from(variables))}" for _ in _PREDICATES[name]]
        atom = f"({' '.join((name, *names))})"
        return atom, draw(st.booleans())

    needs, writes = (
        # One value of a fact: a row with two is refused.
        [atom if value else f"(not {atom})" for atom, value in dict(literal() for _ in range(count)).items()]
        for count in (draw(st.integers(0, 2)), draw(st.integers(1, 2)))
    )
    return {"objects": {f"?{name}": "object" for name in variables}, "needs": needs, "writes": writes}


@st.composite
def _worlds(draw: st.DrawFn) -> tuple[oag.Domain, frozenset[str], list[list[str]], list[str]]:
    rows = {f"DO{number}": draw(_rows()) for number in range(draw(st.integers(1, 3)))}
    data = {"name": "random", "inherits": False, "predicates": _PREDICATES, "kinds": {"block": "support"}}
    domain = oag.Domain.from_json({**data, "primitives": rows})
    atoms = ["(calm)", *(f"(lit {a})" for a in "st"), *(f"(joined {a} {b})" for a in "st" for b in "st")]
    start = draw(st.frozensets(st.sampled_from(atoms)))
    names = st.sampled_from(sorted(rows))
    plan = [
        [name, *(draw(st.sampled_from("st")) for _ in rows[name]["objects"])]
        for name in draw(st.lists(names, max_size=4))
    ]
    goal = draw(st.lists(st.sampled_from(atoms), min_size=1, max_size=2, unique=True))
    return domain, start, plan, [atom if draw(st.booleans()) else f"(not {atom})" for atom in goal]


def _holds(state: frozenset[str], literal: str) -> bool:
    return literal[5:-1] not in state if literal.startswith("(not ") else literal in state


def _simulated(domain: oag.Domain, start: frozenset[str], plan: list[list[str]], goal: list[str]) -> bool:
    state = start
    for name, *objects in plan:
        row: Any = domain.to_json()["primitives"]
        needs, writes = row[name]["needs"], row[name]["writes"]
        for (variable, _), value in zip(row[name]["objects"], objects, strict=True):
            needs, writes = ([text.replace(variable, value) for text in part] for part in (needs, writes))
        if not all(_holds(state, literal) for literal in needs):
            return False
        deleted = {literal[5:-1] for literal in writes if literal.startswith("(not ")}
        state = (state - deleted) | {literal for literal in writes if not literal.startswith("(not ")}
    return all(_holds(state, literal) for literal in goal)


@settings(max_examples=40, deadline=None)
@given(_worlds())
def test_verdicts_of_random_domains_are_those_of_a_simulation(world: Any) -> None:
    domain, start, plan, goal = world
    here = oag.scene({"s": "block", "t": "block"}, sorted(start), "all", domain=domain)
    wanted = domain.formula(f"(and {' '.join(goal)})")
    report = oag.compose(oag.task(here, goal=wanted, steps=[" ".join(step) for step in plan])).verify()
    assert bool(report) is _simulated(domain, start, plan, goal), str(report)
    if report.certificate is not None:
        assert confirmed(report)
    planned = oag.plan(here, wanted)
    assert planned if report else (not planned or confirmed(planned.report))
    exported = pddl.export(here, wanted)
    again, read_goal = pddl.read(exported.domain, exported.problem)
    assert again.domain.rows == domain.rows and set(again.facts) == set(here.facts)
    assert bool(oag.plan(again, read_goal)) is bool(planned)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(0, 999), min_size=1, max_size=25))
def test_what_the_exported_actions_reach_is_proved(choices: list[int]) -> None:
    goal = "(and (nextto apple_0 cup_0) (not (open drawer_0)) (ontop apple_0 table_0) (inside apple_0 drawer_0))"
    exported = pddl.export(kitchen(), goal)
    actions = {
        name: [re.findall(r"\(not \([^()]*\)\)|\([^()]*\)", part.removeprefix("(and")) for part in (before, after)]
        for name, before, after in re.findall(
            r"\(:action (\S+)\n.*\n    :precondition (.*)\n    :effect (.*)\)\n", exported.domain
        )
    }
    assert actions.keys() == exported.actions.keys()
    first = re.search(r"\(:init (.*)\)\n", exported.problem)
    assert first is not None
    state, plan = frozenset(re.findall(r"\([^()]*\)", first[1])), list[str]()
    for choice in choices:
        legal = [name for name, (before, _) in actions.items() if all(_holds(state, each) for each in before)]
        plan.append(legal[choice % len(legal)])
        after = actions[plan[-1]][1]
        deleted = {each[5:-1] for each in after if each.startswith("(not ")}
        state = (state - deleted) | {each for each in after if not each.startswith("(not ")}
    told = [each for each in sorted(state) if each.split()[0] in ("(nextto", "(ontop", "(inside", "(open")]
    denied = ["(not (open drawer_0))"] if "(open drawer_0)" not in state else []
    reached = replace(exported, goal=bddl.parse_formula(f"(and {' '.join(told + denied)})"))
    report = oag.compose(reached.task(plan)).verify()
    assert report, f"{plan}\n{report}"


def test_a_plan_counts_what_a_row_writes_once_and_what_no_choice_of_objects_writes_is_refused() -> None:
    data: Any = NEXT_TO.to_json()
    # Pushing would do it in one.
    data["primitives"] = {"PLACE_NEXT_TO": data["primitives"]["PLACE_NEXT_TO"]}
    facts = ("(ontop cup_0 table_0)", "(ontop apple_0 table_0)")
    here = replace(kitchen(oag.Domain.from_json(data)), facts=tuple(map(bddl.parse_formula, facts)))
    longer, shorter = "(open drawer_0) (ontop apple_0 drawer_0)", "(nextto apple_0 cup_0) (nextto cup_0 apple_0)"
    planned = oag.plan(here, f"(or (and {longer}) (and {shorter}))")
    assert planned.task is not None and len(planned.task.subtasks) == 2
    refused = oag.plan(here, "(nextto table_0 drawer_0)").refusal
    assert refused is not None and refused.code == "impossible" and "no primitive brings it about" in refused.problem


_SLIDE = {
    "objects": [["?thing", "item"], ["?to", "support"], ["?from", "support"]],
    "needs": ["(handempty)", "(near ?to)", "(ontop ?thing ?from)"],
    "writes": ["(ontop ?thing ?to)", "(not (ontop ?thing ?from))"],
    "flow": [18, "SLIDE"],
}


@pytest.mark.parametrize(
    ("rows", "longer", "shorter", "steps"),
    [
        # Each thing that is put down is next to the cup by the same subtask.
        (
            {},
            "(ontop apple drawer) (ontop egg drawer) (open drawer)",
            "(ontop apple table) (ontop egg table) (nextto apple cup) (nextto cup apple) (nextto egg cup)",
            4,
        ),
        # One row does what takes two of the 21.
        (
            {"SLIDE": _SLIDE},
            "(open drawer) (open cabinet) (open fridge) (open safe)",
            "(ontop apple table) (ontop egg table) (ontop cup shelf)",
            3,
        ),
    ],
)
def test_a_plan_is_shortest_where_a_row_writes_what_the_21_write(
    rows: Any, longer: str, shorter: str, steps: int
) -> None:
    domain = oag.Domain.from_json({**NEXT_TO.to_json(), "primitives": rows or NEXT_TO.to_json()["primitives"]})
    things = {name: name for name in ["apple", "egg", "cup", "table", "drawer", "shelf", "cabinet", "fridge", "safe"]}
    here = oag.scene(things, ["(ontop apple shelf)", "(ontop egg shelf)", "(ontop cup table)"], "all", domain=domain)
    planned = oag.plan(here, f"(or (and {longer}) (and {shorter}))")
    assert planned.task is not None, planned.refusal
    assert len(planned.task.subtasks) == steps and confirmed(planned.report)


_DONE: dict[str, Any] = {
    "WIPE": (["?thing - item", "?cloth - towel"], ["(inside ?cloth gripper)", "(near ?thing)"], ["(clean ?thing)"]),
    "POUR": (
        ["?to - cup", "?from - kettle"],
        ["(inside ?from gripper)", "(full ?from)", "(clean ?to)"],
        ["(full ?to)", "(not (full ?from))"],
    ),
    "HEAT": (["?thing - item", "?oven - oven"], ["(inside ?thing ?oven)", "(not (open ?oven))"], ["(hot ?thing)"]),
}


def _of_rows(rows: dict[str, Any], things: dict[str, str], facts: list[str]) -> oag.Scene:
    primitives = {
        name: {"objects": dict(each.split(" - ") for each in objects), "needs": needs, "writes": writes}
        for name, (objects, needs, writes) in rows.items()
    }
    predicates = {"clean": ["a"], "full": ["a"], "wet": ["a"]}
    domain = oag.Domain.from_json({"name": "rows", "predicates": predicates, "primitives": primitives})
    return oag.scene(things, facts, "all", domain=domain)


def test_what_rows_need_guides_the_search() -> None:
    furniture = {"table_0": "table", "shelf_0": "shelf", "cabinet_0": "cabinet", "oven_0": "oven"}
    things = {**furniture, "kettle_0": "kettle", "cup_0": "cup", "cup_1": "cup", "towel_0": "towel", "apple_0": "apple"}
    on_table = [f"(ontop {name} table_0)" for name in ("cup_1", "kettle_0", "apple_0")]
    here = _of_rows(
        _DONE, things, [*on_table, "(inside cup_0 cabinet_0)", "(ontop towel_0 shelf_0)", "(full kettle_0)"]
    )
    planned = oag.plan(here, "(and (hot cup_0) (full cup_0))")
    assert planned.task is not None and len(planned.task.subtasks) == 11 and planned.states < 500


_PLACES = ("(inside ?a ?o)", "(ontop ?a ?t)", "(inside ?b ?o)", "(inside ?b gripper)", "(inside ?a gripper)")
_STATES = ("(wet ?a)", "(wet ?b)", "(clean ?a)", "(hot ?a)", "(hot ?b)")
_NEEDS = (*_PLACES, *_STATES, "(not (wet ?a))", "(open ?o)", "(not (open ?o))", "(handempty)", "(or (wet ?a) (hot ?b))")
# What the 21 write as well.
_HANDLED = ("(handempty)", "(ontop ?a ?t)", "(open ?o)", "(inside ?a ?o)", "(not (inside ?b ?any))")
_ROWS = st.tuples(
    st.just(["?a - item", "?b - item", "?o - fixture", "?t - support"]),
    st.lists(st.sampled_from(_NEEDS), max_size=3, unique=True),
    st.lists(st.sampled_from((*_STATES, *_HANDLED)), min_size=1, max_size=2, unique=True),
)
_ENDS = [f"({word} {name})" for word in ("wet", "clean", "hot") for name in ("apple_0", "book_0")]
_PUT = st.sampled_from(["(ontop {} table_0)", "(inside {} oven_0)", "(inside {} gripper)"])


@settings(max_examples=60, deadline=None)
@given(
    st.lists(_ROWS, min_size=1, max_size=4),
    st.tuples(_PUT, st.sampled_from(["(ontop {} table_0)", "(inside {} oven_0)"])),
    st.lists(st.sampled_from([*_ENDS, "(open oven_0)"]), max_size=2, unique=True),
    st.lists(
        st.sampled_from([*_ENDS, "(not (open oven_0))", "(inside apple_0 oven_0)", "(ontop book_0 table_0)"]),
        min_size=1,
        max_size=3,
    ),
)
@example(
    # One step for two parts of a goal.
    [(["?a - item"], [], ["(wet ?a)", "(clean ?a)"])],
    ("(ontop {} table_0)", "(ontop {} table_0)"),
    [],
    ["(wet apple_0)", "(clean apple_0)"],
)
def test_the_estimate_is_at_most_the_length_that_a_search_without_it_finds(
    rows: list[Any], places: tuple[str, str], states: list[str], ends: list[str]
) -> None:
    things = {"apple_0": "apple", "book_0": "book", "oven_0": "oven", "table_0": "table"}
    facts = [*states, *(place.format(name) for place, name in zip(places, things, strict=False))]
    here = _of_rows({f"DO{number}": row for number, row in enumerate(rows)}, things, facts)
    estimates: list[int] = []

    def none(self: Estimate, state: Any) -> int:
        estimates.append(estimate_of(self, state))
        return 0

    estimate_of = Estimate.of
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Estimate, "of", none)
        shortest = oag.plan(here, f"(and {' '.join(ends)})")
    assert shortest.task is None or max(estimates[:1], default=0) <= len(shortest.task.subtasks)
