"""The 34 layouts: their numbers, what they cover, and what a malformed one is told."""

from __future__ import annotations

from collections import Counter

import pytest

from executor.assets.families import pantry
from executor.assets.library import LIBRARY, entry, kind
from executor.scenes.generators.household import CLUTTER, COUNT, KINDS, VARIATIONS, LayoutError, layouts, read
from oag.model.symbols import Kind

# What the paper's twenty printed examples are about.
PRINTED = (
    "open the refrigerator",
    "open the cabinet under the microwave",
    "open the bottom cabinet",
    "open the cabinet under the cup",
    "open the cabinet under the orange",
    "open the left cabinet",
    "pick up the water bottle on the counter",
    "pick up the water bottle on the table",
    "pick up the black die on the desk",
    "pick up the glass on the table",
    "pick up the half apple",
    "pick up the red apple from the cabinet",
    "pick up the apple on the table",
    "pick up the apple on the nightstand",
    "pick up the teddy bear on the nightstand",
    "pick up the half apple from the nightstand",
    "pick up the bottle of medicine on the table",
)


def test_there_are_as_many_rooms_as_in_the_paper() -> None:
    kinds = Counter(layout.room if layout.room in ("kitchen", "bedroom") else "other" for layout in layouts())
    assert kinds == {"kitchen": 16, "bedroom": 10, "other": 8}
    assert [layout.name for layout in layouts()] == list(dict.fromkeys(layout.name for layout in layouts()))
    assert len(layouts()) * VARIATIONS == COUNT == 102


def test_the_wishes_have_the_proportions_of_the_paper() -> None:
    wishes = [wish for layout in layouts() for wish in layout.wishes]
    assert Counter(wish.family for wish in wishes) == {"T5": 36, "T6": 66}
    assert all(len(layout.wishes) == VARIATIONS for layout in layouts())
    deeds = Counter(wish.deed for wish in wishes)
    assert deeds["open"] > deeds["close"] >= 3
    assert all((wish.start_fraction > 0.0) == (wish.deed == "close") for wish in wishes)


def test_the_printed_examples_of_the_paper_are_there() -> None:
    queries = {wish.query for layout in layouts() for wish in layout.wishes}
    assert set(PRINTED) <= queries


def test_everything_that_opens_and_everything_that_fits_a_hand_is_asked_for() -> None:
    models = {deed: set[str]() for deed in ("open", "close", "pick")}
    for layout in layouts():
        named = {thing.id: thing for thing in layout.things}
        for wish in layout.wishes:
            thing = named[wish.target]
            chosen = (thing.model,) if thing.model else KINDS[thing.kind].models
            models[wish.deed] |= {entry(model).category for model in chosen}
    opens = {entry(model).category for model in LIBRARY if kind(entry(model)) is Kind.ARTICULATED}
    items = {entry(model).category for model in LIBRARY if kind(entry(model)) is Kind.ITEM}
    # The rooms of T5 and T6 stay as they are; a wall cabinet and the pantry came into the library after them.
    items -= {entry.category for entry in pantry.MODELS}
    assert opens - models["open"] == {"wall_cabinet"}
    assert items - models["pick"] == {"plate", "lamp"}, "no hand of this size takes one, or it came later"


def test_what_kinds_and_clutter_name_is_in_the_library() -> None:
    for each in KINDS.values():
        assert set(each.single) <= set(each.models) <= set(LIBRARY)
    for models in CLUTTER.values():
        assert set(models) <= set(LIBRARY)
    assert {layout.room for layout in layouts()} <= set(CLUTTER)


def test_a_thing_that_starts_open_has_one_door() -> None:
    for layout in layouts():
        kind_of = {thing.id: thing for thing in layout.things}
        for wish in layout.wishes:
            thing = kind_of[wish.target]
            if wish.start_fraction > 0.0:
                assert KINDS[thing.kind].single, f"{layout.name}: no {thing.kind} has one door alone"
                assert not thing.model or thing.model in KINDS[thing.kind].single


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ('wall = ["table_0"]', "layout den01, has a key 'wall' that nothing reads"),
        ('east = ["spaceship_0"]', "east[0]: 'spaceship_0' begins with no kind of thing"),
        ('east = ["table_0", "table_0"]', "table_0: is there twice"),
        ('on.shelf_0 = ["cup_0"]', "shelf_0: is not in the room; it has cup_0"),
        ('east = ["table_0"]\non.table_0 = ["clutter many"]', "on.table_0[0]: 'clutter many' needs a number"),
        ('east = ["cabinet_0 cabinet_one_dor"]', "cabinet_0: 'cabinet_one_dor' is no model of a cabinet (cabinet_two"),
        ('east = ["table_0 front"]', "expected nothing"),
        ('east = ["table_0"]\non.table_0 = ["cup_0 frnot"]', "'frnot' is no model of a cup (cup); expected a side"),
        ("floor.table_0 = [1.0, 2.0]", "floor.table_0: entry 3 is missing"),
        ('wishes = [{ open = "door_0", query = "open it" }]', "door_0: is not in the room"),
        ('east = ["table_0"]\nwishes = [{ wash = "table_0" }]', "wishes[0]: expected one of open, close, pick"),
        (
            'east = ["table_0"]\nwishes = [{ pick = "table_0" }]',
            "wishes[0]: expected one of open, close, pick, and a query",
        ),
    ],
)
def test_a_malformed_layout_is_refused(lines: str, message: str) -> None:
    with pytest.raises(LayoutError) as refusal:
        read(f'[[layout]]\nname = "den01"\nsize_m = [3, 3]\n{lines}\n')
    assert message in str(refusal.value)


def test_a_layout_needs_a_size() -> None:
    with pytest.raises(LayoutError, match="layout den02, the field 'size_m' is missing"):
        read('[[layout]]\nname = "den02"\n')
