"""A small server for the page on this machine alone: it gives episodes, their files, and scenes, and takes nothing.

/                     the page
/episode/NAME         details as JSON
/file/NAME/FILE       one of the files that the details list, in parts where a browser asks for parts of a video
/scene/NAME           the scene as a page of its own
"""

from __future__ import annotations

import json
import mimetypes
import re
from collections.abc import Callable
from functools import lru_cache
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from io import BufferedIOBase, BytesIO
from pathlib import Path
from typing import IO
from urllib.parse import quote, unquote, urlsplit

from bddl.files import open_input
from executor.view.page import detail_json
from executor.view.records import EpisodeDetail, Listing, NothingToView
from executor.view.scene_view import scene_page

HOST = "127.0.0.1"
_KEPT = 32
_TYPES = {".jsonl": "text/plain; charset=utf-8", ".json": "application/json", ".xz": "application/x-xz"}


class ViewServer(ThreadingHTTPServer):
    """The server of a listing, or of one page.

    Args:
        pages: Path of a page -> a function that returns its text.
        listing: The episodes; None where there are only pages.
        port: 0 for any that is free.

    Raises:
        OSError: The port is in use.
    """

    daemon_threads = True

    def __init__(self, pages: dict[str, Callable[[], str]], listing: Listing | None = None, port: int = 0) -> None:
        super().__init__((HOST, port), _Handler)
        self.pages = pages
        self.detail: Callable[[str], EpisodeDetail] | None = None
        if listing is not None:
            self.detail = lru_cache(_KEPT)(listing.detail)

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"http://{HOST}:{self.server_port}/"


class _Handler(BaseHTTPRequestHandler):
    server: ViewServer
    protocol_version = "HTTP/1.1"
    timeout = 60

    def do_GET(self) -> None:
        self._begun = False
        try:
            self._answer(urlsplit(self.path).path)
        except NothingToView as problem:
            self.send_error(HTTPStatus.NOT_FOUND, explain=str(problem))
        except Exception as problem:
            # A damaged episode, or a browser that stops reading, does not end the server.
            if self._begun or isinstance(problem, ConnectionError | TimeoutError):
                self.close_connection = True
            else:
                self.send_error(HTTPStatus.INTERNAL_SERVER_ERROR, explain=str(problem))

    def _answer(self, path: str) -> None:
        if self.headers.get("Host", "").partition(":")[0] not in (HOST, "localhost"):
            # Another site may lead its own name to this machine.
            raise NothingToView("only this machine is answered")
        if path in self.server.pages:
            return self._send(self.server.pages[path]().encode(), "text/html; charset=utf-8")
        parts = [unquote(part) for part in path.strip("/").split("/")]
        if self.server.detail is None or len(parts) < 2:
            raise NothingToView(f"there is no page {path}")
        detail = self.server.detail(parts[1])
        if parts[0] == "episode" and len(parts) == 2:
            files, start = _files(detail), f"/file/{quote(parts[1], safe='')}"
            described = detail_json(detail, lambda file: f"{start}/{files.index(file)}/{quote(file.name)}")
            return self._send(json.dumps(described).encode(), "application/json")
        if parts[0] == "scene" and len(parts) == 2 and detail.scene is not None:
            return self._send(scene_page(detail.scene).encode(), "text/html; charset=utf-8")
        if parts[0] == "file" and len(parts) == 4 and parts[2].isdecimal():
            files = _files(detail)
            if int(parts[2]) < len(files) and files[int(parts[2])].name == parts[3]:
                return self._send_file(files[int(parts[2])])
        raise NothingToView(f"there is no page {path}")

    def _send(self, body: bytes, kind: str) -> None:
        self._send_stream(BytesIO(body), len(body), kind)

    def _send_file(self, file: Path) -> None:
        kind = _TYPES.get(file.suffix) or mimetypes.guess_type(file.name)[0] or "application/octet-stream"
        with open_input(file) as stream:
            self._send_stream(stream, file.stat().st_size, kind)

    def _send_stream(self, stream: IO[bytes], size: int, kind: str) -> None:
        first, end = self._range(size)
        partial_answer = (first, end) != (0, size)
        self._begun = True
        self.send_response(HTTPStatus.PARTIAL_CONTENT if partial_answer else HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(end - first))
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("Cache-Control", "no-store")
        # Whatever a name or a sentence holds, the page asks nobody else.
        self.send_header("Content-Security-Policy", _POLICY)
        if partial_answer:
            self.send_header("Content-Range", f"bytes {first}-{end - 1}/{size}")
        self.end_headers()
        stream.seek(first)
        _copy(stream, self.wfile, end - first)

    def _range(self, size: int) -> tuple[int, int]:
        """Return the first byte and the one after the last that are asked for; all of them without a valid range."""
        found = re.fullmatch(r"bytes=(\d+)-(\d*)", self.headers.get("Range", ""))
        if found is None or int(found[1]) >= size:
            return 0, size
        return int(found[1]), min(int(found[2]) + 1, size) if found[2] else size

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing: the terminal shows what the command has to say."""


def _files(detail: EpisodeDetail) -> list[Path]:
    """Return the files of an episode; videos of a data set are called alike in different folders."""
    return list(dict.fromkeys((*detail.files, *(clip.file for clip in detail.clips))))


_POLICY = "default-src 'self' data: blob: 'unsafe-inline'"
_PART_BYTES = 1 << 16


def _copy(source: IO[bytes], target: BufferedIOBase, count: int) -> None:
    while count > 0 and (part := source.read(min(count, _PART_BYTES))):
        target.write(part)
        count -= len(part)
