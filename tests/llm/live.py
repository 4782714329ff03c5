"""Transports to the test server, with a key that must never be seen, and waits that take no time."""

from __future__ import annotations

from threading import Event
from typing import Any

import pytest

from llm.wire.client import OpenAITransport
from llm.wire.profiles import ModelProfile, find_profile
from llm.wire.transport import ChatRequest
from tests.llm.model_server import ModelServer

KEY = "sk-never-to-be-seen-0123456789"
KEY_VARIABLE = "SCENE2DEMO_MODEL_KEY"
ASK = ChatRequest.of("Answer in JSON.", "Where is the mug?", json_schema={"type": "object"})


def profile_of(server: ModelServer, **changes: Any) -> ModelProfile:
    """Returns a profile whose model is the test server."""
    profile = find_profile("openai-compatible:small")
    return profile.model_copy(update={"base_url": server.address, "base_url_variable": "", **changes})


def transport_to(
    server: ModelServer,
    monkeypatch: pytest.MonkeyPatch,
    *,
    retries: int = 2,
    cancel: Event | None = None,
    longest_answer_bytes: int = 100_000,
    **changes: Any,
) -> OpenAITransport:
    """Returns a transport to the test server that holds the key."""
    monkeypatch.setenv(KEY_VARIABLE, KEY)
    hurry(monkeypatch)
    profile = profile_of(server, **changes)
    return OpenAITransport(profile, retries=retries, cancel=cancel, longest_answer_bytes=longest_answer_bytes)


def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets the client library wait hardly at all before it sends again."""
    monkeypatch.setattr("openai._base_client.INITIAL_RETRY_DELAY", 0.001)
