"""Reads the body of a chat-completions answer, whole or streamed, without trusting any of it."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from llm.errors import BadReply, ModelError, ModelUnavailable

_ADDRESS = "Check the server's address: it mostly ends in /v1"


@dataclass(frozen=True, slots=True)
class Failure:
    """An attempt that gave no reply.

    Attributes:
        kind: The exception that it becomes if it is the last.
        problem: What went wrong, without a full stop.
        advice: What to do, or empty.
        again: Whether another attempt may succeed.
        asked_s: How many seconds the server asked to wait before, or None.
    """

    kind: type[ModelError]
    problem: str
    advice: str = ""
    again: bool = False
    asked_s: float | None = None


@dataclass(frozen=True, slots=True)
class Completion:
    """What an answer says; ChatReply's attributes of these names explain them. A text may be empty."""

    text: str
    input_tokens: int | None
    output_tokens: int | None
    finish_reason: str
    model: str


def read_answer(body: bytes, content_type: str) -> Completion | Failure:
    """Returns the completion that a body holds, or what is wrong with it.

    The body itself tells whether it was streamed: some servers ignore the wish, and some label JSON as text.

    Args:
        body: All bytes of an answer with status 200.
        content_type: Its header, for messages.
    """
    start = body.lstrip()[:6]
    if start.startswith((b"data:", b"event:", b":", b"id:")):
        return _streamed(body)
    try:
        answer = _json(body)
    except ValueError as error:
        kind = content_type.partition(";")[0].strip() or "no content type"
        shown = " ".join(body[:200].decode("utf-8", "replace").split())[:80]
        if start.startswith(b"{"):
            return Failure(
                BadReply, f"the server's answer is broken JSON ({error})", "Ask again; if it stays, see its log"
            )
        return Failure(BadReply, f"the server answered {kind} instead of JSON: {shown!r}", _ADDRESS)
    return _whole(answer)


def error_message(body: bytes) -> str:
    """Returns what the body of a failed request says, on one line: its error's message, or else its text."""
    try:
        answer = _json(body)
    except ValueError:
        return " ".join(body.decode("utf-8", "replace").split())
    found = _member(answer, "error", answer)
    words = found if isinstance(found, str) else _member(found, "message", "")
    return " ".join(str(words).split()) or " ".join(body.decode("utf-8", "replace").split())


def _json(body: bytes) -> object:
    """Returns a body as JSON, or raises a ValueError; nesting without end is no JSON either."""
    try:
        return json.loads(body)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _whole(answer: object) -> Completion | Failure:
    """Returns the completion in an answer that came in one piece."""
    choice = _first_choice(answer)
    if choice is None:
        said = error_message(json.dumps(answer).encode()) if _member(answer, "error") else ""
        return Failure(BadReply, f"the server's answer has no choices{': ' + said if said else ''}", _ADDRESS)
    message = _member(choice, "message")
    if not isinstance(message, dict):
        return Failure(BadReply, "the server's answer has a choice without a message", _ADDRESS)
    text = _text(_member(message, "content"))
    refusal = _member(message, "refusal")
    return _completion(text, _text(refusal), _word(_member(choice, "finish_reason")), answer, _member(answer, "usage"))


def _streamed(body: bytes) -> Completion | Failure:
    """Returns the completion whose pieces are the events of a stream (server-sent events)."""
    pieces: list[str] = []
    refusals: list[str] = []
    finish, usage, ended = "", None, False
    chunk: object = {}
    for data in _events(body):
        if data == b"[DONE]":
            ended = True
            break
        try:
            chunk = _json(data)
        except ValueError:
            break
        if _member(chunk, "error"):
            return Failure(ModelUnavailable, f"the server failed while it answered: {error_message(data)}", again=True)
        usage = _member(chunk, "usage") or usage
        choice = _first_choice(chunk)
        delta = _member(choice, "delta")
        pieces.append(_text(_member(delta, "content")) or "")
        refusals.append(_text(_member(delta, "refusal")) or "")
        finish = _word(_member(choice, "finish_reason")) or finish
    if not ended and not finish:
        return Failure(ModelUnavailable, "the server's answer was cut off", again=True)
    return _completion("".join(pieces), "".join(refusals), finish, chunk, usage)


def _events(body: bytes) -> Iterator[bytes]:
    """Yields the data of each event; an event's data may span lines."""
    lines: list[bytes] = []
    for line in body.replace(b"\r\n", b"\n").split(b"\n"):
        if line.startswith(b"data:"):
            lines.append(line[5:].strip())
        elif not line and lines:
            yield b"\n".join(lines)
            lines = []
    if lines:
        yield b"\n".join(lines)


def _completion(text: str | None, refusal: str | None, finish: str, answer: object, usage: object) -> Completion:
    """Returns the completion; without a text it has the refusal, or nothing: then the model can be asked again."""
    counts = [_count(_member(usage, name)) for name in ("prompt_tokens", "completion_tokens")]
    return Completion(text or refusal or "", counts[0], counts[1], finish, _word(_member(answer, "model")))


def _first_choice(answer: object) -> object:
    """Returns the first of an answer's choices, or None."""
    choices = _member(answer, "choices")
    return choices[0] if isinstance(choices, list) and choices else None


def _text(content: object) -> str | None:
    """Returns a message's text: a string, or the texts of its parts; parts of another kind are thoughts."""
    if isinstance(content, list):
        kinds = ("text", "output_text", None)
        texts: list[Any] = [_member(part, "text") for part in content if _member(part, "type") in kinds]
        return "".join(text for text in texts if isinstance(text, str))
    return content if isinstance(content, str) else None


def _member(value: object, name: str, default: object = None) -> object:
    """Returns a member of a JSON object, or the default where there is none."""
    return value.get(name, default) if isinstance(value, dict) else default


def _word(value: object) -> str:
    """Returns a short text that a server said, or nothing."""
    return value[:200] if isinstance(value, str) else ""


def _count(value: object) -> int | None:
    """Returns a number of tokens, or None where the server's word is none."""
    return value if isinstance(value, int) and not isinstance(value, bool) and value >= 0 else None
