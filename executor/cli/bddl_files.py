"""Which BDDL texts a command line names, and the dialect of each."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bddl import PROFILES
from executor.cli.bad_option import BadOption

STANDARD_INPUT = "-"
_EXPECTED = "a BDDL file, a folder with such files, or - for the standard input"
_DOMAIN = re.compile(r"\(\s*:domain\s+([^\s();]+)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class NamedText:
    """A text and where it came from.

    Attributes:
        name: The file's path as it was given, or `<stdin>`.
        path: The file, or None for the standard input.
        text: What it holds.
    """

    name: str
    path: Path | None
    text: str


def find_files(names: Sequence[str]) -> tuple[str, ...]:
    """Returns the files that were named, those in named folders included, each once.

    Raises:
        BadOption: A file does not exist, a folder has no file that ends in .bddl, or nothing was named.
    """
    found: list[str] = []
    for name in names:
        path = Path(name)
        if name == STANDARD_INPUT or path.is_file():
            found.append(name)
        elif path.is_dir():
            inside = sorted(str(file) for file in path.rglob("*.bddl") if file.is_file())
            if not inside:
                raise BadOption(name, "has no file that ends in .bddl", "a BDDL file or a folder with such files")
            found += inside
        else:
            raise BadOption(name, "does not exist", _EXPECTED)
    if not found:
        raise BadOption("FILE", "is missing", _EXPECTED)
    return tuple(dict.fromkeys(found))


def read_text(name: str) -> NamedText:
    """Returns the text of a file or of the standard input.

    Raises:
        BadOption: It is not UTF-8.
        OSError: The file cannot be read.
    """
    path = None if name == STANDARD_INPUT else Path(name)
    content = sys.stdin.buffer.read() if path is None else path.read_bytes()
    shown = "<stdin>" if path is None else name
    try:
        return NamedText(shown, path, content.decode("utf-8"))
    except UnicodeDecodeError as error:
        raise BadOption(shown, f"is not UTF-8 text (byte {error.start})", "a text file") from None


def check_profile(name: str | None) -> None:
    """Refuses the name of a profile that does not exist.

    Raises:
        BadOption: There is no such profile.
    """
    if name is not None and name not in PROFILES:
        raise BadOption("--profile", name, f"one of {', '.join(PROFILES)}")


def profile_of(text: str, wanted: str | None) -> str:
    """Returns the name of the profile to read a text with: the one asked for, or the one that its domain belongs to."""
    if wanted is not None:
        return wanted
    found = _DOMAIN.search(text)
    domain = found.group(1).lower() if found is not None else ""
    return next((name for name, profile in PROFILES.items() if domain in profile.domains), "scene")
