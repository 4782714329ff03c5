"""The JSON object in a reply: found in prose, fences and thoughts; anything else is a finding."""

from __future__ import annotations

import json
import re

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import oag
from llm.structured import lenient
from llm.structured.ask import LONGEST_REPLY, extract
from tests.llm.forms import answer_codes


def answer_in(value: object) -> dict[str, object] | None:
    """Knows answers by their field `goal`."""
    return value if isinstance(value, dict) and "goal" in value else None


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
    assert extract(text, answer_in) == answer


@given(st.text(max_size=200))
def test_any_text_gives_an_object_or_a_finding(text: str) -> None:
    found = extract(text, answer_in)
    assert isinstance(found, dict | oag.Diagnostic)
    if isinstance(found, oag.Diagnostic):
        assert found.code in answer_codes()
        assert found.message


@pytest.mark.parametrize(
    ("text", "goal"),
    [
        ('As in {"example": 1}: {"goal": "a"}', "a"),
        ('Use {braces} with care: {"goal": "a"}', "a"),
        ('<think>{"goal": "first thought"}</think>{"goal": "a"}', "a"),
        ('{"goal": "a"} or rather {"goal": "b"}', "b"),
        ('Draft: {"goal": "b"} Final answer: {"goal": "a"}. I {hope} it fits.', "a"),
        ('{"type": "object", "properties": {"goal": {"type": "string"}}} {"goal": "a"}', "a"),
        ('{"goal": "a"} fits {"type": "object", "properties": {"goal": {"type": "string"}}}', "a"),
        ('{"goal": "b",} was broken: {"goal": "a"}', "a"),
        ('{"goal": "with } and { inside"}', "with } and { inside"),
    ],
)
def test_the_last_object_that_looks_like_an_answer_is_taken(text: str, goal: str) -> None:
    assert extract(text, answer_in) == {"goal": goal}


@pytest.mark.parametrize(
    "text",
    [
        '{"goal": "a",}',
        "{'goal': 'a'}",
        'Draft: {"goal": "b"} Final: {"goal": "a",}',
        'Draft: {"goal": "b"} Final: {\'goal\': "a"}',
        '"goal": "a"',
        '```json\n"goal": "a",\n```',
        "goal: a\nwhy: so",
        "Here it is:\n```yaml\ngoal: a\n```",
        json.dumps('{"goal": "a"}'),
    ],
)
def test_what_has_one_reading_is_read(text: str) -> None:
    found = extract(text, answer_in)
    assert isinstance(found, dict) and found["goal"] == "a"


@pytest.mark.parametrize(
    "text",
    [
        '{"goal": "a", goal: "b"}',
        "goal: a\ngoal: b",
        '"goal": "a", "goal": "b"',
        '{"goal": 0.05/0.07}',
        '{"goal": .5.1}',
        '{"goal": 0x10}',
        '{"goal": "a" "b"}',
        '{"goal": ["a", "b"',
        '{"goal": "\\x41"}',
        '{"goal": undefined}',
        '{"goal": "a"; "x": 1}',
        "goal: &a [*a, *a]\nx: *a",
    ],
)
def test_what_has_two_readings_or_none_is_a_finding(text: str) -> None:
    assert isinstance(extract(text, answer_in, fields=("goal",)), oag.Diagnostic)


def test_an_answer_without_its_last_brace_is_whole_only_with_all_its_fields() -> None:
    text = '{"goal": "a", "why": "b"'
    assert extract(text, answer_in, fields=("goal", "why")) == {"goal": "a", "why": "b"}
    assert isinstance(extract(text, answer_in, fields=("goal", "why", "how")), oag.Diagnostic)
    assert isinstance(extract(text, answer_in, fields=("goal", "why"), cut_off=True), oag.Diagnostic)
    # A number may have lost digits.
    assert isinstance(extract('{"goal": "a", "why": 0.5', answer_in, fields=("goal", "why")), oag.Diagnostic)


def test_an_object_without_a_known_field_is_returned_for_its_fields_to_be_named() -> None:
    assert extract('I say {"aim": 1}', answer_in) == {"aim": 1}


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("", "answer/no-json", "no JSON object"),
        ("open the fridge", "answer/no-json", "no JSON object"),
        ("[1, 2]", "answer/no-json", "no JSON object"),
        ('{"goal": "a"', "answer/broken-json", "ends before its last brace"),
        ('{"goal": NaN}', "answer/broken-json", "NaN is no JSON number"),
        ('{"goal": "a", "goal": "b"}', "answer/broken-json", "'goal' appears twice"),
        ('{"goal": ' + "9" * 5000 + "}", "answer/broken-json", "cannot be used"),
        ('{"goal": ' + "[" * 100_000, "answer/broken-json", "nested too deeply"),
        ('{"sub_tasks": [{"goal": "a"}, {"goal": }]}', "answer/broken-json", "near"),
        ("{" * 50_000, "answer/broken-json", "property name"),
        ("x" * (LONGEST_REPLY + 1), "answer/too-long", "characters"),
        ('Draft: {"goal": "b"} Final: {"goal": "a", "goal": "c"}', "answer/broken-json", "appears twice"),
        ('Draft: {"goal": "b"} Final: {"goal": "a', "answer/broken-json", "Unterminated"),
        ('{"a":' * 2_000 + '{"goal": "b"}' + "}" * 2_000, "answer/broken-json", "nested too deeply"),
        ('{"x" {"x" ' * 2_000 + '{"goal": "b"}', "answer/broken-json", "more than 2000"),
    ],
)
def test_what_is_no_json_is_said_with_its_place(text: str, code: str, said: str) -> None:
    found = extract(text, answer_in)
    assert isinstance(found, oag.Diagnostic)
    assert found.code == code
    assert said in found.message


@pytest.mark.parametrize("before", ["", 'Draft: {"goal": "a"} Final: ', "<think>"])
def test_a_reply_that_was_cut_off_is_said_to_be(before: str) -> None:
    found = extract(before + '{"goal": "(inside', answer_in, cut_off=True)
    assert isinstance(found, oag.Diagnostic)
    assert found.code == "answer/cut-off"


@pytest.mark.parametrize("name", ["goals'", 'goals"', ';goals"', "'goals", ";goals", '"goals', '"goals;', "goals"])
@pytest.mark.parametrize("before", ["", 'Draft: [{"goal": "a"}] Final: '])
def test_a_sound_list_in_a_broken_object_is_no_answer(name: str, before: str) -> None:
    def listed(value: object) -> dict[str, object] | None:
        return {"goals": value} if isinstance(value, list) and value else answer_in(value)

    assert extract('[{"goal": "b"}]', listed) == {"goals": [{"goal": "b"}]}
    found = extract(f'{before}{{{name}: [{{"goal": "b"}}]}}', listed)
    assert isinstance(found, oag.Diagnostic)
    assert found.code == "answer/broken-json"


def test_code_in_a_reply_is_never_run() -> None:
    found = extract('{"goal": __import__("os").getcwd()}', answer_in)
    assert isinstance(found, oag.Diagnostic)
    assert found.code == "answer/broken-json"


@pytest.mark.parametrize(
    "thought",
    [
        '<think>{"goal": "draft"}</think>',
        '<THINKING mode="long">{"goal": "draft"}</THINKING>',
        '<reasoning>{"goal": "draft"}</reasoning>',
        '<seed:think>{"goal": "draft"}</seed:think>',
        '[THINK]{"goal": "draft"}[/THINK]',
        '◁think▷{"goal": "draft"}◁/think▷',
        '<|begin_of_thought|>{"goal": "draft"}<|end_of_thought|>',
        '{"goal": "draft"}</think>',
        '<think>a</think>{"goal": "draft"} and so on</think>',
        '<think>a <think> b {"goal": "draft"}</think>',
        '<|channel|>analysis<|message|>{"goal": "draft"}<|end|><|start|>assistant<|channel|>final<|message|>',
        '<|channel|>final<|message|>{"goal": "draft"}<|end|><|channel|>final <|constrain|>json<|message|>',
    ],
)
def test_a_thought_is_no_answer(thought: str) -> None:
    assert extract(thought + '{"goal": "a"}', answer_in) == {"goal": "a"}
    if "final" not in thought:
        assert extract(f'{thought}\nHere it is: {{"goal": "a"}}<think>Is it right?</think>', answer_in) == {"goal": "a"}
    alone = extract(thought, answer_in)
    assert isinstance(alone, oag.Diagnostic)
    assert alone.code == "answer/no-json"


@pytest.mark.parametrize("opening", ["<think>", "<reasoning>", "[THINK]", "<|channel|>analysis<|message|>"])
def test_a_thought_that_never_ends_is_no_answer(opening: str) -> None:
    found = extract(f'{opening}perhaps {{"goal": "draft"}}', answer_in)
    assert isinstance(found, oag.Diagnostic)
    assert "thoughts" in found.message


@pytest.mark.parametrize(
    "text",
    [
        "<think>" * 57_000,
        "<think" * 66_000,
        "</think>" * 50_000,
        "<thinking " * 40_000,
        "<|channel|>" * 36_000,
        "{" * 400_000,
        '{"' * 200_000,
        "[{" * 200_000,
        '[{"a":' * 66_000,
        '{"a":' * 80_000,
        "{ " * 200_000,
        "{a" * 200_000,
        "{" + " " * 399_998 + "{",
        "{" + ", ".join(f'"k{number}": 1' for number in range(25_000)) + ', "k24999": 2}',
        '{"x": ' * 900 + "9" * 390_000 + "}" * 900,
        '{"a": NaN, "b": ' * 900 + "1" + "}" * 900,
    ],
    ids=lambda text: f"{text[:12]}...",
)
def test_a_reply_as_long_as_may_be_is_read_in_one_pass(text: str) -> None:
    """Each of these takes minutes, or all memory, where a piece is looked at again and again."""
    assert isinstance(extract(text, answer_in), dict | oag.Diagnostic)


SIGNS = st.sampled_from(list("\"'{}[],:#/*()“” \\ab1.-\n"))
WORDS = st.text(st.sampled_from("ab1_- .#'/“"), min_size=1, max_size=4)
NUMBERS = st.integers(-999, 999) | st.floats(-9, 9).map(lambda number: round(number, 2))
VALUES = st.recursive(
    st.none() | st.booleans() | NUMBERS | st.text(SIGNS, max_size=6),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(WORDS, inner, max_size=3),
    max_leaves=6,
)


@given(st.dictionaries(WORDS, VALUES, min_size=1, max_size=3), st.integers(0, 10**6))
def test_what_lacks_a_sign_is_read_as_what_it_was_or_not_at_all(value: dict[str, object], place: int) -> None:
    text = json.dumps(value, ensure_ascii=False)
    assert lenient.read_object(f"{text} and so on") == (value, len(text))
    found = list(re.finditer(r'"(?:[^"\\]|\\.)*"|[{}\[\]:]', text))
    signs = sorted({place for one in found for place in (one.start(), one.end() - 1)} - {0})
    at = signs[place % len(signs)]
    changed = text[:at] + text[at + 1 :]
    try:
        json.JSONDecoder().raw_decode(changed)
    except ValueError:
        assert lenient.read_object(changed) in (None, (value, len(changed)))


ESCAPES = st.sampled_from("xuU0abnrtvefNP_L \\\"'\n").flatmap(
    lambda kind: st.text("0123456789abcdefABCDEF", max_size=8).map(lambda digits: f"\\{kind}{digits}")
)


@given(st.lists(ESCAPES | st.text(SIGNS, max_size=3), max_size=6).map("".join), st.sampled_from(['"', "'", ""]))
@example("\\UFFFFFFFF", '"')
def test_any_escape_in_yaml_is_read_or_not(inside: str, quote: str) -> None:
    """The library raises what Python does for a code beyond Unicode."""
    text = f"goal: {quote}{inside}{quote}\nwhy: so"
    found = lenient.read_yaml(text)
    assert found is None or isinstance(found, dict | list)
    assert isinstance(extract(text, answer_in), dict | oag.Diagnostic)
