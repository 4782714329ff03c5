"""A problem that is read by its domain, given apart or in one text; sets of facts and texts; the profile `auto`."""

from __future__ import annotations

import pytest

import bddl
from tests.bddl.activity import ACTIVITY

DOMAIN = """(define (domain Logistics) (:requirements :strips :typing)
    (:types truck plane - vehicle vehicle package - thing place)
    (:predicates (at ?x - thing ?room - place) (in ?p - package ?v - vehicle))
    (:action load :parameters (?p) :precondition (and) :effect (and)))
"""
PROBLEM = """(define (problem P1) (:domain logistics)
    (:objects T1 - truck A1 - plane b1 - package home - place)
    (:init (at T1 home) (in b1 a1))
    (:goal (and (at b1 home) (forall (?v - vehicle) (at ?v home))))
    (:metric minimize (total-cost)))
"""


def test_a_problem_is_read_by_its_domain() -> None:
    problem = bddl.parse(PROBLEM, domain=bddl.parse_domain(DOMAIN))
    assert [item.name for item in problem.objects] == ["t1", "a1", "b1", "home"]
    assert str(problem.goal) == (
        "(and (at b1 home) (and (forall (?v - truck) (at ?v home)) (forall (?v - plane) (at ?v home))))"
    )
    assert bddl.evaluate(problem.goal, {("at", "b1", "home"), ("at", "t1", "home")}, problem.objects) is False
    for text in (DOMAIN + PROBLEM, PROBLEM + DOMAIN):
        both = bddl.parse(text)
        assert both == problem and bddl.check(text) == () and bddl.analyse(text, prove=False) == ()
    assert bddl.parse(PROBLEM, domain=DOMAIN) == problem


@pytest.mark.parametrize(
    ("old", "new", "code", "place"),
    [
        ("(in b1 a1)", "(inn b1 a1)", "unknown-predicate", (7, 26)),
        ("(in b1 a1)", "(in b1)", "wrong-arity", (7, 26)),
        ("(in b1 a1)", "(in b1 a2)", "unknown-object", (7, 32)),
        ("A1 - plane", "A1 - plain", "unknown-category", (6, 26)),
        ("(?v - vehicle)", "(?v - vehicles)", "unknown-category", (8, 44)),
        ("forall (", "forn (1) (", "unsupported-form", (8, 30)),
        ("(:domain logistics)", "(:domain kitchen)", "unknown-domain", (5, 31)),
    ],
)
def test_what_the_domain_does_not_have_is_reported(old: str, new: str, code: str, place: tuple[int, int]) -> None:
    assert PROBLEM.count(old) == 1
    found = bddl.check(DOMAIN + PROBLEM.replace(old, new))
    assert [(one.code, one.line, one.column) for one in found] == [(code, *place)]


def test_a_type_without_objects_is_legal_and_empty() -> None:
    text = PROBLEM.replace("T1 - truck A1 - plane ", "").replace("(at T1 home) (in b1 a1)", "(at b1 home)")
    problem = bddl.parse(text, domain=DOMAIN)
    assert str(problem.goal) == "(and (at b1 home) (forall (?v - vehicle) (at ?v home)))"
    assert bddl.evaluate(problem.goal, {("at", "b1", "home")}, problem.objects) is True


def test_a_wrong_domain_is_reported() -> None:
    with pytest.raises(bddl.BDDLError) as raised:
        bddl.parse(DOMAIN.replace("(:types", "(:typs") + PROBLEM)
    assert [(one.code, one.line) for one in raised.value.diagnostics] == [("unknown-section", 2)]


@pytest.mark.parametrize("fact", [bddl.Atom("open", ("a",)), ("open", "a"), "(open a)"])
def test_a_set_has_all_that_is_true(fact: bddl.Atom | tuple[str, ...] | str) -> None:
    assert bddl.evaluate("(and (open a) (not (open b)))", {fact}) is True
    assert bddl.evaluate("(open a)", frozenset[str]()) is False
    assert bddl.GoalProgress(bddl.parse_formula("(open a)"))({fact}) == 1.0


def test_the_profile_may_be_found_by_the_text() -> None:
    assert bddl.parse(ACTIVITY, "auto") == bddl.parse(ACTIVITY, "behavior")
    assert bddl.parse_formula("(cooked ?apple.n.01_1)", "auto") == bddl.Atom("cooked", ("apple.n.01_1",))
    assert bddl.check("(open refrigerator_0)", "auto") == bddl.analyse("(open refrigerator_0)", "auto") == ()
    assert bddl.evaluate("(cooked ?apple.n.01_1)", {"(cooked apple.n.01_1)"}) is True
    with pytest.raises(bddl.UnknownProfile):
        bddl.parse(ACTIVITY, "automatic")
