"""What it means when an HTTP request to a model gives no answer, or another one than was hoped for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from llm.chat_answer import Failure, error_message
from llm.errors import ModelRefused, ModelTimeout, ModelUnavailable
from llm.retries import asked_wait_s, is_passing

# Of a failed request's answer, only a message is wanted.
LONGEST_ERROR_BYTES = 64_000


class StatusSeen(Exception):
    """Carries the answer of a request that the server did not grant, past the client library's own handling."""

    def __init__(self, status: int, headers: Mapping[str, str], body: bytes) -> None:
        super().__init__(f"status {status}")
        self.status = status
        self.headers = headers
        self.body = body


def stop_at_failure(response: Any) -> None:
    """Reads the answer of a request that was not granted up to a bound; the client library would read on without one.

    Args:
        response: Of the HTTP library, not read yet; one with a status below 300 is left alone.

    Raises:
        StatusSeen: The status is 300 or above.
    """
    if response.status_code < 300:
        return
    body = b""
    for chunk in response.iter_bytes(LONGEST_ERROR_BYTES):
        body += chunk
        if len(body) >= LONGEST_ERROR_BYTES:
            break
    response.close()
    raise StatusSeen(response.status_code, response.headers, body[:LONGEST_ERROR_BYTES])


def failure_of(error: Exception, address: str, key_variable: str) -> Failure:
    """Returns what an exception means that a request ended with.

    Args:
        error: Of the client library, of the HTTP library under it, or a StatusSeen.
        address: Of the server, for messages.
        key_variable: Where its key is kept, or empty, for messages.
    """
    cause = error if isinstance(error, StatusSeen) else error.__cause__
    if isinstance(cause, StatusSeen):
        return _not_granted(cause, key_variable)
    # By name: which HTTP library is underneath depends on the client library's version.
    names = {kind.__name__ for kind in (*type(error).__mro__, *type(cause).__mro__)}
    if names & {"TimeoutException", "APITimeoutError"}:
        return Failure(ModelTimeout, "the server took too long", again=True)
    what = type(cause or error).__name__
    if names & {"RemoteProtocolError", "ReadError"}:
        return Failure(ModelUnavailable, f"the connection broke before the answer was whole ({what})", again=True)
    if names & {"HTTPError", "APIConnectionError"}:
        advice = "Check that it runs, the address and the network"
        return Failure(ModelUnavailable, f"no connection to the server at {address} ({what})", advice, again=True)
    return Failure(ModelUnavailable, f"the request failed: {type(error).__name__}: {error}")


def _not_granted(seen: StatusSeen, key_variable: str) -> Failure:
    """Returns what a status of 300 and above means."""
    if seen.status < 400:
        # Followed, the request would take key and pictures to whatever place the answer names.
        place = " ".join(seen.headers.get("location", "").split())[:120]
        words = f"the server answered {seen.status} and points elsewhere{f', to {place!r}' if place else ''}"
        return Failure(
            ModelRefused, words, "Redirects are not followed; set the address to where the model's server is"
        )
    said = error_message(seen.body)
    words = f"the server answered {seen.status}{': ' + said if said else ''}"
    if is_passing(seen.status):
        advice = "It is busy or a quota is used up; try later" if seen.status == 429 else "Try later"
        return Failure(ModelUnavailable, words, advice, again=True, asked_s=asked_wait_s(seen.headers))
    advices = {
        401: f"Check the key in {key_variable}" if key_variable else "The server wants a key",
        403: f"Check what the key in {key_variable} may use" if key_variable else "The server wants a key",
        404: "Check the model's name and the server's address",
        413: "Send fewer or smaller images",
    }
    return Failure(ModelRefused, words, advices.get(seen.status, ""))
