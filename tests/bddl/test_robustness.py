"""Whatever the text, the outcome is the tree that it spells, or a BDDLError; nothing depends on the depth."""

from __future__ import annotations

import pickle
import re

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import bddl
from tests.bddl.strategies import OBJECTS, formulas, literals, problems

TOKEN = re.compile(r"[()]|[^\s()]+")
DEPTH = 3_000  # Three times as deep as Python nests calls.
# All that the drawn problems declare, so that what is right of them is read.
DECLARED = {**OBJECTS, "x": "thing", "y": "absent"}


def _outcome(text: str) -> bddl.Formula | bddl.Problem | bddl.BDDLError:
    """Return what parsing gives: the tree that the text spells, or a report that can be read.

    Any exception but BDDLError fails the test.
    """
    read: bddl.Formula | bddl.BDDLError
    try:
        read = bddl.parse_formula(text)
    except bddl.BDDLError as error:
        _assert_reported(error, text)
        read = error
    else:
        assert _tokens(bddl.format(read)) == _tokens(text)
        assert bddl.parse_formula(bddl.format(read)) == read
    try:
        problem = bddl.parse(text, objects=DECLARED)
    except bddl.BDDLError as error:
        _assert_reported(error, text)
        return read
    for part in (problem.goal, *problem.init):
        assert f" {' '.join(_tokens(bddl.format(part)))} " in f" {' '.join(_tokens(text))} "
    assert bddl.parse(bddl.format(problem), objects=DECLARED) == problem
    return problem


def _tokens(text: str) -> list[str]:
    """Return the parentheses and words of a text: of a tree's they are those that it was read from, in their order.

    They have no question marks: a quantifier may leave them out, since its place says what is a variable.
    """
    return [token.removeprefix("?") or token for token in TOKEN.findall(re.sub(r";[^\n]*", "", text))]


def _assert_reported(error: bddl.BDDLError, text: str) -> None:
    assert error.diagnostics
    for found in error.diagnostics:
        _assert_well_formed(found, text)


def _assert_well_formed(found: bddl.Diagnostic, text: str) -> None:
    lines = text.split("\n")
    assert found.code in bddl.MEANINGS
    assert 1 <= found.line <= len(lines)
    assert 1 <= found.column <= len(lines[found.line - 1]) + 1
    assert "^" in found.excerpt
    assert found.message.endswith(".")


# An example is some hundred texts.
@pytest.mark.slow
@settings(max_examples=settings.default.max_examples // 5)
@given(formulas())
def test_every_prefix_parses_or_is_reported(formula: bddl.Formula) -> None:
    text = bddl.format(formula)
    for end in range(len(text)):
        assert isinstance(_outcome(text[:end]), bddl.BDDLError)


@given(st.one_of(formulas(), problems()))
def test_what_is_whole_is_read_as_it_was(node: bddl.Formula | bddl.Problem) -> None:
    assert _outcome(bddl.format(node)) == node


@pytest.mark.slow
@settings(max_examples=15)
@given(st.one_of(formulas(), problems()))
def test_every_deletion_of_one_token_parses_or_is_reported(node: bddl.Formula | bddl.Problem) -> None:
    text = bddl.format(node)
    for token in TOKEN.finditer(text):
        _outcome(text[: token.start()] + text[token.end() :])


@given(st.one_of(formulas(), problems()), st.data())
def test_every_swap_of_two_tokens_parses_or_is_reported(node: bddl.Formula | bddl.Problem, data: st.DataObject) -> None:
    tokens = TOKEN.findall(bddl.format(node))
    first = data.draw(st.integers(0, len(tokens) - 1))
    second = data.draw(st.integers(0, len(tokens) - 1))
    tokens[first], tokens[second] = tokens[second], tokens[first]
    _outcome(" ".join(tokens))


_PIECES = ["(", ")", "and", "not", "imply", "forall", "exists", "forn", "define", "problem", ":goal", ":init"]
_PIECES += [":objects", ":", "-", "?", "?x", "??", "x", "open", "ontop", "on", "glass_0", ",", ";", "\n", "\r", "```"]


@given(st.lists(st.sampled_from([*_PIECES, "(define (problem p)", "(:goal "]), max_size=25).map(" ".join))
@example("?")
@example("open(x,,y)")
def test_any_heap_of_tokens_parses_or_is_reported(text: str) -> None:
    _outcome(text)
    _outcome(text.replace(" ", ""))


@pytest.mark.parametrize("text", ["(and (open a (open b) ) ) (open c", "(zz (future a (open ) b) and ) (future x"])
def test_a_gap_that_is_closed_leaves_every_later_parenthesis_its_match(text: str) -> None:
    assert isinstance(_outcome(text), bddl.BDDLError)


@given(st.text())
@example("\x00(\ud800 \u2028)\x1c(open\u00a0x)")
def test_any_text_parses_or_is_reported(text: str) -> None:
    _outcome(text)


@given(st.lists(literals, min_size=2, max_size=4), st.data())
def test_the_hint_restores_a_deleted_closing_parenthesis(parts: list[bddl.Formula], data: st.DataObject) -> None:
    text = bddl.format(bddl.And(tuple(parts)))
    place = data.draw(st.sampled_from([match.start() for match in re.finditer(r"\)", text)]))
    (found,) = bddl.check(text[:place] + text[place + 1 :])
    assert (found.code, found.hint) == ("missing-parenthesis", f"write {text}")


@given(st.lists(literals, min_size=1, max_size=4))
def test_the_hint_removes_an_extra_closing_parenthesis(parts: list[bddl.Formula]) -> None:
    text = bddl.format(bddl.And(tuple(parts)))
    first_part_ends = len("(and ") + len(str(parts[0]))
    for place in {first_part_ends, len(text)}:
        (found,) = bddl.check(text[:place] + ")" + text[place:])
        assert (found.code, found.hint) == ("extra-parenthesis", f"write {text}")


@pytest.mark.parametrize("opening", ["(not ", "(and ", "(or (open x) ", "(imply (open x) ", "(forall (?x - glass) "])
def test_a_deep_formula_goes_through_everything(opening: str) -> None:
    text = opening * DEPTH + "(open x)" + ")" * DEPTH
    formula = bddl.parse_formula(text, objects={"x": "glass"})
    again = bddl.parse_formula(bddl.format(formula))
    assert again == formula and hash(again) == hash(formula)
    assert repr(again) and bddl.atoms(formula) == {bddl.Atom("open", ("x",))}
    assert bddl.evaluate(formula, {}, {"x": "glass"}) is None
    assert bddl.evaluate(formula, {bddl.Atom("open", ("x",)): True}, {"x": "glass"}) is True
    assert bddl.conjuncts(formula) and not bddl.literals(bddl.Or((formula,)))


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("(" * DEPTH, "missing-parenthesis"),
        (")" * DEPTH, "extra-parenthesis"),
        ("(" * DEPTH + ")" * DEPTH, "not-a-name"),
        ("(not " * DEPTH, "missing-parenthesis"),
        ("(open " * DEPTH + ")" * DEPTH, "not-a-name"),
        pytest.param("(zz " * DEPTH + ")" * DEPTH, "unknown-predicate", marks=pytest.mark.slow),
        ("not(" * DEPTH + "open(x)" + ")" * DEPTH, "function-notation"),
        ("(exists " * DEPTH + ")" * DEPTH, "bad-binder"),
    ],
)
def test_deep_nonsense_is_reported(text: str, code: str) -> None:
    with pytest.raises(bddl.BDDLError) as raised:
        bddl.parse_formula(text)
    assert raised.value.diagnostics[0].code == code


def test_errors_survive_a_process_boundary() -> None:
    with pytest.raises(bddl.BDDLError) as raised:
        bddl.parse_formula("(on a b)")
    copy = pickle.loads(pickle.dumps(raised.value))
    assert copy.diagnostics == raised.value.diagnostics and str(copy) == str(raised.value)
    for misuse in (
        bddl.UnknownProfile("x", ["scene"], ["scene"]),
        bddl.ObjectsRequired("x", "glass"),
        bddl.IllegalName("object", "a b", "no blanks"),
    ):
        assert str(pickle.loads(pickle.dumps(misuse))) == str(misuse)


def test_formulas_survive_a_process_boundary() -> None:
    formula = bddl.parse_formula("(forall (?x - glass) (imply (open ?x) (not (ontop ?x table_0))))")
    copy = pickle.loads(pickle.dumps(formula))
    assert copy == formula and copy.span == formula.span


def test_no_text_has_an_endless_list_of_mistakes() -> None:
    found = bddl.check("(" * 20_000 + "(open glass_0)" + ")" * 20_000)
    assert len(found) == 100 and {mistake.code for mistake in found} == {"not-a-name"}
    assert found[-1].message.endswith("It is number 100; those after it are not listed.")
