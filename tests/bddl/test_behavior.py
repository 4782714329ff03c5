"""The profiles `behavior` and `behavior-compat`: what one rejects and the other tolerates, and where."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

import bddl
from bddl.dialects import PROFILES
from tests.bddl.activity import ACTIVITY, edited
from tests.bddl.slips_in_activities import SLIPS, Slip

GOLDEN = Path(__file__).parents[1] / "golden" / "bddl_behavior_messages.txt"


def _diagnostics(text: str, profile: str = "behavior") -> tuple[bddl.Diagnostic, ...]:
    return bddl.check(text, profile=profile)


def test_an_activity_is_legal() -> None:
    problem = bddl.parse(ACTIVITY, profile="behavior")
    assert problem.warnings == ()
    assert problem.name == "Rinse_Three_Cups-0"
    assert [item.name for item in problem.objects if item.category == "sink.n.01"] == ["sink.n.01_1", "sink.n.01_*"]
    kinds = [type(part) for part in bddl.conjuncts(problem.goal)]
    assert kinds == [bddl.Atom, bddl.ForAll, bddl.ForN, bddl.ForPairs, bddl.ForNPairs, bddl.Imply]


def test_compatible_mode_reads_a_legal_activity_alike() -> None:
    strict, compatible = (bddl.parse(ACTIVITY, profile=name) for name in ("behavior", "behavior-compat"))
    assert compatible == strict and compatible.warnings == ()


def test_letter_case_is_of_no_account_but_in_the_name_of_the_problem() -> None:
    title = "Rinse_Three_Cups-0"
    loud = ACTIVITY.upper().replace(title.upper(), title)
    assert bddl.parse(loud, profile="behavior") == bddl.parse(ACTIVITY, profile="behavior")


@pytest.mark.parametrize("slip", SLIPS, ids=lambda slip: slip.name)
def test_strict_mode_rejects_each_slip_at_its_place(slip: Slip) -> None:
    text = edited(slip.old, slip.new)
    first = next(found for found in _diagnostics(text) if found.severity == "error")
    assert first.code == slip.code
    place = text.index(slip.at)
    line = text.count("\n", 0, place) + 1
    assert (first.line, first.column) == (line, place - text.rfind("\n", 0, place))


@pytest.mark.parametrize("slip", [slip for slip in SLIPS if slip.tolerated], ids=lambda slip: slip.name)
def test_compatible_mode_warns_of_what_the_reference_lets_pass(slip: Slip) -> None:
    problem = bddl.parse(edited(slip.old, slip.new), profile="behavior-compat")
    assert slip.code in [warning.code for warning in problem.warnings]
    assert all(warning.severity == "warning" for warning in problem.warnings)


@pytest.mark.parametrize("slip", [slip for slip in SLIPS if not slip.tolerated], ids=lambda slip: slip.name)
def test_compatible_mode_rejects_what_the_reference_rejects(slip: Slip) -> None:
    found = _diagnostics(edited(slip.old, slip.new), "behavior-compat")
    assert any(diagnostic.severity == "error" for diagnostic in found)


def test_every_tolerance_is_exercised() -> None:
    exercised = {slip.code for slip in SLIPS if slip.tolerated} | {"repeated-object"}
    assert {entry.partition(":")[0] for entry in PROFILES["behavior-compat"].tolerated} == exercised


def test_messages_are_those_of_the_golden_file() -> None:
    shown = "\n".join(
        f"===== {slip.name}\n" + "\n".join(str(found) for found in _diagnostics(edited(slip.old, slip.new))) + "\n"
        for slip in SLIPS
    )
    if os.environ.get("UPDATE_GOLDEN"):
        GOLDEN.write_text(shown, encoding="utf-8")
    assert shown == GOLDEN.read_text(encoding="utf-8")


def _compatible(old: str, new: str) -> bddl.Problem:
    return bddl.parse(edited(old, new), profile="behavior-compat")


def test_the_reference_drops_a_second_goal_and_a_second_start() -> None:
    plain = bddl.parse(ACTIVITY, profile="behavior")
    assert _compatible("    )\n)\n", "(open sink.n.01_1)\n    )\n)\n") == plain
    assert _compatible("    (:goal", "(:init (open sink.n.01_1)) (:goal") == plain


def test_the_reference_joins_two_goal_sections_the_later_first() -> None:
    plain = bddl.parse(ACTIVITY, profile="behavior")
    joined = _compatible("    (:goal", "(:goal (open sink.n.01_1)) (:goal")
    assert bddl.conjuncts(joined.goal) == (*bddl.conjuncts(plain.goal), bddl.Atom("open", ("sink.n.01_1",)))


def test_the_reference_drops_what_follows_inside_not() -> None:
    water = "(covered ?cup.n.01 ?water.n.06_1)"
    assert _compatible(water, f"{water} (open ?cup.n.01)") == bddl.parse(ACTIVITY, profile="behavior")


def test_the_reference_forgets_the_first_line_of_a_category() -> None:
    again = "- cup.n.01 cup.n.01_3 cup.n.01_2 cup.n.01_1 -"
    problem = _compatible("cup.n.01_2 cup.n.01_3 -", again)
    cups = [item.name for item in problem.objects if item.category == "cup.n.01"]
    assert cups == ["cup.n.01_3", "cup.n.01_2", "cup.n.01_1"]


def test_the_reference_lets_the_first_of_two_object_sections_win() -> None:
    again = "(:objects cup.n.01_7 - cup.n.01 lid.n.02_1 - lid.n.02) (:init"
    problem = _compatible("    (:init", again)
    names = [item.name for item in problem.objects]
    assert names[:4] == ["cup.n.01_1", "cup.n.01_2", "cup.n.01_3", "lid.n.02_1"]


def test_the_reference_takes_the_first_letter_of_a_loose_number() -> None:
    problem = _compatible("(2)", "12")
    (node,) = [node for node in problem.goal.walk() if type(node) is bddl.ForN]
    assert node.count == 1


def test_the_reference_calls_objects_without_a_category_object() -> None:
    problem = _compatible(" - agent.n.01", "")
    assert problem.objects[-1] == bddl.TypedObject("agent.n.01_1", "object")


def test_an_object_that_is_declared_twice_is_a_warning_in_both() -> None:
    text = edited("cup.n.01_2 cup.n.01_3 -", "cup.n.01_2 cup.n.01_2 -").replace("cup.n.01_3", "cup.n.01_2")
    for profile in ("behavior", "behavior-compat"):
        problem = bddl.parse(text, profile=profile)
        assert [warning.code for warning in problem.warnings] == ["repeated-object"]
        assert [item.name for item in problem.objects].count("cup.n.01_2") == 2


def test_several_mistakes_are_all_reported() -> None:
    text = edited("(filled", "(fill", edited("sink.n.01_1 kitchen", "sink.n.01_1 kitchens", edited("(:init", "(:int")))
    assert [found.code for found in _diagnostics(text)] == ["unknown-section", "unknown-room", "unknown-predicate"]


def test_water_that_a_washer_makes_need_not_be_asked_for() -> None:
    text = edited("(insource sink.n.01_1 water.n.06_1)", "(future water.n.06_1)")
    assert [found.code for found in _diagnostics(text)] == ["future-without-real"]
    washer = edited("        tea.n.05_1 - tea", "        washer.n.03_1 - washer.n.03\n        tea.n.05_1 - tea", text)
    assert _diagnostics(washer) == ()


def test_a_quantified_real_asks_for_every_object_of_its_category() -> None:
    text = edited("(real ?tea.n.05_1)", "(exists (?tea.n.05 - tea.n.05) (real ?tea.n.05))")
    assert _diagnostics(text) == ()


@pytest.mark.parametrize(
    ("domain", "legal", "illegal"),
    [("igibson", "stained", "folded"), ("omnigibson", "folded", "stained"), ("behavior-100", "dusty", "hot")],
)
def test_the_domain_decides_about_the_predicates(domain: str, legal: str, illegal: str) -> None:
    text = (
        f"(define (problem p-0) (:domain {domain}) (:objects rug.n.01_1 - rug.n.01) (:init (inroom rug.n.01_1 bar)) "
        "(:goal ({} ?rug.n.01_1)))"
    )
    assert bddl.check(text.format(legal), profile="behavior") == ()
    assert [found.code for found in bddl.check(text.format(illegal), profile="behavior")] == ["unknown-predicate"]


def test_a_formula_alone_may_name_any_instance_but_no_free_variable() -> None:
    assert bddl.parse_formula("(ontop ?Cup.n.01_1 table.n.02_1)", profile="behavior") == bddl.Atom(
        "ontop", ("cup.n.01_1", "table.n.02_1")
    )
    (found,) = bddl.check("(open ?cup.n.01)", profile="behavior")
    assert found.code == "unbound-variable"


def test_tolerated_mistakes_are_what_check_returns() -> None:
    (found,) = bddl.check("(not (open cup.n.01_1) (hot cup.n.01_1))", profile="behavior-compat")
    assert (found.code, found.severity) == ("wrong-arity", "warning")


@pytest.mark.parametrize("slip", [slip for slip in SLIPS if slip.tolerated], ids=lambda slip: slip.name)
def test_what_compatible_mode_reads_survives_printing(slip: Slip) -> None:
    problem = bddl.parse(edited(slip.old, slip.new), profile="behavior-compat")
    assert bddl.parse(bddl.format(problem), profile="behavior-compat") == problem


def test_a_profile_of_one_s_own_may_leave_out_forms() -> None:
    plain = replace(bddl.PROFILES["scene"], name="plain", forms=frozenset({"and", "not"}))
    (found,) = bddl.check("(and (forall (?x - cup) (open ?x)))", profile=plain)
    assert (found.code, found.hint) == ("unsupported-form", "the forms are: and, not")


def test_a_name_that_is_far_from_thousands_of_objects_is_reported_in_short() -> None:
    objects = {f"cup_{number}": "cup" for number in range(5_000)}
    (found,) = bddl.check("(open zebra)", objects=objects)
    assert found.code == "unknown-object" and len(found.hint) < 400
