"""Models behind any server that speaks the chat-completions protocol, through the `openai` library.

The library carries the protocol: addresses, authentication, connections. Retries, deadlines, cancellation and the bound
on an answer's size are kept here, where they hold for every provider alike. The key is known to this file alone; it is
struck out of whatever a server says.
"""

from __future__ import annotations

import importlib
import logging
import math
import random
import time
from collections.abc import Mapping
from threading import Event
from typing import Any

from bddl.visible import visible
from llm.chat_answer import Completion, Failure, read_answer
from llm.chat_body import chat_body
from llm.errors import (
    ModelCancelled,
    ModelConfigError,
    ModelError,
    ModelTimeout,
    ReplyTooLong,
)
from llm.http_failures import failure_of, stop_at_failure
from llm.interruptible import Ended, wait_for
from llm.model_profile import ModelProfile
from llm.retries import RetryPolicy
from llm.transport import ChatReply, ChatRequest

LONGEST_ANSWER_BYTES = 4_000_000
LONGEST_MESSAGE = 300

_LOG = logging.getLogger(__name__)
# Keys of local servers are words such as "none", which would be struck out of ordinary texts.
_SHORTEST_SECRET = 8


class OpenAITransport:
    """Sends requests to one model; safe to use from several threads.

    Attributes:
        profile: Which model, and how it wants to be asked.
    """

    def __init__(
        self,
        profile: ModelProfile,
        *,
        retries: RetryPolicy | None = None,
        cancel: Event | None = None,
        longest_answer_bytes: int = LONGEST_ANSWER_BYTES,
        jitter: random.Random | None = None,
    ) -> None:
        """Reads the key and the address from the environment; nothing is sent yet.

        Args:
            profile: From `llm.profiles.find_profile`.
            retries: When to send again; default is 4 attempts within about 10 seconds of waiting.
            cancel: Setting it ends a request that is under way, and all later ones.
            longest_answer_bytes: Where reading an answer stops.
            jitter: Source of chance for the waits.

        Raises:
            ModelConfigError: Key, address or library is missing.
        """
        self.profile = profile
        self._retries = retries or RetryPolicy()
        self._cancel = cancel
        self._longest = longest_answer_bytes
        self._jitter = jitter or random.Random()
        self._address = profile.address()
        self._key = profile.key()
        self._secret = self._key if self._key is not None and len(self._key) >= _SHORTEST_SECRET else None
        self._library = _library(profile.name)

    def __repr__(self) -> str:
        return f"OpenAITransport({self.profile.name!r})"

    def __getstate__(self) -> object:
        # A pickle would hold the key.
        raise TypeError("an OpenAITransport cannot be pickled; make a new one from its profile")

    def complete(self, request: ChatRequest) -> ChatReply:
        """Returns the model's reply; passing failures are retried with growing waits.

        Raises:
            RequestError: The request does not fit the model: too many images, or no JSON.
            ModelUnavailable: No connection, 429 or 5xx, also at the last attempt, or a wait that is too long.
            ModelTimeout: No whole reply in time, also at the last attempt.
            ModelRefused: Another 4xx.
            BadReply: An answer that is no chat completion; ReplyTooLong where it exceeds the bound.
            ModelCancelled: The event was set.
        """
        body = chat_body(request, self.profile)
        ends = math.inf if request.timeout_s is None else time.monotonic() + request.timeout_s
        attempt = 0
        while True:
            attempt += 1
            started = time.monotonic()
            outcome = self._attempt(body, min(self.profile.timeout_s, max(ends - started, 1e-3)))
            if isinstance(outcome, Completion):
                return ChatReply(
                    self._without_key(outcome.text),
                    outcome.input_tokens,
                    outcome.output_tokens,
                    time.monotonic() - started,
                    self._without_key(outcome.finish_reason),
                    self._without_key(outcome.model) or self.profile.model,
                    attempt,
                )
            wait_s = self._retries.wait_s(attempt, outcome.asked_s, self._jitter) if outcome.again else None
            if wait_s is None or time.monotonic() + wait_s >= ends:
                raise self._error(outcome, attempt)
            _LOG.info("%s: %s; again in %.1f s", self.profile.name, self._shown(outcome.problem), wait_s)
            self._pause(wait_s)

    def _attempt(self, body: Mapping[str, Any], timeout_s: float) -> Completion | Failure:
        """Returns what one attempt gave; a failure is a value, so that no exception of the library goes on."""
        if self._cancel is not None and self._cancel.is_set():
            return _CANCELLED
        try:
            client = self._client(timeout_s)
        except Exception as error:
            # A proxy of the environment, for example, that the HTTP library cannot use.
            return Failure(
                ModelConfigError, f"no connection can be set up: {error}", "Check HTTP_PROXY and HTTPS_PROXY"
            )
        given_up = Event()

        def abandon() -> None:
            given_up.set()
            client.close()

        try:
            outcome = wait_for(
                lambda: self._exchange(client, body, given_up),
                timeout_s=timeout_s,
                cancel=self._cancel,
                abandon=abandon,
            )
        finally:
            client.close()
        if outcome is Ended.CANCELLED:
            return _CANCELLED
        if isinstance(outcome, Ended):
            return _late(timeout_s)
        return outcome

    def _client(self, timeout_s: float) -> Any:
        """Returns a client for one attempt: closing it ends the attempt, and no other one."""
        library = self._library
        headers: dict[str, Any] = {"Accept-Encoding": "identity"}
        if not self.profile.account_headers:
            headers |= {"OpenAI-Organization": library.Omit(), "OpenAI-Project": library.Omit()}
        return library.OpenAI(
            api_key=self._key or "none",
            base_url=self._address,
            timeout=timeout_s,
            max_retries=0,
            default_headers=headers,
            http_client=library.DefaultHttpxClient(follow_redirects=False, event_hooks={"response": [stop_at_failure]}),
        )

    def _exchange(self, client: Any, body: Mapping[str, Any], given_up: Event) -> Completion | Failure:
        """Returns what the server answers to one request; runs in a thread of its own."""
        fields = dict(body)
        model, messages = fields.pop("model"), fields.pop("messages")
        chunks: list[bytes] = []
        size = 0
        try:
            create = client.chat.completions.with_streaming_response.create
            with create(model=model, messages=messages, extra_body=fields) as response:
                for chunk in response.iter_bytes():
                    size += len(chunk)
                    if size > self._longest:
                        problem = f"the answer is longer than {self._longest} bytes, and was cut off there"
                        return Failure(ReplyTooLong, problem, "Bound replies by extra_body in a file of profiles")
                    if given_up.is_set():
                        return _CANCELLED
                    chunks.append(chunk)
                kind = response.headers.get("content-type", "")
        except Exception as error:
            return failure_of(error, self._address, self.profile.key_variable)
        answer = b"".join(chunks)
        if self._secret is not None:
            # Here as well as in the words that are read: what is shortened could end within the key.
            answer = answer.replace(self._secret.encode(), b"[key]")
        return read_answer(answer, kind)

    def _error(self, failure: Failure, attempts: int) -> ModelError:
        """Returns the exception for the last failure."""
        problem = self._shown(failure.problem)
        if failure.again and attempts > 1:
            problem += f" ({attempts} attempts)"
        advice = failure.advice
        if failure.asked_s is not None and failure.asked_s > self._retries.longest_wait_s:
            advice = f"It asks to wait {failure.asked_s:.0f} s"
        return failure.kind(self.profile.name, problem, advice)

    def _pause(self, wait_s: float) -> None:
        """Waits before the next attempt, or less when the caller cancels."""
        if self._cancel is None:
            time.sleep(wait_s)
        else:
            self._cancel.wait(wait_s)

    def _shown(self, words: str) -> str:
        """Returns words as they may be shown: without the key, steering no terminal, and not endless."""
        clean = visible(self._without_key(words))
        return clean if len(clean) <= LONGEST_MESSAGE else f"{clean[: LONGEST_MESSAGE - 3]}..."

    def _without_key(self, words: str) -> str:
        """Returns words with the key struck out: a server may repeat what it was sent."""
        return words if self._secret is None else words.replace(self._secret, "[key]")


_CANCELLED = Failure(ModelCancelled, "the request was cancelled")


def _late(timeout_s: float) -> Failure:
    """Returns the failure that no whole reply came in time."""
    advice = "Raise timeout_s, or ask for less"
    return Failure(ModelTimeout, f"no whole reply within {timeout_s:.3g} s", advice, again=True)


def _library(model: str) -> Any:
    """Returns the module `openai`, loaded on first use: it takes a second, and nothing else needs it."""
    try:
        # The part for chats would otherwise be loaded within the first request, and count as its latency.
        importlib.import_module("openai.resources.chat")
        return importlib.import_module("openai")
    except ImportError as error:
        problem = f"the library openai cannot be loaded ({error})"
        raise ModelConfigError(model, problem, "In the checkout, run: pip install -e '.[llm]'") from error
