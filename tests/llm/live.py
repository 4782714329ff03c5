"""Transports to the test server, with a key that must never be seen, and waits that take no time."""

from __future__ import annotations

from dataclasses import replace
from threading import Event
from typing import Any

import pytest

from llm.model_profile import ModelProfile
from llm.openai_transport import OpenAITransport
from llm.profiles import find_profile
from llm.retries import RetryPolicy
from llm.transport import ChatRequest
from tests.llm.model_server import ModelServer

KEY = "sk-never-to-be-seen-0123456789"
KEY_VARIABLE = "SCENE2DEMO_MODEL_KEY"
QUICK = RetryPolicy(attempts=3, first_wait_s=0.001, longest_wait_s=0.5)
ASK = ChatRequest.of("Answer in JSON.", "Where is the mug?", json_schema={"type": "object"})


def profile_of(server: ModelServer, **changes: Any) -> ModelProfile:
    """Returns a profile whose model is the test server."""
    profile = replace(find_profile("openai-compatible:small"), base_url=server.address, base_url_variable="")
    return replace(profile, **changes)


def transport_to(
    server: ModelServer,
    monkeypatch: pytest.MonkeyPatch,
    *,
    retries: RetryPolicy = QUICK,
    cancel: Event | None = None,
    longest_answer_bytes: int = 100_000,
    **changes: Any,
) -> OpenAITransport:
    """Returns a transport to the test server that holds the key."""
    monkeypatch.setenv(KEY_VARIABLE, KEY)
    profile = profile_of(server, **changes)
    return OpenAITransport(profile, retries=retries, cancel=cancel, longest_answer_bytes=longest_answer_bytes)
