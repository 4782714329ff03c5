"""Sentences near to readable ones that mean something else: they are refused, or read for what they say."""

from __future__ import annotations

import pytest

import llm
from oag import Scene
from tests.llm.kitchens import SCENES, conjuncts

FLAT = SCENES["flat"]


@pytest.mark.parametrize(
    ("query", "code"),
    [
        # Going is not moving what was put down before.
        ("put the apple in the fridge and return to the table", "not-understood"),
        ("put the can in the bin, then move on to the sofa", "not-understood"),
        ("open the safe, put the keys in and return to the table", "not-understood"),
        ("open the safe and then place the keys inside and carry on to the sofa", "not-understood"),
        ("put the can on the sofa and put in the bin", "not-understood"),
        ("pick up the can and move onto the sofa", "not-understood"),
        # Two things stay two.
        ("put the big and small box on the table", "unknown-object"),
        ("throw the big and small box away", "unknown-object"),
        ("put the red and blue mug on the sofa", "unknown-object"),
        ("put the red and green mugs on the sofa", "unknown-object"),
        ("put the orange and small boxes on the sofa", "unknown-object"),
        ("put the cold and hot boxes on the table", "unknown-object"),
        ("put the small and medium boxes on the table", "unknown-object"),
        ("put the red and blue boxes on the table", "unknown-object"),
        ("put a medium box on the table", "unknown-object"),
        ("put the blue mug on the sofa and the other blue mug on the counter", "wrong-place"),
        ("put the other blue mug on the counter", "unknown-object"),
        # Another one, or one that is only alike.
        ("put the apple on a sofa and the can on another sofa", "several-objects"),
        ("put the apple on the sofa and another apple on the table", "several-objects"),
        ("put the can on an adjacent sofa", "unknown-object"),
        ("put the can on a similar sofa", "unknown-object"),
        ("put a matching mug on the sofa", "unknown-object"),
        ("put an identical mug on the sofa", "unknown-object"),
        ("put the soap and the salt on the sofa", "ambiguous-object"),
        ("put the mug on the table and the other mug on the sofa", "ambiguous-object"),
        ("put the other mug on the sofa", "unknown-object"),
        ("put the can on the table and put the other can on the sofa", "unknown-object"),
        ("move the can to the other drawer", "unknown-object"),
        ("put the can on the other table", "unknown-object"),
        # Only the one piece of furniture of a name is taken on trust, and nothing that may be moved along.
        ("pick up the can by the window", "unknown-object"),
        ("put the can in the drawer by the window", "unknown-object"),
        ("put the can in the bowl by the window", "unknown-object"),
        ("put the can on the table next to the spoon", "unknown-object"),
        # A side table is a table too, and the top of a cabinet a counter.
        ("put the can on the table by the window", "unknown-object"),
        ("put the can on the table against the wall", "unknown-object"),
        ("put the can on the table to the right of the sofa", "wrong-place"),
        ("put the can on the table at the end of the sofa", "wrong-place"),
        ("put the can on the counter with the fridge", "affordance"),
        # What is moved to a place is not there.
        ("move the can on the sofa to the end of the counter", "wrong-place"),
        ("put the can on the counter with the spoon", "unknown-object"),
        ("put the can on the table under the sofa", "wrong-place"),
        ("pick up the remote to the right of the armchair", "wrong-place"),
        # "The bowl on the sofa" is one that stands there.
        ("put the apple in the bowl on the sofa", "wrong-place"),
        ("put the apple next to a bowl on the sofa", "wrong-place"),
        ("put apple next to bowl on sofa", "wrong-place"),
        # What is moved is not said to go anywhere.
        ("move the can and open the fridge", "missing-place"),
        ("move the can from the armchair", "missing-place"),
        # "With" is together with, too.
        ("put the red mug with the salt on the counter", "ambiguous-reading"),
        ("put the red mug with plate_1 on the counter", "ambiguous-reading"),
        ("put a mug with a mug on the counter", "ambiguous-reading"),
        ("put the remote with the keys on the table", "ambiguous-reading"),
        ("put the bowl on the counter with the apple", "ambiguous-reading"),
        ("put the apple on the plate with the plate", "ambiguous-object"),
        # Where to, or which one.
        ("throw the remote on the sofa", "unknown-action"),
        ("throw the apple in the safe", "unknown-action"),
        ("pick up the mug at the edge of the table", "ambiguous-object"),
        ("find the fridge and put it on the table", "not-understood"),
        ("find the sofa and the table and put the can on it", "not-understood"),
        ("find the apple and open the fridge", "unknown-action"),
        ("I want the mugs off the table", "already-so"),
        ("put the head of lettuce on the counter", "unknown-object"),
    ],
)
def test_what_may_mean_something_else_is_refused(query: str, code: str) -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(query, FLAT)
    assert caught.value.code == code


@pytest.mark.parametrize(
    ("query", "goal"),
    [
        ("put the apple in the fridge, return to the sofa and pick up the remote", "(inside apple_0 refrigerator_0)"),
        ("pick up the can, move to the fridge and put in the fridge", "(inside can_0 refrigerator_0)"),
        ("pick up the can and carry to the sofa", "(ontop can_0 sofa_0)"),
        ("put the yellow and white apple in the bowl", "(inside apple_0 bowl_0)"),
        ("put the bowl with salt on the sofa", "(inside salt_shaker_0 bowl_0)"),
        ("put the bowl containing the apple on the sofa", "(inside apple_0 bowl_0)"),
        ("put the red mug at the edge of the table in the fridge", "(inside mug_0 refrigerator_0)"),
        ("put the can in the corner of the table", "(ontop can_0 table_0)"),
        ("put the keys in the corner of the safe", "(inside key_chain_1 safe_0)"),
        ("find the safe and open it", "(open safe_0)"),
        ("find the bowl and the apple, and put the apple in the bowl", "(inside apple_0 bowl_0)"),
        ("I want the remote from the sofa", "(ontop remote_control_0 table_0)"),
        ("throw the can on the armchair away", "(inside can_0 garbage_can_0)"),
        # A name for each of the describing words, or for each of the things that there are.
        ("put the big and small boxes on the table", "(ontop box_1 table_0)"),
        ("put the big and small boxes and the can on the table", "(ontop can_0 table_0)"),
        ("put all the containers on the sofa", "(ontop mug_0 sofa_0)"),
        ("put the red and blue mugs on the sofa", "(ontop mug_0 sofa_0)"),
        ("put both red and blue coffee mugs on the sofa", "(ontop mug_1 sofa_0)"),
        ("put the mug and the cup on the sofa", "(ontop mug_1 sofa_0)"),
        ("put a knife in the safe, then put the other knife on the sofa", "(ontop knife_1 sofa_0)"),
        ("put the red mug on the sofa and the other mug on the counter", "(ontop mug_1 counter_0)"),
        ("open a drawer and open another drawer", "(open drawer_1)"),
        # Where the only piece of furniture of a name stands.
        ("put the can on the sofa by the window", "(ontop can_0 sofa_0)"),
        ("put the can on the sofa against the wall", "(ontop can_0 sofa_0)"),
        ("put the can on the sofa to the left of the table", "(ontop can_0 sofa_0)"),
        ("put the can on the sofa at the end of the counter", "(ontop can_0 sofa_0)"),
        ("put the can on the sofa with the fridge", "(ontop can_0 sofa_0)"),
        # Forms of sentences.
        ("put apple in bowl on sofa", "(ontop bowl_0 sofa_0)"),
        ("move the can from the armchair and put it in the bin", "(inside can_0 garbage_can_0)"),
        ("stand the can on the stand", "(ontop can_0 side_table_0)"),
        ("put two knives, one at a time, in the safe", "(inside knife_1 safe_0)"),
        ("put the keys that are sitting on the side table in the safe", "(inside key_chain_1 safe_0)"),
        ("put the can in the far left corner of the table", "(ontop can_0 table_0)"),
        ("move the can to the top drawer of the cabinet", "(inside can_0 cabinet_0)"),
    ],
)
def test_what_says_one_thing_is_read(query: str, goal: str) -> None:
    assert goal in conjuncts(llm.propose(query, FLAT).task.goal)


def test_a_colour_that_names_a_thing_is_one_of_two() -> None:
    table = {"category": "table", "position": [1.0, 0.0, 0.3], "bbox_extent": [0.6, 1.4, 0.6]}
    counter = {"category": "countertop", "position": [0.0, 2.0, 0.45], "bbox_extent": [1.6, 0.6, 0.9]}
    items = {
        f"{kind}_0": {"category": kind, "position": [1.0, y_m, 0.65], "bbox_extent": [0.05, 0.05, 0.06]}
        for kind, y_m in (("orange", 0.0), ("egg", 0.3))
    }
    objects = {"table_0": table, "countertop_0": counter, **items}
    facts = [f"(ontop {key} table_0)" for key in items]
    scene = Scene.from_json({"name": "fruit", "objects": objects, "facts": facts, "closed": ["ontop"]})
    goal = conjuncts(llm.propose("put the orange and white egg on the counter", scene).task.goal)
    assert goal == {"(ontop orange_0 countertop_0)", "(ontop egg_0 countertop_0)"}


DESKS = Scene.from_json(
    {
        "name": "study",
        "objects": {
            **{
                f"{kind}_{n}": {"category": kind, "position": [1.0, n - 1.0, z_m], "bbox_extent": size_m}
                for n in range(2)
                for kind, z_m, size_m in (("desk", 0.35, [0.6, 0.8, 0.7]), ("pencil", 0.71, [0.01, 0.15, 0.01]))
            },
            "shelf_0": {"category": "shelf", "position": [3.0, 0.0, 0.4], "bbox_extent": [0.3, 0.8, 0.8]},
            "sofa_0": {"category": "sofa", "position": [-2.0, 0.0, 0.3], "bbox_extent": [0.9, 1.6, 0.6]},
            "microwave_0": {"category": "microwave", "position": [1.0, 0.0, 0.85], "bbox_extent": [0.4, 0.4, 0.3]},
            "apple_0": {"category": "apple", "position": [-2.0, 0.0, 0.63], "bbox_extent": [0.06, 0.06, 0.06]},
        },
        "facts": [
            "(ontop pencil_0 desk_0)",
            "(ontop pencil_1 desk_1)",
            "(ontop microwave_0 desk_1)",
            "(ontop apple_0 sofa_0)",
        ],
        "closed": ["ontop"],
    }
)


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        ("move pencil_0 to the other desk", {"(ontop pencil_0 desk_1)"}),
        ("move pencil_1 from one desk to the other desk", {"(ontop pencil_1 desk_0)"}),
        ("move pencil_0 to an adjacent desk", "unknown-object"),
        ("move pencil_0 to another desk", {"(ontop pencil_0 desk_1)"}),
        ("move a pencil to the other desk", {"(ontop pencil_0 desk_1)"}),
        ("move the pencils to the other desk", "unknown-object"),
        ("move pencil_0 to the desk", "ambiguous-object"),
        ("go to the other desk and pick up pencil_0", "unknown-object"),
        # The one that is named tells which is the other, not the one where a thing is.
        ("put the apple on desk_1 and pencil_0 on the other desk", "wrong-place"),
        (
            "put the apple on desk_1 and pencil_1 on the other desk",
            {"(ontop apple_0 desk_1)", "(ontop pencil_1 desk_0)"},
        ),
        ("go to desk_1, pick up pencil_1 and put it on the other desk", {"(ontop pencil_1 desk_0)"}),
        ("pick up pencil_1 from desk_1 and put it on the other desk", {"(ontop pencil_1 desk_0)"}),
        ("put pencil_1 on desk_0 and the apple on another desk", {"(ontop pencil_1 desk_0)", "(ontop apple_0 desk_1)"}),
        # It is said to stand on a desk.
        ("put pencil_0 on the sofa with the microwave", "affordance"),
        ("put pencil_0 on the bottom shelf", {"(ontop pencil_0 shelf_0)"}),
        ("put pencil_0 on the office shelf", {"(ontop pencil_0 shelf_0)"}),
        # The shelf of a desk is not the one next to it.
        ("put pencil_0 on the desk shelf", "unknown-object"),
        ("put pencil_0 on the dresser shelf", "unknown-object"),
        ("put pencil_0 on the entertainment center shelf", "unknown-object"),
    ],
)
def test_of_several_places_the_one_that_a_sentence_says_is_meant(query: str, wanted: set[str] | str) -> None:
    try:
        found: set[str] | str = set(conjuncts(llm.propose(query, DESKS).task.goal))
    except llm.QueryError as error:
        found = error.code
    assert found == wanted


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("put the can on the sofa by the window", '"by window" is taken on trust: nothing in flat is called "window"'),
        (
            "put the can on the sofa to the left of the table",
            '"to the left of table" is taken on trust: sofa_0 is not',
        ),
        ("put the can on the sofa with the fridge", '"with fridge" is taken on trust'),
        (
            "put the red mug on the table and the other nice mug on the sofa",
            '"nice" is taken on trust: the scene does not describe mug_1 so',
        ),
    ],
)
def test_a_place_that_is_not_confirmed_is_noted(query: str, said: str) -> None:
    assert any(note.startswith(said) for note in llm.propose(query, FLAT).notes)


@pytest.mark.parametrize(
    ("query", "said"),
    [
        ("put the red and blue mug on the sofa", "red and blue at once: mug_0 is red; mug_1 is blue; name each"),
        ("put the big and small box on the table", '"big" describes a thing, and no name follows it'),
    ],
)
def test_two_describing_words_of_one_name_are_explained(query: str, said: str) -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(query, FLAT)
    assert said in caught.value.problem


def test_both_meanings_of_with_are_suggested() -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose("put the bowl with the apple on the counter", FLAT)
    together, within = caught.value.suggestions
    assert llm.propose(together, FLAT).expanded.task_name == together
    assert llm.propose(within, FLAT).expanded.task_name == within
