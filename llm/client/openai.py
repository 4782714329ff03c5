"""Client of any server that speaks the chat-completions protocol, through the `openai` library.

The library handles addresses, authentication, connections, retries with growing waits, and `Retry-After`. This
file writes request bodies; `llm.client.completion` reads the answers. It also holds what is the same for every
provider: the limit on an answer's size, deadlines over all attempts. Only this file knows the key; it
is removed from everything a server writes.
"""

from __future__ import annotations

import base64
import importlib
import json
import time
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import replace
from threading import Event, Thread
from typing import Any

from bddl.terminal import escape_control
from llm.client.completion import Unanswered, error_message, read_answer
from llm.client.profiles import ModelProfile
from llm.client.transport import BOUNDS, FORMS, ChatReply, ChatRequest, Image, Message, Part
from llm.errors import (
    ModelConfigError,
    ModelRefused,
    ModelTimeout,
    ModelUnavailable,
    ReplyTooLong,
    RequestError,
)

# An explicit limit under either name replaces the profile's.
_BOUNDS = ("max_tokens", "max_completion_tokens")


def chat_body(request: ChatRequest, profile: ModelProfile) -> dict[str, Any]:
    """Return the fields of the request's body.

    Raises:
        RequestError: The request has more images than the model takes, an unusable image, or content that is no
            JSON.
    """
    images = len(request.images)
    if profile.max_images is not None and images > profile.max_images:
        raise RequestError(f"the request has {images} images, and {profile.name} takes at most {profile.max_images}")
    for number, image in enumerate(request.images, start=1):
        if (problem := image.problem()) is not None:
            raise RequestError(f"picture {number} of {images} is not sent to {profile.name}: {problem}")
    body: dict[str, Any] = {"model": profile.model, "messages": _messages(request, profile)}
    mode = request.mode or profile.mode
    if mode == "json_schema" and request.json_schema is not None and profile.serve:
        body["grammar"] = _compact_grammar(request.json_schema)
    elif mode == "json_schema" and request.json_schema is not None:
        sent = _without(request.json_schema, (FORMS,) if profile.bounds else (FORMS, *BOUNDS))
        schema: dict[str, Any] = {"name": "answer", "schema": sent}
        if profile.strict:
            schema["strict"] = True
        body["response_format"] = {"type": "json_schema", "json_schema": schema}
    elif mode == "json_object" and (request.json_schema is not None or request.mode is not None):
        body["response_format"] = {"type": "json_object"}
    bound = request.max_tokens or profile.max_tokens
    if bound is not None and not {*_BOUNDS} & {*profile.extra_body, *request.extra_body}:
        body[profile.max_tokens_field] = bound
    if request.temperature is not None and profile.send_temperature:
        body["temperature"] = request.temperature
    if profile.stream:
        body |= {"stream": True, "stream_options": {"include_usage": True}}
    body |= {**profile.extra_body, **request.extra_body}
    try:
        json.dumps(body, ensure_ascii=False, allow_nan=False).encode("utf-8")
    except (TypeError, ValueError, RecursionError) as error:
        raise RequestError(f"the request cannot be written as JSON: {error}") from error
    return body


def _compact_grammar(schema: Mapping[str, object]) -> str:
    """Return a grammar of llguidance for JSON of a schema on one line.

    The server makes a grammar of a schema by itself, but one that admits line breaks and indents. Qwen2.5-Coder-1.5B
    writes these first, and they are a third of its tokens.
    """
    spacing = {"whitespace_flexible": False, "item_separator": ", ", "key_separator": ": "}
    return "%llguidance {}\nstart: %json " + json.dumps({**schema, "x-guidance": spacing})


def _without(schema: Any, keys: Collection[str]) -> Any:
    """Return a schema without the keys that only some endpoints know; a field may have the name of one."""
    if isinstance(schema, list):
        return [_without(item, keys) for item in schema]
    if not isinstance(schema, Mapping):
        return schema
    fields = {
        key: {name: _without(one, keys) for name, one in value.items()}
        for key, value in schema.items()
        if key == "properties"
    }
    return {key: _without(value, keys) for key, value in schema.items() if key not in keys} | fields


def _messages(request: ChatRequest, profile: ModelProfile) -> list[dict[str, Any]]:
    """Return the conversation, with the system text in the role that the model expects."""
    messages = [_message(message) for message in request.messages]
    if not request.system:
        return messages
    first = request.messages[0]
    if profile.system_role == "user" and first.role == "user":
        return [_message(Message((request.system, *first.parts))), *messages[1:]]
    return [{"role": profile.system_role, "content": request.system}, *messages]


def _message(message: Message) -> dict[str, Any]:
    """Return one message; a single text is a plain string, which every server understands."""
    if len(message.parts) == 1 and isinstance(message.parts[0], str):
        return {"role": message.role, "content": message.parts[0]}
    return {"role": message.role, "content": [_part(part) for part in message.parts]}


def _part(part: Part) -> dict[str, Any]:
    """Return a text unchanged, an image as a data URL: the server needs no access to any file."""
    if isinstance(part, Image):
        data = base64.b64encode(part.data).decode("ascii")
        return {"type": "image_url", "image_url": {"url": f"data:{part.media_type};base64,{data}"}}
    return {"type": "text", "text": part}


RETRIES = 3
# The longest answers in practice have some 100 kB.
LONGEST_ANSWER_BYTES = 4_000_000
# Only the message of a failed request's answer is needed.
LONGEST_ERROR_BYTES = 64_000
LONGEST_MESSAGE = 300
# Longest wait of the library before another attempt; a server that asks for more is given up.
_LONGEST_PAUSE_S = 120.0
# Keys of local servers are words such as "none", which would be redacted in ordinary texts.
_SHORTEST_SECRET = 8


class OpenAITransport:
    """Send requests to one model; safe to use from several threads.

    Attributes:
        profile: The model and its settings.
    """

    def __init__(
        self,
        profile: ModelProfile,
        *,
        retries: int = RETRIES,
        longest_answer_bytes: int = LONGEST_ANSWER_BYTES,
    ) -> None:
        """Read key and address from the environment; nothing is sent yet.

        Args:
            profile: From `llm.client.profiles.find_profile`.
            retries: How often a request with a transient failure is sent again.
            longest_answer_bytes: Limit at which reading an answer stops.

        Raises:
            ModelConfigError: Key, address or library is missing.
        """
        self.profile = profile
        self.retries = retries
        self.longest_answer_bytes = longest_answer_bytes
        self.address = profile.address()
        self.library = _library(profile.name)
        self._key = profile.key()
        self._secret = self._key if self._key is not None and len(self._key) >= _SHORTEST_SECRET else None

    def __repr__(self) -> str:
        return f"OpenAITransport({self.profile.name!r})"

    def __getstate__(self) -> object:
        # A pickle would hold the key.
        raise TypeError("an OpenAITransport cannot be pickled; make a new one from its profile")

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the model's reply; the library repeats requests after transient failures.

        Raises:
            RequestError: The request does not fit the model: too many images, or no JSON.
            ModelUnavailable: No connection, 429 or 5xx, also at the last attempt, or a wait that is too long.
            ModelTimeout: No whole reply in time; the request is not sent again.
            ModelRefused: Another 4xx.
            BadReply: An answer that is no chat completion; ReplyTooLong if it exceeds the limit.
        """
        exchange = _Exchange(self, chat_body(request, self.profile))
        # Without a limit of its own a request ends with its last attempt; this limit is for servers that drip headers.
        most_s = (self.retries + 1) * (self.profile.timeout_s + _LONGEST_PAUSE_S)
        outcome = self._outcome(exchange, request.timeout_s or most_s)
        if isinstance(outcome, Unanswered):
            # Without the key, without control characters, and truncated.
            problem = escape_control(self.without_key(outcome.problem))
            problem = problem if len(problem) <= LONGEST_MESSAGE else f"{problem[: LONGEST_MESSAGE - 3]}..."
            if outcome.again and exchange.attempts > 1:
                problem += f" ({exchange.attempts} attempts)"
            error = outcome.kind(self.profile.name, problem, outcome.advice)
            error.attempts = exchange.attempts
            raise error
        return replace(
            outcome,
            text=self.without_key(outcome.text),
            latency_s=time.monotonic() - exchange.started,
            finish_reason=self.without_key(outcome.finish_reason),
            model=self.without_key(outcome.model) or self.profile.model,
            attempts=exchange.attempts,
        )

    def _outcome(self, exchange: _Exchange, timeout_s: float) -> ChatReply | Unanswered:
        """Return the outcome of a request; a failure is a value, so that no exception of the library escapes."""
        try:
            exchange.connect(self._key)
        except Exception as error:
            # For example a proxy in the environment that the HTTP library cannot use.
            problem = f"no connection can be set up: {error}"
            return Unanswered(ModelConfigError, problem, "Check HTTP_PROXY and HTTPS_PROXY")
        try:
            return _awaited(exchange.run, timeout_s)
        finally:
            exchange.close()

    def strike_out(self, answer: bytes) -> bytes:
        """Redact the API key before the answer is truncated, which could cut the key."""
        return answer if self._secret is None else answer.replace(self._secret.encode(), b"[key]")

    def without_key(self, words: str) -> str:
        """Return a text with the key redacted."""
        return words if self._secret is None else words.replace(self._secret, "[key]")


class _TimedOut(BaseException):
    """An attempt had no whole reply in time; the library sends a request again only after an Exception."""


class _Exchange:
    """One request with all its attempts; hooks of the HTTP library time each of them and limit what it reads."""

    def __init__(self, transport: OpenAITransport, body: Mapping[str, Any]) -> None:
        self.attempts = 0
        self.started = 0.0
        # Parsed answer of the last attempt, as far as one was read.
        self._outcome: ChatReply | Unanswered | None = None
        self._transport = transport
        self._body = dict(body)

    def connect(self, key: str | None) -> None:
        """Create a client for this exchange alone: closing it ends no other one."""
        transport, library = self._transport, self._transport.library
        hooks = {"request": [self._sending], "response": [self._answered]}
        http_client = library.DefaultHttpxClient(follow_redirects=False, event_hooks=hooks)
        base = next(kind for kind in type(http_client).__mro__ if kind.__name__ == "Client")
        # httpx or its replacement, depending on the library's version.
        self._http = importlib.import_module(base.__module__.partition(".")[0])
        http_client.send = self._sent_once(http_client.send)
        headers: dict[str, Any] = {"Accept-Encoding": "identity"}
        if not transport.profile.account_headers:
            headers |= {"OpenAI-Organization": library.Omit(), "OpenAI-Project": library.Omit()}
        self._client = library.OpenAI(
            api_key=key or "none",
            base_url=transport.address,
            timeout=transport.profile.timeout_s,
            max_retries=transport.retries,
            default_headers=headers,
            http_client=http_client,
        )

    def _sent_once(self, send: Callable[..., Any]) -> Callable[..., Any]:
        """Return a sender that ends the exchange after a timeout: the server may still work, and charge for it."""

        def sent(*arguments: Any, **options: Any) -> Any:
            try:
                return send(*arguments, **options)
            except (self._http.ReadTimeout, self._http.WriteTimeout) as late:
                raise _TimedOut from late

        return sent

    def close(self) -> None:
        """End the exchange, also while another thread waits for its answer."""
        self._client.close()

    def run(self) -> ChatReply | Unanswered:
        """Return the server's final answer."""
        model, messages = self._body.pop("model"), self._body.pop("messages")
        create = self._client.chat.completions.with_raw_response.create
        try:
            create(model=model, messages=messages, extra_body=self._body)
        except self._transport.library.APIStatusError as error:
            return self._not_granted(error.response)
        except _TimedOut:
            return self._outcome or _late(self._transport.profile.timeout_s)
        except Exception as error:
            return self._outcome or self._failure(error)
        return self._outcome or Unanswered(ModelUnavailable, "the request gave no answer")

    def _sending(self, _request: object) -> None:
        self.attempts += 1
        self.started = time.monotonic()
        self._outcome = None

    def _answered(self, response: Any) -> None:
        """Limit the reading of an answer, whatever the library does with it."""
        stream = response.stream
        most = self._transport.longest_answer_bytes + 1
        # The library would unpack without a limit.
        chunks = self._in_time(_unpacked(stream, response.headers.pop("content-encoding", ""), most))
        kind = response.headers.get("content-type", "")
        chunks = self._read(chunks, kind) if response.status_code < 300 else _first_bytes(chunks)
        members = {"__iter__": lambda _: chunks, "close": lambda _: stream.close()}
        response.stream = type("Bounded", (self._http.SyncByteStream,), members)()

    def _in_time(self, stream: Iterable[bytes]) -> Iterator[bytes]:
        """Yield the bytes of an answer until the attempt times out."""
        timeout_s = self._transport.profile.timeout_s
        for chunk in stream:
            if time.monotonic() - self.started > timeout_s:
                self._outcome = _late(timeout_s)
                raise self._http.ReadTimeout("the answer drips")
            yield chunk

    def _read(self, stream: Iterable[bytes], content_type: str) -> Iterator[bytes]:
        """Yield the bytes of an answer and parse it; the library gets an error if it may repeat the request."""
        transport, parts, size = self._transport, list[bytes](), 0
        for chunk in stream:
            parts.append(chunk)
            size += len(chunk)
            if size > transport.longest_answer_bytes:
                problem = f"the answer is longer than {transport.longest_answer_bytes} bytes, and was cut off there"
                self._outcome = Unanswered(ReplyTooLong, problem, "Bound replies by max_tokens in a file of profiles")
                return
            yield chunk
        answer = transport.strike_out(b"".join(parts))
        self._outcome = read_answer(answer, content_type)
        if isinstance(self._outcome, Unanswered) and self._outcome.again:
            raise self._http.ReadError("the answer is not whole")

    def _not_granted(self, response: Any) -> Unanswered:
        """Return the failure for an HTTP status; the key is redacted before texts are truncated."""
        transport, status = self._transport, response.status_code
        key_variable = transport.profile.key_variable
        if status < 400:
            # Following a redirect would send key and pictures to any address that the answer names.
            place = " ".join(transport.without_key(response.headers.get("location", "")).split())[:120]
            words = f"the server answered {status} and points elsewhere{f', to {place!r}' if place else ''}"
            return Unanswered(
                ModelRefused, words, "Redirects are not followed; set the address to where the model's server is"
            )
        detail = error_message(transport.strike_out(response.content))
        words = f"the server answered {status}{': ' + detail if detail else ''}"
        if status in (408, 409, 429) or status >= 500:
            advice = "It is busy or a quota is used up; try later" if status == 429 else "Try later"
            asked = response.headers.get("retry-after", "")
            # A header may have more digits than an integer can be read from.
            if asked.isdecimal() and float(asked) > _LONGEST_PAUSE_S:
                advice = f"It asks to wait {asked[:12]} s"
            return Unanswered(ModelUnavailable, words, advice, again=True)
        advices = {
            401: f"Check the key in {key_variable}" if key_variable else "The server wants a key",
            403: f"Check what the key in {key_variable} may use" if key_variable else "The server wants a key",
            404: "Check the model's name and the server's address",
            413: "Send fewer or smaller images",
        }
        return Unanswered(ModelRefused, words, advices.get(status, ""))

    def _failure(self, error: Exception) -> Unanswered:
        cause = error.__cause__
        names = {kind.__name__ for kind in (*type(error).__mro__, *type(cause).__mro__)}
        if names & {"TimeoutException", "APITimeoutError"}:
            return Unanswered(ModelTimeout, "the server took too long", again=True)
        what = type(cause or error).__name__
        if names & {"RemoteProtocolError", "ReadError"}:
            return Unanswered(
                ModelUnavailable, f"the connection broke before the answer was whole ({what})", again=True
            )
        if names & {"HTTPError", "APIConnectionError"}:
            problem = f"no connection to the server at {self._transport.address} ({what})"
            return Unanswered(ModelUnavailable, problem, "Check that it runs, the address and the network", again=True)
        return Unanswered(ModelUnavailable, f"the request failed: {type(error).__name__}: {error}")


def _awaited(work: Callable[[], ChatReply | Unanswered], timeout_s: float) -> ChatReply | Unanswered:
    """Run `work` in its own thread; return its outcome unless the deadline comes first.

    A server that sends one byte now and then defeats every socket timeout; only a deadline over the whole works. The
    thread is a daemon: work that hangs keeps no program alive.
    """
    done, outcome = Event(), list[ChatReply | Unanswered]()

    def run() -> None:
        try:
            outcome.append(work())
        finally:
            done.set()

    Thread(target=run, name="model-request", daemon=True).start()
    return outcome[0] if done.wait(timeout_s) else _late(timeout_s)


def _late(timeout_s: float) -> Unanswered:
    advice = "It may be charged, and is not sent again unasked. Raise timeout_s in a file of profiles, or ask for less"
    return Unanswered(ModelTimeout, f"no whole reply within {timeout_s:.3g} s", advice)


def _unpacked(stream: Iterable[bytes], encoding: str, most: int) -> Iterator[bytes]:
    """Yield the bytes of an answer, unpacked with a limit for each piece even if packing was not requested."""
    unpacking = zlib.decompressobj(zlib.MAX_WBITS | 32) if encoding.lower() in ("gzip", "deflate") else None
    for chunk in stream:
        yield chunk if unpacking is None else unpacking.decompress(chunk, most)


def _first_bytes(stream: Iterable[bytes]) -> Iterator[bytes]:
    size = 0
    for chunk in stream:
        yield chunk[: LONGEST_ERROR_BYTES - size]
        size += len(chunk)
        if size >= LONGEST_ERROR_BYTES:
            return


def _library(model: str) -> Any:
    """Return the module `openai`, loaded on first use: it takes a second, and nothing else needs it."""
    try:
        # Otherwise the chat module would be loaded within the first request, and count as its latency.
        importlib.import_module("openai.resources.chat")
        return importlib.import_module("openai")
    except ImportError as error:
        problem = f"the library openai cannot be loaded ({error})"
        raise ModelConfigError(model, problem, "In the checkout, run: pip install -e '.[llm]'") from error
