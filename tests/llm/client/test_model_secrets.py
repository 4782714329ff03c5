"""The key reaches the server, and nothing else: no message, record, log, repr or other provider."""

from __future__ import annotations

import logging
import pickle
import traceback
from pathlib import Path

import pytest

from llm.client.profiles import find_profile
from llm.client.recording import Recorder
from llm.errors import ModelError
from tests.llm.live import ASK, KEY, transport_to
from tests.llm.model_server import Act, ModelServer, fails, replies

# A server that repeats what it was sent, in every place where it can say something.
TELLTALES = {
    "401": fails(401, f"Incorrect API key provided: {KEY}"),
    "500": fails(500, f"upstream said: Bearer {KEY} is {KEY}"),
    "long 500": fails(500, "x" * 280 + KEY),
    "page": Act(body=f"<html>{KEY}</html>".encode(), content_type="text/html"),
    "error in 200": Act(body=f'{{"error": "{KEY}"}}'.encode()),
    "cut short on a page": Act(body=f"<html>{'x' * 56}{KEY}</html>".encode(), content_type="text/html"),
    "cut off": replies(KEY, cut_at=120),
    "silent": Act(wait_s=20),
}


SPEECHLESS = {
    "refusal": {"message": {"refusal": KEY}},
    "finish reason": {"message": {}, "finish_reason": KEY},
    "cut short in the finish reason": {"message": {}, "finish_reason": "x" * 180 + KEY},
    "cut short in the refusal": {"message": {"refusal": "x" * 180 + KEY}},
}


@pytest.mark.parametrize("name", TELLTALES)
def test_no_failure_tells_the_key(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    file = tmp_path / "run.jsonl"
    with ModelServer(TELLTALES[name]) as server:
        transport = transport_to(server, monkeypatch, retries=1, timeout_s=1.0)
        with pytest.raises(ModelError) as caught:
            Recorder(transport, file).complete(ASK)
    assert server.seen[0].headers["authorization"] == f"Bearer {KEY}"
    error = caught.value
    # Any 12 letters of it would be too many.
    told = "".join(
        [str(error), repr(error), str(vars(error)), repr(transport), str(transport.profile), file.read_text()]
        + traceback.format_exception(error)
        + [f"{record.getMessage()}{vars(record)}" for record in caplog.records]
    )
    assert KEY[3:15] not in told
    assert error.__cause__ is None and error.__context__ is None


def test_a_redirect_that_is_cut_short_does_not_tell_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    moved = Act(status=307, headers={"Location": f"http://x/{'y' * 95}{KEY}"})
    with ModelServer(moved) as server, pytest.raises(ModelError, match="points elsewhere") as caught:
        transport_to(server, monkeypatch).complete(ASK)
    assert KEY[:12] not in str(caught.value) + str(vars(caught.value))


def test_no_reply_tells_the_key(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    file = tmp_path / "run.jsonl"
    choice = {"message": {"content": f"your key is {KEY}"}, "finish_reason": f"stopped for {KEY}"}
    with ModelServer(replies("", fields={"model": KEY, "choices": [choice]})) as server:
        reply = Recorder(transport_to(server, monkeypatch), file).complete(ASK)
    assert reply.text == "your key is [key]"
    assert KEY not in repr(reply) + file.read_text() + caplog.text


@pytest.mark.parametrize("name", SPEECHLESS)
def test_no_reply_without_a_text_tells_the_key(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    file = tmp_path / "run.jsonl"
    with ModelServer(Act(fields={"choices": [SPEECHLESS[name]]})) as server:
        reply = Recorder(transport_to(server, monkeypatch), file).complete(ASK)
    assert KEY[3:15] not in repr(reply) + file.read_text() + caplog.text


def test_a_transport_cannot_be_pickled(monkeypatch: pytest.MonkeyPatch) -> None:
    with ModelServer() as server:
        transport = transport_to(server, monkeypatch)
    with pytest.raises(TypeError, match="cannot be pickled"):
        pickle.dumps(transport)


def test_another_providers_account_is_told_to_nobody(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", "sk-of-openai")
    monkeypatch.setenv("OPENAI_ORG_ID", "org-secret")
    monkeypatch.setenv("OPENAI_PROJECT_ID", "project-secret")
    with ModelServer() as server:
        transport_to(server, monkeypatch).complete(ASK)
        transport_to(server, monkeypatch, key_variable="", key_required=False).complete(ASK)
        transport_to(server, monkeypatch, account_headers=True).complete(ASK)
    theirs, keyless, own = (str(seen.headers) for seen in server.seen)
    assert "secret" not in theirs and "of-openai" not in theirs
    assert "secret" not in keyless and "of-openai" not in keyless
    assert "org-secret" in own and "project-secret" in own
    assert find_profile("openai:gpt-5.2").account_headers
