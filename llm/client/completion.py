"""Completions in the answers of servers that speak the chat-completions protocol, whole or streamed.

No answer is trusted: a body is a reply with text, or a failure with a sentence and what to do.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated

from pydantic import (
    BaseModel,
    ConfigDict,
    NonNegativeInt,
    ValidationError,
    ValidatorFunctionWrapHandler,
    field_validator,
)
from pydantic.functional_validators import AfterValidator

from llm.client.transport import ChatReply
from llm.errors import BadReply, ModelError, ModelUnavailable

_ADDRESS = "Check the server's address: it mostly ends in /v1"


@dataclass(frozen=True, slots=True)
class Unanswered:
    """A request without a reply.

    Attributes:
        kind: The exception to raise.
        problem: What went wrong, without a full stop.
        advice: What to do, or empty.
        again: Whether another attempt may succeed.
    """

    kind: type[ModelError]
    problem: str
    advice: str = ""
    again: bool = False


class _ChatPiece(BaseModel):
    """A part of an answer; a missing field, or one of another type than the protocol's, becomes None."""

    model_config = ConfigDict(strict=True)

    @field_validator("*", mode="wrap")
    @classmethod
    def _or_none(cls, value: object, handler: ValidatorFunctionWrapHandler) -> object:
        try:
            return handler(value)
        except ValidationError:
            return None


_Word = Annotated[str, AfterValidator(lambda word: word[:200])]


class _ChatPart(_ChatPiece):
    type: str | None = None
    text: str | None = None


class _ChatFunction(_ChatPiece):
    arguments: str | None = None


class _ChatCall(_ChatPiece):
    function: _ChatFunction | None = None


class _ChatMessage(_ChatPiece):
    """A message, or a piece of one; parts of other kinds than these are thoughts."""

    content: str | list[_ChatPart] | None = None
    refusal: str | None = None
    tool_calls: list[_ChatCall] | None = None

    @property
    def text(self) -> str:
        if not isinstance(self.content, list):
            return self.content or ""
        return "".join(part.text or "" for part in self.content if part.type in ("text", "output_text", None))

    @property
    def called(self) -> str | None:
        """The arguments of the only call of a tool, which some servers write an answer into; no tool is offered."""
        functions = [call.function for call in self.tool_calls or ()]
        return functions[0].arguments if len(functions) == 1 and functions[0] is not None else None


class _ChatChoice(_ChatPiece):
    message: _ChatMessage | None = None
    delta: _ChatMessage | None = None
    finish_reason: _Word | None = None


class _ChatUsage(_ChatPiece):
    prompt_tokens: NonNegativeInt | None = None
    completion_tokens: NonNegativeInt | None = None


class _ChatError(_ChatPiece):
    message: str | None = None


class _ChatAnswer(_ChatError):
    choices: list[_ChatChoice] | None = None
    usage: _ChatUsage | None = None
    model: _Word | None = None
    error: str | _ChatError | None = None


def _read(body: bytes) -> _ChatAnswer:
    """Parse a body; raise ValueError if it is no JSON or nested too deeply."""
    try:
        found = json.loads(body)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    return _ChatAnswer.model_validate(found if isinstance(found, dict) else {})


def read_answer(body: bytes, content_type: str) -> ChatReply | Unanswered:
    """Return the completion in a body, or what is wrong with it.

    The body itself shows whether it was streamed: some servers ignore the setting, and some label JSON as text.
    """
    start = body.lstrip()[:6]
    if start.startswith((b"data:", b"event:", b":", b"id:")):
        return _streamed(body)
    try:
        answer = _read(body)
    except ValueError as error:
        if start.startswith(b"{"):
            problem = f"the server's answer is broken JSON ({error})"
            return Unanswered(BadReply, problem, "Ask again; if it stays, see its log")
        kind = content_type.partition(";")[0].strip() or "no content type"
        shown = " ".join(body[:200].decode("utf-8", "replace").split())[:80]
        return Unanswered(BadReply, f"the server answered {kind} instead of JSON: {shown!r}", _ADDRESS)
    if not answer.choices:
        detail = f": {error_message(body)}" if answer.error else ""
        return Unanswered(BadReply, f"the server's answer has no choices{detail}", _ADDRESS)
    choice = answer.choices[0]
    if choice.message is None:
        return Unanswered(BadReply, "the server's answer has a choice without a message", _ADDRESS)
    text = choice.message.text or choice.message.refusal or choice.message.called
    return _reply(text, choice.finish_reason, answer, answer.usage)


def error_message(body: bytes) -> str:
    """Return the error message in the body of a failed request, or else its text, on one line."""
    whole = " ".join(body.decode("utf-8", "replace").split())
    try:
        answer = _read(body)
    except ValueError:
        return whole
    error = answer.error or answer
    words = error if isinstance(error, str) else error.message or ""
    return " ".join(words.split()) or whole


def _streamed(body: bytes) -> ChatReply | Unanswered:
    """Return the completion whose pieces are the events of a stream (server-sent events)."""
    pieces: list[str] = []
    refusals: list[str] = []
    finish, usage, ended, chunk = "", None, False, _ChatAnswer()
    for data in _events(body):
        if data == b"[DONE]":
            ended = True
            break
        try:
            chunk = _read(data)
        except ValueError:
            break
        if chunk.error:
            problem = f"the server failed while it answered: {error_message(data)}"
            return Unanswered(ModelUnavailable, problem, again=True)
        usage = chunk.usage or usage
        choice = chunk.choices[0] if chunk.choices else _ChatChoice()
        delta = choice.delta or _ChatMessage()
        pieces.append(delta.text)
        refusals.append(delta.refusal or "")
        finish = choice.finish_reason or finish
    if not ended and not finish:
        return Unanswered(ModelUnavailable, "the server's answer was cut off", again=True)
    return _reply("".join(pieces) or "".join(refusals), finish, chunk, usage)


def _events(body: bytes) -> Iterator[bytes]:
    """Yield the data of each event; an event's data may span lines."""
    lines: list[bytes] = []
    for line in (*body.replace(b"\r\n", b"\n").split(b"\n"), b""):
        if line.startswith(b"data:"):
            lines.append(line[5:].strip())
        elif not line and lines:
            yield b"\n".join(lines)
            lines = []


def _reply(text: str | None, finish: str | None, answer: _ChatAnswer, usage: _ChatUsage | None) -> ChatReply:
    counts = usage or _ChatUsage()
    return ChatReply(
        text or "",
        counts.prompt_tokens,
        counts.completion_tokens,
        finish_reason=finish or "",
        model=answer.model or "",
    )
