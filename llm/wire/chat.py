"""The chat-completions protocol: the body of a request as one model's server understands it, and what an answer says.

Answers are read whole or streamed, without trusting any of them.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    ConfigDict,
    NonNegativeInt,
    ValidationError,
    ValidatorFunctionWrapHandler,
    field_validator,
)
from pydantic.functional_validators import AfterValidator

from llm.errors import BadReply, ModelError, ModelUnavailable, RequestError
from llm.wire.profiles import ModelProfile
from llm.wire.transport import ChatReply, ChatRequest, Image, Message, Part

# A bound of one's own under either name stands for the profile's.
_BOUNDS = ("max_tokens", "max_completion_tokens")
_ADDRESS = "Check the server's address: it mostly ends in /v1"


def chat_body(request: ChatRequest, profile: ModelProfile) -> dict[str, Any]:
    """Returns the fields of the request's body.

    Args:
        request: What is asked.
        profile: How the model wants to be asked.

    Raises:
        RequestError: The request has more images than the model takes, one that cannot be looked at, or what JSON
            cannot hold.
    """
    images = len(request.images)
    if profile.max_images is not None and images > profile.max_images:
        raise RequestError(f"the request has {images} images, and {profile.name} takes at most {profile.max_images}")
    for number, image in enumerate(request.images, start=1):
        if (problem := image.problem()) is not None:
            raise RequestError(f"picture {number} of {images} is not sent to {profile.name}: {problem}")
    body: dict[str, Any] = {"model": profile.model, "messages": _messages(request, profile)}
    mode = request.mode or profile.mode
    if mode == "json_schema" and request.json_schema is not None:
        schema = {"name": "answer", "schema": dict(request.json_schema)}
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


def _messages(request: ChatRequest, profile: ModelProfile) -> list[dict[str, Any]]:
    """Returns the conversation, with the system text where the model wants it."""
    messages = [_message(message) for message in request.messages]
    if not request.system:
        return messages
    first = request.messages[0]
    if profile.system_role == "user" and first.role == "user":
        return [_message(Message((request.system, *first.parts))), *messages[1:]]
    return [{"role": profile.system_role, "content": request.system}, *messages]


def _message(message: Message) -> dict[str, Any]:
    """Returns one message; a lone text goes as a plain string, which every server understands."""
    if len(message.parts) == 1 and isinstance(message.parts[0], str):
        return {"role": message.role, "content": message.parts[0]}
    return {"role": message.role, "content": [_part(part) for part in message.parts]}


def _part(part: Part) -> dict[str, Any]:
    """Returns a text as it is, and an image as a data URL: no file has to be anywhere that the server can reach."""
    if isinstance(part, Image):
        data = base64.b64encode(part.data).decode("ascii")
        return {"type": "image_url", "image_url": {"url": f"data:{part.media_type};base64,{data}"}}
    return {"type": "text", "text": part}


@dataclass(frozen=True, slots=True)
class Unanswered:
    """A request that got no reply.

    Attributes:
        kind: The exception that it becomes.
        problem: What went wrong, without a full stop.
        advice: What to do, or empty.
        again: Whether another attempt may succeed.
    """

    kind: type[ModelError]
    problem: str
    advice: str = ""
    again: bool = False


class _ChatPiece(BaseModel):
    """A part of an answer; what is missing, or of another kind than the protocol's, counts as not said."""

    model_config = ConfigDict(strict=True)

    @field_validator("*", mode="wrap")
    @classmethod
    def _or_unsaid(cls, value: object, handler: ValidatorFunctionWrapHandler) -> object:
        try:
            return handler(value)
        except ValidationError:
            return None


_Word = Annotated[str, AfterValidator(lambda word: word[:200])]


class _ChatPart(_ChatPiece):
    type: str | None = None
    text: str | None = None


class _ChatMessage(_ChatPiece):
    """A message, or a piece of one. Parts of another kind than these are thoughts."""

    content: str | list[_ChatPart] | None = None
    refusal: str | None = None

    @property
    def text(self) -> str:
        if not isinstance(self.content, list):
            return self.content or ""
        return "".join(part.text or "" for part in self.content if part.type in ("text", "output_text", None))


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
    """Returns what a body says, or raises a ValueError for what is no JSON; nesting without end is none either."""
    try:
        found = json.loads(body)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    return _ChatAnswer.model_validate(found if isinstance(found, dict) else {})


def read_answer(body: bytes, content_type: str) -> ChatReply | Unanswered:
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
        answer = _read(body)
    except ValueError as error:
        if start.startswith(b"{"):
            problem = f"the server's answer is broken JSON ({error})"
            return Unanswered(BadReply, problem, "Ask again; if it stays, see its log")
        kind = content_type.partition(";")[0].strip() or "no content type"
        shown = " ".join(body[:200].decode("utf-8", "replace").split())[:80]
        return Unanswered(BadReply, f"the server answered {kind} instead of JSON: {shown!r}", _ADDRESS)
    if not answer.choices:
        said = f": {error_message(body)}" if answer.error else ""
        return Unanswered(BadReply, f"the server's answer has no choices{said}", _ADDRESS)
    choice = answer.choices[0]
    if choice.message is None:
        return Unanswered(BadReply, "the server's answer has a choice without a message", _ADDRESS)
    return _reply(choice.message.text or choice.message.refusal, choice.finish_reason, answer, answer.usage)


def error_message(body: bytes) -> str:
    """Returns what the body of a failed request says, on one line: its error's message, or else its text."""
    whole = " ".join(body.decode("utf-8", "replace").split())
    try:
        answer = _read(body)
    except ValueError:
        return whole
    error = answer.error or answer
    words = error if isinstance(error, str) else error.message or ""
    return " ".join(words.split()) or whole


def _streamed(body: bytes) -> ChatReply | Unanswered:
    """Returns the completion whose pieces are the events of a stream (server-sent events)."""
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
    """Yields the data of each event; an event's data may span lines."""
    lines: list[bytes] = []
    for line in (*body.replace(b"\r\n", b"\n").split(b"\n"), b""):
        if line.startswith(b"data:"):
            lines.append(line[5:].strip())
        elif not line and lines:
            yield b"\n".join(lines)
            lines = []


def _reply(text: str | None, finish: str | None, answer: _ChatAnswer, usage: _ChatUsage | None) -> ChatReply:
    """Returns the reply; a text may be empty, and how long it took is for the client to say."""
    counts = usage or _ChatUsage()
    return ChatReply(
        text or "",
        counts.prompt_tokens,
        counts.completion_tokens,
        finish_reason=finish or "",
        model=answer.model or "",
    )
