"""Files: read with an end, and written whole.

A device, a pipe or a file of gigabytes that a person names is refused, not waited for. What others have put into a
folder leads no reading or writing elsewhere, and a file appears only when it is complete.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

MOST_BYTES = 8_000_000
"""Of a scene, a task, a certificate or a BDDL file; the certificate of a plan of 5,000 steps has 2 MB."""
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
# Systems that lack one have no such links or pipes.
_AS_IT_LIES = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)
# Written to try if a file can grow: a block of most file systems.
_PROBE = bytes(4096)


class InputTooLarge(OSError):
    """A file that is read is larger than what is read of it; its number is EFBIG, and no disk is full."""


def no_room(error: BaseException) -> bool:
    """Decide whether the system refused to write: a full disk, a used-up share of it, or a file that may not grow."""
    return isinstance(error, OSError) and error.errno in _NO_ROOM and not isinstance(error, InputTooLarge)


def read_bounded(path: str | os.PathLike[str], most_bytes: int = MOST_BYTES, *, pipes: bool = False) -> bytes:
    """Returns the content of a file.

    Args:
        path: The file.
        most_bytes: The largest that is read.
        pipes: Whether a pipe will do, such as a shell's `<(...)`; it is read to its end.

    Raises:
        OSError: The file cannot be opened, is no regular file, or is larger; `strerror` says which it is.
    """
    with opened(path, pipes=pipes) as stream:
        return read_stream(stream, str(path), most_bytes)


@contextmanager
def opened(path: str | os.PathLike[str], *, pipes: bool = False) -> Iterator[BinaryIO]:
    """Give a file to read from.

    Args:
        path: The file.
        pipes: Whether a pipe will do.

    Raises:
        OSError: The file cannot be opened, or is no regular file; `strerror` says which it is.
    """
    # A pipe that nobody writes into would be waited for when it is opened.
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
    """Returns what a stream still holds.

    Raises:
        OSError: It is more than so many bytes; `filename` is the name given.
    """
    # What the file system says of the size may be 0, or be another a moment later.
    content = stream.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise InputTooLarge(errno.EFBIG, f"it is larger than {most_bytes // 1_000_000} MB", name)
    return content


def read_bounded_text(path: str | os.PathLike[str], most_bytes: int = MOST_BYTES) -> str:
    """Returns the text of a file in UTF-8, with or without a byte order mark, its line ends as `\\n`.

    Raises:
        OSError: As for `read_bounded`.
        UnicodeDecodeError: It is no UTF-8 text.
    """
    text = read_bounded(path, most_bytes).decode("utf-8-sig")
    return text.replace("\r\n", "\n").replace("\r", "\n")


class NoPlainFile(OSError):
    """A link, a pipe or a device lies where a file belongs."""

    def __init__(self, path: Path) -> None:
        super().__init__(None, "is no plain file; remove it, or choose another folder", str(path))


def open_plain(path: Path, flags: int) -> int:
    """Returns a descriptor of a file; nothing that is no plain file is followed, changed or waited for.

    Args:
        path: The file.
        flags: As of `os.open`; with O_CREAT it is made when absent.

    Raises:
        NoPlainFile: Something else lies there.
        OSError: It cannot be opened.
    """
    try:
        descriptor = os.open(path, flags | _AS_IT_LIES, 0o644)
    except OSError as problem:
        if path.is_symlink() or (path.exists() and not path.is_file()):
            raise NoPlainFile(path) from problem
        raise
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise NoPlainFile(path)
    return descriptor


@contextmanager
def temporary_beside(path: Path) -> Iterator[Path]:
    """Gives a new, empty file beside the wanted path, and moves it there when the block ends without an exception.

    Its name cannot be foreseen, and what lies at the wanted path is replaced, a link too: nothing that somebody has
    put into the folder leads the writing elsewhere.

    Args:
        path: Where the file belongs; its folder is made when absent.

    Raises:
        OSError: When the folder cannot be written; it names the wanted path.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem[:64]}.{secrets.token_hex(8)}.part{path.suffix}")
    try:
        os.close(os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666))
        yield temporary
        os.replace(temporary, path)
    except Exception as problem:
        found = _of_the_system(problem, path, temporary)
        if found is None:
            raise
        raise found from problem
    finally:
        temporary.unlink(missing_ok=True)


def _of_the_system(problem: Exception, path: Path, temporary: Path) -> OSError | None:
    """Returns what the system said when the wanted file was written, named by its path; None for anything else."""
    if isinstance(problem, OSError) and problem.errno is not None:
        ours = problem.filename in (None, str(temporary))
        return OSError(problem.errno, problem.strerror, str(path)) if ours else None
    # Libraries for films and data sets raise what they like, without the system's number.
    number = _refusal_to_grow(temporary)
    return None if number is None else OSError(number, os.strerror(number), str(path))


def _refusal_to_grow(file: Path) -> int | None:
    """Return the system's number for why a file cannot grow; None where it can."""
    try:
        with file.open("ab", buffering=0) as stream:
            if stream.write(_PROBE) == len(_PROBE):
                return None
            # What fits in part is written in part; the next piece has a reason.
            stream.write(_PROBE)
            return errno.ENOSPC
    except OSError as problem:
        return problem.errno if no_room(problem) else None


def write_atomically(path: Path, content: bytes) -> Path:
    """Writes a file so that readers see all of it or nothing, and returns its path.

    Two processes that write the same content-named file at once both succeed; the later rename changes nothing.

    Args:
        path: Where the file belongs; its folders are made.
        content: The whole content.

    Raises:
        OSError: When the folder cannot be written.
    """
    with temporary_beside(path) as temporary:
        temporary.write_bytes(content)
    return path
