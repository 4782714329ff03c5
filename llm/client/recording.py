"""Record and replay of exchanges with a model.

    transport = Recorder(model, Path("run.jsonl"))      # asks the model, and writes every exchange
    transport = Replay(Path("run.jsonl"))               # answers from the file, without key or network
    transport = Continued(Replay(...), model)           # answers from the file, and by the model where it ends

The file has one exchange a line, as JSON that a person can read:

    {"cassette": 1, "digest": "…", "request": {…}, "reply": {…}}        pictures are hashes in the request
    {"cassette": 1, "digest": "…", "request": {…}, "failure": {…}}      the model gave no reply

`made_by` says who asked, with which templates, by which version of the program; the digest is of the request alone.

A line is written in one piece and synced, so a crash costs at most the last line. A truncated last line is
skipped and reported. A run that ended early continues with its recording: what is in it is not asked again.
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

from bddl.files import is_disk_full, open_plain, read_bounded, write_atomically
from bddl.terminal import escape_json, pluralize
from llm.client.likeness import differences, nearest
from llm.client.transport import ChatReply, ChatRequest, Transport, digest_of, project_version
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
from oag.model.forms import first_mistake

VERSION = 1
# Pictures are stored as hashes; a day's exchanges have some tens of MB.
MOST_BYTES = 64_000_000

# Disk space reserved for request and reply while a model is asked.
_ROOM_BYTES = 256_000

_ANOTHER_RUN = "It is another run's: type that run's command, or start over with --force, which keeps the file aside"


# Failures that belong to a run and recur in its replay.
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


class _MadeBy(_Recorded):
    module: int
    template: str
    version: str


class _RecordedLine(_Recorded):
    cassette: Literal[1]
    digest: str
    request: dict[str, Any]
    reply: _RecordedReply | None = None
    failure: _RecordedFailure | None = None
    made_by: _MadeBy | None = None


@dataclass(frozen=True, slots=True)
class Exchange:
    """One request, as `ChatRequest.record` writes it, and its reply or the failure in its place.

    Attributes:
        module: Who asked, as in `ChatRequest`; 0 if that is not known.
        template: SHA-256 of the templates of its prompt; empty if that is not known.
        version: Version of the program that asked; empty if that is not known.
    """

    request: Mapping[str, Any]
    outcome: ChatReply | ModelError
    digest: str
    module: int = 0
    template: str = ""
    version: str = ""

    @classmethod
    def of(cls, request: ChatRequest, outcome: ChatReply | ModelError) -> Exchange:
        """Return the exchange of a request that is made now."""
        record = request.record()
        return cls(record, outcome, digest_of(record), request.module, request.template, project_version())

    def line(self) -> str:
        """Return the exchange as one line of JSON, with its newline."""
        head = {"cassette": VERSION, "digest": self.digest, "request": dict(self.request)}
        if isinstance(self.outcome, ChatReply):
            reply = asdict(self.outcome)
            del reply["recorded"], reply["request_sha256"]
            body: dict[str, object] = {"reply": reply}
        else:
            failed = self.outcome
            words = {"model": failed.model, "problem": failed.problem, "advice": failed.advice}
            body = {"failure": {"kind": type(failed).__name__, **words, "attempts": failed.attempts}}
        if self.version:
            body["made_by"] = {"module": self.module, "template": self.template, "version": self.version}
        # Some tools end lines at other characters as well, and some terminals interpret them.
        return escape_json(json.dumps(head | body, ensure_ascii=False, allow_nan=False)) + "\n"


def read_recording(path: Path) -> tuple[tuple[Exchange, ...], tuple[str, ...]]:
    """Return the exchanges of a file in order, and a sentence for each part that was skipped.

    Raises:
        CassetteError: The file cannot be read, or a line other than a truncated last one is no exchange.
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
            mistake = first_mistake(error, _RecordedLine) if isinstance(error, ValidationError) else str(error)
            advice = "A recording has one exchange a line, and is not edited by hand"
            raise CassetteError(name, f"line {number} is no recorded exchange: {mistake}", advice) from None
    warning = f"{path}: the last line was cut off ({len(rest)} bytes), and is left out"
    return tuple(exchanges), (warning,) if rest else ()


def _exchange(line: bytes) -> Exchange:
    # Not by pydantic's own parser, which rejects halves of surrogate pairs.
    read = _RecordedLine.model_validate(json.loads(line))
    if read.digest != digest_of(read.request):
        raise ValueError("its digest is not that of its request")
    made_by = {} if read.made_by is None else read.made_by.model_dump()
    if read.reply is not None:
        return Exchange(read.request, ChatReply(**read.reply.model_dump(), recorded=True), read.digest, **made_by)
    if read.failure is None:
        raise ValueError("it has neither a reply nor a failure")
    failed = read.failure
    error = FAILURES[failed.kind](failed.model, failed.problem, failed.advice)
    error.attempts = failed.attempts
    return Exchange(read.request, error, read.digest, **made_by)


def append_line(path: Path, line: str) -> None:
    """Append a line to a file in one piece and sync it to disk.

    Raises:
        OSError: The disk is full, the folder is missing, or the path is a link or a pipe.
    """
    # Half a surrogate pair has no UTF-8 form; backslashreplace writes it as JSON's own escape.
    data = line.encode("utf-8", "backslashreplace")
    descriptor = open_plain(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    try:
        while data:
            data = data[os.write(descriptor, data) :]
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def has_room(path: Path, size: int) -> None:
    """Check that a file can grow by `size` bytes, where the system can tell.

    Raises:
        OSError: It cannot; the number gives the reason.
    """
    descriptor = open_plain(path, os.O_WRONLY | os.O_CREAT)
    try:
        end = os.fstat(descriptor).st_size
        try:
            os.posix_fallocate(descriptor, end, size)
        except (AttributeError, OSError) as problem:
            # Some systems and file systems do not support this.
            if is_disk_full(problem):
                raise
        os.ftruncate(descriptor, end)
    finally:
        os.close(descriptor)


class Recorder:
    """Forward requests, and write each outcome to a file before returning it.

    Attributes:
        path: The file.
        notes: How an earlier recording is continued, a sentence each.
    """

    def __init__(self, transport: Transport, path: Path, *, resume: bool = False, same_start: bool = True) -> None:
        """Create the file, so that a missing folder or full disk is known before a model is paid.

        Args:
            transport: Transport that answers.
            path: A file that does not exist, or is empty.
            resume: Continue the file: its replies are returned first, and failed requests are sent again.
            same_start: With `resume`, refuse a first request that is not in the file: it belongs to another run.

        Raises:
            CassetteError: The file has content that cannot be continued, is no recording, or cannot be written.
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
            # Failed requests are sent again, and a new line must not follow a truncated one.
            self._replace("".join(exchange.line() for exchange in replied))
        self._earlier = Replay(path)
        if isinstance(transport, (Replay, Continued)):
            # The earlier run took these replies from there.
            for exchange in replied:
                _pass_reply(transport, exchange.digest)
        self._checks_start = same_start and bool(replied)
        self.notes = (*warnings, f"{path}: {pluralize(len(replied), 'answer')} of the earlier run, not asked again")

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the recorded reply, or the transport's once it is on the disk.

        Raises:
            ModelError: As the transport does; failures of the kinds in FAILURES are recorded as well.
            CassetteError: The file cannot be written, or belongs to a run that began with another request.
        """
        earlier = None if self._earlier is None else self._earlier.next_of(request.digest())
        if earlier is not None and isinstance(earlier.outcome, ChatReply):
            self._checks_start = False
            return earlier.outcome
        if self._earlier is not None and self._checks_start:
            raise self._earlier.missing(request, _ANOTHER_RUN)
        self._check_room(request)
        exchange = self._ask(request)
        self._write(exchange.line())
        if isinstance(exchange.outcome, ModelError):
            raise exchange.outcome
        return exchange.outcome

    def _ask(self, request: ChatRequest) -> Exchange:
        """Return the exchange to write: one that a recording answers keeps who made it, and when."""
        if isinstance(self._transport, (Replay, Continued)):
            recorded = self._transport.next_of(request.digest())
            if recorded is not None:
                return recorded
        try:
            return Exchange.of(request, self._transport.complete(request))
        except ModelError as error:
            if type(error).__name__ not in FAILURES:
                raise
            return Exchange.of(request, error)

    def _check_room(self, request: ChatRequest) -> None:
        """Refuse to ask if the answer, which is paid for, could not be stored."""
        with self._writing(), self._lock:
            has_room(self.path, len(json.dumps(request.record(), default=str)) + _ROOM_BYTES)

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
    """Answer requests from a recording; equal requests get their replies in the order of recording.

    Attributes:
        path: The file.
        warnings: What was skipped in it.
    """

    def __init__(self, path: Path) -> None:
        """Read the file."""
        self.path = path
        self._exchanges, self.warnings = read_recording(path)
        self._waiting: dict[str, deque[Exchange]] = defaultdict(deque)
        for exchange in self._exchanges:
            self._waiting[exchange.digest].append(exchange)
        self._lock = Lock()

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the recorded reply to a request.

        Raises:
            ReplayMissing: There is none left; the message states how the nearest recorded request differs.
            ModelError: The model failed when this was recorded.
        """
        exchange = self.next_of(request.digest())
        if exchange is None:
            raise self.missing(request, "Record the run again, with the same version, scene, query and seed")
        if isinstance(exchange.outcome, ModelError):
            raise exchange.outcome
        return exchange.outcome

    def next_of(self, digest: str) -> Exchange | None:
        """Consume and return the next recorded exchange with a digest; None without one."""
        with self._lock:
            exchanges = self._waiting.get(digest)
            return exchanges.popleft() if exchanges else None

    def missing(self, request: ChatRequest, again: str) -> ReplayMissing:
        """Return the error for a request that is not recorded: its difference from the nearest one, and advice."""
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
        recorded = self._exchanges[closest]
        lines = differences(record, recorded.request)
        if recorded.template and request.template and recorded.template != request.template:
            lines = (f"the prompt's template is another one than in version {recorded.version}", *lines)
        problem = f"the request {digest[:12]} was not recorded; the nearest is on line {closest + 1} of the file"
        return ReplayMissing(name, problem, f"{again}. It differs in", digest=digest, differences=lines)


class Continued:
    """Answer from a recording as far as it goes, and by a model from there on; what failed in it is asked again."""

    def __init__(self, replay: Replay, transport: Transport) -> None:
        """Begin at the recording's start."""
        self._replay, self._transport = replay, transport
        self._begun = False

    def complete(self, request: ChatRequest) -> ChatReply:
        """Return the recorded reply, or the transport's.

        Raises:
            ReplayMissing: The first request is not in the recording, which belongs to another run.
            ModelError: As the transport does.
        """
        exchange = self.next_of(request.digest())
        if exchange is not None and isinstance(exchange.outcome, ChatReply):
            return exchange.outcome
        if not self._begun:
            raise self._replay.missing(request, "The recording is of another run: name that run's, or the model alone")
        return self._transport.complete(request)

    def next_of(self, digest: str) -> Exchange | None:
        """Consume and return the next recorded exchange with a digest and a reply; None without one."""
        while (exchange := self._replay.next_of(digest)) is not None:
            self._begun = True
            if isinstance(exchange.outcome, ChatReply):
                return exchange
        return None


def _pass_reply(recorded: Replay | Continued, digest: str) -> None:
    """Consume the exchanges with a digest up to the next one with a reply."""
    while (exchange := recorded.next_of(digest)) is not None and not isinstance(exchange.outcome, ChatReply):
        pass
