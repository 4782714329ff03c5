"""Which BDDL texts a command line names, and the dialect of each."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bddl import PROFILES
from bddl.boundedfile import read_bounded, read_stream
from bddl.syntax.profiles import dialect_of
from executor.cli.options.bad_option import BadOption

STANDARD_INPUT = "-"
_EXPECTED = "a BDDL file, a folder with such files, or - for the standard input"


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


@dataclass(frozen=True, slots=True)
class Unreadable:
    """A file that has no text.

    Attributes:
        name: The file's path as it was given, or `<stdin>`.
        why: What keeps it from being read, as the rest of a sentence that begins with the name.
    """

    name: str
    why: str

    def __str__(self) -> str:
        return f"{self.name} {self.why}"


def find_files(names: Sequence[str]) -> tuple[str, ...]:
    """Returns the files that were named, those in named folders included, each once.

    Raises:
        BadOption: A file does not exist, a folder has no file that ends in .bddl, or nothing was named.
    """
    found: list[str] = []
    for name in names:
        path = Path(name)
        if path.is_dir() and name != STANDARD_INPUT:
            inside = sorted(str(file) for file in path.rglob("*.bddl") if file.is_file())
            if not inside:
                raise BadOption(name, "has no file that ends in .bddl", "a BDDL file or a folder with such files")
            found += inside
        # What exists and is no folder can be read, be it a file, a pipe or a device.
        elif name == STANDARD_INPUT or path.exists():
            found.append(name)
        else:
            raise BadOption(name, "does not exist", _EXPECTED)
    if not found:
        raise BadOption("FILE", "is missing", _EXPECTED)
    return tuple(dict.fromkeys(found))


def read_text(name: str) -> NamedText | Unreadable:
    """Returns the text of a file or of the standard input, or why there is none: the other files can still be read."""
    path = None if name == STANDARD_INPUT else Path(name)
    shown = "<stdin>" if path is None else name
    try:
        content = read_stream(sys.stdin.buffer, shown) if path is None else read_bounded(path, pipes=True)
        return NamedText(shown, path, content.decode("utf-8"))
    except UnicodeDecodeError as error:
        return Unreadable(shown, f"is not UTF-8 text (byte {error.start}); save it in UTF-8")
    except OSError as error:
        return Unreadable(shown, f"cannot be read: {error.strerror or error}")


def check_profile(name: str | None) -> None:
    """Refuses the name of a profile that does not exist.

    Raises:
        BadOption: There is no such profile.
    """
    if name is not None and name not in PROFILES:
        raise BadOption("--profile", name, f"one of {', '.join(PROFILES)}")


def profile_of(text: str, wanted: str | None) -> str:
    """Returns the name of the profile to read a text with: the one asked for, or the one that its domain belongs to."""
    return dialect_of(text) if wanted is None else wanted
