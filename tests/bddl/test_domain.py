"""Domain files, and problems that are read by them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

import bddl
from bddl.ast import RESERVED_WORDS

TEXT = """
; A small domain.
(define (domain Workshop)
    (:requirements :STRIPS :typing)
    (:types
        vise clamp - holder
        plank
    )
    (:predicates
        (Glued ?a ?b - plank)
        (ontop ?item ?support)
        (drying ?a - plank ?b)
    )
    (:action glue
        :parameters (?a ?b)
        :precondition (not (Glued ?a ?b)) ; once is enough
        :effect (Glued ?a ?b)
    )
)
"""

names = st.from_regex(r"[a-z][a-z_]{0,5}", fullmatch=True).filter(lambda name: name not in RESERVED_WORDS)


@st.composite
def domains(draw: st.DrawFn) -> bddl.Domain:
    """Return domains with distinct predicates, types and parameters."""
    types = draw(st.lists(names, unique=True, max_size=3))
    predicates = []
    for name in draw(st.lists(names, unique=True, min_size=1, max_size=4)):
        variables = draw(st.lists(names, unique=True, max_size=3))
        kinds = [draw(st.sampled_from((*types, "object"))) for _ in variables]
        parameters = tuple(bddl.Binder(*pair) for pair in zip(variables, kinds, strict=True))
        predicates.append(bddl.DomainPredicate(name, parameters))
    return bddl.Domain(
        draw(names),
        tuple(draw(st.lists(st.sampled_from((":adl", ":typing")), unique=True))),
        tuple(bddl.TypedObject(name, "object") for name in types),
        tuple(predicates),
    )


def test_a_domain_has_its_parts() -> None:
    domain = bddl.parse_domain(TEXT)
    assert (domain.name, domain.requirements) == ("Workshop", (":strips", ":typing"))
    assert [(item.name, item.category) for item in domain.types] == [
        ("vise", "holder"),
        ("clamp", "holder"),
        ("plank", "object"),
    ]
    assert [(predicate.name, predicate.parameters) for predicate in domain.predicates] == [
        ("glued", (("a", "plank"), ("b", "plank"))),
        ("ontop", (("item", "object"), ("support", "object"))),
        ("drying", (("a", "plank"), ("b", "object"))),
    ]
    assert [action.name for action in domain.actions] == ["glue"]
    assert domain.actions[0].text == (
        "(:action glue :parameters (?a ?b) :precondition (not (Glued ?a ?b)) :effect (Glued ?a ?b))"
    )
    assert domain.predicates[1].span is not None and domain.predicates[1].span.line == 11


def test_a_domain_survives_printing() -> None:
    domain = bddl.parse_domain(TEXT)
    assert bddl.parse_domain(bddl.format(domain)) == domain


@given(domains())
def test_every_domain_survives_printing(domain: bddl.Domain) -> None:
    assert bddl.parse_domain(bddl.format(domain)) == domain


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("(domain Workshop)", "(domain)", "bad-section"),
        ("(:predicates", "(:predicate", "unknown-section"),
        (":typing", ":tying", "unknown-requirement"),
        (":typing", "(typing)", "unknown-requirement"),
        ("(ontop ?item", "(ontop item", "bad-predicate"),
        ("(ontop ?item ?support)", "(ontop ?item ?item)", "bad-predicate"),
        ("(ontop ?item ?support)", "ontop", "bad-predicate"),
        ("(ontop ?item", "(and ?item", "bad-predicate"),
        ("(ontop ?item", "(glued ?item", "repeated-predicate"),
        ("vise clamp -", "-", "bad-objects"),
        ("- holder", "- (holder)", "bad-objects"),
        (":action glue", ":action", "bad-section"),
        ("    (:types", "    (:action glue) (:types", "repeated-section"),
        (":effect (Glued ?a ?b)", ":effect (Glued ?a ?b", "missing-parenthesis"),
    ],
)
def test_what_is_wrong_in_a_domain_is_reported(old: str, new: str, code: str) -> None:
    assert TEXT.count(old) == 1
    with pytest.raises(bddl.BDDLError) as raised:
        bddl.parse_domain(TEXT.replace(old, new))
    assert raised.value.diagnostics[0].code == code


def test_texts_of_another_kind_are_told_apart() -> None:
    problem = "(define (problem p) (:domain d) (:goal (open refrigerator_0)))"
    for text, read in ((problem, bddl.parse_domain), (TEXT, bddl.parse), (TEXT, bddl.parse_formula)):
        with pytest.raises(bddl.BDDLError) as raised:
            read(text)
        assert raised.value.diagnostics[0].code == "wrong-kind"
    assert bddl.check(TEXT) == ()
    with pytest.raises(TypeError, match="BDDL text is a str"):
        bddl.parse_domain(None)  # type: ignore[arg-type]
