"""Stability of decompositions: changes that keep the meaning, forms up to renaming, and what a bug looks like."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from random import Random
from typing import Any

import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scipy.stats import beta

import bddl
import executor
import llm
import oag
from oag import testing
from oag.perturbations import PERTURBATIONS, mirrored, perturbed, renamed
from oag.phrasing import rephrasings

QUERY = "put the apple into the drawer"
SCENE = oag.scene({"drawer_0": "drawer", "apple_0": "apple", "table_0": "table"}, ["(ontop apple_0 table_0)"], "all")
FEW = settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))


def storing(scene: oag.Scene, *, shut: bool = True) -> oag.Task:
    """The right decomposition, by the categories of a scene."""
    drawer, apple = (next(k for k, t in scene.objects.items() if t.category == noun) for noun in ("drawer", "apple"))
    steps = [oag.open(drawer), oag.pick(apple), oag.place(apple, inside=drawer), *([oag.close(drawer)] if shut else [])]
    return oag.task(scene, goal=f"(inside {apple} {drawer})", steps=steps)


@pytest.mark.parametrize("kind", [*PERTURBATIONS, "all", "none"])
def test_a_planner_that_reads_the_scene_is_stable(kind: str) -> None:
    kinds = {"all": PERTURBATIONS, "none": ()}.get(kind, (kind,))
    found = oag.stability(lambda query, scene: storing(scene), QUERY, SCENE, 6, kinds)
    assert found and found.agreeing == (5, 5) and found.forms[0].verdicts == {"PROVED": 6}
    assert found.lengths == {4: 6}


@pytest.mark.parametrize("scene", ["kitchen_t1", SCENE], ids=["file", "written"])
def test_the_offline_planner_is_stable(scene: Any) -> None:
    query = "put the glass into the refrigerator" if isinstance(scene, str) else QUERY
    room = executor.load_scene(scene) if isinstance(scene, str) else scene
    assert oag.stability(llm.propose, query, room, n=7)


def test_what_depends_on_the_order_of_objects_is_found_with_the_edit() -> None:
    def hasty(query: str, scene: oag.Scene) -> dict[str, object]:
        return storing(scene, shut=next(iter(scene.objects)).startswith("drawer")).to_json()

    found = oag.stability(hasty, QUERY, SCENE, n=20)
    assert not found and len(found.forms) == 2
    assert {name for name, (same, of) in found.by_change.items() if same < of} <= {"order", "all"}
    other = next(form for form in found.forms if form.edits is not None)
    assert other.edits is not None and other.edits.words == ('leave out T4 "close drawer 0"',)
    assert other.example.task is not None and len(other.example.task.subtasks) == 3
    assert sum(form.count for form in found.forms) == 20 and found.lengths.keys() == {3, 4}
    assert [form.count for form in found.forms] == sorted((form.count for form in found.forms), reverse=True)


def test_intervals_are_exact() -> None:
    calls = iter(range(100))
    found = oag.stability(lambda query, scene: storing(scene, shut=next(calls) % 4 != 1), QUERY, SCENE, 13, [])
    agreeing, count = found.agreeing
    assert (agreeing, count) == (9, 12)
    wanted = beta.ppf(0.025, agreeing, count - agreeing + 1), beta.ppf(0.975, agreeing + 1, count - agreeing)
    assert found.interval == pytest.approx(wanted)
    assert found.forms[1].interval == pytest.approx((beta.ppf(0.025, 3, 11), beta.ppf(0.975, 4, 10)))
    assert found.by_change == {"none": (9, 12)}
    assert oag.stability(lambda query, scene: storing(scene), QUERY, SCENE, 1).interval == (0.0, 1.0)


def test_names_that_a_model_respells_are_taken_back() -> None:
    def respelled(query: str, scene: oag.Scene) -> dict[str, object]:
        text = json.dumps(storing(scene).to_json())
        return json.loads(text.replace("drawer_", "Drawer-"))  # type: ignore[no-any-return]

    assert oag.stability(respelled, QUERY, SCENE, 4, ["rename"])


def test_refusals_and_errors_are_outcomes_but_for_the_first_run() -> None:
    def shy(query: str, scene: oag.Scene) -> oag.Task:
        if query != QUERY:
            raise ValueError("no such sentence")
        return storing(scene)

    found = oag.stability(shy, QUERY, SCENE, 4, ["paraphrase"])
    assert [form.name for form in found.forms] == ["ValueError", found.forms[1].name]
    assert found.forms[0].subtasks is None and "no such sentence" in str(found)
    with pytest.raises(ValueError, match="no such sentence"):
        oag.stability(shy, "put it away", SCENE, 4)
    with pytest.raises(ValueError, match="no such sentence"):
        oag.stability(shy, QUERY, SCENE, 4, ["paraphrase"], refusals=(KeyError,))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"perturb": ["oder"]}, ("perturb", "order")),
        ({"n": 0}, ("n", "from 1")),
        ({"decompose": "a planner"}, ("decompose",)),
        ({"decompose": lambda query, scene: None}, ("decompose", "Task")),
        ({"scene": "kitchen"}, ("Scene",)),
    ],
)
def test_misuse_is_one_clear_error(given: dict[str, Any], words: tuple[str, ...]) -> None:
    arguments: dict[str, Any] = {"decompose": lambda query, scene: storing(scene), "query": QUERY, "scene": SCENE}
    with pytest.raises(oag.OagError) as refused:
        oag.stability(**(arguments | given))
    assert all(word in str(refused.value) for word in words)


def test_the_picture_is_a_file_with_a_bar_for_each_number_of_subtasks() -> None:
    calls = iter(range(100))
    found = oag.stability(lambda query, scene: storing(scene, shut=next(calls) % 2 == 0), "a <b> & c", SCENE, 8, [])
    drawn = ET.fromstring(found.to_svg())
    parts = [one for one in drawn.iter("{http://www.w3.org/2000/svg}rect") if one.find("{*}title") is not None]
    assert len(parts) == 2 and found._repr_html_().startswith("<div><svg")
    heights = [float(str(part.get("height"))) for part in parts]
    assert heights[0] == pytest.approx(heights[1])
    assert json.loads(json.dumps(found.to_json()))["subtasks"] == {"3": 4, "4": 4}


@given(testing.scenes(), st.integers(0, 10**6))
@FEW
def test_changed_scenes_mean_the_same_under_the_old_names(scene: oag.Scene, seed: int) -> None:
    setting = perturbed("pick the apple_0 up on the left", scene, PERTURBATIONS, Random(seed), ("take it",))
    back = renamed(setting.scene, setting.original)
    assert back.objects.keys() == setting.judged.objects.keys() >= scene.objects.keys()
    assert {bddl.format(fact) for fact in back.facts} == {bddl.format(fact) for fact in setting.judged.facts}
    assert {bddl.format(fact) for fact in scene.facts} <= {bddl.format(fact) for fact in setting.judged.facts}
    added = setting.judged.objects.keys() - scene.objects.keys()
    assert added and {scene.categories.get(key) for key in added} == {None}
    assert {key: thing.category for key, thing in back.objects.items()} == setting.judged.categories


def test_a_query_names_objects_as_the_scene_does_then() -> None:
    scene = oag.scene({"drawer_1": "drawer", "drawer_2": "drawer", "cup": "cup"}, closed="all")
    setting = perturbed("open drawer 2, then drawer_1 on the Left", scene, ("rename", "mirror"), Random(3), ())
    names = {old: new for new, old in setting.original.items()}
    spelled = names["drawer_2"].replace("_", " ")
    assert setting.query == f"open {spelled}, then {names['drawer_1']} on the Right"
    assert set(names) == set(scene.objects) and set(names.values()).isdisjoint(scene.objects)


@given(st.floats(-3, 3), st.tuples(*[st.floats(-1, 1)] * 4), st.tuples(*[st.floats(-2, 2)] * 3))
@FEW
def test_mirrored_twice_a_scene_is_itself(yaw: float, turn: tuple[float, ...], place: tuple[float, ...]) -> None:
    norm = sum(part * part for part in turn) ** 0.5
    assume(norm > 0.1)
    cup = oag.SceneObject("cup_0", "cup", "cup", place, tuple(p / norm for p in turn), (0.1, 0.1, 0.1))  # type: ignore[arg-type]
    door = replace(cup, id="cabinet_0", category="cabinet", parameters={"hinge": "left", "drawers": 2})
    scene = replace(oag.scene({"cup_0": cup, "cabinet_0": door}), robot=replace(SCENE.robot, yaw_rad=yaw))
    once, twice = mirrored(scene), mirrored(mirrored(scene))
    assert once["cabinet_0"].parameters == {"hinge": "right", "drawers": 2}
    assert once["cup_0"].height_m == pytest.approx(cup.height_m)
    for key, thing in scene.objects.items():
        assert twice[key].position == pytest.approx(thing.position)
        assert twice[key].orientation == pytest.approx(thing.orientation)
        assert twice[key].parameters == thing.parameters


def test_rephrasings_keep_the_request() -> None:
    texts = list(rephrasings(QUERY))
    assert len(texts) == len(set(texts)) >= 12 and QUERY not in texts
    assert all(text.rstrip("?").endswith(("the apple into the drawer", "please")) for text in texts)
    assert "please wipe the table" in list(rephrasings("wipe the table"))
