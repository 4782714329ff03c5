"""Where a mistake is placed, how often it is reported, what it is called, and that what a hint offers is legal."""

from __future__ import annotations

import random
import re

import pytest

import bddl
from benchmarks.conformance.fuzz import LIBERO_TEXT
from tests.bddl.activity import ACTIVITY, edited

NAMES = ("glass_0", "glass_1", "table_0", "refrigerator_0", "apple_0", "bowl_0")
OBJECTS = {name: name.partition("_")[0] for name in NAMES}
FORMULAS = (
    "(not (open refrigerator_0))",
    "(and (inside glass_0 refrigerator_0) (not (open refrigerator_0)))",
    "(forall (?x - glass) (and (ontop ?x table_0) (not (inside ?x bowl_0))))",
    "(or (open refrigerator_0) (exists (?x - glass) (inside ?x refrigerator_0)))",
    "(forn (2) (?x - glass) (inside ?x refrigerator_0))",
    "(forpairs (?x - glass) (?y - apple) (nextto ?x ?y))",
    "(imply (open refrigerator_0) (ontop apple_0 table_0))",
)
OPENINGS = [(text, place) for text in FORMULAS for place, letter in enumerate(text) if letter == "("]
OFFER = re.compile(r"(?:give the formula alone: |remove the outer parentheses: |(?:.*, )?write )(\(.*\))")
TOKEN = re.compile(r"[()]|[^\s()]+")
ONE_LINE = " ".join(ACTIVITY.split())


def _errors(text: str, profile: str = "scene") -> list[bddl.Diagnostic]:
    objects = OBJECTS if profile == "scene" else None
    return [found for found in bddl.check(text, profile=profile, objects=objects) if found.severity == "error"]


def _illegal_offers(text: str) -> list[str]:
    """Return the forms that hints about a formula offer and that are not legal as they are."""
    mistakes = _errors(text)
    known = {found.code for found in mistakes} & {"unknown-object", "unknown-predicate", "wrong-arity"}
    offers = [match.group(1) for found in mistakes if (match := OFFER.fullmatch(found.hint))]
    forms = [offer for offer in offers if not re.search(r"FORMULA|CATEGORY|NAME|\(N\)|\.\.\.|\), or ", offer)]
    return [form for form in forms if any(found.code not in (*known, "unbound-variable") for found in _errors(form))]


@pytest.mark.parametrize(("text", "place"), OPENINGS)
def test_a_missing_opening_parenthesis_is_found_on_one_line(text: str, place: int) -> None:
    (found,) = _errors(text[:place] + text[place + 1 :])
    assert (found.code, found.column) == ("missing-parenthesis", place + 1)
    assert found.hint == f"write {text}"


@pytest.mark.parametrize("section", ["(define", "(problem", "(:domain", "(:objects", "(:init", "(:goal", "(forall"])
def test_a_missing_opening_parenthesis_of_a_problem_on_one_line_is_found(section: str) -> None:
    place = ONE_LINE.index(section)
    (found,) = _errors(ONE_LINE[:place] + ONE_LINE[place + 1 :], "behavior")
    assert (found.code, found.column) == ("missing-parenthesis", place + 1)


@pytest.mark.parametrize("text", ["not open refrigerator_0", "[and [open refrigerator_0]]", "open", "(((", ")("])
def test_no_hint_offers_what_is_illegal(text: str) -> None:
    assert _errors(text) and _illegal_offers(text) == []
    assert all(found.hint for found in _errors(text))


def test_a_loose_negation_is_offered_with_both_its_parentheses() -> None:
    assert _errors("not open refrigerator_0")[0].hint == "write (not (open refrigerator_0))"


@pytest.mark.slow
def test_what_hints_offer_for_damaged_formulas_is_legal() -> None:
    rng = random.Random(17)
    words = ["(", ")", "and", "not", "glass_0", "?x", "-", "open", ",", "cup_0", "2", "is", "[", "isnot", "fridge_0"]
    offered = 0
    for _ in range(600):
        tokens = TOKEN.findall(rng.choice(FORMULAS))
        for _ in range(rng.randint(1, 2)):
            place = rng.randrange(len(tokens))
            tokens[place : place + rng.randrange(2)] = rng.choice(([], [rng.choice(words)]))
        text = " ".join(tokens)
        offered += any(OFFER.fullmatch(found.hint) for found in _errors(text))
        assert _illegal_offers(text) == [], text
    assert offered > 100


@pytest.mark.parametrize(
    ("text", "code", "slip"),
    [
        ("(forn (two) (?x - glass) (open ?x))", "bad-count", None),
        ("(forn (-1) (?x - glass) (open ?x))", "bad-count", None),
        ("(forall (glass) (open refrigerator_0))", "bad-binder", "binder-shape"),
        ("<bddl>(open refrigerator_0)</bddl>", "text-around", "prose-around"),
        ("(At glass_0 table_0)", "unknown-predicate", "predicate-synonym"),
        ("(goal (open refrigerator_0))", "unknown-predicate", "goal-section"),
        ("(not_open refrigerator_0)", "unknown-predicate", "opposite-predicate"),
        ("(for_all (?x - glass) (open ?x))", "unknown-predicate", "misspelt-word"),
    ],
)
def test_the_code_decides_which_slips_are_possible(text: str, code: str, slip: str | None) -> None:
    assert [(found.code, found.slip) for found in _errors(text)] == [(code, slip)]


def test_objects_in_parentheses_are_no_invented_predicate() -> None:
    text = "(define (problem p) (:domain d) (:objects (a_1 - a)) (:goal (and)))"
    assert [(found.code, found.slip) for found in bddl.check(text)] == [("not-a-name", None)]


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("-pi/2 3.14", "inf nan"),
        ("          (:target wooden_cabinet_1)\n", ""),
        ("(And (On", "(Or (On"),
        ("(And (On bowl_1 plate_1)", "(And (Not (On bowl_1 plate_1))"),
    ],
)
def test_mistakes_of_libero_s_own_sections_are_no_invented_words(old: str, new: str) -> None:
    assert old in LIBERO_TEXT
    assert _errors(LIBERO_TEXT.replace(old, new), "libero")[0].slip is None


@pytest.mark.parametrize(
    ("old", "new", "code"),
    [
        ("(define (problem", "(defin (problem", "unknown-predicate"),
        ("(:domain omnigibson)", ":domain omnigibson", "bad-section"),
        ("(forall\n                (?cup.n.01 - cup.n.01)", "(for_all (?cup.n.01 - cup.n.01)", "unknown-predicate"),
        ("(forall\n                (?cup.n.01 - cup.n.01)", "(atleast 2 (?cup.n.01 - cup.n.01)", "unknown-predicate"),
        ("(forall\n                (?cup.n.01 - cup.n.01)", "(forall ?cup.n.01 - cup.n.01", "bad-binder"),
        ("countertop.n.01_1 - countertop.n.01", "countertop_1 - countertop.n.01", "wrong-category"),
        ("(nextto ?cup.n.01 ?saucer.n.02)", "(inroom ?cup.n.01 kitchen)", "misplaced-predicate"),
    ],
)
def test_one_mistake_is_reported_once(old: str, new: str, code: str) -> None:
    assert [found.code for found in _errors(edited(old, new), "behavior")] == [code]


def test_prose_with_parentheses_behind_an_answer_is_one_mistake() -> None:
    text = "Sure! Here is it:\n(open refrigerator_0)\nLet me know (if you want) more (or less)."
    (found,) = _errors(text)
    assert found.code == "text-around" and found.hint.endswith("(open refrigerator_0)")


def test_a_word_for_counting_leads_to_the_forms_that_count() -> None:
    (found,) = _errors("(atleast 2 (?x - glass) (open ?x))")
    assert "(forn (N)" in found.hint and "(fornpairs (N)" in found.hint


def test_an_unused_variable_and_the_object_in_its_place_are_one_mistake() -> None:
    found = bddl.analyse("(forall (?x - glass) (inside glass_0 bowl_0))", objects=OBJECTS)
    assert [item.code for item in found if item.code in ("unused-variable", "mixed-instance")] == ["unused-variable"]


def test_a_wildcard_is_no_near_name_of_an_object() -> None:
    text = edited("cup.n.01_1 cup.n.01_2 cup.n.01_3 - cup.n.01", "cup.n.01_* - cup.n.01")
    assert not any("_*" in found.hint for found in _errors(text, "behavior") if found.code == "unknown-object")


@pytest.mark.parametrize(
    ("text", "wrong", "right"),
    [
        ("(nand (open refrigerator_0))", "and?", "(not (and FORMULA FORMULA))"),
        ("(xor (open refrigerator_0) (open bowl_0))", "or?", "(not (and FORMULA FORMULA))"),
        ("(not_open refrigerator_0)", "open?", "write (not (open refrigerator_0))"),
        ("(at glass_0 table_0)", "BDDL has no numbers", "ontop or inside or nextto"),
    ],
)
def test_no_near_name_reverses_the_meaning(text: str, wrong: str, right: str) -> None:
    (found,) = _errors(text)
    assert wrong not in found.hint and right in found.hint


def test_a_word_for_a_declared_category_leads_to_it() -> None:
    text = edited("(?cup.n.01 - cup.n.01)\n                (not", "(?cup.n.01 - cups)\n                (not")
    assert [(found.code, found.hint) for found in _errors(text, "behavior")] == [("bad-name", "did you mean cup.n.01?")]
