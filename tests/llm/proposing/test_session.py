"""The part of a scene that module 1 sees."""

from __future__ import annotations

import pytest

import oag
from llm.proposing.session import mentioned
from llm.structured.prompting import scene_table


def room(cups: int, books: int) -> oag.Scene:
    """Return a room with cups on a table and books on a sofa."""
    items = {**{f"cup_{n}": "cup" for n in range(cups)}, **{f"book_{n}": "book" for n in range(books)}}
    facts = [f"(ontop {key} {'table_0' if kind == 'cup' else 'sofa_0'})" for key, kind in items.items()]
    return oag.scene({**items, "table_0": "table", "fridge_0": "fridge", "sofa_0": "sofa"}, facts)


@pytest.mark.parametrize("query", ["tidy up the room", "I am thirsty", "stelle die Tasse in den Kühlschrank"])
def test_a_query_without_a_name_of_the_scene_is_about_all_of_it(query: str) -> None:
    scene = room(20, 15)
    assert mentioned(query, scene) == {*scene.objects}
    assert "book_14" not in mentioned("put the cup into the fridge", scene)


def test_of_a_scene_beyond_a_prompt_the_largest_part_is_shown_and_the_rest_counted() -> None:
    scene = room(400, 50)
    shown = mentioned("tidy up the room", scene)
    table = scene_table(scene, shown)
    assert 8_500 < len(table) <= 9_000
    assert {"table_0", "fridge_0", "sofa_0", "cup_0", "book_0"} <= shown < {*scene.objects}
    cups = 400 - sum(key.startswith("cup") for key in shown)
    assert f'not listed: {cups} "cup"' in table
