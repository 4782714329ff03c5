"""The chat-completions protocol: the body of a request as one model's server understands it, and what an answer says.

Answers are read whole or streamed, without trusting any of them.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from llm.errors import BadReply, ModelError, ModelUnavailable, RequestError
from llm.wire.profiles import ModelProfile
from llm.wire.transport import ChatRequest, Image, Message, Part

_ADDRESS = "Check the server's address: it mostly ends in /v1"


def chat_body(request: ChatRequest, profile: ModelProfile) -> dict[str, Any]:
    """Returns the fields of the request's body.

    Args:
        request: What is asked.
        profile: How the model wants to be asked.

    Raises:
        RequestError: The request has more images than the model takes, or holds what JSON cannot.
    """
    images = len(request.images)
    if profile.max_images is not None and images > profile.max_images:
        raise RequestError(f"the request has {images} images, and {profile.name} takes at most {profile.max_images}")
    body: dict[str, Any] = {"model": profile.model, "messages": _messages(request, profile)}
    mode = request.mode or profile.mode
    if mode == "json_schema" and request.json_schema is not None:
        schema = {"name": "answer", "schema": dict(request.json_schema)}
        body["response_format"] = {"type": "json_schema", "json_schema": schema}
    elif mode == "json_object" and (request.json_schema is not None or request.mode is not None):
        body["response_format"] = {"type": "json_object"}
    if request.max_tokens is not None:
        body[profile.max_tokens_field] = request.max_tokens
    if request.temperature is not None and profile.send_temperature:
        body["temperature"] = request.temperature
    if profile.stream:
        body |= {"stream": True, "stream_options": {"include_usage": True}}
    body |= {**profile.extra_body, **request.extra_body}
    try:
        json.dumps(body, ensure_ascii=False, allow_nan=False).encode("utf-8")
    except (TypeError, ValueError) as error:
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


@dataclass(frozen=True, slots=True)
class ChatAnswer:
    """What an answer says; ChatReply's attributes of these names explain them. A text may be empty."""

    text: str
    input_tokens: int | None
    output_tokens: int | None
    finish_reason: str
    model: str


def read_answer(body: bytes, content_type: str) -> ChatAnswer | Unanswered:
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
        if start.startswith(b"{"):
            problem = f"the server's answer is broken JSON ({error})"
            return Unanswered(BadReply, problem, "Ask again; if it stays, see its log")
        kind = content_type.partition(";")[0].strip() or "no content type"
        shown = " ".join(body[:200].decode("utf-8", "replace").split())[:80]
        return Unanswered(BadReply, f"the server answered {kind} instead of JSON: {shown!r}", _ADDRESS)
    choice = _first_choice(answer)
    if choice is None:
        said = error_message(json.dumps(answer).encode()) if _member(answer, "error") else ""
        return Unanswered(BadReply, f"the server's answer has no choices{': ' + said if said else ''}", _ADDRESS)
    message = _member(choice, "message")
    if not isinstance(message, dict):
        return Unanswered(BadReply, "the server's answer has a choice without a message", _ADDRESS)
    said = _text(message.get("content")) or _text(message.get("refusal"))
    return _completion(said, _word(_member(choice, "finish_reason")), answer, _member(answer, "usage"))


def error_message(body: bytes) -> str:
    """Returns what the body of a failed request says, on one line: its error's message, or else its text."""
    whole = " ".join(body.decode("utf-8", "replace").split())
    try:
        answer = _json(body)
    except ValueError:
        return whole
    found = _member(answer, "error", answer)
    words = found if isinstance(found, str) else _member(found, "message", "")
    return " ".join(str(words).split()) or whole


def _json(body: bytes) -> object:
    """Returns a body as JSON, or raises a ValueError; nesting without end is no JSON either."""
    try:
        return json.loads(body)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def _streamed(body: bytes) -> ChatAnswer | Unanswered:
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
            problem = f"the server failed while it answered: {error_message(data)}"
            return Unanswered(ModelUnavailable, problem, again=True)
        usage = _member(chunk, "usage") or usage
        choice = _first_choice(chunk)
        delta = _member(choice, "delta")
        pieces.append(_text(_member(delta, "content")))
        refusals.append(_text(_member(delta, "refusal")))
        finish = _word(_member(choice, "finish_reason")) or finish
    if not ended and not finish:
        return Unanswered(ModelUnavailable, "the server's answer was cut off", again=True)
    return _completion("".join(pieces) or "".join(refusals), finish, chunk, usage)


def _events(body: bytes) -> Iterator[bytes]:
    """Yields the data of each event; an event's data may span lines."""
    lines: list[bytes] = []
    for line in (*body.replace(b"\r\n", b"\n").split(b"\n"), b""):
        if line.startswith(b"data:"):
            lines.append(line[5:].strip())
        elif not line and lines:
            yield b"\n".join(lines)
            lines = []


def _completion(text: str, finish: str, answer: object, usage: object) -> ChatAnswer:
    counts = [_count(_member(usage, name)) for name in ("prompt_tokens", "completion_tokens")]
    return ChatAnswer(text, counts[0], counts[1], finish, _word(_member(answer, "model")))


def _first_choice(answer: object) -> object:
    choices = _member(answer, "choices")
    return choices[0] if isinstance(choices, list) and choices else None


def _text(content: object) -> str:
    """Returns a message's text: a string, or the texts of its parts; parts of another kind are thoughts."""
    if isinstance(content, list):
        kinds = ("text", "output_text", None)
        texts = [_member(part, "text") for part in content if _member(part, "type") in kinds]
        return "".join(text for text in texts if isinstance(text, str))
    return content if isinstance(content, str) else ""


def _member(value: object, name: str, default: object = None) -> object:
    return value.get(name, default) if isinstance(value, dict) else default


def _word(value: object) -> str:
    return value[:200] if isinstance(value, str) else ""


def _count(value: object) -> int | None:
    return value if isinstance(value, int) and not isinstance(value, bool) and value >= 0 else None
