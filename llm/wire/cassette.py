"""Record and replay: every exchange with a model goes into a file, and the file can answer in the model's place.

    transport = Recorder(model, Path("run.jsonl"))      # asks the model, and writes every exchange
    transport = Replay(Path("run.jsonl"))               # answers from the file, without key or network

The file has one exchange a line, as JSON that a person can read:

    {"cassette": 1, "digest": "…", "request": {…}, "reply": {…}}        pictures are hashes in the request
    {"cassette": 1, "digest": "…", "request": {…}, "failure": {…}}      the model gave no reply

A line is written in one piece and synced, so a crash costs at most the last line; a cut-off last line is left out when
the file is read, and reported. A run that ended early goes on with its recording: what is in it is not asked again.
"""

from __future__ import annotations

import json
import os
from collections import defaultdict, deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Lock
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from bddl.files import no_room, open_plain, read_bounded, write_atomically
from bddl.visible import counted, json_escaped
from llm.errors import (
    BadReply,
    CassetteError,
    ModelError,
    ModelRefused,
    ModelTimeout,
    ModelUnavailable,
    ReplayMissing,
    ReplyTooLong,
)
from llm.wire.differences import differences, nearest
from llm.wire.transport import ChatReply, ChatRequest, Transport, digest_of
from oag.model.forms import first_mistake

VERSION = 1
# Pictures are hashes in it; a day's exchanges have some tens of MB.
MOST_BYTES = 64_000_000

# Kept free for the reply while a model is asked, with the request.
_ROOM_BYTES = 256_000

_ANOTHER_RUN = "It is another run's: type that run's command, or start over with --force, which keeps the file aside"


# Failures that belong to a run, and come again when it is replayed; a cancelled request belongs to its caller.
FAILURES: Mapping[str, type[ModelError]] = {
    kind.__name__: kind for kind in (ModelUnavailable, ModelTimeout, ModelRefused, BadReply, ReplyTooLong)
}


class _Recorded(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class _RecordedReply(_Recorded):
    text: str
    input_tokens: int | None
    output_tokens: int | None
    latency_s: float
    finish_reason: str
    model: str
    attempts: int


class _RecordedFailure(_Recorded):
    kind: Literal["ModelUnavailable", "ModelTimeout", "ModelRefused", "BadReply", "ReplyTooLong"]
    model: str
    problem: str
    advice: str
    attempts: int = 1


class _RecordedLine(_Recorded):
    cassette: Literal[1]
    digest: str
    request: dict[str, Any]
    reply: _RecordedReply | None = None
    failure: _RecordedFailure | None = None


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
            reply = asdict(self.outcome)
            del reply["recorded"]
            body: dict[str, object] = {"reply": reply}
        else:
            failed = self.outcome
            words = {"model": failed.model, "problem": failed.problem, "advice": failed.advice}
            body = {"failure": {"kind": type(failed).__name__, **words, "attempts": failed.attempts}}
        # Some tools end a line at further characters, and some terminals are steered by them.
        return json_escaped(json.dumps(head | body, ensure_ascii=False, allow_nan=False)) + "\n"


def read_recording(path: Path) -> tuple[tuple[Exchange, ...], tuple[str, ...]]:
    """Returns the exchanges of a file in the order in which they were recorded, and what was left out, a sentence each.

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
            said = first_mistake(error, _RecordedLine) if isinstance(error, ValidationError) else str(error)
            advice = "A recording has one exchange a line, and is not edited by hand"
            raise CassetteError(name, f"line {number} is no recorded exchange: {said}", advice) from None
    warning = f"{path}: the last line was cut off ({len(rest)} bytes), and is left out"
    return tuple(exchanges), (warning,) if rest else ()


def _exchange(line: bytes) -> Exchange:
    # Not by pydantic's own parser, which has no halves of surrogate pairs.
    read = _RecordedLine.model_validate(json.loads(line))
    if read.digest != digest_of(read.request):
        raise ValueError("its digest is not that of its request")
    if read.reply is not None:
        return Exchange(read.request, ChatReply(**read.reply.model_dump(), recorded=True), read.digest)
    if read.failure is None:
        raise ValueError("it has neither a reply nor a failure")
    failed = read.failure
    error = FAILURES[failed.kind](failed.model, failed.problem, failed.advice)
    error.attempts = failed.attempts
    return Exchange(read.request, error, read.digest)


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


def has_room(path: Path, size: int) -> None:
    """Check that a file can grow by so many bytes, where the system can tell.

    Raises:
        OSError: It cannot; the number says why.
    """
    descriptor = open_plain(path, os.O_WRONLY | os.O_CREAT)
    try:
        end = os.fstat(descriptor).st_size
        try:
            os.posix_fallocate(descriptor, end, size)
        except (AttributeError, OSError) as problem:
            # Some systems and file systems do not tell.
            if no_room(problem):
                raise
        os.ftruncate(descriptor, end)
    finally:
        os.close(descriptor)


class Recorder:
    """Passes requests on, and writes what came of them before it returns.

    Attributes:
        path: The file.
        notes: What became of an earlier recording that it goes on with, a sentence each.
    """

    def __init__(self, transport: Transport, path: Path, *, resume: bool = False, same_start: bool = True) -> None:
        """Makes the file, so that a folder that is missing or full is known before a model is paid.

        Args:
            transport: Who answers.
            path: A file that does not exist, or is empty.
            resume: Goes on with what the file has: its replies are given first, and what failed is asked again.
            same_start: With `resume`, refuses a first request that is not in the file: it is another run's.

        Raises:
            CassetteError: The file holds something that is not to be gone on with, is none, or cannot be written.
        """
        self.path = path
        self.notes: tuple[str, ...] = ()
        self._transport = transport
        self._lock = Lock()
        self._earlier: Replay | None = None
        self._checks_start = False
        self._write("")
        if path.stat().st_size == 0:
            return
        if not resume:
            raise CassetteError(f"record:{path}", "the file exists already", "Name another one, or remove it")
        exchanges, warnings = read_recording(path)
        replied = tuple(exchange for exchange in exchanges if isinstance(exchange.outcome, ChatReply))
        if warnings or len(replied) < len(exchanges):
            # What failed is asked again, and a new line does not go behind half a one.
            self._replace("".join(exchange.line() for exchange in replied))
        self._earlier = Replay(path)
        self._checks_start = same_start and bool(replied)
        self.notes = (*warnings, f"{path}: {counted(len(replied), 'answer')} of the earlier run, not asked again")

    def complete(self, request: ChatRequest) -> ChatReply:
        """Returns the recorded reply, or the one that the transport gives, once it is on the disk.

        Raises:
            ModelError: As the transport does; what FAILURES names is recorded as well.
            CassetteError: The file cannot be written; or it is of a run that began with another request.
        """
        record, digest = request.record(), request.digest()
        earlier = None if self._earlier is None else self._earlier.next_of(digest)
        if isinstance(earlier, ChatReply):
            self._checks_start = False
            return earlier
        if self._earlier is not None and self._checks_start:
            raise self._earlier.missing(request, _ANOTHER_RUN)
        self._check_room(record)
        try:
            reply = self._transport.complete(request)
        except ModelError as error:
            if type(error).__name__ in FAILURES:
                self._write(Exchange(record, error, digest).line())
            raise
        self._write(Exchange(record, reply, digest).line())
        return reply

    def _check_room(self, record: Mapping[str, object]) -> None:
        """Refuses to ask where the answer, which is paid for, could not be kept."""
        with self._writing(), self._lock:
            has_room(self.path, len(json.dumps(record, default=str)) + _ROOM_BYTES)

    def _write(self, line: str) -> None:
        with self._writing(), self._lock:
            append_line(self.path, line)

    def _replace(self, lines: str) -> None:
        with self._writing():
            write_atomically(self.path, lines.encode("utf-8", "backslashreplace"))

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            problem = f"the recording cannot be written: {error.strerror or error}"
            raise CassetteError(f"record:{self.path}", problem, "Check the folder and the disk") from error


class Replay:
    """Answers requests from a recording; equal requests get their replies in the order of recording.

    Attributes:
        path: The file.
        warnings: What was left out of it.
    """

    def __init__(self, path: Path) -> None:
        """Reads the file.

        Raises:
            CassetteError: It cannot be read, or is no recording.
        """
        self.path = path
        self._exchanges, self.warnings = read_recording(path)
        self._waiting: dict[str, deque[ChatReply | ModelError]] = defaultdict(deque)
        for exchange in self._exchanges:
            self._waiting[exchange.digest].append(exchange.outcome)
        self._lock = Lock()

    def complete(self, request: ChatRequest) -> ChatReply:
        """Returns the recorded reply to a request.

        Raises:
            ReplayMissing: There is none, or none any more; the message says how the nearest recorded request differs.
            ModelError: The model failed when this was recorded.
        """
        outcome = self.next_of(request.digest())
        if outcome is None:
            raise self.missing(request, "Record the run again, with the same version, scene, query and seed")
        if isinstance(outcome, ModelError):
            raise outcome
        return outcome

    def next_of(self, digest: str) -> ChatReply | ModelError | None:
        """Return what came of the next recorded request with a digest, which then is used; None without one."""
        with self._lock:
            outcomes = self._waiting.get(digest)
            return outcomes.popleft() if outcomes else None

    def missing(self, request: ChatRequest, again: str) -> ReplayMissing:
        """Return the error for a request that is not recorded: how it differs from the nearest one, and what to do."""
        name, digest = f"replay:{self.path}", request.digest()
        times = sum(exchange.digest == digest for exchange in self._exchanges)
        if times:
            often = "once" if times == 1 else f"{times} times"
            problem = f"the request {digest[:12]} was recorded {often}, and is asked once more"
            return ReplayMissing(name, problem, again, digest=digest)
        record = request.record()
        closest = nearest(record, (exchange.request for exchange in self._exchanges))
        if closest is None:
            return ReplayMissing(name, "the recording is empty", "Record a run first", digest=digest)
        lines = differences(record, self._exchanges[closest].request)
        problem = f"the request {digest[:12]} was not recorded; the nearest is on line {closest + 1} of the file"
        return ReplayMissing(name, problem, f"{again}. It differs in", digest=digest, differences=lines)
