"""Transports to the test server, with a key that must never be seen, and waits that take no time."""

from __future__ import annotations

import base64
import struct
import zlib
from typing import Any

import pytest

from llm.client.openai import OpenAITransport
from llm.client.profiles import ModelProfile, find_profile
from llm.client.transport import ChatRequest
from tests.llm.model_server import ModelServer

PNG = base64.b64decode("iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGP4//8/AAX+Av4N70a4AAAAAElFTkSuQmCC")
"""A picture of one pixel; what is written behind it makes another file of it."""

KEY = "sk-never-to-be-seen-0123456789"
KEY_VARIABLE = "SCENE2DEMO_MODEL_KEY"
ASK = ChatRequest.of("Answer in JSON.", "Where is the mug?", json_schema={"type": "object"})


def profile_of(server: ModelServer, **changes: Any) -> ModelProfile:
    """Return a profile whose model is the test server."""
    profile = find_profile("openai-compatible:small")
    return profile.model_copy(update={"base_url": server.address, "base_url_variable": "", **changes})


def transport_to(
    server: ModelServer,
    monkeypatch: pytest.MonkeyPatch,
    *,
    retries: int = 2,
    longest_answer_bytes: int = 100_000,
    **changes: Any,
) -> OpenAITransport:
    """Return a transport to the test server that holds the key."""
    monkeypatch.setenv(KEY_VARIABLE, KEY)
    hurry(monkeypatch)
    profile = profile_of(server, **changes)
    return OpenAITransport(profile, retries=retries, longest_answer_bytes=longest_answer_bytes)


def hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the client library wait hardly at all before it sends again."""
    monkeypatch.setattr("openai._base_client.INITIAL_RETRY_DELAY", 0.001)


def png_of(width: int, height: int, rows: bytes = b"") -> bytes:
    """Return a picture whose file says that it has so many pixels, whatever it holds."""
    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    pieces = ((b"IHDR", head), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in pieces
    )


BAD_PICTURES: dict[str, tuple[bytes, str]] = {
    "900 million pixels": (png_of(30_000, 30_000), "million"),
    "100 million pixels": (png_of(10_000, 10_000), "million"),
    "65 million pixels": (png_of(65_000, 1_001), "million"),
    "cut off": (png_of(64, 64, bytes(65 * 64))[:60], "broken"),
    "garbage behind the mark": (b"\x89PNG\r\n\x1a\nand what follows", "broken"),
    "JPEG without an end": (b"\xff\xd8\xff\xe0" + bytes(40), "no picture"),
    "a letter": (b"Dear Sir", "PNG"),
}
"""Name -> file, and a word of why it is not sent."""
