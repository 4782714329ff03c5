"""Atomic JSON and text files; plain data; the cache folder."""

from __future__ import annotations

import hashlib
import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bddl.files import atomic_path, read_bounded_text
from bddl.terminal import escape_json

LARGEST_JSON_BYTES = 50_000_000
"""Bounds the memory that a foreign file can take."""


def write_text(path: Path, text: str) -> Path:
    """Write a text file in UTF-8 atomically, and return its path.

    Half a surrogate pair, which a model may return, has no UTF-8; it is written as JSON's escape for it.
    """
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")
    return path


def write_json(path: Path, value: object) -> Path:
    """Write a JSON file atomically, and return its path."""
    return write_text(path, json_text(value) + "\n")


def read_json(path: Path) -> Any:
    """Return the content of a JSON file.

    Raises:
        OSError: It cannot be read, is no regular file, or is larger than `LARGEST_JSON_BYTES`.
        ValueError: It is no JSON, or is nested deeper than can be read.
    """
    try:
        return json.loads(read_bounded_text(path, LARGEST_JSON_BYTES))
    except RecursionError:
        raise ValueError("it is nested too deeply") from None


def json_text(value: object) -> str:
    """Return indented JSON of plain data, with control characters escaped and numpy's numbers as numbers."""
    return escape_json(json.dumps(plain(value), indent=2, ensure_ascii=False, allow_nan=False))


def plain(value: object) -> Any:
    """Return data made of dictionaries, lists, strings, numbers, truth values and None only.

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


CACHE_VARIABLE = "SCENE2DEMO_CACHE"


def cache_dir() -> Path:
    """Return the folder for generated files: SCENE2DEMO_CACHE, else `scene2demo` in the user's XDG cache folder."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "scene2demo"


def content_key(*parts: bytes | memoryview | str) -> str:
    """Return a short name for some content: equal parts give equal names, whatever wrote them."""
    digest = hashlib.sha256()
    for part in parts:
        raw = part.encode() if isinstance(part, str) else part
        digest.update(len(raw).to_bytes(8, "little"))
        digest.update(raw)
    return digest.hexdigest()[:16]
