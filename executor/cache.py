"""Where generated files live between runs, and how they are written so that two processes never see half of one."""

from __future__ import annotations

import hashlib
import os
import tempfile
from pathlib import Path

CACHE_VARIABLE = "SCENE2DEMO_CACHE"


def cache_dir() -> Path:
    """Returns the folder for generated files: SCENE2DEMO_CACHE, else `scene2demo` in the user's XDG cache folder."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "scene2demo"


def content_key(*parts: bytes | str) -> str:
    """Returns a short name for some content: equal parts give equal names, whatever wrote them."""
    digest = hashlib.sha256()
    for part in parts:
        raw = part.encode() if isinstance(part, str) else part
        digest.update(len(raw).to_bytes(8, "little"))
        digest.update(raw)
    return digest.hexdigest()[:16]


def write_atomically(path: Path, content: bytes) -> Path:
    """Writes a file so that readers see all of it or nothing, and returns its path.

    Two processes that write the same content-named file at once both succeed; the later rename changes
    nothing.

    Args:
        path: Where the file belongs; its folders are made.
        content: The whole content.

    Raises:
        OSError: When the folder cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=path.suffix)
    try:
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise
    return path
