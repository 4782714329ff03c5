"""Files in folders that others write to as well: what they have put there leads no reading or writing elsewhere."""

from __future__ import annotations

import os
import secrets
import stat
from pathlib import Path

# Systems that lack one have no such links or pipes.
_AS_IT_LIES = getattr(os, "O_NOFOLLOW", 0) | getattr(os, "O_NONBLOCK", 0)


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


def write_whole(path: Path, data: bytes) -> None:
    """Writes a file, all of it or nothing; what lies there is replaced, a link too. Its folder is made when absent.

    Raises:
        OSError: The disk is full, or the folder cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f".{secrets.token_hex(8)}.part")
    try:
        with os.fdopen(open_plain(partial, os.O_WRONLY | os.O_CREAT | os.O_EXCL), "wb") as stream:
            stream.write(data)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
