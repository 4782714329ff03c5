"""Tells which shared libraries a library needs, and where the dynamic loader finds them (through ldd)."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path


def linked(library: Path, folders: tuple[Path, ...] = ()) -> dict[str, Path | None]:
    """Return every library that `library` needs, its own needs included, and where it is found.

    Args:
        library: A shared library.
        folders: Folders to look in before the system's.

    Returns:
        Name to path; None for a library that is not found.
    """
    environment = dict(os.environ)
    if folders:
        environment["LD_LIBRARY_PATH"] = ":".join(map(str, folders))
    done = subprocess.run(
        ["ldd", str(library)], env=environment, capture_output=True, text=True, check=False,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    found: dict[str, Path | None] = {}
    for line in done.stdout.splitlines():
        match = re.match(r"\s*(\S+) => (not found|/\S+)", line)
        if match:
            found[match[1]] = None if match[2] == "not found" else Path(match[2])
    return found


def missing(library: Path, folders: tuple[Path, ...] = ()) -> tuple[str, ...]:
    """Return the names of the libraries that `library` needs and that are not found."""
    return tuple(sorted(name for name, path in linked(library, folders).items() if path is None))


def loading_order(libraries: tuple[Path, ...], folders: tuple[Path, ...]) -> tuple[Path, ...]:
    """Return libraries so that each stands after all that it needs.

    A library's needs include those of what it needs, so the number of needs grows along every dependency.
    """
    return tuple(sorted(libraries, key=lambda path: (len(linked(path, folders)), path.name)))


def library_folders(root: Path) -> tuple[Path, ...]:
    """Return the folders under an unpacked package tree that hold shared libraries."""
    return tuple(sorted({path.parent for path in root.rglob("*.so*") if path.is_file()}))
