"""Which names are near, and that the vocabulary is sound."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from bddl.dialects import FORM_SHAPES, FORM_SYNONYMS, REWRITES, edit_distance

SCENE = ("refrigerator_0", "glass_0", "glass_1", "table_0", "cabinet_0", "apple_0", "bowl_0", "gripper", "robot")


@pytest.mark.parametrize(
    ("name", "first"),
    [
        ("fridge_0", "refrigerator_0"),
        ("cup_0", "glass_0"),
        ("cup_1", "glass_1"),
        ("Glass_0", "glass_0"),
        ("glas_0", "glass_0"),
        ("tabel_0", "table_0"),
        ("table", "table_0"),
        ("table_1", "table_0"),
        ("hand", "gripper"),
        ("refridgerator_0", "refrigerator_0"),
        ("water_glass_0", "glass_0"),
    ],
)
def test_the_nearest_object_comes_first(name: str, first: str) -> None:
    assert bddl.near_names(name, SCENE)[0] == first


@pytest.mark.parametrize("name", ["zebra_0", "x", "", "_", "spoon"])
def test_nothing_is_near_a_name_of_another_kind(name: str) -> None:
    assert bddl.near_names(name, SCENE) == ()


def test_at_most_three_names_are_given_and_the_name_itself_never() -> None:
    assert len(bddl.near_names("glass_9", [f"glass_{index}" for index in range(9)])) == 3
    assert "glass_0" not in bddl.near_names("glass_0", SCENE)


@pytest.mark.parametrize(("slip", "meant"), [("on", "ontop"), ("in", "inside"), ("opened", "open"), ("below", "under")])
def test_synonyms_lead_to_their_predicate(slip: str, meant: str) -> None:
    assert bddl.near_names(slip, bddl.PREDICATES) == (meant,)


def test_no_synonym_is_ambiguous_or_legal() -> None:
    synonyms = [word for spec in bddl.PREDICATES.values() for word in spec.synonyms]
    synonyms += [*FORM_SYNONYMS, *REWRITES]
    assert len(synonyms) == len(set(synonyms))
    assert set(synonyms).isdisjoint(bddl.PREDICATES)


@pytest.mark.parametrize("word", REWRITES)
def test_every_rewrite_is_a_legal_formula(word: str) -> None:
    assert bddl.check(REWRITES[word].format("a_0", "a_1")) == ()


@pytest.mark.parametrize("name", bddl.PREDICATES)
def test_the_shape_of_every_predicate_parses(name: str) -> None:
    spec = bddl.PREDICATES[name]
    assert bddl.parse_formula(spec.shape) == bddl.Atom(name, spec.parameters)
    assert spec.arity == len(spec.parameters) in (1, 2)


@pytest.mark.parametrize("form", FORM_SHAPES)
def test_the_shape_of_every_form_parses(form: str) -> None:
    text = FORM_SHAPES[form].replace("FORMULA", "(open a)").replace("(N)", "(2)")
    assert bddl.format(bddl.parse_formula(text)) == text


def _plain_distance(left: str, right: str) -> int:
    """Optimal string alignment by its recurrence, for short words."""
    if not left or not right:
        return len(left) + len(right)
    best = min(
        _plain_distance(left[:-1], right) + 1,
        _plain_distance(left, right[:-1]) + 1,
        _plain_distance(left[:-1], right[:-1]) + (left[-1] != right[-1]),
    )
    if len(left) > 1 and len(right) > 1 and left[-2:] == right[-1] + right[-2]:
        best = min(best, _plain_distance(left[:-2], right[:-2]) + 1)
    return best


@given(st.text("ab", max_size=5), st.text("ab", max_size=5), st.integers(0, 3))
def test_edit_distance_is_its_recurrence(left: str, right: str, at_most: int) -> None:
    distance = _plain_distance(left, right)
    assert edit_distance(left, right, at_most) == (distance if distance <= at_most else None)
