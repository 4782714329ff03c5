"""One configuration string is all that a run needs: live, recorded, replayed."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from llm.client.budget import Budget
from llm.client.connect import connect
from llm.errors import BadReply, BudgetSpent, CassetteError, ModelConfigError, ModelError, QueryError
from llm.structured.conversation import AnswersRefused, Conversation
from tests.llm.live import ASK, KEY, KEY_VARIABLE, hurry
from tests.llm.model_server import ModelServer, fails, replies
from tests.source_tree import ROOT


def test_live_then_replayed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "run.jsonl"
    monkeypatch.setenv(KEY_VARIABLE, KEY)
    hurry(monkeypatch)
    with ModelServer(fails(503), replies("on the table"), key=KEY) as server:
        monkeypatch.setenv("SCENE2DEMO_MODEL_URL", server.address)
        live = connect("openai-compatible:small", record=file)
        first = live.complete(ASK)
    assert (first.text, first.attempts) == ("on the table", 2)
    # Each time that it was sent; its price is not known.
    assert (live.usage.requests, live.usage.failures, live.usage.cost_usd) == (2, 1, None)

    monkeypatch.delenv(KEY_VARIABLE)
    monkeypatch.delenv("SCENE2DEMO_MODEL_URL")
    again = connect(f"replay:{file}", budget=Budget(cost_usd=1.0, requests=1))
    assert again.complete(ASK) == first
    # The tokens are those of the recording; nothing was paid.
    assert again.usage.tokens == live.usage.tokens > 0
    assert again.usage.cost_usd == 0.0
    with pytest.raises(BudgetSpent):
        again.complete(ASK)


def test_a_replay_loads_no_client_library(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "run.jsonl"
    with ModelServer(replies("here")) as server:
        monkeypatch.setenv("SCENE2DEMO_MODEL_URL", server.address)
        connect("openai-compatible:small", record=file).complete(ASK)
    code = (
        "import sys\nfrom llm.client.connect import connect\nfrom llm.client.transport import ChatRequest\n"
        "ask = ChatRequest.of('Answer in JSON.', 'Where is the mug?', json_schema={'type': 'object'})\n"
        "print(connect('replay:' + sys.argv[1]).complete(ask).text)\n"
        "print({'openai', 'httpx2', 'httpx', 'anyio'} & set(sys.modules))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(file)], cwd=ROOT, capture_output=True, text=True, timeout=600, check=True
    )
    assert done.stdout.split("\n") == ["here", "set()", ""]


def test_modules_have_models_prices_and_sampling_of_their_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    profiles, file = tmp_path / "p.toml", tmp_path / "run.jsonl"
    prices = (("small", 1.0), ("large", 100.0))
    profiles.write_text(
        "".join(f"[openai-compatible.models.{name}]\nprice = {{input = {p}, output = 0.0}}\n" for name, p in prices)
    )
    monkeypatch.setenv("SCENE2DEMO_PROFILES", str(profiles))
    how = {"models": {5: "openai-compatible:large"}, "temperature": 0.2, "seed": 7}
    with ModelServer(replies("{}")) as server:
        monkeypatch.setenv("SCENE2DEMO_MODEL_URL", server.address)
        model = connect("openai-compatible:small", record=file, **how)  # type: ignore[arg-type]
        first, second = model.complete(ASK), model.complete(replace(ASK, module=5))
    assert [seen.body["model"] for seen in server.seen] == ["small", "large"]
    assert [(seen.body["temperature"], seen.body["seed"]) for seen in server.seen] == [(0.2, 7)] * 2
    assert model.usage.cost_usd == pytest.approx(((first.input_tokens or 0) + 100 * (second.input_tokens or 0)) / 1e6)
    # The key in the recording is the digest of what was sent.
    assert first.request_sha256 in file.read_text() and first.request_sha256 != ASK.digest()
    again = connect(f"replay:{file}", temperature=0.2, seed=7)
    assert again.complete(ASK).text == "{}" and again.usage.recorded == 1
    with pytest.raises(CassetteError, match=r"temperature: recorded 0\.2"):
        connect(f"replay:{file}").complete(ASK)


def test_a_model_without_a_temperature_says_so() -> None:
    with pytest.raises(ModelConfigError, match="takes no temperature"):
        connect("openai:gpt-5.2", temperature=0.2)


def test_what_is_missing_is_said_before_anything_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENAI_API_KEY", raising=False)
    file = tmp_path / "run.jsonl"
    with pytest.raises(ModelConfigError, match="OPENAI_API_KEY is not set"):
        connect("openai:gpt-5.2", record=file)
    with pytest.raises(ModelConfigError, match="no provider is named"):
        connect("nobody:x", record=file)
    with pytest.raises(ModelConfigError, match=r"Name its file, as in replay:run\.jsonl"):
        connect("replay:")
    with pytest.raises(CassetteError, match="cannot be read"):
        connect(f"replay:{file}")
    assert not file.exists()


@pytest.mark.parametrize(
    "configuration",
    [
        "\x1b]0;owned\x07",
        "\x1b[2J:small",
        "openai:\x1b[31mgpt",
        "openai-compatible:\x9b31m",
        "replay:\x1b[2J\u202e.jsonl",
        "openai-compatible:gpt\u2028x",
    ],
)
def test_a_configuration_steers_no_terminal(configuration: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, KEY)
    monkeypatch.delenv("SCENE2DEMO_MODEL_URL", raising=False)
    with pytest.raises(ModelError) as caught:
        connect(configuration)
    error = caught.value
    shown = f"{error}{error.model}{error.problem}{error.advice}".replace("\n", "")
    assert shown.isprintable()


def test_a_query_and_a_recorded_failure_steer_no_terminal() -> None:
    assert str(QueryError("empty", "\x1b[2Jput it", "\x9b31m")).replace("\n", "").isprintable()
    assert str(AnswersRefused(Conversation("\x1b[2J", "\x07", "s"), 1, ())).replace("\n", "").isprintable()
    assert str(BadReply("m", "it said \x1b[2J", "\x07")).isprintable()
