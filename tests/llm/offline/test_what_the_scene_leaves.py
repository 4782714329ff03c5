"""Where a sentence leaves a choice, the scene decides: the one place, the one part, the nearest surface."""

from __future__ import annotations

import pytest

import llm
import oag
from oag import Scene
from tests.llm.kitchens import SCENES, conjuncts, noted

_SIZES = {
    "refrigerator": [0.7, 0.7, 1.5], "table": [0.6, 0.8, 0.6], "bed": [1.9, 1.2, 0.6], "chair": [0.4, 0.4, 0.8],
    "nightstand": [0.4, 0.5, 0.5], "floor": [9.0, 9.0, 0.02], "oven": [0.6, 0.6, 0.85],
}  # fmt: skip


def _home(
    furniture: dict[str, tuple[float, float]], things: dict[str, str], models: dict[str, str] | None = None
) -> Scene:
    """Return furniture at places [m], and things in refrigerators, in boxes and on all else."""
    places = {key: [*at, _SIZES[key[:-2]][2] / 2] for key, at in furniture.items()}
    objects: dict[str, dict[str, object]] = {
        key: {
            "category": key[:-2],
            "position": at,
            "bbox_extent": _SIZES[key[:-2]],
            "model": (models or {}).get(key, key[:-2]),
        }
        for key, at in places.items()
    }
    for key, host in things.items():
        size = [0.2, 0.2, 0.1] if key.startswith("box") else [0.05, 0.05, 0.05]
        place = places.setdefault(key, places[host])
        objects[key] = {"category": key[:-2], "position": place, "bbox_extent": size}
    inside = ("refrigerator", "box")
    facts = [f"({'inside' if host.startswith(inside) else 'ontop'} {key} {host})" for key, host in things.items()]
    facts += [f"(not (open {key}))" for key in furniture if key.startswith(("refrigerator", "oven"))]
    return Scene.from_json({"name": "home", "objects": objects, "facts": facts, "closed": ["ontop", "inside", "open"]})


def _outcome(query: str, scene: Scene) -> set[str] | str:
    try:
        return set(conjuncts(llm.propose(query, scene).task.goal))
    except llm.QueryError as error:
        return error.code


ALIKE = _home(
    {"refrigerator_0": (2.0, 1.5), "refrigerator_1": (2.0, -1.5), "table_0": (0.0, 2.0), "table_1": (0.0, -2.0)},
    {
        "bottle_0": "table_0", "bottle_1": "refrigerator_1", "apple_0": "table_0", "apple_1": "table_1",
        "egg_0": "refrigerator_0", "egg_1": "refrigerator_1", "box_0": "table_0", "box_1": "box_0", "can_0": "box_1",
    },
)  # fmt: skip
HELD = {"(inside bottle_1 gripper)"}


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        # A place that is said twice.
        ("pick up the bottle in the fridge that is in the fridge", HELD),
        ("pick up the bottle in the fridge that is in the refrigerator", HELD),
        ("pick up the bottle in the fridge that is in the right fridge", HELD),
        ("pick up the bottle in the fridge that is in the left fridge", "wrong-place"),
        ("pick up the bottle in the fridge that is on the table", "wrong-place"),
        ("pick up the egg in the fridge that is in the fridge", "ambiguous-object"),
        ("pick up the apple in the fridge that is in the fridge", "wrong-place"),
        # A box in a box is no box said twice.
        ("pick up the can in the box that is in the box", {"(inside can_0 gripper)"}),
        # Taken from the one place that has such a thing.
        ("get the bottle in the fridge from the refrigerator", HELD),
        ("take the bottle in the fridge", HELD),
        (
            "take the bottle in the fridge and put it on the left table",
            {"(ontop bottle_1 table_0)", "(not (open refrigerator_1))"},
        ),
        ("get the egg in the fridge from the refrigerator", "ambiguous-object"),
        ("get the bottle on the table in the fridge", "ambiguous-object"),
        ("put the bottle in the fridge", "ambiguous-object"),
        ("move the can from the box to the fridge", "ambiguous-object"),
        ("take the bottle in the fridge and put it in the fridge", "ambiguous-object"),
    ],
)
def test_the_one_place_of_a_thing_is_meant(query: str, wanted: set[str] | str) -> None:
    assert _outcome(query, ALIKE) == wanted


@pytest.mark.parametrize(
    ("models", "query", "wanted"),
    [
        (("fridge_side_by_side", "fridge_top_freezer"), "open the left door of the fridge", "refrigerator_0"),
        (("fridge_side_by_side", "fridge_top_freezer"), "open the top door of the fridge", "refrigerator_1"),
        (("fridge_one_door", "fridge_two_doors"), "open the right door of the refrigerator", "refrigerator_1"),
        (("fridge_one_door", "fridge_top_freezer"), "open the left door of the fridge", ""),
        (("fridge_side_by_side", "fridge_two_doors"), "open the left door of the fridge", ""),
        # Of a model whose name says nothing, nothing is known.
        (("fridge_side_by_side", "fridge_17"), "open the left door of the fridge", ""),
        (("fridge_side_by_side", "fridge_top_freezer"), "open the door of the fridge", ""),
    ],
)
def test_a_part_that_one_alone_has_decides_the_whole(models: tuple[str, str], query: str, wanted: str) -> None:
    at = {"refrigerator_0": (2.0, 0.0), "refrigerator_1": (-2.0, 0.0)}
    scene = _home(at, {}, dict(zip(at, models, strict=True)))
    assert _outcome(query, scene) == ({f"(open {wanted})"} if wanted else "ambiguous-object")


DICE = _home(
    {"oven_0": (3.0, 2.0), "oven_1": (3.0, -2.0), "table_0": (1.0, 0.0), "nightstand_0": (0.0, 3.0)},
    {"die_0": "nightstand_0", "die_1": "table_0", "die_2": "oven_1", "mug_0": "nightstand_0", "cup_0": "oven_0"},
)


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        ("I'd like the die on the nightstand", {"(ontop die_0 table_0)"}),
        ("I'd like the die on the nightstand, please", {"(ontop die_0 table_0)"}),
        ("I'd like the die closest to the nightstand", {"(ontop die_0 table_0)"}),
        # The mug can be put on the table, and the cup on the other oven.
        ("I'd like the mug on the table", {"(ontop mug_0 table_0)"}),
        ("I'd like the cup on the oven", "ambiguous-object"),
        ("I'd like the die", "ambiguous-object"),
        ("I'd like the die on the left oven", "ambiguous-object"),
        ("I'd like the die and the mug on the nightstand", "ambiguous-object"),
        ("put the die on the nightstand", "ambiguous-object"),
        ("I'd like the mug on the nightstand", "already-so"),
    ],
)
def test_a_wish_to_have_a_thing_that_its_place_names(query: str, wanted: set[str] | str) -> None:
    assert _outcome(query, DICE) == wanted


def test_what_a_place_is_said_for_is_noted() -> None:
    notes = llm.propose("I'd like the die on the nightstand", DICE).notes
    assert "where die_0 is tells which one is meant, and not where it shall be" in notes


BEDROOM = _home(
    {
        "nightstand_0": (2.0, 0.0), "bed_0": (2.0, 1.0), "chair_0": (2.0, -0.6), "table_0": (0.0, 2.0),
        "table_1": (-3.0, 0.0), "floor_0": (0.0, 0.0),
    },
    {"mug_0": "nightstand_0", "book_0": "nightstand_0", "candle_0": "table_1", "candle_1": "floor_0"},
)  # fmt: skip


@pytest.mark.parametrize(
    "query", ["clear the nightstand", "tidy up the nightstand", "put away everything on the nightstand"]
)
def test_what_has_no_usual_place_goes_onto_the_nearest_surface(query: str) -> None:
    """A bed and a chair are nearer, and nothing is put onto the floor."""
    proposal = llm.propose(query, BEDROOM)
    assert conjuncts(proposal.task.goal) == {"(ontop mug_0 table_0)", "(ontop book_0 table_0)"}
    assert "no usual place of mug_0 is known; table_0 is the nearest other surface" in proposal.notes


@pytest.mark.parametrize("query", ["put away all the fruit on the table", "put all the fruit on the table away"])
def test_all_of_a_name_are_put_away_from_where_they_are(query: str) -> None:
    """The table is where the fruit is, and not where it shall go; the mug there stays."""
    scene = _home(
        {"table_0": (0.0, 0.0), "refrigerator_0": (2.0, 0.0), "bed_0": (0.0, 4.0)},
        {"apple_0": "table_0", "mug_0": "table_0"},
    )
    assert "(inside apple_0 refrigerator_0)" in _outcome(query, scene)
    assert not any("mug_0" in literal for literal in _outcome(query, scene))


DESKS = oag.scene(
    {
        "desk_0": "desk",
        "desk_1": "desk_with_drawers",
        "nightstand_0": "nightstand",
        "apple_0": "apple",
        "cup_0": "cup",
        "cup_1": "cup",
    },
    ["(inside apple_0 desk_1)", "(ontop cup_0 desk_0)", "(ontop cup_1 nightstand_0)"],
    closed="all",
)


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        ("take the apple out of the desk", {"(inside apple_0 gripper)"}),
        ("pick up the apple on the desk", "wrong-place"),
        ("take the apple out of the nightstand", "wrong-place"),
    ],
)
def test_a_holder_that_a_name_fits_less_well_is_meant_where_it_alone_has_the_thing(
    query: str, wanted: set[str] | str
) -> None:
    assert _outcome(query, DESKS) == wanted


def test_what_is_taken_off_its_place_is_not_put_there_first() -> None:
    query = "take the cup on the desk off the desk and put it on the nightstand"
    task = llm.propose(query, DESKS).task
    assert conjuncts(task.goal) == {"(ontop cup_0 nightstand_0)"} and len(task.subtasks) == 2


def test_seats_take_things_where_nothing_else_does() -> None:
    scene = _home(
        {"nightstand_0": (2.0, 0.0), "bed_0": (2.0, 1.5), "chair_0": (2.0, -0.6), "floor_0": (0.0, 0.0)},
        {"mug_0": "nightstand_0"},
    )
    assert _outcome("clear the nightstand", scene) == {"(ontop mug_0 chair_0)"}


def test_what_has_a_usual_place_goes_there_and_the_rest_onto_the_nearest_surface() -> None:
    proposal = llm.propose("clear the armchair", SCENES["flat"])
    assert {"(inside can_0 refrigerator_0)", "(ontop tissue_box_0 table_0)"} <= conjuncts(proposal.task.goal)
    assert "refrigerator_0 is taken for the usual place of can_0" in proposal.notes


def test_tidying_leaves_what_lies_on_furniture_and_takes_up_what_lies_on_the_floor() -> None:
    proposal = llm.propose("tidy up the room", BEDROOM)
    assert conjuncts(proposal.task.goal) == {"(ontop candle_1 table_0)"}
    assert "no usual place of candle_0 is known; it stays where it is" in proposal.notes


@pytest.mark.parametrize(
    ("query", "wanted"),
    [
        ("bring me the glass", {"(inside glass_0 gripper)"}),
        ("I'd like the glass", {"(inside glass_0 gripper)"}),
        (
            "bring me the glass and put it in the fridge",
            {"(inside glass_0 refrigerator_0)", "(not (open refrigerator_0))"},
        ),
        ("put the glass on the table", "already-so"),
    ],
)
def test_what_is_brought_and_there_already_is_held(query: str, wanted: set[str] | str) -> None:
    assert _outcome(query, SCENES["kitchen_t1"]) == wanted


def test_what_is_in_the_nearest_thing_is_brought_onto_it() -> None:
    scene = _home({"refrigerator_0": (1.0, 0.0), "table_0": (0.0, 3.0)}, {"egg_0": "refrigerator_0"}).to_json()
    cabinet = {"category": "bottom_cabinet", "position": [0.6, 0.0, 0.4], "bbox_extent": [0.4, 0.6, 0.8]}
    scene["objects"]["cabinet_0"] = cabinet
    scene["facts"] = ["(inside egg_0 cabinet_0)", "(not (open cabinet_0))"]
    assert _outcome("bring me the egg", Scene.from_json(scene)) == {"(ontop egg_0 cabinet_0)", "(not (open cabinet_0))"}


def test_that_it_is_held_is_said_and_two_things_are_not() -> None:
    (note,) = noted(llm.propose("bring me the glass", SCENES["kitchen_t1"]))
    assert (
        note == "glass_0 stands already on table_0, the nearest surface to the robot's start; it is picked up and held"
    )
    assert _outcome("bring me the apple and the glass", SCENES["breakfast"]) == "already-so"


@pytest.mark.parametrize(
    ("query", "code"),
    [
        ("stand the mug up", "already-so"),
        ("stand the mug upright", "already-so"),
        ("stand the mug", "missing-place"),
        ("put the mug up", "missing-place"),
    ],
)
def test_standing_a_thing_up_is_no_placing_without_a_place(query: str, code: str) -> None:
    assert _outcome(query, BEDROOM) == code
    assert _outcome("stand the mug on the table", SCENES["flat"]) != code


def test_what_no_hand_can_take_is_said_before_where_it_cannot_go() -> None:
    """A plate of 0.4 m can neither be taken nor be put onto the refrigerator; the mug can be taken."""
    things = {"plate_0": "table_0", "mug_0": "table_0"}
    scene = _home({"refrigerator_0": (2.0, 0.0), "table_0": (0.0, 2.0)}, things).to_json()
    scene["objects"]["plate_0"]["bbox_extent"] = [0.4, 0.4, 0.02]
    wide = Scene.from_json(scene)
    assert _outcome("put the plate onto the fridge", wide) == "too-large"
    assert _outcome("put the mug onto the fridge", wide) == "affordance"
