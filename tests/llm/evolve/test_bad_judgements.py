"""Thousands of wrong answers of Inspector and Supervisor: none is taken, each fault is named, nothing else raised."""

from __future__ import annotations

from collections import Counter

import pytest

from llm.evolve import GiveUp, Situation
from llm.evolve.judges import judges
from oag.model.actions import flow_to_json
from oag.model.diagnostics import CODES
from oag.revision import History, Revision
from tests.llm.evolve.bad_judgements import OF_BOTH, OF_ONE, RIGHT_FLOW, STEP, BadJudgement, generate, right_answer
from tests.llm.evolve.scripted_judges import ajar, as_reply, attempt_of
from tests.llm.forms import answer_codes
from tests.llm.scripted import Scripted
from tests.oag.paper import scene

QUICK = range(150)
ALL = range(2_400)
SEEN = ajar()
SITUATION = Situation(SEEN.task, 3, scene("T1"), attempt_of(SEEN, ()), History(3), observation=SEEN)


def check(seed: int) -> BadJudgement:
    """Check the bad answer of a seed, and returns it."""
    bad = generate(seed)
    both = judges(Scripted(bad.reply), rounds=2)
    if bad.who == "supervisor":
        answer = both.supervisor.revise(SITUATION)
        assert isinstance(answer, GiveUp) and answer.reason, f"seed {seed}, {bad.fault}: {bad.reply}"
    else:
        critique = both.inspector.inspect(SEEN, STEP - 1)
        assert critique.evidence.model_did_not_judge, f"seed {seed}, {bad.fault}: {bad.reply}"
    assert not any(entry.accepted for entry in both.conversation.rounds)
    found = [finding for entry in both.conversation.entries for finding in entry.findings]
    codes = {finding.code for finding in found}
    assert codes & bad.codes, f"seed {seed}, {bad.who}, {bad.fault}: {codes} names none of {set(bad.codes)}"
    assert codes <= {*answer_codes(), *CODES}
    assert all(finding.message for finding in found)
    assert len("\n".join(str(finding) for finding in found)) < 60_000
    return bad


def test_the_right_answers_would_be_taken() -> None:
    both = judges(Scripted(as_reply(right_answer("inspector"))))
    assert both.inspector.inspect(SEEN, STEP - 1).state_reached is False
    both = judges(Scripted(as_reply(right_answer("supervisor"))))
    answer = both.supervisor.revise(SITUATION)
    assert isinstance(answer, Revision) and flow_to_json(answer.flow) == RIGHT_FLOW


@pytest.mark.parametrize("part", range(5))
def test_bad_judgements_are_refused_and_named(part: int) -> None:
    for seed in QUICK[part::5]:
        check(seed)


@pytest.mark.slow
def test_thousands_of_bad_judgements_are_refused_and_named() -> None:
    met = Counter((bad.who, bad.fault) for bad in map(check, ALL))
    assert sum(met.values()) == len(ALL)
    assert set(met) == {(who, fault.__name__) for who, own in OF_ONE.items() for fault in (*OF_BOTH, *own)}


def test_equal_seeds_give_equal_answers() -> None:
    assert [generate(seed) for seed in range(20)] == [generate(seed) for seed in range(20)]
