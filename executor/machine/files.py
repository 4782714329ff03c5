"""Files that appear only when they are complete."""

from __future__ import annotations

import errno
import json
import math
import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bddl.boundedfile import read_bounded_text
from bddl.visible import json_escaped

NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""What the system says when a disk is full, or somebody's share of it, or a file may not grow."""
LARGEST_JSON_BYTES = 50_000_000
_PROBE = bytes(4096)


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
    return None if _has_room(temporary) else OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _has_room(file: Path) -> bool:
    """Decides whether a file can still grow."""
    try:
        with file.open("ab", buffering=0) as stream:
            return stream.write(_PROBE) == len(_PROBE)
    except OSError as problem:
        return problem.errno not in NO_ROOM


def write_text(path: Path, text: str) -> Path:
    """Writes a text file in UTF-8, all of it or nothing, and returns its path.

    Half a surrogate pair, which a model can say, has no UTF-8; it is written as the escape that JSON has for it.
    """
    with temporary_beside(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")
    return path


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


def write_json(path: Path, value: object) -> Path:
    """Writes a JSON file, all of it or nothing, and returns its path."""
    return write_text(path, json_text(value) + "\n")


def read_json(path: Path) -> Any:
    """Returns what a JSON file holds.

    Raises:
        OSError: It cannot be read, is no regular file, or is larger than `LARGEST_JSON_BYTES`.
        ValueError: It is no JSON, or is nested deeper than can be read.
    """
    try:
        return json.loads(read_bounded_text(path, LARGEST_JSON_BYTES))
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def json_text(value: object) -> str:
    """Returns indented JSON of plain data, in which no character steers a terminal; numbers of numpy are numbers."""
    return json_escaped(json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False))


def plain(value: object) -> Any:
    """Returns data made of dictionaries, lists, strings, numbers, truth values and None only.

    Numbers that JSON does not have (infinite, not a number) become None.

    Raises:
        TypeError: When the data holds something else.
    """
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if value is None or isinstance(value, str | bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, Sequence | set | frozenset):
        return [plain(entry) for entry in (sorted(value) if isinstance(value, set | frozenset) else value)]
    raise TypeError(f"expected plain data, got {type(value).__name__}")
