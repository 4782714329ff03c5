"""Names that are a thing's own come before names that it shares; what is suggested can be done; no size is too much."""

from __future__ import annotations

from collections.abc import Callable

import pytest

import llm
from llm.offline import planner
from llm.offline.names import Names
from oag import Scene
from tests.llm.kitchens import conjuncts

TABLE = {"category": "table", "bbox_extent": [0.6, 0.9, 0.6], "position": [1.0, 0.0, 0.3]}
FRIDGE = {"category": "refrigerator", "bbox_extent": [0.7, 0.6, 1.3], "position": [0.0, 2.0, 0.65]}


def _scene(items: dict[str, dict[str, object]]) -> Scene:
    return Scene.from_json(
        {
            "name": "made",
            "objects": {"table_0": TABLE, "refrigerator_0": FRIDGE, **items},
            "facts": [f"(ontop {key} table_0)" for key in items],
            "closed": ["ontop", "inside", "open"],
        }
    )


def _thing(category: str, size_m: list[float], model: str = "") -> dict[str, object]:
    return {"category": category, "bbox_extent": size_m, "position": [1.0, 0.0, 0.66], "model": model or category}


GLASS_SIZE = [0.07, 0.07, 0.12]
MUG_SIZE = [0.11, 0.08, 0.09]


@pytest.mark.parametrize(
    ("word", "items", "meant"),
    [
        ("glass", {"thing_1": _thing("water_glass", GLASS_SIZE), "mug_0": _thing("mug", MUG_SIZE)}, "thing_1"),
        ("mug", {"thing_1": _thing("water_glass", GLASS_SIZE), "mug_0": _thing("mug", MUG_SIZE)}, "mug_0"),
        ("tumbler", {"a_1": _thing("water_glass", GLASS_SIZE, "tumbler"), "b_1": _thing("mug", MUG_SIZE)}, "a_1"),
        ("cup", {"a_1": _thing("water_glass", GLASS_SIZE), "b_1": _thing("mug", MUG_SIZE, "cup")}, "b_1"),
        ("coffee cup", {"a_1": _thing("mug", MUG_SIZE, "coffee_cup"), "b_1": _thing("mug", MUG_SIZE)}, "a_1"),
        ("water_glass", {"a_1": _thing("water_glass", GLASS_SIZE), "b_1": _thing("mug", MUG_SIZE)}, "a_1"),
        ("b_1", {"a_1": _thing("mug", MUG_SIZE, "b_1"), "b_2": _thing("mug", MUG_SIZE)}, "a_1"),
    ],
)
def test_the_name_that_fits_best_decides(word: str, items: dict[str, dict[str, object]], meant: str) -> None:
    proposal = llm.propose(f"put the {word} in the fridge", _scene(items))
    assert f"(inside {meant} refrigerator_0)" in conjuncts(proposal.task.goal)


@pytest.mark.parametrize(
    ("word", "models"), [("cup", ("tumbler", "mug")), ("tumbler", ("tumbler", "tumbler")), ("glass", ("", ""))]
)
def test_what_fits_two_alike_stays_a_question(word: str, models: tuple[str, str]) -> None:
    items = {f"thing_{i}": _thing("water_glass", GLASS_SIZE, model) for i, model in enumerate(models)}
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(f"put the {word} in the fridge", _scene(items))
    assert caught.value.code == "ambiguous-object"


VESSELS = _scene(
    {
        "apple_0": _thing("apple", [0.08, 0.08, 0.08]),
        "mug_0": _thing("mug", MUG_SIZE),
        "plate_0": _thing("plate", [0.2, 0.2, 0.02]),
        "shot_glass_0": _thing("water_glass", [0.03, 0.03, 0.05]),
        "bowl_0": _thing("bowl", [0.18, 0.18, 0.06]),
    }
)


@pytest.mark.parametrize(
    "query",
    ["swap the apple and the mug", "put the apple under the mug", "the apple the mug", "put the apple on the mug"],
)
def test_no_suggestion_puts_a_thing_into_one_without_room_for_it(query: str) -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(query, VESSELS)
    assert caught.value.suggestions
    assert not [text for text in caught.value.suggestions if "into mug_0" in text or "into shot_glass_0" in text]


def test_a_thing_that_is_wider_than_the_mouth_is_refused() -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose("put the apple into shot_glass_0", VESSELS)
    assert caught.value.code == "affordance"
    assert llm.propose("put the apple into the bowl", VESSELS).task.subtasks


def _apples(count: int) -> Scene:
    return _scene({f"apple_{number}": _thing("apple", [0.08, 0.08, 0.08]) for number in range(count)})


def _calls(monkeypatch: pytest.MonkeyPatch, owner: object, name: str, run: Callable[[], object]) -> int:
    count = 0
    original = getattr(owner, name)

    def counted(*arguments: object, **named: object) -> object:
        nonlocal count
        count += 1
        return original(*arguments, **named)

    with monkeypatch.context() as patch:
        patch.setattr(owner, name, counted)
        with pytest.raises(llm.QueryError):
            run()
    return count


@pytest.mark.parametrize("query", ["put the apple into the fridge", "sing a song", "put apple_3 next to the table"])
def test_more_things_in_the_scene_do_not_mean_more_candidates(monkeypatch: pytest.MonkeyPatch, query: str) -> None:
    few, many = _apples(60), _apples(600)
    counts = [
        _calls(monkeypatch, planner, "is_possible", lambda scene=scene: llm.propose(query, scene))
        for scene in (few, many)
    ]
    assert 0 < counts[0] == counts[1]


def test_words_are_looked_up_in_proportion_to_their_number(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = _apples(3)
    counts = [
        _calls(monkeypatch, Names, "by_name", lambda words=words: llm.propose("quux " * words, scene))
        for words in (100, 200)
    ]
    # Runs of up to three words, as the longest name of the scene has: 3 n - 3 of n words.
    assert 0 < counts[1] <= 2 * counts[0] + 3


@pytest.mark.slow
def test_eight_hundred_apples_are_planned_and_a_refusal_about_them_stays_short() -> None:
    scene = _apples(800)
    assert len(llm.propose("put everything into the fridge", scene).task.subtasks) == 1602
    for query in ("put the apple into the fridge", "put the apple in the fridge on the table", "put both apples on it"):
        with pytest.raises(llm.QueryError) as caught:
            llm.propose(query, scene)
        assert len(str(caught.value)) < 2_000


@pytest.mark.parametrize(
    "query", ["put the glass and " * 60_000, "x" * 1_000_000, " " * 1_000_000, "step 1. " * 100_000]
)
def test_a_query_of_a_megabyte_is_refused_at_once(query: str) -> None:
    with pytest.raises(llm.QueryError) as caught:
        llm.propose(query, _apples(3))
    assert caught.value.code == "too-long"
    assert len(str(caught.value)) < 1_000


def _home() -> Scene:
    """A cabinet of drawers and one of doors, two fridges of which one is open, and things of which some are alike."""
    furniture = {
        "cabinet_0": {"category": "bottom_cabinet", "model": "cabinet_drawers"},
        "cabinet_1": {"category": "bottom_cabinet", "model": "cabinet_two_doors"},
        "refrigerator_0": {"category": "refrigerator"},
        "refrigerator_1": {"category": "refrigerator"},
        "table_0": {"category": "table"},
        "desk_0": {"category": "desk"},
    }
    items = {
        "glass_0": "water_glass", "glass_1": "water_glass", "apple_0": "apple", "apple_1": "half_apple",
        "box_0": "box", "box_1": "box", "mug_0": "mug", "can_0": "can", "can_1": "can",
    }  # fmt: skip
    objects = {
        **{key: {**piece, "bbox_extent": [0.6, 0.8, 0.8]} for key, piece in furniture.items()},
        **{key: {"category": category, "bbox_extent": [0.06, 0.06, 0.06]} for key, category in items.items()},
    }
    objects["box_0"] |= {"model": "carton"}
    objects["box_1"] |= {"model": "open_box", "bbox_extent": [0.2, 0.2, 0.1]}
    places = {key: {**thing, "position": [1.0 + 2 * i, 0.0, 0.4]} for i, (key, thing) in enumerate(objects.items())}
    facts = ["(open refrigerator_1)", "(not (open refrigerator_0))", "(not (open cabinet_0))", "(not (open cabinet_1))"]
    facts += ["(ontop glass_0 table_0)", "(ontop glass_1 desk_0)", "(ontop apple_0 table_0)", "(ontop apple_1 table_0)"]
    facts += ["(ontop box_0 table_0)", "(ontop box_1 table_0)", "(ontop mug_0 table_0)", "(inside can_1 mug_0)"]
    facts += ["(ontop can_0 table_0)"]
    return Scene.from_json({"name": "home", "objects": places, "facts": facts, "closed": ["ontop", "inside", "open"]})


HOME = _home()


@pytest.mark.parametrize(
    ("query", "meant"),
    [
        ("open the second drawer of the cabinet", {"(open cabinet_0)"}),
        ("open the left door of the cabinet", {"(open cabinet_1)"}),
        ("open the fridge", {"(open refrigerator_0)"}),
        ("close the fridge", {"(not (open refrigerator_1))"}),
        ("put the glass on the table into the box", {"(inside glass_0 box_1)"}),
        ("place the glass on the table beside the mug", {"(ontop glass_0 table_0)"}),
        ("put the glass on the table on the desk", {"(ontop glass_0 desk_0)"}),
        ("put the apple on the desk", {"(ontop apple_0 desk_0)"}),
        ("put the half apple on the desk", {"(ontop apple_1 desk_0)"}),
        ("put the can on the table on the desk", {"(ontop can_0 desk_0)"}),
        ("put the can in the mug on the desk", {"(ontop can_1 desk_0)"}),
    ],
)
def test_of_several_the_only_one_that_serves_is_meant(query: str, meant: set[str]) -> None:
    assert meant <= conjuncts(llm.propose(query, HOME).task.goal)


@pytest.mark.parametrize(
    "query",
    [
        "put the can into the fridge", "put the glass on the desk next to the box", "put the glass on the box",
        "open the cabinet", "put the mug into the cabinet", "pick up the glass", "put the mug into the fridge shelf",
    ],
)  # fmt: skip
def test_where_several_serve_it_stays_a_question(query: str) -> None:
    with pytest.raises(llm.QueryError):
        llm.propose(query, HOME)


def _bowls(far_m: float) -> Scene:
    near, far = (_thing("bowl", [0.12, 0.12, 0.06]) for _ in range(2))
    cup = _thing("cup", [0.07, 0.07, 0.09])
    places = {"bowl_0": (far, [0.9 + far_m, 0.1, 0.63]), "bowl_1": (near, [0.9, -0.1, 0.63])}
    items = {key: {**thing, "position": at} for key, (thing, at) in places.items()}
    return _scene({**items, "cup_0": {**cup, "position": [1.0, 0.3, 0.64]}})


@pytest.mark.parametrize(
    ("query", "goal"),
    [
        ("put the cup into the bowl in front", "(inside cup_0 bowl_1)"),
        ("put the cup into the front bowl", "(inside cup_0 bowl_1)"),
        ("put the cup into the bowl closest to me", "(inside cup_0 bowl_1)"),
        ("put the cup into the bowl at the back", "(inside cup_0 bowl_0)"),
        ("put the cup into the rear bowl", "(inside cup_0 bowl_0)"),
        ("put the front cup into the closest bowl", "(inside cup_0 bowl_1)"),
    ],
)
def test_the_one_in_front_is_the_nearest_to_the_robots_start(query: str, goal: str) -> None:
    assert conjuncts(llm.propose(query, _bowls(0.25)).task.goal) == {goal}
    if "front cup" not in query:
        with pytest.raises(llm.QueryError, match="can mean bowl_0 or bowl_1"):
            llm.propose(query, _bowls(0.0))
