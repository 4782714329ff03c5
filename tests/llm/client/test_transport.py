"""Requests: what they may hold, and that their digest covers exactly what was asked."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from llm.client.transport import ChatReply, ChatRequest, Image, Message, Transport, digest_of
from llm.errors import RequestError
from tests.test_layers import loaded_after

PLAIN = ChatRequest.of("Be brief.", "Where is the mug?", Image(b"abc"), json_schema={"type": "object"})


def test_the_digest_is_the_same_on_every_machine() -> None:
    """A change of this value makes every recording useless; it has to be wanted."""
    picture = '{"bytes":3,"image":"ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",'
    canonical = (
        '{"extra_body":{},"json_schema":{"type":"object"},"max_tokens":null,'
        '"messages":[{"parts":["Where is the mug?",' + picture + '"media_type":"image/png"}],"role":"user"}],'
        '"mode":null,"system":"Be brief.","temperature":null}'
    )
    assert PLAIN.digest() == hashlib.sha256(canonical.encode()).hexdigest()


@pytest.mark.parametrize(
    "change",
    [
        {"system": "Be long."},
        {"messages": (Message(("Where is the mug?",)),)},
        {"messages": (Message((Image(b"abc"), "Where is the mug?")),)},
        {"messages": (Message(("Where is the mug?", Image(b"abd"))),)},
        {"messages": (Message(("Where is the mug?", Image(b"abc", "image/jpeg"))),)},
        {"messages": (Message(("Hm.",), "assistant"), *PLAIN.messages)},
        {"json_schema": None},
        {"json_schema": {"type": "array"}},
        {"mode": "plain"},
        {"temperature": 0.0},
        {"max_tokens": 10},
        {"extra_body": {"seed": 1}},
    ],
)
def test_whatever_changes_the_question_changes_the_digest(change: dict[str, Any]) -> None:
    assert replace(PLAIN, **change).digest() != PLAIN.digest()


def test_how_long_one_waits_is_no_part_of_the_question() -> None:
    assert replace(PLAIN, timeout_s=3.0).digest() == PLAIN.digest()


JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-9, 9) | st.floats(-2, 2) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.text(max_size=4), JSON, max_size=4), st.text(st.characters(), max_size=20))
def test_the_digest_survives_being_written_and_read(schema: dict[str, object], text: str) -> None:
    request = ChatRequest.of(text, text, json_schema=schema)
    turned = replace(request, json_schema=dict(reversed(schema.items())))
    read = json.loads(json.dumps(request.record()))
    assert digest_of(read) == request.digest() == turned.digest()


def test_a_record_holds_no_picture_but_its_hash() -> None:
    assert PLAIN.record()["messages"] == [
        {
            "role": "user",
            "parts": [
                "Where is the mug?",
                {
                    "image": "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad",
                    "media_type": "image/png",
                    "bytes": 3,
                },
            ],
        }
    ]
    assert "abc" not in repr(PLAIN)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Image(b""), "not empty"),
        (lambda: Image("text"), "bytes of an encoded picture"),  # type: ignore[arg-type]
        (lambda: Image(b"x", "image/tiff"), "not 'image/tiff'"),
        (lambda: Message(()), "at least one part"),
        (lambda: Message(("x",), "system"), "system text is `system`"),  # type: ignore[arg-type]
        (lambda: Message((Image(b"x"),), "assistant"), "texts only"),
        (lambda: ChatRequest("x", ()), "last message is the user's"),
        (lambda: ChatRequest("x", (Message(("x",), "assistant"),)), "last message is the user's"),
        (lambda: replace(PLAIN, mode="xml"), "json_schema, json_object, plain, or None, not 'xml'"),
        (lambda: replace(PLAIN, mode="json_schema", json_schema=None), "needs a json_schema"),
        (lambda: replace(PLAIN, timeout_s=0.0), "above 0"),
        (lambda: replace(PLAIN, timeout_s=float("nan")), "above 0"),
        (lambda: replace(PLAIN, max_tokens=0), "at least 1"),
        (lambda: replace(PLAIN, extra_body={"x": {1}}).digest(), "are JSON"),
        (lambda: replace(PLAIN, extra_body={"x": float("inf")}).digest(), "are JSON"),
    ],
)
def test_a_wrong_request_is_refused_where_it_is_made(make: Any, words: str) -> None:
    with pytest.raises(RequestError, match=words):
        make()


def test_whatever_completes_requests_is_a_transport() -> None:
    class Script:
        def complete(self, request: ChatRequest) -> ChatReply:
            return ChatReply(request.system)

    assert isinstance(Script(), Transport)
    assert not isinstance(object(), Transport)


CLIENT_LIBRARIES = {"openai", "httpx", "httpx2", "anyio", "jiter"}


@pytest.mark.parametrize("module", ["llm", "llm.client.openai", "llm.client.connect"])
def test_importing_loads_no_client_library(module: str) -> None:
    assert not loaded_after(f"import {module}") & CLIENT_LIBRARIES
