"""Where generated files live between runs, and what they are called."""

from __future__ import annotations

import hashlib
import os
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
