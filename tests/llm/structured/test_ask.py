"""Asking until an answer holds: errors refuse, doubts are asked about once, rounds end."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence

import pytest

import llm
import oag
from llm.client.transport import ChatReply
from llm.errors import ModelTimeout
from llm.proposing.understanding import Understanding
from llm.structured.ask import MOST_REPEATS, Log, ask
from llm.structured.conversation import Conversation, finding
from llm.structured.prompting import Prompt, Refused
from tests.llm.forms import answer_codes
from tests.llm.scripted import Scripted
from tests.source_tree import ROOT

PROMPT = Prompt(1, "system", "question")


def answer(goal: str) -> str:
    """Return an answer of module 1 with a goal."""
    texts = {"problem": "", "task_name": "n", "task_activity_name": "n", "task_message_detail": "", "goal": goal}
    return json.dumps(texts)


def check(given: Understanding) -> Sequence[oag.Diagnostic]:
    """Refuse goals that say wrong, doubts those that say odd."""
    found = []
    if "wrong" in given.goal:
        found.append(finding("answer/empty-goal", f"{given.goal} is wrong", "goal"))
    if "odd" in given.goal:
        found.append(finding("answer/other-reading", f"{given.goal} is odd", "goal", severity="warning"))
    return found


def asked(*replies: str, rounds: int = 4, objection: Refused | None = None) -> tuple[str, Scripted, Conversation]:
    """Return the goal of the answer that was taken, who was asked, and the record."""
    script, log = Scripted(*map(ChatReply, replies)), Log(Conversation("script", "query", "scene"))
    taken = ask(script, PROMPT, Understanding, check, rounds=rounds, log=log, objection=objection)
    return taken.goal, script, log.conversation


def test_a_right_answer_is_taken_at_once() -> None:
    goal, script, conversation = asked(answer("a"))
    assert (goal, len(script.asked)) == ("a", 1)
    assert conversation.rounds[0].accepted
    assert conversation.rounds[0].request_sha256 == script.asked[0].digest()


def test_the_old_answer_and_the_numbered_findings_come_with_the_next_question() -> None:
    _, script, conversation = asked(answer("wrong"), "no JSON", answer("a"))
    first, second, third = script.asked
    assert [message.role for message in second.messages] == ["user", "assistant", "user"]
    assert second.messages[:1] == first.messages
    assert second.messages[1].parts == (answer("wrong"),)
    assert "1. answer/empty-goal  goal" in str(second.messages[2].parts[0])
    assert "Earlier answers were refused for:\n- answer/empty-goal goal" in str(third.messages[2].parts[0])
    assert [entry.accepted for entry in conversation.rounds] == [False, False, True]


def test_a_doubt_is_raised_once_and_an_answer_that_stays_is_taken() -> None:
    goal, script, conversation = asked(answer("odd"))
    assert (goal, len(script.asked)) == ("odd", 2)
    assert "give the same answer again" in str(script.asked[1].messages[2].parts[0])
    assert [entry.accepted for entry in conversation.rounds] == [False, True]


def test_each_new_doubt_is_raised_and_the_last_answer_stands_when_the_rounds_end() -> None:
    goal, script, _ = asked(answer("odd 1"), answer("odd 2"), answer("odd 3"), rounds=3)
    assert (goal, len(script.asked)) == ("odd 3", 3)


def test_a_doubted_answer_is_better_than_a_wrong_one() -> None:
    goal, _, _ = asked(answer("odd"), answer("wrong"), rounds=2)
    assert goal == "odd"


def test_rounds_end_with_the_whole_story() -> None:
    with pytest.raises(llm.AnswersRefused) as caught:
        asked(*(answer(f"wrong {number}") for number in range(9)), rounds=3)
    assert not caught.value.insists
    assert caught.value.module == 1
    assert len(caught.value.conversation.rounds) == 3
    assert str(caught.value).splitlines() == [
        "script does not solve module 1 in 3 rounds (query: 'query')",
        "  round 1  module 1  refused: answer/empty-goal",
        "  round 2  module 1  refused: answer/empty-goal",
        "  round 3  module 1  refused: answer/empty-goal",
        "the last answer:",
        "  answer/empty-goal  goal",
        "            wrong 2 is wrong",
    ]


def test_an_answer_that_is_only_written_otherwise_counts_as_the_same() -> None:
    spaced = json.dumps(json.loads(answer("wrong")), indent=3)
    with pytest.raises(llm.AnswersRefused) as caught:
        asked(answer("wrong"), f"Sorry. {spaced}", f"```{answer('wrong')}```", rounds=10)
    assert caught.value.insists
    assert len(caught.value.conversation.rounds) == 1 + MOST_REPEATS


def test_an_objection_comes_with_the_first_question() -> None:
    objection = Refused(answer("old"), (oag.Diagnostic("goal/not-reached", "error", "it is false", "task goal"),))
    _, script, _ = asked(answer("a"), objection=objection)
    assert script.asked[0].messages[1].parts == (answer("old"),)
    assert "goal/not-reached" in str(script.asked[0].messages[2].parts[0])


def test_what_the_transport_raises_goes_through() -> None:
    script = Scripted(ModelTimeout("script", "no reply in 1 s"))
    with pytest.raises(ModelTimeout):
        ask(script, PROMPT, Understanding, check, rounds=4, log=Log(Conversation("script", "q", "s")))
    assert len(script.asked) == 1


def test_a_reply_that_was_cut_off_is_told_so() -> None:
    script = Scripted(ChatReply('{"problem": "', finish_reason="length"), ChatReply(answer("a")))
    log = Log(Conversation("script", "q", "s"))
    ask(script, PROMPT, Understanding, check, rounds=2, log=log)
    assert [found.code for found in log.conversation.rounds[0].findings] == ["answer/cut-off"]


def test_every_code_is_documented() -> None:
    sources = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "llm").rglob("*.py"))
    assert set(re.findall(r'"(answer/[a-z-]+)"', sources)) == answer_codes()
