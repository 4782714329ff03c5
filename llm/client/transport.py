"""Requests to a model and its replies: the one interface of live models, recordings and scripts.

A request has content only. The model, its address and its settings belong to the transport. So a run recorded
with one model replays without it, and the digest of a request does not depend on where it is sent.
"""

from __future__ import annotations

import hashlib
import json
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module, metadata
from io import BytesIO
from typing import Literal, Protocol, TypeAlias, runtime_checkable

from llm.errors import RequestError

# How JSON is requested: by a schema, by a JSON-only mode, or by the prompt alone.
Mode = Literal["json_schema", "json_object", "plain"]
MODES: tuple[Mode, ...] = ("json_schema", "json_object", "plain")
BOUNDS = ("maxLength", "minItems", "maxItems", "pattern")
"""Keys of a schema that bound an answer; several endpoints reject a request that has them."""
FORMS = "anyOf"
"""Key of a schema whose alternatives narrow the fields next to it; only the library's own server is known to do so."""


def project_version() -> str:
    """Return the installed version of this project, for records; empty if it is not installed."""
    try:
        return metadata.version("scene2demo")
    except metadata.PackageNotFoundError:
        return ""


MEDIA_TYPES = ("image/png", "image/jpeg", "image/webp", "image/gif")
MOST_PIXELS = 64_000_000
"""Most pixels of a picture: services accept no more, and each takes three bytes when decoded."""


@dataclass(frozen=True, slots=True)
class Image:
    """An encoded picture.

    Attributes:
        data: The bytes of the encoded file.
        media_type: One of MEDIA_TYPES.
    """

    data: bytes = field(repr=False)
    media_type: str = "image/png"

    def __post_init__(self) -> None:
        if type(self.data) is not bytes or not self.data:
            raise RequestError("an image's data is the bytes of an encoded picture, and not empty")
        if self.media_type not in MEDIA_TYPES:
            raise RequestError(f"an image's media type is one of {', '.join(MEDIA_TYPES)}, not {self.media_type!r}")

    @property
    def sha256(self) -> str:
        """The SHA-256 of the bytes, in hexadecimal."""
        return hashlib.sha256(self.data).hexdigest()

    def problem(self) -> str | None:
        """Return why a picture is unusable for a model; None if all of it can be decoded."""
        pillow = import_module("PIL.Image")
        kinds = [kind.partition("/")[2] for kind in MEDIA_TYPES]
        with warnings.catch_warnings():
            warnings.simplefilter("error", pillow.DecompressionBombWarning)
            try:
                with pillow.open(BytesIO(self.data), formats=kinds) as picture:
                    width, height = picture.size
                    if width * height > MOST_PIXELS:
                        return f"it has {width} x {height} pixels; {MOST_PIXELS // 1_000_000} million are the most"
                    picture.load()
            except (pillow.DecompressionBombWarning, pillow.DecompressionBombError):
                return f"it has far more than {MOST_PIXELS // 1_000_000} million pixels, which are the most"
            except pillow.UnidentifiedImageError:
                return "it is no picture in PNG, JPEG, WebP or GIF"
            except Exception as error:  # Decoders raise exceptions of any kind.
                return f"it is broken: {error}"
        return None

    def record(self) -> dict[str, object]:
        """Return the picture's entry in records: hash, media type and size [bytes]."""
        return {"image": self.sha256, "media_type": self.media_type, "bytes": len(self.data)}


Part: TypeAlias = str | Image


@dataclass(frozen=True, slots=True)
class Message:
    """One turn of a conversation.

    Attributes:
        parts: Texts and images, in the order in which the model reads them.
        role: The user, or the model in an earlier reply (then texts only).
    """

    parts: tuple[Part, ...]
    role: Literal["user", "assistant"] = "user"

    def __post_init__(self) -> None:
        if not self.parts:
            raise RequestError("a message has at least one part")
        if self.role not in ("user", "assistant"):
            raise RequestError(f"a message's role is user or assistant, not {self.role!r}; system text is `system`")
        if self.role == "assistant" and self.images:
            raise RequestError("an assistant's message has texts only; images go into a user's message")

    @property
    def images(self) -> tuple[Image, ...]:
        """The message's pictures, in order."""
        return tuple(part for part in self.parts if isinstance(part, Image))

    def record(self) -> dict[str, object]:
        """Return the message as JSON, with hashes in place of pictures."""
        return {"role": self.role, "parts": [part if isinstance(part, str) else part.record() for part in self.parts]}


@dataclass(frozen=True, slots=True)
class ChatRequest:
    """Content of one exchange.

    Attributes:
        system: Instructions above the conversation; may be empty.
        messages: The conversation; the last message is the user's.
        json_schema: JSON Schema of the answer, or None if any text will do.
        mode: How JSON is requested; None leaves it to the model's profile.
        temperature: None leaves it to the server.
        max_tokens: Most tokens in the reply; None leaves it to the server.
        timeout_s: Most time until the reply, retries included [s]; None leaves only the profile's limit for each
            attempt. Not part of the digest.
        extra_body: Further fields of the request's body; they override those of the profile.
        module: Who asks: a module, 1 to 5, or a judge (`llm.structured.conversation`); 0 if not given. Not part of the
            digest.
        template: SHA-256 of the templates of the prompt; empty if not given. Not part of the digest.
    """

    system: str
    messages: tuple[Message, ...]
    json_schema: Mapping[str, object] | None = None
    mode: Mode | None = None
    temperature: float | None = None
    max_tokens: int | None = None
    timeout_s: float | None = None
    extra_body: Mapping[str, object] = field(default_factory=dict)
    module: int = field(default=0, compare=False)
    template: str = field(default="", compare=False)

    def __post_init__(self) -> None:
        if not self.messages or self.messages[-1].role != "user":
            raise RequestError("a request's last message is the user's")
        if self.mode is not None and self.mode not in MODES:
            raise RequestError(f"a request's mode is one of {', '.join(MODES)}, or None, not {self.mode!r}")
        if self.mode == "json_schema" and self.json_schema is None:
            raise RequestError("mode json_schema needs a json_schema")
        if self.timeout_s is not None and not self.timeout_s > 0:
            raise RequestError(f"timeout_s is above 0, not {self.timeout_s}")
        if self.max_tokens is not None and self.max_tokens < 1:
            raise RequestError(f"max_tokens is at least 1, not {self.max_tokens}")

    @classmethod
    def of(cls, system: str, *parts: Part, json_schema: Mapping[str, object] | None = None) -> ChatRequest:
        """Return a request with one user message."""
        return cls(system, (Message(parts),), json_schema)

    @property
    def images(self) -> tuple[Image, ...]:
        """All pictures of the conversation, in order."""
        return tuple(image for message in self.messages for image in message.images)

    def record(self) -> dict[str, object]:
        """Return the request as JSON, with hashes in place of pictures; the digest covers exactly this."""
        return {
            "system": self.system,
            "messages": [message.record() for message in self.messages],
            "json_schema": None if self.json_schema is None else dict(self.json_schema),
            "mode": self.mode,
            "temperature": self.temperature,
            "max_tokens": self.max_tokens,
            "extra_body": dict(self.extra_body),
        }

    def digest(self) -> str:
        """Return the SHA-256 of the record as canonical JSON (sorted keys, no blanks), in hexadecimal."""
        return digest_of(self.record())


def digest_of(record: Mapping[str, object]) -> str:
    """Return the SHA-256 of a request's record as canonical JSON, in hexadecimal.

    Raises:
        RequestError: The record is not JSON.
    """
    try:
        text = json.dumps(record, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
    except (TypeError, ValueError, RecursionError) as error:
        raise RequestError(f"json_schema and extra_body are JSON: {error}") from error
    return hashlib.sha256(text.encode("ascii")).hexdigest()


@dataclass(frozen=True, slots=True)
class ChatReply:
    """Reply to one request.

    Attributes:
        text: The model's answer, unchanged.
        input_tokens: Tokens of the request as counted by the server, or None if not given.
        output_tokens: Tokens of the reply, thinking included, or None.
        latency_s: Time from sending to the last byte, of the successful attempt [s].
        finish_reason: Why the model stopped: "stop", "length" (cut off by max_tokens), or the server's own word.
        model: The model's name as given by the server.
        attempts: How often the request was sent, at least 1.
        recorded: Whether it comes from a recording; nothing was sent, and nothing paid now.
        request_sha256: Digest of the request as it was sent, where a transport has changed it; else empty.
    """

    text: str
    input_tokens: int | None = None
    output_tokens: int | None = None
    latency_s: float = 0.0
    finish_reason: str = "stop"
    model: str = ""
    attempts: int = 1
    recorded: bool = field(default=False, compare=False, repr=False)
    request_sha256: str = field(default="", compare=False, repr=False)


@runtime_checkable
class Transport(Protocol):
    """Interface of everything that answers requests: a model behind a server, a recording, or a script in a test."""

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the reply to a request.

        Raises:
            ModelError: There is none; the subclass gives the reason.
        """
        ...


@dataclass(frozen=True, slots=True)
class Sampled:
    """Forward requests with the same temperature and seed, which replace the requests' own; the digest has both."""

    transport: Transport
    temperature: float | None = None
    seed: int | None = None

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the transport's reply."""
        temperature = request.temperature if self.temperature is None else self.temperature
        extra = dict(request.extra_body) if self.seed is None else {**request.extra_body, "seed": self.seed}
        sent = replace(request, temperature=temperature, extra_body=extra)
        return replace(self.transport.complete(sent), request_sha256=sent.digest())


@dataclass(frozen=True, slots=True)
class Routed:
    """Forward the requests of some modules to transports of their own."""

    transport: Transport
    others: Mapping[int, Transport]

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the reply of the asking module's transport."""
        return self.others.get(request.module, self.transport).complete(request)
