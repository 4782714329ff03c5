"""Messages are safe to print, and their carets stand under what is meant, however wide the characters are."""

from __future__ import annotations

import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from bddl.terminal import display_width, escape_control

STEERING = "\x00\x07\x08\x1b\r\x7f\x9b\u202e\u2066\ud800"


@given(st.text(alphabet=st.one_of(st.characters(), st.sampled_from(STEERING))))
def test_what_is_visible_has_no_control_characters_and_the_same_length(text: str) -> None:
    shown = escape_control(text)
    assert len(shown) == len(text)
    assert not [one for one in shown if unicodedata.category(one) in ("Cc", "Cs") and one not in "\t\n"]
    assert all(new == old for new, old in zip(shown, text, strict=True) if old.isprintable())


@pytest.mark.parametrize("character", STEERING)
def test_no_part_of_a_message_steers_the_terminal(character: str) -> None:
    for text in (f"(open a{character}b)", f"(op{character}en a)", f"open{character}(a)", f"{character} (open a) (b)"):
        for found in (*bddl.check(text), *bddl.check(text, "behavior"), *bddl.check(text, objects={"ab": "b"})):
            assert character not in str(found)


@pytest.mark.parametrize(
    ("text", "excerpt"),
    [
        ("(桌子 a)", "1 | (桌子 a)\n  |  ^^^^"),
        ("(and (open 杯) (opn a))", "1 | (and (open 杯) (opn a))\n  |                 ^^^"),
        ("(and (open cafe\u0301) (opn a))", "1 | (and (open cafe\u0301) (opn a))\n  |                   ^^^"),
        ("(and\t(opn a))", "1 | (and\t(opn a))\n  |     \t ^^^"),
        ("(and (open a) \u200b)", "1 | (and (open a) \u200b)\n  |               ^"),
        ("(and (open x) (opn\x1b a))", "1 | (and (open x) (opn␛ a))\n  |                ^^^^"),
    ],
)
def test_carets_stand_under_what_they_mark(text: str, excerpt: str) -> None:
    assert excerpt in [found.excerpt for found in bddl.check(text)]


def test_the_width_of_a_character() -> None:
    assert [display_width(one) for one in ("a", "é", "\u0301", "桌", "\uff21", "\u200b", "ｱ")] == [1, 1, 0, 2, 2, 0, 1]


def test_a_word_with_backticks_is_quoted_otherwise() -> None:
    (found,) = bddl.check("(`open` a)")
    assert found.message == 'The profile `scene` has no predicate "`open`".'


def test_one_more_and_two_more() -> None:
    first, second = (bddl.check(f"{words} (open a)")[0].message for words in ("foo bar", "foo bar baz"))
    assert first == "The word `foo` stands outside the formula, and so does 1 more."
    assert second == "The word `foo` stands outside the formula, and so do 2 more."


def test_a_stray_word_between_sections_is_named() -> None:
    (found,) = bddl.check("(define (problem p) (:domain d) \\ (:objects a - b) (:goal (open a)))")
    assert found.code == "bad-section" and found.message == "A section belongs here, not `\\`."


def test_a_form_that_a_fence_ends_is_closed_before_the_fence() -> None:
    fence, gap = bddl.check("```bddl\n(and (open a) (open b)\n```\n")
    assert fence.code == "markdown-fence"
    assert (gap.code, gap.line, gap.column) == ("missing-parenthesis", 2, 23)
