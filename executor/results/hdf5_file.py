"""A new HDF5 file that appears only when it is complete, and that a full disk cannot break.

The library ends the whole process where it cannot write while it closes a file. So it writes through a stream here that
always takes what it is given, and says afterwards that there was no room.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bddl.files import temporary_beside
from executor.machine.extras import require


@contextmanager
def new_hdf5(path: Path) -> Iterator[Any]:
    """Gives a new `h5py.File`, which is the wanted file when the block ends without an exception.

    Args:
        path: Where the file belongs; its folder is made when absent.

    Raises:
        OSError: The disk is full, or the folder cannot be written.
        MissingExtra: h5py is not installed.
    """
    h5py: Any = require("h5py", "data")
    with temporary_beside(path) as temporary, _Patient(temporary) as stream:
        try:
            with h5py.File(stream, "w") as file:
                yield file
        finally:
            if stream.problem is not None:
                raise stream.problem


class _Patient(io.FileIO):
    """A file that takes everything, and keeps the first problem of writing it.

    Attributes:
        problem: What the system said; from then on nothing is written.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, "r+")
        self.problem: OSError | None = None

    def write(self, data: Any) -> int:
        size = memoryview(data).nbytes
        done = 0
        while done < size and self.problem is None:
            try:
                done += super().write(memoryview(data).cast("B")[done:]) or 0
            except OSError as problem:
                self.problem = problem
        return size

    def truncate(self, size: int | None = None) -> int:
        try:
            return super().truncate(size)
        except OSError as problem:
            self.problem = self.problem or problem
            return self.tell() if size is None else size
