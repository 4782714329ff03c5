"""Models behind any server that speaks the chat-completions protocol, through the `openai` library.

The library carries the protocol: addresses, authentication, connections, retries with growing waits, `Retry-After`.
What holds for every provider alike is kept here: the bound on an answer's size, deadlines over the whole,
cancellation. The key is known to this file alone; it is struck out of whatever a server says.
"""

from __future__ import annotations

import importlib
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from threading import Event, Thread
from typing import Any

from bddl.visible import visible
from llm.errors import ModelCancelled, ModelConfigError, ModelRefused, ModelTimeout, ModelUnavailable, ReplyTooLong
from llm.wire.chat import Unanswered, chat_body, error_message, read_answer
from llm.wire.profiles import ModelProfile
from llm.wire.transport import ChatReply, ChatRequest

RETRIES = 3
# A day's longest answers have some 100 kB.
LONGEST_ANSWER_BYTES = 4_000_000
# Of a failed request's answer, only a message is wanted.
LONGEST_ERROR_BYTES = 64_000
LONGEST_MESSAGE = 300
# The library waits no longer before another attempt; a server that asks for more is given up.
_LONGEST_PAUSE_S = 120.0
# Keys of local servers are words such as "none", which would be struck out of ordinary texts.
_SHORTEST_SECRET = 8
# A caller's event can be set by any thread without a signal that would wake the waiting one.
_LOOKS_S = 0.05
_CANCELLED = Unanswered(ModelCancelled, "the request was cancelled")


class OpenAITransport:
    """Sends requests to one model; safe to use from several threads.

    Attributes:
        profile: Which model, and how it wants to be asked.
    """

    def __init__(
        self,
        profile: ModelProfile,
        *,
        retries: int = RETRIES,
        cancel: Event | None = None,
        longest_answer_bytes: int = LONGEST_ANSWER_BYTES,
    ) -> None:
        """Reads the key and the address from the environment; nothing is sent yet.

        Args:
            profile: From `llm.wire.profiles.find_profile`.
            retries: How often a request that failed in passing is sent again.
            cancel: Setting it ends a request that is under way, and all later ones.
            longest_answer_bytes: Where reading an answer stops.

        Raises:
            ModelConfigError: Key, address or library is missing.
        """
        self.profile = profile
        self.retries = retries
        self.longest_answer_bytes = longest_answer_bytes
        self.address = profile.address()
        self.library = _library(profile.name)
        self._cancel = cancel
        self._key = profile.key()
        self._secret = self._key if self._key is not None and len(self._key) >= _SHORTEST_SECRET else None

    def __repr__(self) -> str:
        return f"OpenAITransport({self.profile.name!r})"

    def __getstate__(self) -> object:
        # A pickle would hold the key.
        raise TypeError("an OpenAITransport cannot be pickled; make a new one from its profile")

    def complete(self, request: ChatRequest) -> ChatReply:
        """Returns the model's reply; the library sends again what fails in passing.

        Raises:
            RequestError: The request does not fit the model: too many images, or no JSON.
            ModelUnavailable: No connection, 429 or 5xx, also at the last attempt, or a wait that is too long.
            ModelTimeout: No whole reply in time, also at the last attempt.
            ModelRefused: Another 4xx.
            BadReply: An answer that is no chat completion; ReplyTooLong where it exceeds the bound.
            ModelCancelled: The event was set.
        """
        exchange = _Exchange(self, chat_body(request, self.profile))
        # Without a limit of its own a request ends with its last attempt; this is for a server that drips headers.
        most_s = (self.retries + 1) * (self.profile.timeout_s + _LONGEST_PAUSE_S)
        outcome = self._outcome(exchange, request.timeout_s or most_s)
        if isinstance(outcome, Unanswered):
            # Shown without the key, steering no terminal, and not endless.
            problem = visible(self.without_key(outcome.problem))
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
        """Returns what came of a request; a failure is a value, so that no exception of the library goes on."""
        if self._cancel is not None and self._cancel.is_set():
            return _CANCELLED
        try:
            exchange.connect(self._key)
        except Exception as error:
            # A proxy of the environment, for example, that the HTTP library cannot use.
            problem = f"no connection can be set up: {error}"
            return Unanswered(ModelConfigError, problem, "Check HTTP_PROXY and HTTPS_PROXY")
        try:
            return _awaited(exchange.run, timeout_s, self._cancel)
        finally:
            exchange.close()

    def strike_out(self, answer: bytes) -> bytes:
        """Returns an answer without the key: what is read of it may be shortened, and end within the key."""
        return answer if self._secret is None else answer.replace(self._secret.encode(), b"[key]")

    def without_key(self, words: str) -> str:
        """Returns words without the key."""
        return words if self._secret is None else words.replace(self._secret, "[key]")


class _Exchange:
    """One request with all its attempts; the HTTP library's hooks time each of them and bound what it reads."""

    def __init__(self, transport: OpenAITransport, body: Mapping[str, Any]) -> None:
        self.attempts = 0
        self.started = 0.0
        # What the answer of the last attempt says, as far as one was read.
        self._outcome: ChatReply | Unanswered | None = None
        self._transport = transport
        self._body = dict(body)

    def connect(self, key: str | None) -> None:
        """Makes a client for this exchange: closing it ends the exchange, and no other one."""
        transport, library = self._transport, self._transport.library
        hooks = {"request": [self._sending], "response": [self._answered]}
        http_client = library.DefaultHttpxClient(follow_redirects=False, event_hooks=hooks)
        base = next(kind for kind in type(http_client).__mro__ if kind.__name__ == "Client")
        # httpx, or what has taken its place: that depends on the library's version.
        self._http = importlib.import_module(base.__module__.partition(".")[0])
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

    def close(self) -> None:
        """Ends the exchange, also while another thread waits for its answer."""
        self._client.close()

    def run(self) -> ChatReply | Unanswered:
        """Returns what the server answers in the end."""
        model, messages = self._body.pop("model"), self._body.pop("messages")
        create = self._client.chat.completions.with_raw_response.create
        try:
            create(model=model, messages=messages, extra_body=self._body)
        except self._transport.library.APIStatusError as error:
            return self._not_granted(error.response)
        except Exception as error:
            return self._outcome or self._failure(error)
        return self._outcome or Unanswered(ModelUnavailable, "the request gave no answer")

    def _sending(self, _request: object) -> None:
        self.attempts += 1
        self.started = time.monotonic()
        self._outcome = None

    def _answered(self, response: Any) -> None:
        """Bounds the reading of an answer, whatever the library does with it."""
        stream = response.stream
        most = self._transport.longest_answer_bytes + 1
        # The library would unpack without a bound.
        chunks = self._in_time(_unpacked(stream, response.headers.pop("content-encoding", ""), most))
        kind = response.headers.get("content-type", "")
        chunks = self._read(chunks, kind) if response.status_code < 300 else _first_bytes(chunks)
        members = {"__iter__": lambda _: chunks, "close": lambda _: stream.close()}
        response.stream = type("Bounded", (self._http.SyncByteStream,), members)()

    def _in_time(self, stream: Iterable[bytes]) -> Iterator[bytes]:
        """Yields the bytes of an answer until the attempt has taken too long; the library then asks again."""
        timeout_s = self._transport.profile.timeout_s
        for chunk in stream:
            if time.monotonic() - self.started > timeout_s:
                self._outcome = _late(timeout_s)
                raise self._http.ReadTimeout("the answer drips")
            yield chunk

    def _read(self, stream: Iterable[bytes], content_type: str) -> Iterator[bytes]:
        """Yields the bytes of an answer, and notes what it says; the library sees an error where it may ask again."""
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
        """Returns what a failed status says; the key goes before words are shortened, which could end within it."""
        transport, status = self._transport, response.status_code
        key_variable = transport.profile.key_variable
        if status < 400:
            # Followed, the request would take key and pictures to whatever place the answer names.
            place = " ".join(transport.without_key(response.headers.get("location", "")).split())[:120]
            words = f"the server answered {status} and points elsewhere{f', to {place!r}' if place else ''}"
            return Unanswered(
                ModelRefused, words, "Redirects are not followed; set the address to where the model's server is"
            )
        said = error_message(transport.strike_out(response.content))
        words = f"the server answered {status}{': ' + said if said else ''}"
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


def _awaited(
    work: Callable[[], ChatReply | Unanswered], timeout_s: float, cancel: Event | None
) -> ChatReply | Unanswered:
    """Returns the outcome of work in a thread of its own, unless the deadline or the caller comes first.

    A server that sends one byte now and then keeps every socket timeout at bay; a deadline over the whole is the only
    one that holds. The thread is a daemon: work that hangs keeps no program alive.
    """
    done, outcome = Event(), list[ChatReply | Unanswered]()

    def run() -> None:
        try:
            outcome.append(work())
        finally:
            done.set()

    deadline = time.monotonic() + timeout_s
    Thread(target=run, name="model-request", daemon=True).start()
    while not done.wait(min(max(deadline - time.monotonic(), 0.0), _LOOKS_S)):
        if cancel is not None and cancel.is_set():
            return _CANCELLED
        if time.monotonic() >= deadline:
            return _late(timeout_s)
    return outcome[0]


def _late(timeout_s: float) -> Unanswered:
    advice = "Raise timeout_s, or ask for less"
    return Unanswered(ModelTimeout, f"no whole reply within {timeout_s:.3g} s", advice, again=True)


def _unpacked(stream: Iterable[bytes], encoding: str, most: int) -> Iterator[bytes]:
    """Yields the bytes of an answer; what a server has packed unasked is unpacked, at most so much of each piece."""
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
    """Returns the module `openai`, loaded on first use: it takes a second, and nothing else needs it."""
    try:
        # The part for chats would otherwise be loaded within the first request, and count as its latency.
        importlib.import_module("openai.resources.chat")
        return importlib.import_module("openai")
    except ImportError as error:
        problem = f"the library openai cannot be loaded ({error})"
        raise ModelConfigError(model, problem, "In the checkout, run: pip install -e '.[llm]'") from error
