"""Arrays and archives that somebody else has packed: what their heads say is checked before anything is unpacked.

An archive of a few kilobytes can say gigabytes, and a head of a few bytes more than there is. Nothing here takes more
memory than what it is to return, and a few megabytes.
"""

from __future__ import annotations

import math
import subprocess
import sys
import zipfile
from io import BytesIO
from typing import BinaryIO

import numpy as np

from executor.machine.extras import require

_HEAD_BYTES = 1 << 16  # Of an array's file: more than any head has that NumPy reads.
_LARGEST_ITEM_BYTES = 8
_DIRECTORY_BYTES = 8_000_000
"""Of an archive: 100,000 files, three for each picture of a recording of ten minutes."""

_END, _END_BYTES, _FAR_END, _FAR_BYTES = b"PK\x05\x06", 22, b"PK\x06\x07", 20 + 56
_PLAIN = frozenset({zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED})
_LZFSE_MEMORY_BYTES, _LZFSE_S = 256_000_000, 10.0
_LZFSE = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]),) * 2)
import lzfse
sys.stdout.buffer.write(lzfse.decompress(sys.stdin.buffer.read()))
"""


class BadPacking(ValueError):
    """What is packed is not what it says, or too much."""


def array_in(stream: BinaryIO, most_side: int) -> np.ndarray:
    """Return the (H, W) numbers of a `.npy` file.

    Args:
        stream: Its content.
        most_side: The largest height and width that it may have.

    Raises:
        BadPacking: It is none, or holds something else.
    """
    head = stream.read(_HEAD_BYTES)
    start = BytesIO(head)
    try:
        version = np.lib.format.read_magic(start)
        if version not in ((1, 0), (2, 0)):
            raise BadPacking(f"it is of version {version[0]}.{version[1]}, and 1.0 and 2.0 are read")
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(start)
    except BadPacking:
        raise
    except (ValueError, TypeError, KeyError, EOFError, RecursionError, MemoryError, OverflowError) as problem:
        raise BadPacking(f"its head is no array's: {problem}") from None
    if dtype.kind not in "uif" or dtype.itemsize > _LARGEST_ITEM_BYTES or len(shape) != 2:
        raise BadPacking(f"its array has the shape {shape} of {dtype}")
    if not all(0 <= side <= most_side for side in shape):
        raise BadPacking(f"its head says {shape[1]} x {shape[0]} numbers; at most {most_side} on a side are read")
    size = math.prod(shape) * dtype.itemsize
    content = head[start.tell() :] + stream.read(max(size - (len(head) - start.tell()), 0) + 1)
    if len(content) != size:
        more = "more" if len(content) > size else f"{len(content)}"
        raise BadPacking(f"its head says {size} bytes, and it has {more}")
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran else "C")


def archive_of(stream: BinaryIO) -> zipfile.ZipFile:
    """Return an archive whose list of files is of a size that can be read.

    Raises:
        BadPacking: It is none, or has too many files.
        OSError: It cannot be read.
    """
    size = stream.seek(0, 2)
    stream.seek(max(size - _END_BYTES - _FAR_BYTES, 0))
    tail = stream.read()
    end = tail[-_END_BYTES:]
    # With a comment the end would have to be searched for, and could be found in two places.
    if len(end) < _END_BYTES or not end.startswith(_END) or end[-2:] != b"\0\0":
        raise BadPacking("it does not end as an archive does")
    directory = int.from_bytes(end[12:16], "little")
    if tail[:-_END_BYTES][-20:].startswith(_FAR_END):
        directory = int.from_bytes(tail[40:48], "little")
    if directory > _DIRECTORY_BYTES:
        raise BadPacking(f"its list of files takes more than {_DIRECTORY_BYTES // 1_000_000} MB")
    try:
        return zipfile.ZipFile(stream)
    except (zipfile.BadZipFile, ValueError, NotImplementedError) as problem:
        raise BadPacking(str(problem)) from None


def opened_in(archive: zipfile.ZipFile, name: str) -> BinaryIO:
    """Return a file of an archive to read from, which unpacks no more than is asked for.

    Raises:
        BadPacking: It is packed or locked in a way that is not read.
        KeyError: There is none of this name.
    """
    entry = archive.getinfo(name)
    # Of the others Python unpacks whole blocks, however much they hold.
    if entry.compress_type not in _PLAIN:
        raise BadPacking(f"its {name} is packed in a way that is not read: expected stored or deflated")
    try:
        return archive.open(entry)  # type: ignore[return-value]
    except (zipfile.BadZipFile, RuntimeError, NotImplementedError) as problem:
        raise BadPacking(f"its {name} cannot be unpacked: {problem}") from None


def lzfse_unpacked(content: bytes) -> bytes:
    """Return what LZFSE has packed; a process with an end to its memory and time unpacks it.

    Raises:
        BadPacking: It cannot be unpacked so.
        MissingExtra: The library that reads it is not installed.
    """
    require("lzfse", "captures")
    command = [sys.executable, "-P", "-c", _LZFSE, str(_LZFSE_MEMORY_BYTES)]
    try:
        done = subprocess.run(command, input=content, capture_output=True, timeout=_LZFSE_S, check=False)
    except subprocess.TimeoutExpired:
        raise BadPacking(f"it is not unpacked within {_LZFSE_S:g} s") from None
    if done.returncode != 0:
        words = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        raise BadPacking(words or "it takes too much memory")
    return done.stdout
