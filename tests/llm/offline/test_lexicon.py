"""The lexicon as data: what is shipped is consistent, what a user writes is checked."""

from __future__ import annotations

import re
import tomllib
from dataclasses import replace
from importlib.resources import files
from types import MappingProxyType

import pytest

import llm
import oag
from llm.offline.lexicon import Category, built_in
from llm.offline.words import TaggedWord, read_words
from oag.model.symbols import Kind, is_known, kind_of
from tests.llm.kitchens import SCENES

TEXT = files("llm.offline").joinpath("lexicon.toml").read_text(encoding="utf-8")
GRAMMAR = files("llm.offline").joinpath("grammar.lark").read_text(encoding="utf-8")


def test_every_class_of_words_is_a_terminal_of_the_grammar() -> None:
    declared = set(re.findall(r"[A-Z]+", " ".join(re.findall(r"(?m)^%declare(.*)$", GRAMMAR))))
    assert set(built_in().terminals.values()) <= declared
    made = {"SETUPRIGHT", "SWITCHON", "SWITCHOFF", "OPERATE", "SWITCHEDON", "SWITCHEDOFF"}
    assert declared <= set(built_in().terminals.values()) | {"WORD", "COMMA", "STOP", "POSSESSIVE"} | made


def test_no_name_of_a_thing_is_swallowed_by_another_class() -> None:
    lexicon = built_in()
    for entry in lexicon.categories.values():
        for name in entry.names:
            tokens, manner = read_words(name, lexicon)
            # "Chest of drawers": a drawer is a noun as well, and names with "of" are put together again.
            assert {word.terminal for word in tokens} <= {"WORD", "DOOR", "OF"}, name
            assert not manner


def test_no_thing_is_listed_under_a_name_twice() -> None:
    for key, entry in tomllib.loads(TEXT)["categories"].items():
        assert len(set(entry["names"])) == len(entry["names"]), key


def test_entries_and_kinds_agree() -> None:
    kinds = {key: kind_of(key, 0.0) for key in built_in().categories}
    vessels = {key for key, entry in built_in().categories.items() if entry.affordances.interior}
    assert all(kinds[key] is not Kind.ITEM or "container" in built_in().categories[key].names for key in vessels)
    # What has no known kind is an item or a fixture with a door, by its size; a vase is small.
    assert {key for key in vessels if not is_known(key)} == {"vase"}


ENTRIES = {
    "water_glass": "water_glass",
    "half_apple": "half_apple",
    "breakfast_table": "table",
    "fridge": "refrigerator",
    "bottom_cabinet": "cabinet",
    "countertop": "countertop",
    "apple.n.01": "apple",
    "Coffee-Table": "table",
}


@pytest.mark.parametrize(("category", "key"), ENTRIES.items())
def test_a_scene_category_finds_its_entry(category: str, key: str) -> None:
    assert built_in().category_of(category) is built_in().categories[key]


def test_an_unknown_category_has_no_entry() -> None:
    assert built_in().category_of("flux_capacitor") is None


@pytest.mark.parametrize(
    ("query", "tokens"),
    [
        ("Pick up the cup!", "PICK DETERMINER WORD STOP"),
        ("take the glass OUT OF the fridge", "TAKE DETERMINER WORD OUTOF DETERMINER WORD"),
        ("the refrigerator\u2019s door", "DETERMINER WORD POSSESSIVE DOOR"),
        ("put glass_0 on top of table_0", "PUT WORD ON WORD"),
        ("a drinking-glass", "A WORD WORD"),
        ("the 'glass' (it) \N{EM DASH} *now*", "DETERMINER WORD PRONOUN"),
        ("50% of glass/cup", "WORD WORD OF WORD WORD WORD"),
        ("the first cup", "DETERMINER WORD WORD"),
        ("put it there too, and close it also", "PUT PRONOUN THERE TOO COMMA AND CLOSE PRONOUN TOO"),
        ("also too put it", "PUT PRONOUN"),
        ("that's on it", "RELATIVE ON PRONOUN"),
        ("Could you please", ""),
    ],
)
def test_tokens(query: str, tokens: str) -> None:
    assert " ".join(word.terminal for word in read_words(query, built_in())[0]) == tokens


def test_words_keep_their_text_and_manner_is_kept_apart() -> None:
    tokens, manner = read_words("carefully open it", built_in())
    assert tokens == (TaggedWord("OPEN", "open"), TaggedWord("PRONOUN", "it"))
    assert manner == ("carefully",)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[structure]", "[structures]", r"\[structure\]: the table is missing"),
        ('OF = ["of"]', 'OF = ["into"]', "'into' belongs to INTO already"),
        ('OF = ["of"]', 'OF = ["Of"]', "'Of' is not in lower case"),
        ('OF = ["of"]', 'OF = "of"', "expected a list of phrases"),
        ('courtesy = [\n    "please",', 'courtesy = [\n    "into",', "'into' belongs to INTO already"),
        ('names = ["jar", "container"]', "title = 1", r"\[categories.jar\]: expected a list `names`"),
        (
            'names = ["jar", "container"]',
            'names = ["jar"]\nfronts = ["flap"]',
            r"\[categories.jar\]: expected `fronts` from door and",
        ),
        ("people = [", 'people = ["Me", ', r"\[signs\] people: 'Me' is not in lower case"),
        ('OF = ["of"]', "OF = [", "is no TOML"),
    ],
)
def test_a_broken_lexicon_says_where(old: str, new: str, message: str) -> None:
    assert TEXT.count(old) == 1
    with pytest.raises(llm.LexiconError, match=message):
        llm.Lexicon.from_toml(TEXT.replace(old, new))


def test_a_lexicon_of_ones_own_teaches_new_names() -> None:
    text = TEXT.replace('names = ["refrigerator",', 'names = ["kuehlschrank", "refrigerator",')
    planner = llm.OfflinePlanner(llm.Lexicon.from_toml(text))
    assert llm.propose("open the kuehlschrank", SCENES["kitchen_t1"], model=planner).expanded.task_name == (
        "open refrigerator_0"
    )
    with pytest.raises(llm.QueryError):
        llm.propose("open the kuehlschrank", SCENES["kitchen_t1"])


def with_object(scene: str, category: str, facts: list[str]) -> oag.Scene:
    """Return a scene with a large object `thing_0` more."""
    data = SCENES[scene].to_json()
    objects = {**SCENES[scene].objects}
    data["objects"] = {
        key: {"category": value.category, "bbox_extent": list(value.bbox_extent), "position": list(value.position)}
        for key, value in objects.items()
    } | {"thing_0": {"category": category, "bbox_extent": [0.6, 0.6, 1.0], "position": [3, 0, 0.5]}}
    data["facts"] = [*data["facts"], *facts]  # type: ignore[misc]
    return oag.Scene.from_json(data)


def test_a_large_thing_of_unknown_category_counts_as_a_fixture_with_a_door() -> None:
    scene = with_object("kitchen_t1", "flux_capacitor", ["(not (open thing_0))"])
    proposal = llm.propose("put the glass into the flux capacitor", scene)
    assert [subtask.target for subtask in proposal.task.subtasks] == ["thing_0", "glass_0", "glass_0", "thing_0"]
    assert oag.compose(proposal.task).verify().verdict is oag.Verdict.PROVED


def test_the_facts_show_a_surface_that_the_category_does_not_promise() -> None:
    empty = with_object("kitchen_t4", "flux_capacitor", [])
    with pytest.raises(llm.QueryError, match="has no surface"):
        llm.propose("put the glass onto the flux capacitor", empty)
    data = with_object("kitchen_t1", "flux_capacitor", []).to_json()
    data["facts"] = ["(ontop glass_0 thing_0)", "(not (open refrigerator_0))"]
    scene = oag.Scene.from_json(data)
    assert llm.propose("put the glass on the table", scene).task.subtasks[0].support_init == "thing_0"


@pytest.mark.parametrize("appliance", ["microwave", "oven", "dishwasher"])
def test_an_appliance_carries_things_where_the_sentence_says_so(appliance: str) -> None:
    scene = with_object("kitchen_t1", appliance, ["(not (open thing_0))"])
    onto, into = (llm.propose(f"put the glass {how} the {appliance}", scene) for how in ("on top of", "into"))
    assert str(onto.task.goal) == "(ontop glass_0 thing_0)" and "(inside glass_0 thing_0)" in str(into.task.goal)
    assert oag.compose(onto.task, scene=scene).verify().verdict is oag.Verdict.PROVED
    # What stands on it already does not make "to" ambiguous.
    carrying = with_object("kitchen_t1", appliance, ["(not (open thing_0))"]).to_json()
    carrying["facts"] = ["(ontop glass_0 thing_0)", "(not (open refrigerator_0))", "(not (open thing_0))"]
    moved = llm.propose(f"move the glass to the {appliance}", oag.Scene.from_json(carrying))
    assert "(inside glass_0 thing_0)" in str(moved.task.goal)


def test_the_own_name_of_an_object_counts_before_a_name_of_its_kind() -> None:
    data = SCENES["two_glasses"].to_json()
    objects = dict(data["objects"])  # type: ignore[call-overload]
    objects["glass_1"] = {**objects["glass_1"], "category": "cup"}
    scene = oag.Scene.from_json({**data, "objects": objects})
    proposal = llm.propose("put the cup into the fridge", scene)
    assert proposal.expanded.task_name == "put glass_1 into refrigerator_0"
    assert any("glass_0 was passed over" in note for note in proposal.notes)


def room(**things: tuple[str, str]) -> oag.Scene:
    """Return a scene with a can on a table and fixtures of the given categories and models, by id."""
    extent = {"bbox_extent": [0.6, 0.8, 0.75]}
    row = enumerate({"table_0": ("table", ""), **things}.items())
    objects: dict[str, object] = {
        key: {"category": category, "model": model, "position": [1.5, float(index), 0.375], **extent}
        for index, (key, (category, model)) in row
    }
    objects["can_0"] = {"category": "can", "position": [1.5, 0.0, 0.8], "bbox_extent": [0.05, 0.05, 0.1]}
    doors = [f"(not (open {key}))" for key, (category, _) in things.items() if "cabinet" in category]
    return oag.Scene.from_json(
        {"name": "room", "objects": objects, "facts": ["(ontop can_0 table_0)", *doors], "closed": ["ontop", "inside"]}
    )


@pytest.mark.parametrize(
    ("things", "name", "meant"),
    [
        ({"desk_with_drawers_0": ("desk_with_drawers", "")}, "desk", "desk_with_drawers_0"),
        ({"writing_desk_0": ("table", "")}, "desk", "writing_desk_0"),
        ({"thing_0": ("computer_desk", "")}, "desk", "thing_0"),
        ({"countertop_0": ("countertop", ""), "cabinet_0": ("bottom_cabinet", "")}, "counter", "countertop_0"),
        (
            {"drawer_cabinet_0": ("bottom_cabinet", ""), "bottom_cabinet_0": ("bottom_cabinet", "")},
            "cabinet",
            "bottom_cabinet_0",
        ),
        ({"unit_0": ("drawer_cabinet", ""), "unit_1": ("base_cabinet", "")}, "cabinet", "unit_1"),
        ({"unit_0": ("kitchen_island", ""), "bench_0": ("bench", "")}, "island", "unit_0"),
        ({"stool_0": ("bench", ""), "bench_1": ("bench", "")}, "stool", "stool_0"),
    ],
)
def test_a_noun_means_the_thing_that_is_called_so(things: dict[str, tuple[str, str]], name: str, meant: str) -> None:
    proposal = llm.propose(f"put the can on the {name}", room(**things))
    assert proposal.task.subtasks[-1].support_goal == meant


@pytest.mark.parametrize(
    "things",
    [
        {"bottom_cabinet_0": ("bottom_cabinet", ""), "kitchen_cabinet_0": ("bottom_cabinet", "")},
        {"drawer_cabinet_0": ("bottom_cabinet", ""), "unit_0": ("drawer_cabinet", "")},
    ],
)
def test_two_that_are_called_alike_stay_ambiguous(things: dict[str, tuple[str, str]]) -> None:
    with pytest.raises(llm.QueryError) as refused:
        llm.propose("put the can on the cabinet", room(**things))
    assert refused.value.code == "ambiguous-object"


@pytest.mark.parametrize(
    ("query", "subject"),
    [
        ("stack the can on the apple", "can_0"),
        ("put the can between the apple and the cabinet", "can_0"),
        ("pour the apple over the can", "apple_0"),
        ("into the cabinet's third drawer, put the can", "can_0"),
        ("don't open the cabinet near the can", "cabinet_0"),
    ],
)
def test_suggestions_keep_the_subject_of_the_sentence(query: str, subject: str) -> None:
    data = room(cabinet_0=("bottom_cabinet", "")).to_json()
    apple = {"category": "apple", "position": [1.5, 0.1, 0.8], "bbox_extent": [0.05, 0.05, 0.05]}
    objects = {"apple_0": apple, **dict(data["objects"])}  # type: ignore[call-overload]
    facts = [*data["facts"], "(ontop apple_0 table_0)"]  # type: ignore[misc]
    with pytest.raises(llm.QueryError) as refused:
        llm.propose(query, oag.Scene.from_json({**data, "objects": objects, "facts": facts}))
    assert refused.value.suggestions
    # "put can_0 into cabinet_0", "pick up can_0", "open cabinet_0": the subject comes before any place.
    assert all(subject in re.split(" into | onto ", text)[0].split() for text in refused.value.suggestions)


def test_categories_can_be_replaced_in_code() -> None:
    lexicon = built_in()
    entry = lexicon.categories["apple"]
    renamed = Category(("pomme",), entry.surface_names, entry.affordances)
    other = replace(lexicon, categories=MappingProxyType({**lexicon.categories, "apple": renamed}))
    task = llm.propose("pick up the pomme", SCENES["kitchen_t3"], model=llm.OfflinePlanner(other)).task
    assert task.subtasks[0].target == "apple_0"
