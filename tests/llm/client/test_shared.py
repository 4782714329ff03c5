"""One budget for several processes: what each uses counts for all, and what was recorded uses up nothing."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import llm
from llm.client.budget import Budget
from llm.client.profiles import Price
from llm.client.recording import Recorder
from llm.client.shared import Shared, usage_in
from llm.client.transport import ChatReply
from llm.errors import BudgetSpent, CassetteError, ModelConfigError, ModelUnavailable
from tests.llm.live import ASK
from tests.llm.scripted import Scripted

PRICE = Price(input=2.0, output=10.0)


def shared(script: Scripted, file: Path, price: Price | None = PRICE, **limits: float) -> Shared:
    """Return a process's transport; a request costs 10 tokens of 2 and 5 of 10 dollars a million."""
    return Shared(script, file, name="lab:small", budget=Budget(**limits), price=price)  # type: ignore[arg-type]


def test_what_one_process_uses_counts_for_all(tmp_path: Path) -> None:
    script, file = Scripted(), tmp_path / "answers" / "used.json"
    one, other = (shared(script, file, cost_usd=200e-6) for _ in range(2))
    for process in (one, other, one):
        process.complete(ASK)
    for process in (one, other):
        with pytest.raises(BudgetSpent, match=r"budget of \$0\.0002 is used up\. Used by all together: 3 requests"):
            process.complete(ASK)
    assert len(script.asked) == 3
    used = usage_in(file, "lab:small")
    assert used.cost_usd == pytest.approx(210e-6) and used.tokens == 45
    # Who starts later, with more, goes on.
    shared(script, file, cost_usd=1.0).complete(ASK)
    assert len(script.asked) == 4


def test_nothing_is_lost_between_processes_that_count_at_once(tmp_path: Path) -> None:
    file = tmp_path / "used.json"

    def use(_: int) -> None:
        shared(Scripted(), file).complete(ASK)

    with ThreadPoolExecutor(8) as threads:
        list(threads.map(use, range(200)))
    used = usage_in(file, "lab:small")
    assert (used.requests, used.input_tokens) == (200, 2000)


def test_a_recorded_reply_uses_up_nothing(tmp_path: Path) -> None:
    script, file, recording = Scripted(), tmp_path / "used.json", tmp_path / "e.jsonl"
    Recorder(shared(script, file, tokens=1), recording).complete(ASK)
    again = Recorder(shared(script, file, tokens=1), recording, resume=True, same_start=False)
    assert again.complete(ASK).recorded
    with pytest.raises(BudgetSpent):
        again.complete(ASK)
    assert len(script.asked) == 1


def test_requests_without_a_reply_and_without_a_price_are_said(tmp_path: Path) -> None:
    file = tmp_path / "used.json"
    with pytest.raises(ModelUnavailable):
        shared(Scripted(ModelUnavailable("lab:small", "it is busy")), file).complete(ASK)
    shared(Scripted(ChatReply("fine", 10, None)), file, price=None).complete(ASK)
    used = usage_in(file, "lab:small")
    assert (used.requests, used.failures, used.uncounted) == (2, 1, 1)
    assert used.cost_usd is None and "1 failed" in used.summary()


@pytest.mark.parametrize("text", ["{", "[]", "[" * 4000, '{"requests": 1}', json.dumps({"requests": -1})])
def test_a_file_that_says_something_else_is_refused(tmp_path: Path, text: str) -> None:
    script, file = Scripted(), tmp_path / "used.json"
    file.write_text(text)
    with pytest.raises(CassetteError, match="does not say what was used"):
        shared(script, file).complete(ASK)
    assert not script.asked
    with pytest.raises(CassetteError, match="does not say what was used"):
        usage_in(file, "lab:small")


def test_nothing_was_used_only_where_there_is_no_file(tmp_path: Path) -> None:
    assert usage_in(tmp_path / "answers" / "used.json", "lab:small").requests == 0
    with pytest.raises(CassetteError, match="cannot be counted"):
        usage_in(tmp_path, "lab:small")


def test_a_limit_in_dollars_needs_a_price(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SCENE2DEMO_MODEL_URL", "http://127.0.0.1:9/v1")
    with pytest.raises(ModelConfigError, match="needs a price"):
        llm.connect("openai-compatible:m", budget=Budget(cost_usd=1.0), shared=tmp_path / "used.json")
