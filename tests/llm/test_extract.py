"""The JSON object in a reply: found in prose, fences and thoughts; anything else is a finding."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

import oag
from llm.extract import LONGEST_REPLY, extract
from llm.findings import ANSWER_CODES


def recognises(data: object) -> bool:
    """Knows answers by their field `goal`."""
    return isinstance(data, dict) and "goal" in data


PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**6), 10**6) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
PROSE = st.text(st.characters(blacklist_characters="{}<>", blacklist_categories=("Cs",)), max_size=40)


@given(st.dictionaries(st.text(max_size=5), PLAIN, max_size=3), PROSE, PROSE, st.sampled_from([None, 0, 2]))
def test_an_object_is_found_whatever_stands_around_it(
    data: dict[str, object], before: str, after: str, indent: int | None
) -> None:
    answer = {**data, "goal": "(open a)"}
    text = f"{before}```json\n{json.dumps(answer, indent=indent)}\n```{after}"
    assert extract(text, recognises) == answer


@given(st.text(max_size=200))
def test_any_text_gives_an_object_or_a_finding(text: str) -> None:
    found = extract(text, recognises)
    assert isinstance(found, dict | oag.Diagnostic)
    if isinstance(found, oag.Diagnostic):
        assert found.code in ANSWER_CODES
        assert found.message


@pytest.mark.parametrize(
    ("text", "goal"),
    [
        ('As in {"example": 1}: {"goal": "a"}', "a"),
        ('Use {braces} with care: {"goal": "a"}', "a"),
        ('<think>{"goal": "first thought"}</think>{"goal": "a"}', "a"),
        ('{"goal": "a"} or rather {"goal": "b"}', "a"),
        ('{"goal": "with } and { inside"}', "with } and { inside"),
    ],
)
def test_the_first_object_that_looks_like_an_answer_is_taken(text: str, goal: str) -> None:
    assert extract(text, recognises) == {"goal": goal}


def test_an_object_without_a_known_field_is_returned_for_its_fields_to_be_named() -> None:
    assert extract('I say {"aim": 1}', recognises) == {"aim": 1}


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("", "answer/no-json", "no JSON object"),
        ("open the fridge", "answer/no-json", "no JSON object"),
        ("[1, 2]", "answer/no-json", "no JSON object"),
        ('{"goal": "a"', "answer/broken-json", "ends before its last brace"),
        ('{"goal": "a",}', "answer/broken-json", "line 1"),
        ("{'goal': 'a'}", "answer/broken-json", "property name enclosed in double quotes"),
        ('{"goal": NaN}', "answer/broken-json", "NaN is no JSON number"),
        ('{"goal": "a", "goal": "b"}', "answer/broken-json", "'goal' appears twice"),
        ('{"goal": ' + "9" * 5000 + "}", "answer/broken-json", "cannot be used"),
        ('{"goal": ' + "[" * 100_000, "answer/broken-json", "nested too deeply"),
        ('{"sub_tasks": [{"goal": "a"}, {"goal": }]}', "answer/broken-json", "near"),
        ("{" * 50_000, "answer/broken-json", "property name"),
        ("x" * (LONGEST_REPLY + 1), "answer/too-long", "characters"),
    ],
)
def test_what_is_no_json_is_said_with_its_place(text: str, code: str, said: str) -> None:
    found = extract(text, recognises)
    assert isinstance(found, oag.Diagnostic)
    assert found.code == code
    assert said in found.message


def test_a_reply_that_was_cut_off_is_said_to_be() -> None:
    found = extract('{"goal": "(inside', recognises, cut_off=True)
    assert isinstance(found, oag.Diagnostic)
    assert found.code == "answer/cut-off"


def test_code_in_a_reply_is_never_run() -> None:
    found = extract('{"goal": __import__("os").getcwd()}', recognises)
    assert isinstance(found, oag.Diagnostic)
    assert found.code == "answer/broken-json"
