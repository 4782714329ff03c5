"""What a refused query is told, byte for byte; UPDATE_GOLDEN=1 writes the files anew: read the difference then."""

from __future__ import annotations

import os
from typing import get_args

import pytest

import llm
from tests.llm.kitchens import GOLDEN, SCENES

# Golden file -> scene and query of each message in it.
CASES = {
    "objects": (
        ("kitchen_t1", "put the banana into the fridge"),
        ("kitchen_t1", "put the glas into the refridgerator"),
        ("kitchen_t1", "put glass_1 into the fridge"),
        ("kitchen_t1", "put the second glass into the fridge"),
        ("kitchen_t1", "put the glasses into the fridge"),
        ("two_glasses", "put the cup into the fridge"),
        ("trio", "put both cups on the apple"),
        ("trio", "put three cups into the fridge"),
        ("trio", "pick up the glass to the right of the apple"),
        ("bedroom", "pick up the cup next to the book"),
        ("breakfast", "put the apple into the bowl and then put it into the fridge"),
        ("breakfast", "pick up the glass and put them into the fridge"),
        ("stocked", "pick up the apple on the table"),
        ("stocked", "take the apple from the cabinet"),
        ("stocked", "put the apple into the open fridge"),
        ("kitchen_t1", "close it"),
        ("open_world", "put the bowl into the fridge"),
    ),
    "actions": (
        ("kitchen_t1", "sing a song"),
        ("kitchen_t1", "clean the room"),
        ("kitchen_t1", "opne the fridge"),
        ("kitchen_t1", "dance"),
        ("kitchen_t1", "glass"),
        ("breakfast", "bring me the apple and the glass"),
        ("kitchen_t1", "stand the glass up"),
        ("kitchen_t1", "don't open the fridge"),
        ("kitchen_t1", "put the glass into the fridge without closing it"),
        ("kitchen_t1", "open the fridge and sing a song"),
        ("breakfast", "put the glass on the table and the apple in the fridge"),
        ("kitchen_t1", "put the glass away"),
        ("kitchen_t1", "put the glass next to the fridge"),
        ("kitchen_t1", " , please!"),
        ("kitchen_t1", "put the glass " + "on the table " * 7),
    ),
    "affordances": (
        ("kitchen_t1", "pick up the fridge"),
        ("kitchen_t1", "put the glass into the table"),
        ("kitchen_t1", "put the glass onto the fridge"),
        ("kitchen_t1", "put the glass into the glass"),
        ("kitchen_t1", "put the glass into the fridge door"),
        ("kitchen_t1", "open the glass"),
        ("kitchen_t1", "close the fridge"),
        ("kitchen_t1", "put the glass on the table"),
        ("kitchen_t3", "put the apple into the countertop"),
        ("kitchen_t3", "move the table to the apple"),
        ("full_hand", "put the glass into the fridge"),
        ("full_hand", "pick up the apple"),
        ("full_hand", "pick up the glass"),
        ("full_hand", "open the fridge"),
        ("breakfast", "take the milk out of the fridge and close it"),
        ("breakfast", "pick up the apple and the glass"),
        ("breakfast", "put the apple and the fridge into the bowl"),
        ("breakfast", "put the apple and the glass on the table"),
    ),
}


def refusal(scene: str, query: str) -> llm.QueryError:
    """Return the error that a query ends in."""
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(query, SCENES[scene])
    return caught.value


@pytest.mark.parametrize("group", CASES)
def test_messages(group: str) -> None:
    blocks = [f"# {scene}\n[{(error := refusal(scene, query)).code}] {error}\n" for scene, query in CASES[group]]
    text = "\n".join(blocks)
    path = GOLDEN / f"llm_{group}.txt"
    if os.environ.get("UPDATE_GOLDEN"):
        path.write_text(text, encoding="utf-8")
    assert text == path.read_text(encoding="utf-8")


def test_what_is_suggested_works() -> None:
    suggested = [
        (scene, text)
        for cases in CASES.values()
        for scene, query in cases
        for text in refusal(scene, query).suggestions
    ]
    assert suggested
    for scene, text in suggested:
        assert llm.propose(text, SCENES[scene]).expanded.task_name == text


def test_the_message_is_made_of_the_data() -> None:
    error = refusal("two_glasses", "put the cup into the fridge")
    assert error.query == "put the cup into the fridge"
    assert error.code in get_args(llm.RefusalCode)
    assert error.scene == ("glass_0 (water_glass) on table_0", "glass_1 (water_glass) on cabinet_0")
    for piece in (error.problem, error.understood, *error.scene, *error.suggestions):
        assert piece in str(error)


def test_a_long_query_is_cut_in_the_message_and_kept_in_the_data() -> None:
    query = "put the glass and " * 50
    error = refusal("kitchen_t1", query)
    assert error.code == "too-long"
    assert error.query == query
    assert max(map(len, str(error).splitlines())) < 250
