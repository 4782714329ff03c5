"""Single-edit mutants of an activity are rejected, on the line of the edit; random texts are read or reported."""

from __future__ import annotations

import random
from itertools import islice

import pytest

import bddl
from benchmarks.conformance.cutting import cut
from benchmarks.conformance.fuzz import LIBERO_TEXT, PROFILES, fuzzed, use_everything
from benchmarks.conformance.mutants import KINDS, OMISSIONS, Mutant, mutants
from tests.bddl.activity import ACTIVITY, edited

MUTANTS = [mutant for seed in range(4) for mutant in mutants("rinse", ACTIVITY, seed)]
DEPTH = 3_000  # Three times as deep as Python nests calls.


def test_every_kind_of_mutant_is_made() -> None:
    assert {mutant.kind for mutant in MUTANTS} == set(KINDS)


def test_a_mutant_tells_its_lines() -> None:
    before = ACTIVITY.split("\n")
    for mutant in MUTANTS:
        after = mutant.text.split("\n")
        kept = {line for line in range(1, len(after) + 1) if line not in mutant.lines}
        assert mutant.lines and mutant.text != ACTIVITY
        assert all(after[line - 1] in before for line in kept), mutant.kind


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.kind)
def test_a_mutant_is_rejected_on_its_line(mutant: Mutant) -> None:
    errors = [found for found in bddl.check(mutant.text, profile="behavior") if found.severity == "error"]
    assert errors
    if mutant.kind not in OMISSIONS:
        assert errors[0].line in mutant.lines


def test_the_cutter_sees_what_the_parser_sees() -> None:
    definition, problem = cut(ACTIVITY), bddl.parse(ACTIVITY, profile="behavior")
    assert definition.objects == [item.name for item in problem.objects]
    atoms = [node for node in problem.goal.walk() if isinstance(node, bddl.Atom)]
    assert [definition.source(atom).replace("?", "") for atom in definition.atoms(":goal")] == [str(a) for a in atoms]
    assert len(definition.binders()) == sum(
        len(node.binders) for node in problem.goal.walk() if isinstance(node, bddl.ast.Quantified)
    )


@pytest.mark.parametrize("profile", PROFILES)
def test_random_texts_are_read_or_reported(profile: str) -> None:
    texts = fuzzed([ACTIVITY, edited("Rinse_Three_Cups-0", "other"), LIBERO_TEXT], random.Random(profile))
    # `make conformance` draws many more.
    for text in islice(texts, 40):
        for found in bddl.check(text, profile=profile):
            assert found.code in bddl.MEANINGS and str(found)
        use_everything(text, profile)


def test_the_fuzz_check_leaves_no_profile_out() -> None:
    assert set(PROFILES) == set(bddl.PROFILES)


@pytest.mark.parametrize(
    "opening",
    ["(not ", "(fornpairs (1) (?cup.n.01 - cup.n.01) (?saucer.n.02 - saucer.n.02) "],
)
def test_a_deep_goal_is_read_and_printed(opening: str) -> None:
    deep = opening * DEPTH + "(open ?sink.n.01_1)" + ")" * DEPTH
    text = edited("(real ?tea.n.05_1)", f"(real ?tea.n.05_1) {deep}")
    problem = bddl.parse(text, profile="behavior")
    assert bddl.parse(bddl.format(problem), profile="behavior") == problem


def test_many_objects_are_read_and_printed() -> None:
    cups = " ".join(f"cup.n.01_{number}" for number in range(4, 20_000))
    problem = bddl.parse(edited("cup.n.01_3 - cup.n.01", f"cup.n.01_3 {cups} - cup.n.01"), profile="behavior")
    assert len(problem.objects) > 20_000
    assert bddl.parse(bddl.format(problem), profile="behavior") == problem


def test_an_activity_survives_printing_in_both_profiles() -> None:
    for profile in ("behavior", "behavior-compat"):
        problem = bddl.parse(ACTIVITY, profile=profile)
        assert bddl.parse(bddl.format(problem), profile=profile) == problem


def test_every_span_of_an_activity_covers_its_own_text() -> None:
    problem = bddl.parse(ACTIVITY, profile="behavior")
    for formula in (*problem.init, problem.goal):
        for node in formula.walk():
            assert node.span is not None
            covered = ACTIVITY[node.span.offset : node.span.offset + node.span.length]
            assert " ".join(covered.split()).replace("( ", "(").replace(" )", ")").replace("?", "") == str(
                node
            ).replace("?", "")
            if isinstance(node, bddl.Atom):
                words = [ACTIVITY[span.offset : span.offset + span.length].strip("?") for span in node.word_spans]
                assert words == list(node.label)
    for item in problem.objects:
        assert item.span is not None and ACTIVITY[item.span.offset :].startswith(item.name)
