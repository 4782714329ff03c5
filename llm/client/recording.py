"""Record and replay of exchanges with a model, and `connect`, which opens a model or a recording by name.

    transport = Recorder(model, Path("run.jsonl"))      # asks the model, and writes every exchange
    transport = Replay(Path("run.jsonl"))               # answers from the file, without key or network

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
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from threading import Lock
from types import MappingProxyType
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from bddl.files import is_disk_full, open_plain, read_bounded, write_atomically
from bddl.terminal import escape_json, pluralize
from llm.client.budget import Budget, Metered, check_price
from llm.client.local import served
from llm.client.openai import OpenAITransport
from llm.client.profiles import ModelProfile, Price, find_profile, tables
from llm.client.shared import Shared
from llm.client.transport import ChatReply, ChatRequest, Routed, Sampled, Transport, digest_of, project_version
from llm.errors import (
    BadReply,
    CassetteError,
    ModelConfigError,
    ModelError,
    ModelRefused,
    ModelTimeout,
    ModelUnavailable,
    ReplayMissing,
    ReplyTooLong,
)
from oag.model.forms import first_mistake

MOST_LINES = 6
_CONTEXT = 30


def nearest(asked: Mapping[str, object], recorded: Iterable[Mapping[str, object]]) -> int | None:
    """Return the position of the recorded request that differs least, or None if there is none.

    A differing field counts by its differing share. So a request with one other word is nearer than another one of
    the same form. The earliest wins a tie.
    """
    leaves = _leaves(asked)
    distances = [_distance(leaves, _leaves(other)) for other in recorded]
    return distances.index(min(distances)) if distances else None


def differences(asked: Mapping[str, object], recorded: Mapping[str, object]) -> tuple[str, ...]:
    """Return a line for each of the first few fields in which two requests differ."""
    ours, theirs = _leaves(asked), _leaves(recorded)
    places = _unlike(ours, theirs)
    lines = [_line(place, ours.get(place), theirs.get(place)) for place in places[:MOST_LINES]]
    if len(places) > MOST_LINES:
        lines.append(f"and {len(places) - MOST_LINES} more")
    return tuple(lines)


def _leaves(record: object) -> dict[str, object]:
    found: dict[str, object] = {}
    waiting: list[tuple[str, object]] = [("", record)]
    while waiting:
        place, value = waiting.pop()
        if isinstance(value, Mapping) and "image" in value:
            found[place] = f"image {str(value['image'])[:12]}… ({value.get('bytes')} bytes)"
        elif isinstance(value, Mapping) and value:
            waiting += [(f"{place}.{name}" if place else str(name), item) for name, item in reversed([*value.items()])]
        elif isinstance(value, (list, tuple)) and value:
            waiting += [(f"{place}[{index}]", item) for index, item in reversed([*enumerate(value)])]
        else:
            found[place] = value
    return found


def _unlike(ours: Mapping[str, object], theirs: Mapping[str, object]) -> list[str]:
    missing = object()
    places = dict.fromkeys([*ours, *theirs])
    return [place for place in places if ours.get(place, missing) != theirs.get(place, missing)]


def _distance(ours: Mapping[str, object], theirs: Mapping[str, object]) -> float:
    """Sum over differing fields: 1, or for two texts the share that is in neither common head nor tail."""
    total = 0.0
    for place in _unlike(ours, theirs):
        one, other = ours.get(place), theirs.get(place)
        if not isinstance(one, str) or not isinstance(other, str):
            total += 1.0
            continue
        head = _shared(one, other)
        tail = _shared(one[head:][::-1], other[head:][::-1])
        total += 1.0 - (head + tail) / max(len(one), len(other))
    return total


def _shared(one: str, other: str) -> int:
    pairs = enumerate(zip(one, other, strict=False))
    return next((index for index, (a, b) in pairs if a != b), min(len(one), len(other)))


def _line(place: str, ours: object, theirs: object) -> str:
    if not isinstance(ours, str) or not isinstance(theirs, str) or max(len(ours), len(theirs)) < 2 * _CONTEXT:
        return f"{place}: recorded {theirs!r:.80}, asked {ours!r:.80}"
    start = _shared(theirs, ours)
    before = max(0, start - _CONTEXT)
    shown = [text[before : start + _CONTEXT] for text in (theirs, ours)]
    return f"{place}, from character {start}: recorded …{shown[0]!r}, asked …{shown[1]!r}"


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


_REPLAY = "replay"
_NOTHING_PAID = Price(input=0.0, output=0.0)  # Recorded replies are not paid for again.


def recording_of(configuration: str) -> tuple[Path | None, str]:
    """Return the recording that a configuration names, and the model that goes on where it ends; empty for none.

    Only `replay:FILE` and `replay:FILE,PROVIDER:MODEL` name a recording.
    """
    provider, _, rest = configuration.strip().partition(":")
    if provider != _REPLAY or not rest:
        return None, configuration
    file, comma, model = rest.rpartition(",")
    goes_on = bool(comma) and model.partition(":")[0] in tables() and ":" in model
    return (Path(file), model) if goes_on else (Path(rest), "")


def is_replay(configuration: str) -> bool:
    """Decide whether a configuration names a recording alone, so that nothing is asked or paid."""
    file, model = recording_of(configuration)
    return file is not None and not model


def replayed(file: Path, *, temperature: float | None = None, seed: int | None = None) -> Metered:
    """Return a transport that answers from a recording alone, whatever its path contains.

    Args:
        file: The recording.
        temperature, seed: Sampling of every request, as when it was recorded.

    Raises:
        CassetteError: It cannot be read.
    """
    transport: Transport = (replay := Replay(file))
    if temperature is not None or seed is not None:
        transport = Sampled(transport, temperature, seed)
    return Metered(transport, name=f"{_REPLAY}:{file}", price=_NOTHING_PAID, warnings=replay.warnings, replays=True)


def connect(
    configuration: str,
    *,
    budget: Budget | None = None,
    record: Path | None = None,
    resume: bool = False,
    same_start: bool = True,
    models: Mapping[int, str] = MappingProxyType({}),
    temperature: float | None = None,
    seed: int | None = None,
    shared: Path | None = None,
    starts: bool = True,
) -> Metered:
    """Return a transport for a configuration, with usage counted in `.usage`; nothing is sent yet.

    `.warnings` states what was skipped in a damaged recording, and what is continued.

    Args:
        configuration: "provider:model", such as "openai:gpt-5.2"; "replay:FILE" for a recorded run; or
            "replay:FILE,provider:model" for one that the model continues where the recording ends.
        budget: Limits of the run; default is none.
        record: A new file into which every exchange is written.
        resume: Continue the file of a run that ended early: its replies are returned first, and not asked again.
        same_start: With `resume`, refuse to ask if the run's first request is not in the file.
        models: Module, 1 to 5, or judge -> configuration of its own model.
        temperature, seed: Sampling of every request; None leaves it to the server. A replay needs the same values.
        shared: File in which processes count what they use together; the budget is then one of all of them.
        starts: Whether the server of a model's file is started; without it, all else is checked and nothing answers.

    Raises:
        ModelConfigError: Provider, model, key, address or library is unknown or missing; or a model takes no
            temperature.
        CassetteError: A recording cannot be read or created.
    """
    if configuration.strip() == f"{_REPLAY}:":
        raise ModelConfigError(configuration, "no recording is named", "Name its file, as in replay:run.jsonl")
    file, model = recording_of(configuration)
    profile = find_profile(model) if model or file is None else None
    profiles = {module: find_profile(name) for module, name in models.items()}
    for one in (profile, *profiles.values()):
        if temperature is not None and one is not None and not one.send_temperature:
            raise ModelConfigError(one.name, "the model takes no temperature", "Leave the temperature out")
    prices = {module: one.price for module, one in profiles.items()}
    transport: Transport
    warnings: tuple[str, ...] = ()
    live: Transport | None = None if profile is None else _live(profile, profiles, starts=starts)
    if live is not None and profile is not None and shared is not None:
        together, budget = budget or Budget(), None
        check_price(profile.name, together, profile.price, *prices.values())
        live = Shared(live, shared, name=profile.name, budget=together, price=profile.price, prices=prices)
    if file is not None:
        transport = replay = Replay(file)
        warnings = replay.warnings
        if live is not None:
            transport = Continued(replay, live)
    else:
        assert live is not None
        transport = live
    if record is not None:
        transport = recorder = Recorder(transport, record, resume=resume, same_start=same_start)
        warnings = (*warnings, *recorder.notes)
    if temperature is not None or seed is not None:
        transport = Sampled(transport, temperature, seed)
    return Metered(
        transport,
        name=configuration if profile is None or file is not None else profile.name,
        budget=budget,
        price=_NOTHING_PAID if profile is None else profile.price,
        prices={} if profile is None else prices,
        warnings=warnings,
        boxes=None if profile is None else profile.boxes,
        replays=profile is None,
    )


def _live(profile: ModelProfile, profiles: Mapping[int, ModelProfile], *, starts: bool) -> Transport:
    """Return a transport to a model, and to those of some modules."""
    others = {module: OpenAITransport(served(one, starts=starts)) for module, one in profiles.items()}
    transport = OpenAITransport(served(profile, starts=starts))
    return Routed(transport, others) if others else transport
