"""What is chosen or assumed is said; colours, sizes and places of drawers are those that the scene states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
import llm
from llm.offline.viewpoint import by_size, placed
from oag import Scene, Task
from tests.llm.kitchens import SCENES, conjuncts, noted

FLAT = SCENES["flat"]


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("put a mug on the counter", 'any "mug" will do: mug_0 is taken, and not mug_1'),
        ("put a knife in the safe", 'any "knife" will do: knife_0 is taken, and not knife_1'),
        ("open the third drawer", 'drawer_2 is taken for "third drawer", counted from the top'),
        ("bring me the can", "table_0, the nearest surface to the robot's start"),
        ("clear the table", "refrigerator_0 is taken for the usual place of apple_0"),
        ("tidy up the room", "no usual place of tissue_box_0 is known; it stays where it is"),
        ("put the can on the edge of the table", '"on the edge of" changes nothing in the plan'),
        ("put the yellow apple on the sofa", '"yellow" is taken on trust'),
    ],
)
def test_what_is_chosen_or_assumed_is_noted(query: str, said: str) -> None:
    assert any(said in note for note in llm.propose(query, FLAT).notes)


@pytest.mark.parametrize("query", ["put the red mug on the sofa", "put the big box on the sofa"])
def test_what_the_scene_states_is_not_taken_on_trust(query: str) -> None:
    assert not any("trust" in note for note in noted(llm.propose(query, FLAT)))


@pytest.mark.parametrize(
    ("query", "reason"),
    [
        ("pour the mug into the bowl", "tilts"),
        ("please wipe the table", "cleans"),
        ("fold the newspaper", "shape"),
        ("turn on the microwave", "joint"),
        ("heat the apple", "warm"),
        ("push the table aside", "pushes"),
    ],
)
def test_what_no_plan_can_do_is_refused_with_the_reason_and_with_what_can_be_done(query: str, reason: str) -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(query, FLAT)
    assert caught.value.code == "unknown-action"
    assert reason in caught.value.problem
    assert caught.value.suggestions


def test_beside_a_thing_the_nearest_wish_is_the_place_that_it_stands_on() -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose("put the apple under the can", FLAT)
    assert caught.value.suggestions == ("put apple_0 onto armchair_0",)


@pytest.mark.parametrize(
    ("query", "where"),
    [
        ("put the apple next to the can", "next to can_0"),
        ("set the apple down beside the can", "next to can_0"),
        ("move the apple to the left of the can", "left of can_0"),
        ("place the apple to the right of the can", "right of can_0"),
        ("set the apple behind the can", "behind can_0"),
        ("put the apple in front of the can", "in front of can_0"),
    ],
)
def test_a_spot_next_to_a_thing_is_on_what_that_stands_on(query: str, where: str) -> None:
    """Symbols do not tell spots apart: the goal is the place, and the subtask names the spot."""
    proposal = llm.propose(query, FLAT)
    (placing,) = (subtask for subtask in proposal.task.subtasks if subtask.where is not None)
    assert (placing.target, placing.support_goal, str(placing.where)) == ("apple_0", "armchair_0", where)
    assert proposal.expanded.task_name == f"put apple_0 {where}"
    again = llm.propose(proposal.expanded.task_name, FLAT)
    assert again.task.subtasks == proposal.task.subtasks
    assert Task.from_json(proposal.task.to_json(), scene=FLAT).subtasks == proposal.task.subtasks


@pytest.mark.parametrize(
    ("query", "opened", "put"),
    [
        ("open the second drawer of the cabinet", "second drawer", None),
        ("open the left door of the cabinet", "left door", None),
        ("put the apple in the third drawer of the cabinet", "third drawer", "third drawer"),
        ("put the apple into the top shelf of the cabinet", None, "top shelf"),
        ("put the apple on the top shelf of the cabinet", None, "top shelf"),
    ],
)
def test_a_part_of_a_thing_is_named_in_the_subtasks(query: str, opened: str | None, put: str | None) -> None:
    task = llm.propose(query, FLAT).task
    said = {subtask.name.partition("_")[0]: subtask.where for subtask in task.subtasks}
    assert [None if said.get(verb) is None else str(said[verb]) for verb in ("open", "put")] == [opened, put]
    assert put is None or bddl.Atom("inside", ("apple_0", "cabinet_0")) in [part.goal for part in task.subtasks]
    again = llm.propose(llm.propose(query, FLAT).expanded.task_name, FLAT).task
    assert again.subtasks == task.subtasks


def test_two_things_may_go_first() -> None:
    task = llm.propose("put the apple and the can on the sofa first, then the salt", FLAT).task
    assert [s.target for s in task.subtasks if s.support_goal] == ["apple_0", "can_0", "salt_shaker_0"]


COLORS = st.lists(st.sampled_from(["red", "blue", "green", ""]), min_size=1, max_size=4)


def _mugs(colors: Sequence[str]) -> Scene:
    table = {"category": "table", "position": [1.0, 0.0, 0.3], "bbox_extent": [0.6, 1.4, 0.6]}
    mugs = {
        f"mug_{index}": {
            "category": "mug",
            "position": [1.0, 0.3 * index, 0.65],
            "bbox_extent": [0.08, 0.08, 0.09],
            "parameters": {"color": color} if color else {},
        }
        for index, color in enumerate(colors)
    }
    facts = [f"(ontop {key} table_0)" for key in mugs]
    return Scene.from_json({"name": "mugs", "objects": {"table_0": table, **mugs}, "facts": facts, "closed": ["ontop"]})


@given(COLORS)
def test_a_colour_means_what_is_stated_so_or_else_what_is_stated_nothing_of(colors: Sequence[str]) -> None:
    meant = [index for index, color in enumerate(colors) if color == "red"]
    meant = meant or [index for index, color in enumerate(colors) if not color]
    try:
        goal = conjuncts(llm.propose("pick up the red mug", _mugs(colors)).task.goal)
    except llm.QueryError as error:
        assert len(meant) != 1
        assert error.code == ("ambiguous-object" if meant else "unknown-object")
    else:
        assert goal == {f"(inside mug_{meant[0]} gripper)"}


SHARES = st.lists(st.sampled_from([0.0, 0.03, 0.2, 0.5, 0.9]), min_size=1, max_size=3)


@given(SHARES, st.sampled_from(["red", "orange"]), st.sampled_from(["the", "a"]))
def test_a_colour_that_a_photograph_shows_is_compared(shares: Sequence[float], shown: str, article: str) -> None:
    scene = _mugs(["blue"] * len(shares))  # As the model of each is drawn, which states nothing then.
    parameters = [{"color": "blue", "color_shares": {"grey": 1.0 - share, shown: share}} for share in shares]
    mugs = {
        f"mug_{index}": replace(scene.objects[f"mug_{index}"], parameters=own) for index, own in enumerate(parameters)
    }
    scene = replace(scene, objects={**scene.objects, **mugs})
    # In warm light what is red looks orange, which counts half.
    amounts = [share if shown == "red" else share / 2 for share in shares]
    alike = [i for i, one in enumerate(amounts) if max(amounts) > 0.1 and one >= max(amounts) / 2]
    meant = alike if len(shares) > 1 else [0]
    try:
        proposal = llm.propose(f"pick up {article} red mug", scene)
    except llm.QueryError as error:
        assert not meant or (len(meant) > 1 and article == "the")
        assert error.code == "ambiguous-object"
    else:
        assert conjuncts(proposal.task.goal) in [{f"(inside mug_{index} gripper)"} for index in meant]


def _column(heights_m: Sequence[float], sizes_m: Sequence[float]) -> Scene:
    objects = {
        f"drawer_{index}": {
            "category": "drawer",
            "position": [1.0, 0.0, height_m],
            "bbox_extent": [size_m, size_m, 0.1],
        }
        for index, (height_m, size_m) in enumerate(zip(heights_m, sizes_m, strict=True))
    }
    return Scene.from_json({"name": "column", "objects": objects, "facts": []})


HEIGHTS = st.permutations([0.1, 0.3, 0.5, 0.7, 0.9]).flatmap(
    lambda order: st.integers(2, 5).map(lambda count: list(order[:count]))
)


@given(HEIGHTS)
def test_what_is_above_each_other_is_counted_from_the_top(heights_m: list[float]) -> None:
    scene = _column(heights_m, [0.5] * len(heights_m))
    ids = tuple(scene.objects)
    downwards = [f"drawer_{heights_m.index(height_m)}" for height_m in sorted(heights_m, reverse=True)]
    for word, place in {"first": 0, "top": 0, "second": 1, "third": 2, "last": -1, "bottom": -1}.items():
        found = placed(ids, word, scene)
        expected = downwards[place] if place < len(downwards) else None
        assert (found and found[0]) == expected
    middle = placed(ids, "middle", scene)
    assert (middle and middle[0]) == (downwards[len(ids) // 2] if len(ids) % 2 else None)


@given(st.lists(st.sampled_from([0.2, 0.22, 0.4, 0.6]), min_size=2, max_size=4))
def test_a_size_decides_where_the_difference_is_clear(sizes_m: list[float]) -> None:
    scene = _column([0.1] * len(sizes_m), sizes_m)
    ids = tuple(scene.objects)
    largest, second = sorted(((size_m * size_m * 0.1) ** (1 / 3) for size_m in sizes_m), reverse=True)[:2]
    clear = largest >= 1.15 * second
    assert by_size(ids, "big", scene) == ((f"drawer_{sizes_m.index(max(sizes_m))}",) if clear else ids)


def _cabinet() -> Scene:
    """A cabinet with one apple inside and one on its top, and a table."""
    things = {
        "cabinet_0": ("cabinet", [2.0, 0.0, 0.4], [0.8, 0.6, 0.8]),
        "table_0": ("table", [0.0, 2.0, 0.35], [0.8, 1.4, 0.7]),
        "apple_0": ("apple", [2.0, 0.0, 0.2], [0.05, 0.05, 0.05]),
        "apple_1": ("apple", [2.0, 0.0, 0.83], [0.05, 0.05, 0.05]),
    }
    objects = {
        key: {"category": category, "position": place, "bbox_extent": size}
        for key, (category, place, size) in things.items()
    }
    facts = ["(inside apple_0 cabinet_0)", "(ontop apple_1 cabinet_0)", "(open cabinet_0)"]
    return Scene.from_json(
        {"name": "one cabinet", "objects": objects, "facts": facts, "closed": ["ontop", "inside", "open"]}
    )


@pytest.mark.parametrize(
    ("query", "moved"),
    [
        ("empty the cabinet onto the table", {"apple_0"}),
        ("unload the cabinet", {"apple_0"}),
        ("put the contents of the cabinet on the table", {"apple_0"}),
        ("take everything out of the cabinet and put it on the table", {"apple_0"}),
        ("take the apple out of the cabinet and put it on the table", {"apple_0"}),
        ("take everything off the cabinet and put it on the table", {"apple_0", "apple_1"}),
        ("put everything from the cabinet on the table", {"apple_0", "apple_1"}),
        ("clear the cabinet onto the table", {"apple_0", "apple_1"}),
    ],
)
def test_out_of_a_thing_means_what_is_inside_it(query: str, moved: set[str]) -> None:
    goal = conjuncts(llm.propose(query, _cabinet()).task.goal)
    assert {key for key in ("apple_0", "apple_1") if any(f" {key} table_0" in text for text in goal)} == moved


def test_several_things_that_move_along_are_named_in_the_plural() -> None:
    notes = llm.propose("put the salt and the apple in the bowl and put the bowl on the counter", FLAT).notes
    assert "salt_shaker_0 and apple_0 stand in or on bowl_0 and move along with it" in notes


def test_what_a_photograph_shows_in_another_colour_is_not_meant_beside_what_is_stated() -> None:
    scene = _mugs(["red", "", "green"])
    shown = replace(scene.objects["mug_1"], parameters={"color_shares": {"blue": 0.95}})
    scene = replace(scene, objects={**scene.objects, "mug_1": shown})
    for color, index in (("red", 0), ("blue", 1), ("green", 2)):
        goal = conjuncts(llm.propose(f"pick up the {color} mug", scene).task.goal)
        assert goal == {f"(inside mug_{index} gripper)"}
    with pytest.raises(llm.QueryError) as caught:
        llm.propose("pick up the black mug", scene)
    assert caught.value.code == "unknown-object"
