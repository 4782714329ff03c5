"""What geometry found impossible: verify, the planner, fixes and the checker take it as a fact of the scene."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import chain, combinations
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
import oag
from oag.certificate.recheck import digest, scene_json
from oag.model.infeasible import Infeasible
from oag.verify.verify import verify

SCENE = oag.scene(
    objects={
        "shelf_0": "shelf",
        "shelf_1": "shelf",
        "table_0": "table",
        "cup_0": "cup",
        "bottle_0": "bottle",
        "drawer_0": "drawer",
    },
    facts=["(ontop cup_0 table_0)", "(ontop bottle_0 shelf_1)", "(not (open drawer_0))"],
    closed="all",
)
FACTS = ("(ontop bottle_0 shelf_1)", "(ontop bottle_0 shelf_0)", "(open drawer_0)", "(not (open drawer_0))")
CLEARED = [oag.pick("bottle_0"), oag.place("bottle_0", ontop="shelf_0")]
PUT = [oag.pick("cup_0"), oag.place("cup_0", ontop="shelf_1")]
GOAL = "(ontop cup_0 shelf_1)"


def found(*given: str, kind: Any = "ontop", place: str | None = "shelf_1") -> Infeasible:
    literals = tuple(map(bddl.parse_formula, given))
    return Infeasible(kind, "cup_0", place, literals, "put_cup", "no spot is free")


def certificate_of(report: oag.Report) -> dict[str, Any]:
    assert report.certificate is not None
    data: dict[str, Any] = json.loads(json.dumps(report.certificate.to_json()))
    return data


@given(
    bottle=st.sets(st.sampled_from(FACTS[:2])),
    door=st.sets(st.sampled_from(FACTS[2:]), max_size=1),
    opened=st.booleans(),
    cleared=st.booleans(),
)
def test_a_plan_fails_exactly_where_all_of_the_circumstances_hold(
    bottle: set[str], door: set[str], opened: bool, cleared: bool
) -> None:
    given = bottle | door
    steps = [*([oag.open("drawer_0")] if opened else []), *(CLEARED if cleared else []), *PUT]
    task = oag.task(SCENE, goal=GOAL, steps=steps)
    holds = {
        "(ontop bottle_0 shelf_1)": not cleared,
        "(ontop bottle_0 shelf_0)": cleared,
        "(open drawer_0)": opened,
        "(not (open drawer_0))": not opened,
    }
    scene = SCENE.knowing([found(*sorted(given))])
    report = oag.compose(task, scene=scene).verify()
    refuted = all(holds[fact] for fact in given)
    assert report.verdict is (oag.Verdict.REFUTED if refuted else oag.Verdict.PROVED)
    assert verify(task, scene, exact=True).verdict is report.verdict
    assert not refuted or [error.code for error in report.errors] == ["task/infeasible"]
    if given or not refuted:
        assert oag.recheck(certificate_of(report), task=task, scene=scene)


@pytest.mark.parametrize("given", [(), ("(ontop bottle_0 shelf_1)",)])
def test_a_proof_without_the_fact_is_none_with_it(given: tuple[str, ...]) -> None:
    data = certificate_of(oag.compose(oag.task(SCENE, goal=GOAL, steps=PUT)).verify())
    data["scene"] = json.loads(json.dumps(scene_json(SCENE.knowing([found(*given)]))))
    data["scene_sha"] = digest(data["scene"])
    assert not oag.recheck(data)


def test_a_proof_with_the_fact_is_of_another_scene_without_it() -> None:
    scene, task = SCENE.knowing([found("(open drawer_0)")]), oag.task(SCENE, goal=GOAL, steps=PUT)
    data = certificate_of(oag.compose(task, scene=scene).verify())
    assert data["scene"]["known"][0]["reason"] == "no spot is free"
    assert oag.recheck(data, task=task, scene=scene) and not oag.recheck(data, task=task, scene=SCENE)


def test_the_planner_goes_elsewhere_and_else_clears_the_place() -> None:
    scene = SCENE.knowing([found("(ontop bottle_0 shelf_1)")])
    elsewhere = oag.plan(scene, "(exists (?s - shelf) (ontop cup_0 ?s))")
    assert elsewhere.task is not None
    assert [each.support_goal for each in elsewhere.task.subtasks] == [None, "shelf_0"]
    cleared = oag.plan(scene, GOAL)
    assert cleared.task is not None and len(cleared.task.subtasks) == 4
    assert cleared.task.subtasks[0].target == "bottle_0"
    never = oag.plan(SCENE.knowing([found()]), GOAL)
    assert not never and "no spot is free" in str(never.refusal)


def test_what_is_taken_opened_and_closed_is_recognised_by_its_flow() -> None:
    taken = SCENE.knowing([found("(ontop cup_0 table_0)", kind="take", place=None)])
    assert oag.compose(oag.task(SCENE, goal=GOAL, steps=PUT), scene=taken).verify().errors[0].subtask == 0
    shut = SCENE.knowing([Infeasible("open", "drawer_0"), Infeasible("close", "drawer_0")])
    for step in (oag.open("drawer_0"), oag.close("drawer_0")):
        start = (
            replace(SCENE, facts=(bddl.parse_formula("(open drawer_0)"),)) if step == oag.close("drawer_0") else SCENE
        )
        task = oag.task(start, goal="(ontop cup_0 table_0)", steps=[step])
        assert [e.code for e in verify(task, replace(start, known=shut.known)).errors] == ["task/infeasible"]


@given(st.sampled_from(list(chain.from_iterable(combinations(FACTS[:3], n) for n in range(4)))))
def test_a_scene_file_keeps_it(given: tuple[str, ...]) -> None:
    scene = SCENE.knowing([found(*given)])
    assert oag.Scene.from_json(json.loads(json.dumps(scene.to_json()))) == scene
    assert scene.knowing(scene.known) == scene and "known" not in SCENE.to_json()


@pytest.mark.parametrize("change", [{"thing": "cpu_0"}, {"place": "shelf_9"}, {"given": ("(ontop cup_0 shelf_9)",)}])
def test_what_it_names_is_in_the_scene(change: dict[str, Any]) -> None:
    with pytest.raises(oag.SceneError, match="unknown object"):
        SCENE.knowing([replace(found(), **change)])


@pytest.mark.parametrize(
    ("changed", "place"),
    [
        ({"kind": "inside", "place": None}, "known[0].place"),
        ({"kind": "take"}, "known[0].place"),
        ({"given": ["(ontop cup_9 shelf_0)"]}, "known[0].given[0]"),
    ],
)
def test_what_is_malformed_in_a_scene_is_refused_by_its_place(changed: dict[str, Any], place: str) -> None:
    data = {**SCENE.to_json(), "known": [{**found(FACTS[0]).to_json(), **changed}]}
    with pytest.raises(oag.SceneError) as caught:
        oag.Scene.from_json(data)
    assert caught.value.place == place


def test_circumstances_of_a_formula_are_named_as_such() -> None:
    known = replace(SCENE, known=(replace(found(FACTS[0]), reason="no spot\nis free"),))
    task = oag.task(SCENE.knowing([]), goal=GOAL, steps=PUT)
    init = bddl.parse_formula("(or (inside cup_0 gripper) (open drawer_0))")
    subtasks = (task.subtasks[0], replace(task.subtasks[1], init=init))
    report = verify(replace(task, subtasks=subtasks, scene=known), known)
    assert [each.code for each in report.errors] == ["task/infeasible"] and "\n" not in report.errors[0].message
