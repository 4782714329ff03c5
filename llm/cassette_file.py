"""The file of a recorded run: one exchange a line, as JSON that a person can read.

    {"cassette": 1, "digest": "…", "request": {…}, "reply": {…}}        pictures are hashes in the request
    {"cassette": 1, "digest": "…", "request": {…}, "failure": {…}}      the model gave no reply

A line is written in one piece and synced, so a crash costs at most the last line; a cut-off last line is left out when
the file is read, and said.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from bddl.boundedfile import read_bounded
from bddl.wholefile import open_plain
from llm.errors import (
    BadReply,
    CassetteError,
    ModelError,
    ModelRefused,
    ModelTimeout,
    ModelUnavailable,
    ReplyTooLong,
)
from llm.transport import ChatReply, digest_of

VERSION = 1
# Pictures are hashes in it; a day's exchanges have some tens of MB.
MOST_BYTES = 64_000_000

# Some tools end a line at these as well; within JSON they can be written as escapes.
_LINE_ENDS = {ord(letter): f"\\u{ord(letter):04x}" for letter in "\x85\u2028\u2029"}

# Failures that belong to a run, and come again when it is replayed; a cancelled request belongs to its caller.
FAILURES: Mapping[str, type[ModelError]] = {
    kind.__name__: kind for kind in (ModelUnavailable, ModelTimeout, ModelRefused, BadReply, ReplyTooLong)
}


@dataclass(frozen=True, slots=True)
class Exchange:
    """One request and what came of it.

    Attributes:
        request: `ChatRequest.record()`.
        outcome: The reply, or the failure in its place.
        digest: Of the request.
    """

    request: Mapping[str, Any]
    outcome: ChatReply | ModelError
    digest: str

    def line(self) -> str:
        """Returns the exchange as one line of JSON, with its newline."""
        head = {"cassette": VERSION, "digest": self.digest, "request": dict(self.request)}
        if isinstance(self.outcome, ChatReply):
            body: dict[str, object] = {"reply": asdict(self.outcome)}
        else:
            failed = self.outcome
            words = {"model": failed.model, "problem": failed.problem, "advice": failed.advice}
            body = {"failure": {"kind": type(failed).__name__, **words}}
        return json.dumps(head | body, ensure_ascii=False, allow_nan=False).translate(_LINE_ENDS) + "\n"


@dataclass(frozen=True, slots=True)
class Recording:
    """What a file holds.

    Attributes:
        exchanges: In the order in which they were recorded.
        warnings: What was left out, a sentence each.
        whole_bytes: How far the file consists of whole lines.
    """

    exchanges: tuple[Exchange, ...]
    warnings: tuple[str, ...] = ()
    whole_bytes: int = 0


def read_recording(path: Path) -> Recording:
    """Returns the exchanges of a file.

    Raises:
        CassetteError: The file cannot be read, or a line other than a cut-off last one is no exchange.
    """
    name = f"replay:{path}"
    try:
        data = read_bounded(path, MOST_BYTES)
    except OSError as error:
        problem = f"the recording cannot be read: {error.strerror or error}"
        raise CassetteError(name, problem, "Record one first") from error
    whole, end, rest = data.rpartition(b"\n")
    exchanges = []
    for number, line in enumerate(whole.split(b"\n") if end else [], start=1):
        try:
            exchanges.append(_exchange(line))
        except (ValueError, RecursionError) as error:
            advice = "A recording has one exchange a line, and is not edited by hand"
            raise CassetteError(name, f"line {number} is no recorded exchange: {error}", advice) from None
    warnings: tuple[str, ...] = ()
    if rest:
        warnings = (f"{path}: the last line was cut off ({len(rest)} bytes), and is left out",)
    return Recording(tuple(exchanges), warnings, len(data) - len(rest))


def append_line(path: Path, line: str) -> None:
    """Appends a line to a file in one piece, and has it on the disk before it returns.

    Raises:
        OSError: The disk is full, the folder is not there, or a link or a pipe lies in the file's place.
    """
    # Half a surrogate pair has no UTF-8; backslashreplace writes it as JSON's own escape.
    data = line.encode("utf-8", "backslashreplace")
    descriptor = open_plain(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    try:
        while data:
            data = data[os.write(descriptor, data) :]
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _exchange(line: bytes) -> Exchange:
    """Returns the exchange of a line, or raises a ValueError that says what is wrong with it."""
    value = json.loads(line)
    if not isinstance(value, dict) or value.get("cassette") != VERSION:
        raise ValueError(f'it does not begin with "cassette": {VERSION}')
    request, digest = value.get("request"), value.get("digest")
    if not isinstance(request, dict):
        raise ValueError("it has no request")
    if digest != digest_of(request):
        raise ValueError("its digest is not that of its request")
    if "reply" in value:
        return Exchange(request, _reply(value["reply"]), digest)
    return Exchange(request, _failure(value.get("failure")), digest)


def _reply(value: object) -> ChatReply:
    """Returns a recorded reply, or raises a ValueError."""
    kinds: dict[str, tuple[type, ...]] = {
        "text": (str,),
        "input_tokens": (int, type(None)),
        "output_tokens": (int, type(None)),
        "latency_s": (float, int),
        "finish_reason": (str,),
        "model": (str,),
        "attempts": (int,),
    }
    if not isinstance(value, dict) or set(value) != {item.name for item in fields(ChatReply)}:
        raise ValueError(f"its reply has not exactly the fields {', '.join(kinds)}")
    for name, wanted in kinds.items():
        if not isinstance(value[name], wanted) or isinstance(value[name], bool):
            raise ValueError(f"its reply's {name} is {value[name]!r:.40}")
    return ChatReply(**value)


def _failure(value: object) -> ModelError:
    """Returns a recorded failure, or raises a ValueError."""
    if not isinstance(value, dict) or value.get("kind") not in FAILURES:
        raise ValueError("it has neither a reply nor a failure")
    model, problem, advice = (value.get(name) for name in ("model", "problem", "advice"))
    if not isinstance(model, str) or not isinstance(problem, str) or not isinstance(advice, str):
        raise ValueError("its failure has not the texts model, problem and advice")
    return FAILURES[value["kind"]](model, problem, advice)
