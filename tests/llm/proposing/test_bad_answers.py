"""Thousands of wrong answers to all five modules: none is taken, each fault is named, nothing else is raised."""

from __future__ import annotations

from collections import Counter

import pytest

import llm
import oag
from llm.proposing.model_proposer import ModelProposer
from oag.model.diagnostics import CODES
from tests.llm.bad_answers import ANY_MODULE, OF_MODULE, BadAnswer, generate
from tests.llm.forms import answer_codes
from tests.llm.scripted_modules import QUERIES, Script, Wrong, right_answers, scene_of

# The search for a fix takes seconds on answer 120; the slow test has it.
QUICK = [seed for seed in range(200) if seed != 120]
ALL = range(2_400)
FAULTS = {fault.__name__ for fault in (*ANY_MODULE, *(fault for faults in OF_MODULE.values() for fault in faults))}


def findings_for(bad: BadAnswer) -> tuple[oag.Diagnostic, ...]:
    """Return everything that was found wrong while a model insisted on a bad answer, which has to be refused."""
    script = Script(right_answers(bad.task), {bad.module: [Wrong(bad.reply)]})
    proposer = ModelProposer(script, name="script", rounds=2, revisions=3, cross_check=False)
    with pytest.raises(llm.AnswersRefused) as caught:
        proposer.propose(QUERIES[bad.task], scene_of(bad.task))
    assert str(caught.value)
    return tuple(found for entry in caught.value.conversation.entries for found in entry.findings)


def check(seed: int) -> BadAnswer:
    """Check the bad answer of a seed, and returns it."""
    bad = generate(seed)
    found = findings_for(bad)
    codes = {finding.code for finding in found}
    assert codes & bad.codes, f"seed {seed}, module {bad.module}, {bad.fault}: {codes} names none of {set(bad.codes)}"
    assert codes <= {*answer_codes(), *CODES}
    assert all(finding.message for finding in found)
    said = "\n".join(str(finding) for finding in found)
    assert bad.culprit in said, f"seed {seed}, {bad.fault}: {bad.culprit!r} is not in\n{said}"
    assert len(said) < 60_000
    return bad


@pytest.mark.parametrize("part", range(10))
def test_bad_answers_are_refused_and_named(part: int) -> None:
    for seed in QUICK[part::10]:
        check(seed)


@pytest.mark.slow
def test_thousands_of_bad_answers_are_refused_and_named() -> None:
    met = Counter((bad.module, bad.fault) for bad in map(check, ALL))
    assert sum(met.values()) == len(ALL) >= 2_000
    assert {fault for _, fault in met} == FAULTS
    assert {module for module, _ in met} == {1, 2, 3, 4, 5}


def test_equal_seeds_give_equal_answers() -> None:
    assert [generate(seed) for seed in range(20)] == [generate(seed) for seed in range(20)]
