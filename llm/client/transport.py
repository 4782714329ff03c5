"""Requests to a model and its replies, the one interface of models, recordings and scripts, and budgets of a run.

A request has content only. The model, its address and its settings belong to the transport. So a run recorded
with one model replays without it, and the digest of a request does not depend on where it is sent.
"""

from __future__ import annotations

import hashlib
import json
import math
import time
import warnings
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib import import_module
from io import BytesIO
from threading import Lock
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias, runtime_checkable

from llm.errors import BudgetSpent, ModelConfigError, ModelError, ModelTimeout, RequestError

if TYPE_CHECKING:
    from llm.client.profiles import BoxForm, Price


# How JSON is requested: by a schema, by a JSON-only mode, or by the prompt alone.
Mode = Literal["json_schema", "json_object", "plain"]
MODES: tuple[Mode, ...] = ("json_schema", "json_object", "plain")

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
    """

    system: str
    messages: tuple[Message, ...]
    json_schema: Mapping[str, object] | None = None
    mode: Mode | None = None
    temperature: float | None = None
    max_tokens: int | None = None
    timeout_s: float | None = None
    extra_body: Mapping[str, object] = field(default_factory=dict)

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
    """

    text: str
    input_tokens: int | None = None
    output_tokens: int | None = None
    latency_s: float = 0.0
    finish_reason: str = "stop"
    model: str = ""
    attempts: int = 1
    recorded: bool = field(default=False, compare=False, repr=False)


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
class Budget:
    """Limits of a run; None is no limit.

    Attributes:
        requests: Requests, counted at each sending.
        tokens: Tokens of requests and replies together, as counted by the server.
        cost_usd: Cost by the profile's list price [US dollars].
        time_s: Time since the first request [s].
    """

    requests: int | None = None
    tokens: int | None = None
    cost_usd: float | None = None
    time_s: float | None = None

    def __post_init__(self) -> None:
        for name, limit in asdict(self).items():
            if limit is not None and not 0 <= limit < math.inf:
                raise RequestError(f"a budget's {name} is 0 or more, or None, not {limit}")


@dataclass(frozen=True, slots=True)
class Usage:
    """Usage of a run.

    Attributes:
        requests: Requests, counted at each sending, failed ones included.
        failures: Requests without a reply; a server may charge for them, so the cost is a lower bound.
        input_tokens: As counted by the server.
        output_tokens: As counted by the server.
        uncounted: Replies without counts; tokens and cost are then lower bounds.
        cost_usd: By list price, or None if the price is unknown.
        waited_s: Time spent waiting for replies, retries included [s].
        elapsed_s: Time since the first request [s].
        recorded: Replies from a recording; the other numbers include them, and nothing was paid for them now.
    """

    requests: int = 0
    failures: int = 0
    input_tokens: int = 0
    output_tokens: int = 0
    uncounted: int = 0
    cost_usd: float | None = None
    waited_s: float = 0.0
    elapsed_s: float = 0.0
    recorded: int = 0

    @property
    def tokens(self) -> int:
        """Tokens of requests and replies together."""
        return self.input_tokens + self.output_tokens

    @property
    def is_bound(self) -> bool:
        """True if tokens and cost may be more than what was counted."""
        return self.failures > 0 or self.uncounted > 0

    def record(self) -> dict[str, object]:
        """Return the usage as JSON."""
        return {**asdict(self), "waited_s": round(self.waited_s, 3), "elapsed_s": round(self.elapsed_s, 3)}

    def summary(self) -> str:
        """Return one line for people."""
        parts = [
            f"{self.requests} {'request' if self.requests == 1 else 'requests'}",
            f"{self.input_tokens} + {self.output_tokens} tokens",
            "cost unknown" if self.cost_usd is None else f"{'at least ' if self.is_bound else ''}${self.cost_usd:.4f}",
            f"{self.elapsed_s:.1f} s",
        ]
        if self.failures:
            parts.insert(1, f"{self.failures} failed")
        if self.uncounted:
            parts.append(f"{self.uncounted} replies without token counts")
        if self.recorded:
            parts.append(f"{self.recorded} of them recorded earlier and not paid again")
        return ", ".join(parts)


class Metered:
    """Forward requests within a budget, and count them.

    The budget is checked before a request. The reply that exceeds it is returned, since it is paid for; the next
    request is not sent. No request waits longer than the remaining time.

    Attributes:
        name: The configuration string.
        budget: The limits.
        warnings: What was skipped in a recording that answers.
        boxes: Requested form of boxes in a picture; None for a recording, which does not state it.
        price: Price of tokens; None if unknown, or paid when it was recorded.
        answered_by: Model of the latest reply, as its server named it; empty before the first one.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        name: str = "model",
        budget: Budget | None = None,
        price: Price | None = None,
        warnings: tuple[str, ...] = (),
        boxes: BoxForm | None = None,
    ) -> None:
        """Set up the meter; nothing is sent.

        Raises:
            ModelConfigError: The cost is limited, but the price is unknown.
        """
        self.name = name
        self.budget = budget or Budget()
        self.warnings = warnings
        self.boxes = boxes
        self.price = price
        self.answered_by = ""
        if self.budget.cost_usd is not None and price is None:
            advice = "Limit tokens instead, or write the price into a file of profiles"
            raise ModelConfigError(name, "a budget in dollars needs a price, and none is known", advice)
        self._transport = transport
        self._usage = Usage(cost_usd=None if price is None else 0.0)
        self._started: float | None = None
        self._lock = Lock()

    @property
    def usage(self) -> Usage:
        """Usage until now."""
        with self._lock:
            return replace(self._usage, elapsed_s=self._elapsed_s())

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the transport's reply."""
        left_s = self._admit()
        if left_s is not None and (request.timeout_s is None or request.timeout_s > left_s):
            request = replace(request, timeout_s=left_s)
        began = time.monotonic()
        reply: ChatReply | None = None
        attempts = 1
        try:
            reply = self._transport.complete(request)
            self.answered_by, attempts = reply.model, reply.attempts
        except ModelError as error:
            attempts = error.attempts
            if isinstance(error, ModelTimeout) and left_s is not None and time.monotonic() - began >= left_s:
                raise self._spent(f"the budget of {self.budget.time_s:g} s ran out during a request") from error
            raise
        finally:
            self._count(reply, attempts, time.monotonic() - began)
        return reply

    def _admit(self) -> float | None:
        """Count a request and return the remaining time [s]; raise BudgetSpent if a limit is reached."""
        with self._lock:
            if self._started is None:
                self._started = time.monotonic()
            used, budget, elapsed_s = self._usage, self.budget, self._elapsed_s()
            limits = (
                (used.requests, budget.requests, f"{budget.requests} requests"),
                (used.tokens, budget.tokens, f"{budget.tokens} tokens"),
                (used.cost_usd or 0.0, budget.cost_usd, f"${budget.cost_usd or 0.0:g}"),
                (elapsed_s, budget.time_s, f"{budget.time_s or 0.0:g} s"),
            )
            spent = next((words for use, limit, words in limits if limit is not None and use >= limit), None)
            problem = None if spent is None else f"the budget of {spent} is used up"
            if problem is None and used.uncounted and (budget.tokens, budget.cost_usd) != (None, None):
                problem = "the server does not count tokens, so a budget in tokens or dollars cannot be kept"
            if problem is None:
                self._usage = replace(used, requests=used.requests + 1)
                return None if budget.time_s is None else budget.time_s - elapsed_s
        raise self._spent(problem)

    def _spent(self, problem: str) -> BudgetSpent:
        return BudgetSpent(self.name, problem, f"Used: {self.usage.summary()}")

    def _count(self, reply: ChatReply | None, attempts: int, waited_s: float) -> None:
        """Add the result of a request; `_admit` has counted one of its attempts."""
        with self._lock:
            used = replace(
                self._usage,
                requests=self._usage.requests + attempts - 1,
                failures=self._usage.failures + attempts - (reply is not None),
                waited_s=self._usage.waited_s + waited_s,
            )
            if reply is None:
                self._usage = used
                return
            inputs = used.input_tokens + (reply.input_tokens or 0)
            outputs = used.output_tokens + (reply.output_tokens or 0)
            self._usage = replace(
                used,
                input_tokens=inputs,
                output_tokens=outputs,
                uncounted=used.uncounted + (reply.input_tokens is None or reply.output_tokens is None),
                cost_usd=None if self.price is None else self.price.cost_usd(inputs, outputs),
                recorded=used.recorded + reply.recorded,
            )

    def _elapsed_s(self) -> float:
        return 0.0 if self._started is None else time.monotonic() - self._started
