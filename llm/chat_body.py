"""The body of a chat-completions request: a request in the words that one model's server understands."""

from __future__ import annotations

import base64
import json
from typing import Any

from llm.errors import RequestError
from llm.model_profile import ModelProfile
from llm.transport import ChatRequest, Image, Message, Part


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
    wanted = _response_format(request, profile)
    if wanted is not None:
        body["response_format"] = wanted
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
    if profile.system_role == "system":
        return [{"role": "system", "content": request.system}, *messages]
    first = request.messages[0]
    if first.role == "user":
        return [_message(Message((request.system, *first.parts))), *messages[1:]]
    return [{"role": "user", "content": request.system}, *messages]


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


def _response_format(request: ChatRequest, profile: ModelProfile) -> dict[str, Any] | None:
    """Returns how JSON is demanded, or None where it is left to the words of the prompt."""
    mode = request.mode or profile.mode
    if mode == "json_schema" and request.json_schema is not None:
        return {"type": "json_schema", "json_schema": {"name": "answer", "schema": dict(request.json_schema)}}
    if mode == "json_object" and (request.json_schema is not None or request.mode is not None):
        return {"type": "json_object"}
    return None
