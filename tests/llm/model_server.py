"""A model's server on this machine: it speaks the chat-completions protocol, and misbehaves when it is told to.

    with ModelServer(replies("{}"), fails(500), replies("again")) as server:
        ...  # server.address; server.seen holds every request, its images decoded

Each request uses up one act; after the last one, it is repeated. A function in place of acts decides by the request.
"""

from __future__ import annotations

import base64
import json
import socket
import struct
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Event, Lock, Thread
from types import TracebackType
from typing import Any

MOST_REQUESTS = 5_000
LONGEST_BODY = 64_000_000
LONGEST_WAIT_S = 30.0
PATH = "/v1/chat/completions"


@dataclass(frozen=True)
class Act:
    """What the server does with one request.

    Attributes:
        text: What the model says, wrapped as the protocol wants it.
        body: Sent as it is, in place of a wrapped text.
        fields: Members that replace those of the wrapped answer.
        wait_s: Seconds of silence before the answer.
        drip_s: Seconds between single bytes of the body.
        cut_at: Bytes of the body after which the connection is closed.
        reset: The connection is reset before anything is sent.
    """

    text: str = "{}"
    status: int = 200
    headers: Mapping[str, str] = field(default_factory=dict)
    body: bytes | None = None
    content_type: str = "application/json"
    fields: Mapping[str, Any] = field(default_factory=dict)
    wait_s: float = 0.0
    drip_s: float = 0.0
    cut_at: int | None = None
    reset: bool = False


def replies(text: str, **options: Any) -> Act:
    """Return an act that answers with a text."""
    return Act(text, **options)


def fails(status: int, message: str = "it failed", **headers: str) -> Act:
    """Return an act that answers with a status of failure, as the protocol words it."""
    body = json.dumps({"error": {"message": message, "type": "error", "code": None}}).encode()
    return Act(status=status, body=body, headers={name.replace("_", "-"): value for name, value in headers.items()})


@dataclass(frozen=True)
class Seen:
    """A request that arrived.

    Attributes:
        headers: With names in lower case.
        body: Its JSON.
        images: The pictures of all messages, decoded from their data URLs.
    """

    headers: Mapping[str, str]
    body: Mapping[str, Any]
    images: tuple[bytes, ...]

    @property
    def texts(self) -> tuple[str, ...]:
        """All texts of the conversation, in order."""
        found: list[str] = []
        for message in self.body["messages"]:
            content = message["content"]
            found += [content] if isinstance(content, str) else [part["text"] for part in content if "text" in part]
        return tuple(found)


class ModelServer:
    """The server; a context manager. It answers on 127.0.0.1 only, at a port that the system chooses."""

    def __init__(self, *acts: Act, decide: Callable[[Seen], Act] | None = None, key: str | None = None) -> None:
        self.seen: list[Seen] = []
        self.closing = Event()
        self._acts = acts or (Act(),)
        self._decide = decide
        self._key = key
        self._lock = Lock()
        self._server = _Server(("127.0.0.1", 0), _Handler)
        self._server.owner = self
        self._thread = Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True)

    @property
    def address(self) -> str:
        """The base URL that a client is given."""
        return f"http://127.0.0.1:{self._server.server_address[1]}/v1"

    def __enter__(self) -> ModelServer:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.closing.set()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(timeout=10)

    def act_on(self, path: str, headers: Mapping[str, str], data: bytes) -> tuple[Act, Mapping[str, Any]]:
        """Return what to do with a request, and its body; a request against the protocol gets what a server says."""
        if path != PATH:
            return fails(404, f"no such path: {path}"), {}
        if self._key is not None and headers.get("authorization") != f"Bearer {self._key}":
            return fails(401, f"Incorrect API key provided: {headers.get('authorization')}"), {}
        try:
            seen = _seen(headers, data)
        except (ValueError, KeyError, TypeError) as error:
            return fails(400, f"bad request: {error!r}"), {}
        with self._lock:
            number = len(self.seen)
            if number >= MOST_REQUESTS:
                return fails(503, "this test server has answered enough"), {}
            self.seen.append(seen)
        if self._decide is not None:
            return self._decide(seen), seen.body
        return self._acts[min(number, len(self._acts) - 1)], seen.body


class _Server(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False
    owner: ModelServer

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Stays silent: clients that hang up are what is tested."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: _Server
    timeout = LONGEST_WAIT_S

    def log_message(self, format: str, *args: Any) -> None:
        """Stays silent."""

    def do_POST(self) -> None:
        """Answers one request."""
        length = int(self.headers.get("Content-Length", "0"))
        if length > LONGEST_BODY:
            self.close_connection = True
            return
        data = self.rfile.read(length)
        headers = {name.lower(): value for name, value in self.headers.items()}
        act, asked = self.server.owner.act_on(self.path, headers, data)
        self.server.owner.closing.wait(min(act.wait_s, LONGEST_WAIT_S))
        if act.reset:
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            self.connection.close()
            self.close_connection = True
            return
        streamed = bool(asked.get("stream")) and act.body is None
        body = b"".join(_events(act, asked)) if streamed else act.body or json.dumps(_answer(act, asked)).encode()
        self.send_response(act.status)
        self.send_header("Content-Type", "text/event-stream" if streamed else act.content_type)
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Connection", "close")
        for name, value in act.headers.items():
            self.send_header(name, value)
        self.end_headers()
        self._send(body[: act.cut_at], act.drip_s)
        self.close_connection = True

    def _send(self, body: bytes, drip_s: float) -> None:
        """Send a body, in one piece or byte by byte until the test ends."""
        if not drip_s:
            self.wfile.write(body)
            return
        for index in range(len(body)):
            if self.server.owner.closing.wait(drip_s):
                return
            self.wfile.write(body[index : index + 1])
            self.wfile.flush()


def _seen(headers: Mapping[str, str], data: bytes) -> Seen:
    """Return a request as it is kept; raises for one that the protocol does not allow."""
    body = json.loads(data)
    images = []
    if not isinstance(body["model"], str) or not body["messages"]:
        raise ValueError("a request has a model and messages")
    for message in body["messages"]:
        if message["role"] not in ("system", "user", "assistant"):
            raise ValueError(f"no such role: {message['role']}")
        for part in message["content"] if isinstance(message["content"], list) else ():
            if part["type"] == "image_url":
                head, _, encoded = part["image_url"]["url"].partition(",")
                if not head.startswith("data:image/") or not head.endswith(";base64"):
                    raise ValueError(f"no data URL: {head[:40]}")
                images.append(base64.b64decode(encoded, validate=True))
            elif part["type"] != "text":
                raise ValueError(f"no such part: {part['type']}")
    return Seen(headers, body, tuple(images))


def _usage(act: Act, asked: Mapping[str, Any]) -> dict[str, int]:
    """Return token counts: one for each word, which tests can reckon themselves."""
    words = len(json.dumps(asked["messages"]).split()) if asked else 0
    return {"prompt_tokens": words, "completion_tokens": len(act.text.split()), "total_tokens": words}


def _answer(act: Act, asked: Mapping[str, Any]) -> dict[str, Any]:
    """Return a whole answer."""
    message = {"role": "assistant", "content": act.text}
    return {
        "id": "chatcmpl-1",
        "object": "chat.completion",
        "created": 1,
        "model": asked.get("model", "none"),
        "choices": [{"index": 0, "message": message, "finish_reason": "stop"}],
        "usage": _usage(act, asked),
        **act.fields,
    }


def _events(act: Act, asked: Mapping[str, Any]) -> Iterator[bytes]:
    """Yield an answer as server-sent events, a few letters each."""
    head = {"id": "chatcmpl-1", "object": "chat.completion.chunk", "created": 1, "model": asked["model"]}
    deltas: list[dict[str, Any]] = [{"role": "assistant", "content": ""}]
    deltas += [{"content": act.text[start : start + 7]} for start in range(0, len(act.text), 7)]
    for delta in deltas:
        yield _event(head | {"choices": [{"index": 0, "delta": delta, "finish_reason": None}]})
    yield _event(head | {"choices": [{"index": 0, "delta": {}, "finish_reason": "stop"}], **act.fields})
    if asked.get("stream_options", {}).get("include_usage"):
        yield _event(head | {"choices": [], "usage": _usage(act, asked)})
    yield b"data: [DONE]\n\n"


def _event(value: Mapping[str, Any]) -> bytes:
    return b"data: " + json.dumps(value).encode() + b"\n\n"
