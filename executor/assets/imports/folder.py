"""The folder that an asset lives in: no name in its files leads out of it, and no file is too large to read."""

from __future__ import annotations

import stat
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from bddl import near_names
from executor.assets.imports.problems import ImportRefused

LARGEST_FILE_BYTES = 200_000_000
MOST_NAMES = 5000
"""Of the folder's names, how many are looked at for a hint."""
_SCHEMES = ("package://", "file://", "model://")


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
            ImportRefused: The name leads out of the folder, there is no such file, or it is too large.
        """
        for candidate in self._candidates(name):
            path = (self.here / candidate).resolve()
            if not path.is_relative_to(self.root):
                raise ImportRefused(
                    self.here / name, "the name leads out of the asset's folder", "copy the file into it"
                )
            try:
                found = path.is_file()
            except OSError as error:
                raise ImportRefused(self.here, f"a name of {len(name)} letters cannot be read", "shorten it") from error
            if found:
                return self.readable(path)
        near = near_names(name, self._names())
        hint = f"did you mean {' or '.join(near)}?" if near else "the folder must have all files that the asset names"
        raise ImportRefused(self.here / name, "no such file", hint)

    def read_text(self, file: Path) -> str:
        """Returns the text of a file of the folder.

        Raises:
            ImportRefused: It cannot be read as text.
        """
        try:
            return self.readable(file).read_text(encoding="utf-8")
        except UnicodeDecodeError as error:
            raise ImportRefused(
                file, f"is no text: {error.reason} at byte {error.start}", "save it as UTF-8"
            ) from error
        except OSError as error:
            raise ImportRefused(file, error.strerror or "cannot be read", "check its name and permissions") from error

    def _names(self) -> list[str]:
        """Names of the first files in the folder, for hints: it may be somebody's home."""
        paths = islice(self.here.rglob("*"), MOST_NAMES)
        return sorted(str(path.relative_to(self.here)) for path in paths if path.is_file())

    def _candidates(self, name: str) -> tuple[str, ...]:
        scheme = next((scheme for scheme in _SCHEMES if name.startswith(scheme)), None)
        if scheme is None:
            return (name,)
        rest = name[len(scheme) :]
        _, _, below = rest.partition("/")
        return (below, rest) if below else (rest,)

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
        size = found.st_size
        if size > LARGEST_FILE_BYTES:
            limit = LARGEST_FILE_BYTES // 1_000_000
            raise ImportRefused(
                path, f"has {size // 1_000_000} MB", f"files up to {limit} MB are read; simplify the mesh"
            )
        return path
