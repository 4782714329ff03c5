"""What a scene admits: nothing is left out, every plan is proved, every sentence is read back."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bddl
import llm
import oag
from executor.scenes.library import load
from oag.planning import NoPlan
from oag.wish_list import KINDS, Wish, wishes

# What each category is for, as people say it: things go into it, things stand on it.
FURNITURE = {"refrigerator": (True, False), "cabinet": (True, True), "table": (False, True), "sink": (False, False)}
ITEMS = {"apple": (False, False), "bowl": (True, False), "plate": (False, True), "can": (False, False)}
DOORS = ("refrigerator", "cabinet")
SIZES = {"apple": [0.05, 0.05, 0.05], "bowl": [0.2, 0.2, 0.1], "plate": [0.05, 0.05, 0.02], "can": [0.05, 0.05, 0.1]}


@st.composite
def scenes(draw: st.DrawFn) -> oag.Scene:
    """A kitchen of some furniture and items, each item on or in a piece that takes it; doors are open or closed."""
    fixed = draw(st.lists(st.sampled_from(sorted(FURNITURE)), max_size=2))
    furniture = [f"{category}_{number}" for number, category in enumerate(["cabinet", "table", *fixed])]
    names = draw(st.lists(st.sampled_from(sorted(ITEMS)), min_size=1, max_size=4))
    items = [f"{category}_{number}" for number, category in enumerate(names)]
    where = [
        f"(inside {{}} {key})" if relation == "inside" else f"(ontop {{}} {key})"
        for key in furniture
        for relation, given_to in zip(("inside", "ontop"), FURNITURE[stem(key)], strict=True)
        if given_to
    ]
    facts = [draw(st.sampled_from(where)).format(item) for item in items]
    facts += [f"(open {key})" for key in furniture if stem(key) in DOORS and draw(st.booleans())]
    objects: dict[str, Any] = {key: {"category": stem(key), "bbox_extent": [0.6, 0.6, 0.8]} for key in furniture}
    objects |= {item: {"category": stem(item), "bbox_extent": SIZES[stem(item)]} for item in items}
    return oag.Scene.from_json({"objects": objects, "facts": facts, "closed": ["ontop", "inside", "open"]})


def stem(key: str) -> str:
    return key.rsplit("_", 1)[0]


def single_wishes(scene: oag.Scene) -> Iterator[tuple[str, str, str | None]]:
    """Yield relation or verb, target and place of every wish about one object, by trying out all pairs of ids."""
    facts = {bddl.format(fact) for fact in scene.facts}
    uses = {**FURNITURE, **ITEMS}
    for key in scene.objects:
        if stem(key) in DOORS:
            yield ("close" if f"(open {key})" in facts else "open", key, None)
        if stem(key) not in ITEMS:
            continue
        yield ("hold", key, None)
        for place in scene.objects:
            into, onto = uses[stem(place)]
            into = into and (stem(place) not in ITEMS or stem(key) != "bowl")
            for relation, possible in (("inside", into), ("ontop", onto)):
                if possible and key != place and f"({relation} {key} {place})" not in facts:
                    yield (relation, key, place)


@given(scenes())
@settings(max_examples=60, deadline=None)
def test_every_wish_about_one_object_is_listed_once(scene: oag.Scene) -> None:
    single = [wish for wish in wishes(scene) if wish.kind not in ("all", "empty")]
    verbs = {"pick": "hold", "take-out": "hold", "open": "open", "close": "close"}
    listed = [(wish.relation or verbs[wish.kind], wish.targets[0], wish.place) for wish in single]
    assert sorted(listed, key=str) == sorted(single_wishes(scene), key=str)


@given(scenes())
@settings(max_examples=25, deadline=None)
def test_every_listed_task_is_proved_and_has_something_to_do(scene: oag.Scene) -> None:
    for found in oag.tasks(scene):
        report = oag.compose(found.task, scene=scene).verify()
        assert report.verdict is oag.Verdict.PROVED and oag.recheck(report.certificate)
        assert found.task.subtasks and bddl.equivalent(found.task.goal, found.wish.goal, scene.categories)


@given(scenes())
@settings(max_examples=15, deadline=None)
@pytest.mark.slow
def test_sentences_are_read_as_the_goals_of_their_wishes(scene: oag.Scene) -> None:
    refused: list[Wish] = []
    found = list(llm.tasks(scene, on_refusal=lambda wish, why: refused.append(wish)))
    for one in found:
        assert bddl.equivalent(llm.propose(one.sentence, scene).task.goal, one.wish.goal, scene.categories)
    assert [one.wish for one in found] == [wish for wish in wishes(scene) if wish not in refused]
    assert not refused


def test_kinds_can_be_chosen_and_come_in_their_order() -> None:
    scene = load("kitchen_t4")
    kinds = [found.wish.kind for found in oag.tasks(scene)]
    assert kinds == sorted(kinds, key=KINDS.index)
    assert {found.wish.kind for found in oag.tasks(scene, ["fill", "open"])} == {"fill", "open"}


def test_a_wish_without_a_plan_is_refused_with_the_reason() -> None:
    refused: dict[str, NoPlan] = {}
    found = list(oag.tasks(load("kitchen_t2"), on_refusal=lambda wish, why: refused.update({str(wish): why})))
    assert "pick up plate_0" in refused and refused["pick up plate_0"].code == "impossible"
    assert all("plate_0" not in one.wish.targets for one in found)


def test_a_door_that_a_putting_needs_open_is_closed_again() -> None:
    wish = next(iter(wishes(load("kitchen_t1"), ["put-into"])))
    assert bddl.format(wish.goal) == "(and (inside glass_0 refrigerator_0) (not (open refrigerator_0)))"
    assert wish.sentences == ("put the glass into the refrigerator", "put glass_0 into refrigerator_0")


def test_a_planner_that_reads_another_goal_does_not_count() -> None:
    scene = load("kitchen_t1")
    other = llm.propose("open the refrigerator", scene).task
    refused: list[str] = []
    found = oag.tasks(
        scene, ["pick"], planner=lambda sentence: other, on_refusal=lambda w, why: refused.append(why.code)
    )
    assert not list(found) and refused == ["no-plan"]


@pytest.mark.parametrize("name", ["kitchen_t1", "kitchen_t3"])
def test_a_task_is_plain_data_that_is_read_again(name: str) -> None:
    scene = load(name)
    for found in oag.tasks(scene):
        data: dict[str, Any] = found.to_json()
        assert oag.Task.from_json(data["task"], scene=scene).subtasks == found.task.subtasks
        assert bddl.equivalent(data["goal"], found.wish.goal, scene.categories)


def test_things_that_contain_each_other_are_refused_and_end_no_list() -> None:
    facts = ["(inside bowl_0 box_0)", "(ontop box_0 bowl_0)"]
    scene = oag.scene({"bowl_0": "bowl", "box_0": "box", "table_0": "table"}, facts, "all")
    with pytest.raises(oag.SceneError, match="things carry each other in a circle"):
        list(oag.tasks(scene))
