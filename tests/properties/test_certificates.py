"""Properties 12 to 14: certificates pass the independent check, survive JSON, and cannot be bent."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import oag
from tests.bruteforce import Part, decided
from tests.forgeries import VALIDATOR, claim_holds, forgeries, rehashed, same
from tests.framings import framings
from tests.properties import formulas
from tests.properties.plans import FACTS, Case, cases, crossed_cases

FEW = settings(max_examples=40, deadline=None)
MANY = settings(max_examples=2000, deadline=None)


def certificate_of(task: oag.Task) -> dict[str, Any]:
    """The certificate of a task after a trip through JSON."""
    certificate = oag.compose(task).verify().certificate
    # A plan that is not well formed has none.
    assume(certificate is not None)
    data: dict[str, Any] = json.loads(json.dumps(certificate.to_json()))  # type: ignore[union-attr]
    return data


def check_passes(task: oag.Task) -> None:
    """12: it passes before and after a trip through JSON, and has the documented form."""
    data = certificate_of(task)
    result = oag.recheck(data)
    assert result, result.reason
    assert oag.recheck(oag.compose(task).verify().certificate) == result
    VALIDATOR.validate(data)


def check_change(task: oag.Task, data: st.DataObject) -> None:
    """13: with a few things changed and the hashes right, it is rejected, or of the same plan it says the same."""
    original = certificate_of(task)
    changed = data.draw(forgeries(original))
    assert not oag.recheck(changed) or VALIDATOR.is_valid(changed)
    if oag.recheck(changed) and all(same(changed[key], original[key]) for key in ("plan", "scene")):
        assert all(same(changed[key], original[key]) for key in ("verdict", "failure"))


def check_forgery(case: Case, data: st.DataObject) -> None:
    """14: with a few things changed and the hashes right, whatever it says of its own plan is so."""
    forged = data.draw(forgeries(certificate_of(case.task())))
    if oag.recheck(forged):
        assert VALIDATOR.is_valid(forged)
        assert claim_holds(forged, FACTS) is not False


def check_framing(case: Case, data: st.DataObject) -> None:
    """14: so it is when the plan or its start is changed, and then any verdict is given with links that fit."""
    original = certificate_of(case.task())
    for forged in framings(data.draw(st.one_of(st.just(original), forgeries(original)))):
        if oag.recheck(forged):
            assert claim_holds(forged, FACTS) is not False


def check_formula_framing(task: oag.Task) -> None:
    """13: so it is when any verdict is given with links that fit."""
    original = certificate_of(task)
    for forged in framings(original):
        if oag.recheck(forged):
            assert all(same(forged[key], original[key]) for key in ("verdict", "failure"))


def check_judge(case: Case) -> None:
    """What a certificate says as it was made is so by the judge of forgeries, too."""
    held = claim_holds(certificate_of(case.task()), ())
    assert held is True or (case.loose and held is None)


@given(cases(most_unknown=4))
@FEW
def test_the_judge_agrees_with_what_was_not_forged(case: Case) -> None:
    check_judge(case)


@given(cases())
@FEW
def test_p12_certificates_pass_and_survive_json(case: Case) -> None:
    check_passes(case.task())


@given(crossed_cases())
@settings(FEW, max_examples=60)
def test_p12_so_do_those_whose_assumptions_say_what_a_step_wrote(case: Case) -> None:
    check_passes(case.task())
    check_judge(case)


@given(formulas.formula_cases())
@settings(FEW, max_examples=30)
def test_p12_certificates_of_formulas_pass_and_survive_json(case: formulas.FormulaCase) -> None:
    check_passes(case.task())


@given(cases(most_unknown=2), st.data())
@settings(FEW, max_examples=100)
def test_p13_an_altered_certificate_is_rejected_or_still_true(case: Case, data: st.DataObject) -> None:
    check_change(case.task(), data)


@given(formulas.formula_cases(), st.data())
@settings(FEW, max_examples=40)
def test_p13_so_is_one_about_formulas(case: formulas.FormulaCase, data: st.DataObject) -> None:
    check_change(case.task(), data)


@given(cases(), st.data())
@settings(FEW, max_examples=100)
def test_p14_what_passes_is_so(case: Case, data: st.DataObject) -> None:
    check_forgery(case, data)


@given(cases(most_unknown=3), st.data())
@settings(FEW, max_examples=2)
def test_p14_no_other_verdict_passes(case: Case, data: st.DataObject) -> None:
    check_framing(case, data)


@given(cases(most_unknown=0), st.data())
@settings(FEW, max_examples=50)
def test_p14_a_proof_of_one_plan_is_none_of_another(case: Case, data: st.DataObject) -> None:
    """Links taken from one plan and put under another, hashes made right, pass only if that plan is right too."""
    other = data.draw(cases(most_unknown=0))
    forged = certificate_of(case.task())
    second = certificate_of(other.task())
    assert oag.recheck(rehashed(second)), "what is not forged passes"
    forged["plan"], forged["scene"] = second["plan"], second["scene"]
    if oag.recheck(rehashed(forged)):
        assert claim_holds(forged, FACTS)


@pytest.mark.slow
@given(cases(most_unknown=6))
@MANY
def test_p12_at_length(case: Case) -> None:
    check_passes(case.task())


@pytest.mark.slow
@given(crossed_cases())
@MANY
def test_p12_crossed_at_length(case: Case) -> None:
    check_passes(case.task())


@pytest.mark.slow
@given(formulas.formula_cases())
@MANY
def test_p12_formulas_at_length(case: formulas.FormulaCase) -> None:
    check_passes(case.task())
    verdict = certificate_of(case.task())["verdict"]
    assert verdict == decided(case.starts(), case.parts, case.goal, formulas.KINDS)[0]


def test_two_unknown_facts_that_exclude_each_other_are_distinguished() -> None:
    first, second = ("inside", "cup_0", "cup_1"), ("inside", "cup_1", "cup_0")
    contradiction = ("and", ("or", (second, False), (first, False)), ("and", (first, False), (first, True)))
    known = {("open", "fridge_0"): False}
    start = (("open", "fridge_0"), False)
    part = Part("fridge_0", None, (start, contradiction), ((("open", "fridge_0"), True),), (17, 1, 2, 3, 4, 5))
    case = formulas.FormulaCase(known, (first, second), (part,), ())
    assert oag.recheck(oag.compose(case.task()).verify().certificate)


@pytest.mark.slow
@given(cases(most_unknown=4), st.data())
@MANY
def test_p13_at_length(case: Case, data: st.DataObject) -> None:
    check_change(case.task(), data)


@pytest.mark.slow
@given(formulas.formula_cases(), st.data())
@MANY
def test_p13_formulas_at_length(case: formulas.FormulaCase, data: st.DataObject) -> None:
    check_change(case.task(), data)


@pytest.mark.slow
@given(cases(most_unknown=6), st.data())
@settings(MANY, max_examples=4000)
def test_p14_at_length(case: Case, data: st.DataObject) -> None:
    check_forgery(case, data)


@pytest.mark.slow
@given(cases(most_unknown=3), st.data())
@settings(MANY, max_examples=100)
def test_p14_no_other_verdict_passes_at_length(case: Case, data: st.DataObject) -> None:
    check_framing(case, data)


@pytest.mark.slow
@given(formulas.formula_cases())
@settings(MANY, max_examples=20)
def test_p13_no_other_verdict_about_formulas_passes(case: formulas.FormulaCase) -> None:
    check_formula_framing(case.task())
