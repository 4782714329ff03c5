"""Files that a person names, read with an end: a device, a pipe or a file of gigabytes is refused, not waited for."""

from __future__ import annotations

import errno
import os
import stat
from typing import BinaryIO

MOST_BYTES = 8_000_000
"""Of a scene, a task, a certificate or a BDDL file; the certificate of a plan of 5,000 steps has 2 MB."""


def read_bounded(path: str | os.PathLike[str], most_bytes: int = MOST_BYTES, *, pipes: bool = False) -> bytes:
    """Returns the content of a file.

    Args:
        path: The file.
        most_bytes: The largest that is read.
        pipes: Whether a pipe will do, such as a shell's `<(...)`; it is read to its end.

    Raises:
        OSError: The file cannot be opened, is no regular file, or is larger; `strerror` says which it is.
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
        return read_stream(stream, str(path), most_bytes)


def read_stream(stream: BinaryIO, name: str, most_bytes: int = MOST_BYTES) -> bytes:
    """Returns what a stream still holds.

    Raises:
        OSError: It is more than so many bytes; `filename` is the name given.
    """
    # What the file system says of the size may be 0, or be another a moment later.
    content = stream.read(most_bytes + 1)
    if len(content) > most_bytes:
        raise OSError(errno.EFBIG, f"it is larger than {most_bytes // 1_000_000} MB", name)
    return content


def read_bounded_text(path: str | os.PathLike[str], most_bytes: int = MOST_BYTES) -> str:
    """Returns the text of a file in UTF-8, with or without a byte order mark, its line ends as `\\n`.

    Raises:
        OSError: As for `read_bounded`.
        UnicodeDecodeError: It is no UTF-8 text.
    """
    text = read_bounded(path, most_bytes).decode("utf-8-sig")
    return text.replace("\r\n", "\n").replace("\r", "\n")
