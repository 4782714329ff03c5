"""Every word of a query is understood, or the query is refused and the words are named: none is dropped."""

from __future__ import annotations

from dataclasses import replace

import pytest

import llm
from oag import Scene
from tests.llm.kitchens import FIRST_WORDS, SCENES, Phrasing, conjuncts, mostly_slow


def _box(category: str, size_m: list[float], y: float, model: str = "", z: float = 0.0) -> dict[str, object]:
    named = {"model": model} if model else {}
    return {"category": category, "bbox_extent": size_m, "position": [1.0, y, z], **named}


# One thing that opens by drawers, two that open by doors, and one that nobody says it of.
ROOM = Scene.from_json(
    {
        "name": "room",
        "objects": {
            "cabinet_0": _box("bottom_cabinet", [0.6, 0.5, 0.8], 2.0, "cabinet_drawers"),
            "cabinet_1": _box("bottom_cabinet", [0.6, 0.9, 0.8], 1.0, "cabinet_two_doors"),
            "cupboard_0": _box("cabinet", [0.6, 0.9, 0.8], -2.0, "mine"),
            "refrigerator_0": _box("refrigerator", [0.7, 0.6, 1.3], 0.0, "fridge_freezer_drawer"),
            "table_0": _box("table", [0.6, 0.9, 0.6], -1.0),
            "glass_0": _box("water_glass", [0.07, 0.07, 0.12], -1.0, z=0.66),
            "apple_0": _box("apple", [0.08, 0.08, 0.08], -1.2, z=0.64),
            "apple_1": _box("apple", [0.08, 0.08, 0.08], -0.8, z=0.64),
        },
        "facts": ["(ontop glass_0 table_0)", "(ontop apple_0 table_0)", "(ontop apple_1 table_0)"],
        "closed": ["ontop", "inside", "open"],
    }
)


def refusal(query: str, scene: Scene) -> llm.QueryError:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(query, scene)
    return caught.value


def goal(query: str, scene: Scene) -> frozenset[str]:
    return conjuncts(llm.propose(query, scene).task.goal)


@pytest.mark.parametrize("word", ["quux", "third", "%", "\N{NO ENTRY SIGN}"])
@pytest.mark.parametrize("phrasing", mostly_slow(FIRST_WORDS[::5], 3), ids=lambda phrasing: phrasing.query)
def test_a_word_that_says_something_else_is_not_passed_over(phrasing: Phrasing, word: str) -> None:
    words = phrasing.query.split()
    for index in range(len(words) + 1):
        error = refusal(" ".join([*words[:index], word, *words[index:]]), SCENES[phrasing.scene])
        assert word in error.problem or word == "third", error.problem


@pytest.mark.parametrize(
    ("query", "code", "named"),
    [
        ("open the top drawer", "unknown-object", "top"),
        ("open the first drawer", "unknown-object", "first"),
        ("open the left door", "unknown-object", "left"),
        ("open the drawer of cabinet_1", "affordance", "drawer"),
        ("open the drawer of cupboard_0", "affordance", "drawer"),
        ("open the drawer of the fridge", "affordance", "drawer"),
        ("open the door of cabinet_0", "affordance", "door"),
        ("open all the drawers", "several-objects", "drawers"),
        ("open every drawer", "several-objects", "drawer"),
        ("open both doors of cabinet_1", "several-objects", "doors"),
        ("open the window of cabinet_1", "unknown-object", "window"),
        ("open the green dragon door of cabinet_1", "unknown-object", "dragon"),
        ("put the glass into the fridge, wait 10 seconds and take it out", "not-understood", "wait 10 seconds"),
        ("turn on the fridge", "unknown-action", "turn"),
        ("open the fridge 50%", "unknown-object", "50 %"),
        ("put the glass/apple_0 into the fridge", "not-understood", "/"),
        ("open the fridge and go to the table", "not-understood", "table_0"),
        ("go to the table and open the fridge", "not-understood", "table_0"),
        ("put some apples into the fridge", "ambiguous-object", "apples"),
        ("put the left apple on the right into the fridge", "not-understood", ""),
        ("set the table", "affordance", "table_0"),
    ],
)
def test_what_no_plan_can_follow_is_refused(query: str, code: str, named: str) -> None:
    error = refusal(query, ROOM)
    assert error.code == code
    assert named in error.problem


def test_two_doors_are_no_drawer() -> None:
    doors_alone = replace(ROOM, objects={key: thing for key, thing in ROOM.objects.items() if key != "cabinet_0"})
    error = refusal("open the drawer, put the glass in, close it", doors_alone)
    assert error.code == "unknown-object"
    assert "drawer" in error.problem
    assert any("cabinet_1" in line for line in error.scene)


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        ("open the drawer", {"(open cabinet_0)"}),
        ("slide the drawer of cabinet_0 open", {"(open cabinet_0)"}),
        ("put the glass into the drawer", {"(inside glass_0 cabinet_0)", "(not (open cabinet_0))"}),
        (
            "open cabinet_0, put the glass in, close the drawer",
            {"(inside glass_0 cabinet_0)", "(not (open cabinet_0))"},
        ),
        ("open the door of the fridge", {"(open refrigerator_0)"}),
        ("open cabinet_1, open the fridge, then close the door", {"(open cabinet_1)", "(not (open refrigerator_0))"}),
        ("open the door of cupboard_0", {"(open cupboard_0)"}),
        ("go to the table and pick up the glass", {"(inside glass_0 gripper)"}),
        ("walk to the fridge and open it", {"(open refrigerator_0)"}),
        (
            "put the glass in the fridge and apple_0 too",
            {"(inside glass_0 refrigerator_0)", "(inside apple_0 refrigerator_0)", "(not (open refrigerator_0))"},
        ),
        (
            "put the glass in the fridge, close it too",
            {"(inside glass_0 refrigerator_0)", "(not (open refrigerator_0))"},
        ),
        (
            "both apples go into the fridge",
            {"(inside apple_0 refrigerator_0)", "(inside apple_1 refrigerator_0)", "(not (open refrigerator_0))"},
        ),
        (
            "the apples need to be in the fridge",
            {"(inside apple_0 refrigerator_0)", "(inside apple_1 refrigerator_0)", "(not (open refrigerator_0))"},
        ),
    ],
)
def test_what_is_understood(query: str, wanted: set[str]) -> None:
    assert goal(query, ROOM) == wanted


@pytest.mark.parametrize(
    ("query", "note"),
    [
        ("put the left glass into the fridge", '"left"'),
        ("put the glass on the left table into the fridge", '"left"'),
        ("take the glass from the red table", '"red"'),
        ("clear the table into the blue fridge", '"blue"'),
        ("open the green door of cabinet_1", '"green"'),
        ("open the door of the white fridge", '"white"'),
        ("open all the doors", "one door"),
        ("open the doors of cabinet_1", "one door"),
    ],
)
def test_what_is_taken_on_trust_is_noted(query: str, note: str) -> None:
    notes = llm.propose(query, ROOM).notes
    assert any(note in text for text in notes), notes


@pytest.mark.parametrize(
    "query",
    [
        "stell das glas in den kühlschrank",
        "把杯子放进冰箱",
        "mets le verre dans le frigo",
        "pon el vaso en la nevera",
        "поставь стакан в холодильник",
        "öffne refrigerator_0",
    ],
)
def test_another_language_is_called_so(query: str) -> None:
    assert "English" in refusal(query, ROOM).problem


@pytest.mark.parametrize("query", ["opne the fridge", "put the glas into the fridge", "dance", "put the glass on Mars"])
def test_what_is_english_is_not_called_another_language(query: str) -> None:
    assert "English" not in refusal(query, ROOM).problem


def test_each_misspelt_name_is_named_with_what_is_nearest() -> None:
    problem = refusal("put the glas into the refridgerator", ROOM).problem
    for name in ('"glas"', '"refridgerator"', "glass_0", "refrigerator_0"):
        assert name in problem


def test_what_was_understood_has_no_verb_that_nobody_said() -> None:
    assert not refusal("glass_0 on the fridge", ROOM).understood.startswith("put")


def test_what_opens_by_nobody_knows_what_is_opened_by_its_own_name() -> None:
    error = refusal("open the drawer of cupboard_0", ROOM)
    assert "open cupboard_0" in error.suggestions
