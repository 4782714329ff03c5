"""The slips of language models: written examples with the label and the text that was meant, and whole notations."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from tests.bddl.universe import formulas

EXAMPLES: list[dict[str, Any]] = json.loads(
    (Path(__file__).parents[1] / "data" / "slips" / "examples.json").read_text(encoding="utf-8")
)
OBJECTS = {
    "glass_0": "glass",
    "glass_1": "glass",
    "table_0": "table",
    "refrigerator_0": "refrigerator",
    "apple_0": "apple",
    "cabinet_0": "cabinet",
}


def _plain(text: str) -> str:
    return " ".join(text.split()).replace("( ", "(").replace(" )", ")")


@pytest.mark.parametrize("example", EXAMPLES, ids=[repr(example["text"])[:60] for example in EXAMPLES])
def test_a_slip_is_labelled_and_put_right(example: dict[str, Any]) -> None:
    found = bddl.analyse(example["text"], objects=OBJECTS)
    correction = bddl.correct(example["text"], objects=OBJECTS)
    labels = {item.slip for item in found} | set(correction.slips if correction else ())
    assert found != ()
    assert example["slip"] in labels
    if "fix" in example:
        assert correction is not None and _plain(correction.text) == _plain(example["fix"])
    else:
        assert correction is None
        assert any(example["hint"] in item.hint for item in found)


def test_every_slip_has_an_example_and_a_meaning() -> None:
    assert {example["slip"] for example in EXAMPLES} | {"unbound-variable"} == set(bddl.SLIPS)
    assert len(EXAMPLES) >= 60 and sum(example["held_out"] for example in EXAMPLES) * 3 >= len(EXAMPLES) - 2


@pytest.mark.parametrize("example", EXAMPLES, ids=[repr(example["text"])[:60] for example in EXAMPLES])
def test_a_whole_text_that_a_hint_offers_is_legal(example: dict[str, Any]) -> None:
    correction = bddl.correct(example["text"], objects=OBJECTS)
    for item in bddl.analyse(example["text"], objects=OBJECTS):
        offered = item.hint.removeprefix("write ")
        if correction is not None and _plain(offered) == _plain(correction.text):
            assert [one.severity for one in bddl.check(offered, objects=OBJECTS) if one.severity == "error"] == []


def test_hints_of_structural_slips_offer_the_whole_text() -> None:
    texts = ("(open refrigerator_0) and (ontop glass_0 table_0)", '["(open refrigerator_0)"]', "!(open refrigerator_0)")
    for text in texts:
        correction = bddl.correct(text, objects=OBJECTS)
        assert correction is not None
        assert f"write {correction.text}" in [item.hint for item in bddl.check(text, objects=OBJECTS)]


@pytest.mark.parametrize(
    "text",
    [
        # A second glass is not the first one, and a name that is used already is taken.
        "(ontop glass_7 table_0)",
        "(nextto fridge_0 refrigerator_0)",
        "(and (open refrigerator_0) ...)",
        "(levitating glass_0)",
        "(not (open refrigerator_0) (ontop glass_0 table_0))",
        "no formula at all",
        "",
        "(",
    ],
)
def test_what_is_not_certain_is_not_corrected(text: str) -> None:
    assert bddl.correct(text, objects=OBJECTS) is None


@pytest.mark.parametrize("text", ["(open refrigerator_0)", "; why\n(and (open refrigerator_0))", "(open glass#1)"])
def test_a_legal_text_is_left_as_it_is(text: str) -> None:
    correction = bddl.correct(text, objects={**OBJECTS, "glass#1": "glass"})
    assert correction == bddl.Correction(text, ())


def _call(formula: bddl.Formula) -> str:
    """Return a formula in the notation of calls."""
    if isinstance(formula, bddl.Atom):
        return f"{formula.predicate}({', '.join(formula.args)})"
    word = str(formula).removeprefix("(").split(" ", 1)[0].rstrip(")")
    return f"{word}({', '.join(map(_call, formula.operands))})"


def _infix(formula: bddl.Formula) -> str:
    """Return a formula with operators between operands; negations as prefixes, every operand in parentheses."""
    if isinstance(formula, bddl.Atom):
        return str(formula)
    if isinstance(formula, bddl.Not):
        return f"(not {_infix(formula.body)})"
    word = {bddl.And: "and", bddl.Or: "||", bddl.Imply: "->"}[type(formula)]
    return f"({f' {word} '.join(map(_infix, formula.operands))})"


def _as_json(formula: bddl.Formula) -> Any:
    if isinstance(formula, bddl.Atom):
        return [formula.predicate, *formula.args]
    word = {bddl.Not: "not", bddl.And: "and", bddl.Or: "or", bddl.Imply: "imply"}[type(formula)]
    return [word, *map(_as_json, formula.operands)]


_things = st.sampled_from(("glass_0", "table_0", "apple_0", "cabinet_0"))
_atoms = st.one_of(
    st.builds(lambda name: bddl.Atom("open", (name,)), _things),
    st.builds(lambda *names: bddl.Atom("nextto", names), _things, _things),
)
# Connectives with two operands or more: with one, infix notation does not show them.
_joined = st.recursive(
    _atoms,
    lambda inner: st.one_of(
        st.builds(bddl.Not, inner),
        st.builds(bddl.And, st.lists(inner, min_size=2, max_size=3).map(tuple)),
        st.builds(bddl.Or, st.lists(inner, min_size=2, max_size=3).map(tuple)),
        st.builds(bddl.Imply, inner, inner),
    ),
    max_leaves=8,
)


@given(_joined, st.sampled_from((_call, _infix, lambda formula: json.dumps(_as_json(formula)))), st.booleans())
def test_whole_notations_are_read_back(formula: bddl.Formula, notation: Any, fenced: bool) -> None:
    text = f"Sure, here it is:\n```\n{notation(formula)}\n```" if fenced else notation(formula)
    correction = bddl.correct(text, objects=OBJECTS)
    assert correction is not None
    assert bddl.parse_formula(correction.text, objects=OBJECTS) == formula


@given(formulas, st.data())
def test_a_correction_is_always_legal(formula: bddl.Formula, data: st.DataObject) -> None:
    text = bddl.format(formula)
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(text)))
        piece = data.draw(
            st.sampled_from(("(", ")", ",", '"', "not ", " and ", "[", "{", "`", "?", ":goal ", "...", "!"))
        )
        text = text[:place] + piece + text[place + data.draw(st.integers(0, 2)) :]
    correction = bddl.correct(text)
    if correction is not None:
        assert [item.code for item in bddl.check(correction.text) if item.severity == "error"] == []
    for item in bddl.check(text):
        assert item.slip is None or item.slip in bddl.SLIPS


@given(st.text(alphabet="()[]{}\"'`!&|,.?:-\\ \nopenatd", max_size=40))
def test_no_text_upsets_the_correction(text: str) -> None:
    correction = bddl.correct(text)
    if correction is not None:
        again = bddl.correct(correction.text)
        assert again is not None and again.text == correction.text
        assert [item.code for item in bddl.check(correction.text) if item.severity == "error"] == []


@pytest.mark.slow
@pytest.mark.parametrize("text", ["(" * 10_000, ")" * 10_000, "(not " * 10_000 + "open(x)", "[" * 10_000, "`" * 19_000])
def test_depth_and_length_are_no_obstacle(text: str) -> None:
    assert bddl.check(text) != ()
    assert bddl.correct(text) is None or bddl.check(text) != ()
