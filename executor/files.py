"""Files that appear only when they are complete."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any


@contextmanager
def temporary_beside(path: Path) -> Iterator[Path]:
    """Gives a temporary path beside the wanted one, and moves it there when the block ends without an exception.

    Args:
        path: Where the file belongs; its folder is made when absent.

    Raises:
        OSError: When the folder cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> Path:
    """Writes a text file in UTF-8, all of it or nothing, and returns its path.

    Half a surrogate pair, which a model can say, has no UTF-8; it is written as the escape that JSON has for it.
    """
    with temporary_beside(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")
    return path


def write_json(path: Path, value: object) -> Path:
    """Writes a JSON file, all of it or nothing, and returns its path."""
    return write_text(path, json_text(value) + "\n")


def json_text(value: object) -> str:
    """Returns indented JSON of plain data; numbers of numpy count as numbers."""
    return json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False)


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
