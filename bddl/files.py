"""Files: bounded reads and atomic writes.

A device, a pipe or a file of gigabytes that a person names is refused, not waited for. Links that others have put into
a folder are neither read nor written through. A file appears only when it is complete.
"""

from __future__ import annotations

import errno
import os
import stat
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

MOST_BYTES = 8_000_000
"""Limit of a scene, a task, a certificate or a BDDL file [bytes]; the certificate of a plan of 5,000 steps has 2 MB."""
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
# Systems that lack one have no such links or pipes.
_NO_FOLLOW = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
# Written to test whether a file can grow: a block of most file systems.
_PROBE = bytes(4096)


class InputTooLarge(OSError):
    """Raised when a file exceeds the limit of a bounded read; its errno is EFBIG, although no disk is full."""


def is_disk_full(error: BaseException) -> bool:
    """Decide whether the system refused to write: a full disk, an exhausted quota, or a file that may not grow."""
    return isinstance(error, OSError) and error.errno in _NO_ROOM and not isinstance(error, InputTooLarge)


def read_bounded(path: str | os.PathLike[str], most_bytes: int = MOST_BYTES, *, pipes: bool = False) -> bytes:
    """Return the content of a file; raise OSError when it is no regular file, or larger than the limit.

    With `pipes`, a pipe is accepted, such as a shell's `<(...)`; it is read to its end.
    """
    with open_input(path, pipes=pipes) as stream:
        return read_stream(stream, str(path), most_bytes)


@contextmanager
def open_input(path: str | os.PathLike[str], *, pipes: bool = False) -> Iterator[BinaryIO]:
    """Open a regular file, or a pipe where these are accepted; `strerror` of the OSError says what is wrong."""
    # Opening a pipe that has no writer would block.
    waiting = 0 if pipes else getattr(os, "O_NONBLOCK", 0)
    try:
        descriptor = os.open(path, os.O_RDONLY | waiting | getattr(os, "O_BINARY", 0))
    except ValueError:  # A zero byte in the name.
        raise OSError(errno.EINVAL, "no file has such a name", str(path)) from None
    with os.fdopen(descriptor, "rb") as stream:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not (stat.S_ISREG(mode) or pipes):
            raise OSError(errno.EINVAL, "it is no regular file, but a device, a pipe or a socket", str(path))
        yield stream


def read_stream(stream: BinaryIO, name: str, most_bytes: int = MOST_BYTES) -> bytes:
    """Return the rest of a stream; the OSError of one with too many bytes has the name given."""
    # The size that the file system reports may be 0, or change a moment later.
    content = stream.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise InputTooLarge(errno.EFBIG, f"it is larger than {most_bytes // 1_000_000} MB", name)
    return content


def read_bounded_text(path: str | os.PathLike[str], most_bytes: int = MOST_BYTES) -> str:
    """Return the text of a file in UTF-8, with or without a byte order mark, its line ends as `\\n`."""
    text = read_bounded(path, most_bytes).decode("utf-8-sig")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_table(name: str) -> dict[str, Any]:
    """Return the content of a TOML file of this package."""
    return tomllib.loads(Path(__file__).with_name(name).read_text(encoding="utf-8"))


class NoPlainFile(OSError):
    """A link, a pipe or a device lies where a file belongs."""

    def __init__(self, path: Path) -> None:
        super().__init__(None, "is no plain file; remove it, or choose another folder", str(path))


def open_plain(path: Path, flags: int) -> int:
    """Return a descriptor of a regular file; anything else raises NoPlainFile and is not followed or waited for."""
    try:
        descriptor = os.open(path, flags | _NO_FOLLOW, 0o644)
    except OSError as problem:
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise NoPlainFile(path) from problem
        raise
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise NoPlainFile(path)
    return descriptor


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a new, empty file in the folder of a path, and move it to the path when the block ends without an error.

    Its name is random, and what lies at the path is replaced, a link too. So nothing that somebody has put into the
    folder redirects the write. An OSError names the wanted path.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem[:64]}.{os.urandom(8).hex()}.part{path.suffix}")
    try:
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        yield temporary
        os.replace(temporary, path)
    except Exception as problem:
        found = _as_os_error(problem, path, temporary)
        if found is None:
            raise
        raise found from problem
    finally:
        temporary.unlink(missing_ok=True)


def _as_os_error(problem: Exception, path: Path, temporary: Path) -> OSError | None:
    """Return the system's error with the wanted path in it; None for any other exception."""
    if isinstance(problem, OSError) and problem.errno is not None:
        ours = problem.filename in (None, str(temporary))
        return OSError(problem.errno, problem.strerror, str(path)) if ours else None
    # Libraries for videos and data sets raise exceptions of their own, without the system's errno.
    number = _growth_errno(temporary)
    return None if number is None else OSError(number, os.strerror(number), str(path))


def _growth_errno(file: Path) -> int | None:
    try:
        with file.open("ab", buffering=0) as stream:
            if stream.write(_PROBE) == len(_PROBE):
                return None
            # What fits is written in part; writing more raises the reason.
            stream.write(_PROBE)
            return errno.ENOSPC
    except OSError as problem:
        return problem.errno if is_disk_full(problem) else None


def write_atomically(path: Path, content: bytes) -> Path:
    """Write a file so that readers see all of it or nothing, and return its path.

    Two processes that write the same content-named file at once both succeed; the later rename changes nothing.
    """
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)
    return path
