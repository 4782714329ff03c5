"""Layout: the words, the comments and their order stay; only blanks change, and once is enough."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from bddl.printer import INDENT, MOST_LEVELS, WIDTH, comments
from tests.bddl.strategies import problems

_TOKEN = re.compile(r";[^\n]*|[()]|[^\s();]+")

WRITTEN = """; who wrote this
(define (problem tidy)   ; the name
(:domain d)
  (:objects glass_0 glass_1
      - glass ; two of them
      table_0 - table)


  (:init (ontop glass_0 table_0)(ontop glass_1 table_0)

     ; nothing else
  )
  (:goal (and (forall (?x - glass) (and (ontop ?x table_0) (not (inside ?x table_0)) (nextto ?x table_0) (hot ?x)))
     (open table_0) ; last
  )))
; done"""

LAID_OUT = """; who wrote this
(define (problem tidy) ; the name
    (:domain d)
    (:objects
        glass_0 glass_1 - glass ; two of them
        table_0 - table
    )

    (:init
        (ontop glass_0 table_0)
        (ontop glass_1 table_0)

        ; nothing else
    )
    (:goal
        (and
            (forall (?x - glass)
                (and (ontop ?x table_0) (not (inside ?x table_0)) (nextto ?x table_0) (hot ?x))
            )
            (open table_0) ; last
        )
    )
)
; done
"""


def _tokens(text: str) -> list[str]:
    return [token.rstrip() for token in _TOKEN.findall(text)]


def test_a_file_written_by_hand() -> None:
    assert bddl.lay_out(WRITTEN) == LAID_OUT
    assert bddl.lay_out(LAID_OUT) == LAID_OUT


def test_comments_are_found_in_order() -> None:
    assert comments(WRITTEN) == [
        "; who wrote this",
        "; the name",
        "; two of them",
        "; nothing else",
        "; last",
        "; done",
    ]


@pytest.mark.slow
@given(problems(), st.data())
def test_every_word_and_comment_stays(problem: bddl.Problem, data: st.DataObject) -> None:
    pieces = re.findall(r"[()]|[^\s()]+", bddl.format(problem))
    for _ in range(data.draw(st.integers(0, 4))):
        place = data.draw(st.integers(0, len(pieces)))
        pieces.insert(place, data.draw(st.sampled_from(("; a (note\n", "\n;\n", "\n\n\n", "\n ; x ; y )\n"))))
    text = " ".join(pieces)
    laid_out = bddl.lay_out(text)
    assert _tokens(laid_out) == _tokens(text)
    assert bddl.lay_out(laid_out) == laid_out
    assert bddl.parse(laid_out) == problem


@given(problems())
def test_lines_are_no_longer_than_they_must_be(problem: bddl.Problem) -> None:
    for line in bddl.lay_out(bddl.format(problem)).split("\n"):
        indent = len(line) - len(line.lstrip())
        # An atom or a list of names is never broken.
        assert len(line) <= WIDTH or line.count("(") <= 1 or line.lstrip().startswith(("(forall", "(exists"))
        assert indent % len(INDENT) == 0 and line == line.rstrip()


def test_prose_stays_letter_for_letter() -> None:
    text = "(define (problem p) (:domain d) (:language Put  it; (there) now) (:goal (and)))"
    assert "(:language Put  it; (there) now)" in bddl.lay_out(text, {":language"})
    broken = "(define (problem p) (:language a\n  b) (:goal (and)))"
    assert "(:language a\n  b)" in bddl.lay_out(broken, {":language"})


@pytest.mark.parametrize("text", ["(", ")", "(open a))", "((open a)"])
def test_parentheses_must_match(text: str) -> None:
    with pytest.raises(ValueError, match="close"):
        bddl.lay_out(text)


def test_depth_is_no_obstacle() -> None:
    depth = 10_000
    text = "(not " * depth + "(open a)" + ")" * depth
    laid_out = bddl.lay_out(text)
    assert _tokens(laid_out) == _tokens(text)
    assert max(len(line) - len(line.lstrip()) for line in laid_out.split("\n")) == MOST_LEVELS * len(INDENT)
