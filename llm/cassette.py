"""Record and replay: every exchange with a model goes into a file, and the file can answer in the model's place.

transport = Recorder(model, Path("run.jsonl"))      # asks the model, and writes every exchange
transport = Replay(Path("run.jsonl"))               # answers from the file, without key or network
"""

from __future__ import annotations

import os
from collections import defaultdict, deque
from pathlib import Path
from threading import Lock

from bddl.wholefile import write_atomically
from llm.cassette_file import FAILURES, Exchange, append_line, read_recording
from llm.errors import CassetteError, ModelError, ReplayMissing
from llm.request_differences import differences, nearest
from llm.transport import ChatReply, ChatRequest, Image, Transport


class Recorder:
    """Passes requests on, and writes what came of them before it returns.

    Attributes:
        path: The file.
        warnings: What was found amiss in a file that is continued.
    """

    def __init__(
        self, transport: Transport, path: Path, *, resume: bool = False, images_folder: Path | None = None
    ) -> None:
        """Makes the file, so that a folder that is missing or full is known before a model is paid.

        Args:
            transport: Who answers.
            path: A file that does not exist, or is empty.
            resume: True continues a recording; a cut-off last line is removed first.
            images_folder: Where pictures are kept, named by their hashes; None keeps their hashes only.

        Raises:
            CassetteError: The file holds something, or cannot be written.
        """
        self.path = path
        self.warnings: tuple[str, ...] = ()
        self._transport = transport
        self._images_folder = images_folder
        self._lock = Lock()
        self._write("")
        if path.stat().st_size > 0:
            if not resume:
                raise CassetteError(f"record:{path}", "the file exists already", "Name another one, or remove it")
            recording = read_recording(path)
            self.warnings = recording.warnings
            if recording.warnings:
                os.truncate(path, recording.whole_bytes)

    def complete(self, request: ChatRequest) -> ChatReply:
        """Returns the reply that the transport gives, once it is on the disk.

        Raises:
            ModelError: As the transport does; what `llm.cassette_file.FAILURES` names is recorded as well.
            CassetteError: The file or a picture cannot be written.
        """
        record, digest = request.record(), request.digest()
        try:
            reply = self._transport.complete(request)
        except ModelError as error:
            if type(error).__name__ in FAILURES:
                self._keep(Exchange(record, error, digest), request.images)
            raise
        self._keep(Exchange(record, reply, digest), request.images)
        return reply

    def _keep(self, exchange: Exchange, images: tuple[Image, ...]) -> None:
        """Writes an exchange, its pictures first."""
        if self._images_folder is not None:
            for image in images:
                self._keep_image(image, self._images_folder)
        self._write(exchange.line())

    def _keep_image(self, image: Image, folder: Path) -> None:
        """Writes a picture under its hash, unless it is there."""
        target = folder / f"{image.sha256}.{image.media_type.partition('/')[2]}"
        if target.exists():
            return
        try:
            write_atomically(target, image.data)
        except OSError as error:
            raise CassetteError(f"record:{self.path}", f"a picture cannot be written: {error}") from error

    def _write(self, line: str) -> None:
        """Appends to the file, one line at a time."""
        try:
            with self._lock:
                append_line(self.path, line)
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
        recording = read_recording(path)
        self.path = path
        self.warnings = recording.warnings
        self._exchanges = recording.exchanges
        self._waiting: dict[str, deque[ChatReply | ModelError]] = defaultdict(deque)
        for exchange in recording.exchanges:
            self._waiting[exchange.digest].append(exchange.outcome)
        self._lock = Lock()

    @property
    def left(self) -> int:
        """How many recorded replies were not asked for yet."""
        return sum(len(outcomes) for outcomes in self._waiting.values())

    def complete(self, request: ChatRequest) -> ChatReply:
        """Returns the recorded reply to a request.

        Raises:
            ReplayMissing: There is none, or none any more; the message says how the nearest recorded request differs.
            ModelError: The model failed when this was recorded.
        """
        digest = request.digest()
        with self._lock:
            outcomes = self._waiting.get(digest)
            outcome = outcomes.popleft() if outcomes else None
        if outcome is None:
            raise self._missing(request, digest)
        if isinstance(outcome, ModelError):
            raise outcome
        return outcome

    def _missing(self, request: ChatRequest, digest: str) -> ReplayMissing:
        """Returns the error for a request that the recording does not answer."""
        name = f"replay:{self.path}"
        times = sum(exchange.digest == digest for exchange in self._exchanges)
        again = "Record the run again, with the same version, scene, query and seed"
        if times:
            problem = f"the request {digest[:12]} was recorded {_times(times)}, and is asked once more"
            return ReplayMissing(name, problem, again, digest=digest)
        record = request.record()
        closest = nearest(record, (exchange.request for exchange in self._exchanges))
        if closest is None:
            return ReplayMissing(name, "the recording is empty", "Record a run first", digest=digest)
        lines = differences(record, self._exchanges[closest].request)
        problem = f"the request {digest[:12]} was not recorded; the nearest is on line {closest + 1} of the file"
        return ReplayMissing(name, problem, f"{again}. It differs in", digest=digest, differences=lines)


def _times(count: int) -> str:
    """Returns "once", or how many times."""
    return "once" if count == 1 else f"{count} times"
