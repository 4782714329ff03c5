"""The folder that an asset lives in: no name in its files leads out of it, and no file is too large to read.

XML is the same for every reader: UTF-8, without a document type, whatever its declaration says. A parser believes the
declaration. In UTF-7 or UTF-16 a file can so say to it what a look at its text does not show, such as entities that
grow to gigabytes or name other files. Readers get what was looked at, and no declaration.
"""

from __future__ import annotations

import re
import stat
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from bddl import near_names
from executor.machine.extras import require

LARGEST_FILE_BYTES = 200_000_000  # Far above any mesh that a simulation needs.
MOST_NAMES = 5000
"""Of the folder's names, how many are looked at for a hint."""
_SCHEMES = ("package://", "file://", "model://")
# Also of versions of XML that there are not, which many files name.
_DECLARATION = re.compile(r"\A\s*<\?xml[^>]*\?>")


class ImportRefused(ValueError):
    """An asset cannot be read, or the robot could do nothing with it; the message says how to mend it."""

    def __init__(self, path: Path, problem: str, hint: str) -> None:
        self.problem, self.hint = problem, hint
        super().__init__(f"{path}: {problem}; {hint}")


class NothingThere(ImportRefused):
    """A file that an asset names is not there, or has nothing solid in it."""


@dataclass(frozen=True, slots=True)
class AssetFolder:
    """Where an asset's files may be.

    Attributes:
        root: The folder; nothing above it is read.
        here: The folder that relative names start from, in `root` or `root` itself.
    """

    root: Path
    here: Path

    @classmethod
    def of(cls, file: Path) -> AssetFolder:
        """Returns the folder of an asset's main file."""
        folder = file.resolve().parent
        return cls(folder, folder)

    def find(self, name: str) -> Path:
        """Returns the file that a name in the asset's files means.

        `package://NAME/rest` is looked for as `rest` and as `NAME/rest` in the folder.

        Raises:
            NothingThere: There is no such file.
            ImportRefused: The name leads out of the folder, its package is not there, or the file is too large.
        """
        scheme = next((scheme for scheme in _SCHEMES if name.startswith(scheme)), "")
        rest = name[len(scheme) :]
        _, _, below = rest.partition("/")
        for candidate in (below, rest) if scheme and below else (rest,):
            path = (self.here / candidate).resolve()
            if not path.is_relative_to(self.root):
                problem = "the name leads out of the asset's folder"
                raise ImportRefused(self.here / name, problem, "copy the file into it")
            try:
                found = path.is_file()
            except OSError as error:
                raise ImportRefused(self.here, f"a name of {len(name)} letters cannot be read", "shorten it") from error
            if found:
                return self.readable(path)
        if scheme and below:
            package = rest.partition("/")[0]
            if not any((self.here / first).is_dir() for first in (package, below.partition("/")[0])):
                hint = f"copy the package's folder {package!r} into this one, so that there is {rest}"
                raise ImportRefused(self.here, f"{name} is not there", hint)
        near = near_names(below if scheme else name, self._names())
        hint = f"did you mean {' or '.join(near)}?" if near else "the folder must have all files that the asset names"
        raise NothingThere(self.here / rest, "no such file", hint)

    def _names(self) -> list[str]:
        """Names of the first files in the folder, for hints: it may be somebody's home."""
        paths = islice(self.here.rglob("*"), MOST_NAMES)
        return sorted(str(path.relative_to(self.here)) for path in paths if path.is_file())

    @staticmethod
    def readable(path: Path) -> Path:
        """Returns a file's path.

        Raises:
            ImportRefused: It is too large, or no regular file.
            OSError: It cannot be looked at.
        """
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):
            raise ImportRefused(path, "is no regular file, but a folder, a device or a pipe", "name a file")
        if found.st_size > LARGEST_FILE_BYTES:
            hint = f"files up to {LARGEST_FILE_BYTES // 1_000_000} MB are read; simplify the mesh"
            raise ImportRefused(path, f"has {found.st_size // 1_000_000} MB", hint)
        return path


def read_text(file: Path) -> str:
    """Returns the text of a file.

    Raises:
        ImportRefused: It cannot be read as text.
    """
    try:
        return AssetFolder.readable(file).read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ImportRefused(file, f"is no text: {error.reason} at byte {error.start}", "save it as UTF-8") from error
    except OSError as error:
        raise ImportRefused(file, error.strerror or "cannot be read", "check its name and permissions") from error


def read_markup(file: Path) -> str:
    """Returns the text of an XML file, without its declaration.

    Raises:
        ImportRefused: It is no text, or has a document type or entities.
    """
    text = read_text(file).removeprefix("\ufeff")
    if "\0" in text:
        raise ImportRefused(file, "is no text: it has characters that are none", "save it as UTF-8")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ImportRefused(file, "has a document type or entities", "remove them; neither is needed")
    return _DECLARATION.sub("", text, count=1)


def parsed_markup(file: Path) -> Any:
    """Returns the root element (of lxml) of an XML file; nothing that the text names is followed.

    Raises:
        ImportRefused: As for `read_markup`; or it is not well-formed.
        MissingExtra: lxml is not installed.
    """
    etree: Any = require("lxml.etree", "mesh")
    text = read_markup(file)
    strict = etree.XMLParser(
        encoding="utf-8", resolve_entities=False, no_network=True, huge_tree=False, remove_blank_text=True
    )
    try:
        return etree.fromstring(text.encode(), strict)
    except etree.XMLSyntaxError as error:
        raise ImportRefused(file, f"is not well-formed XML: {error.msg}", "see the line and column it names") from error
