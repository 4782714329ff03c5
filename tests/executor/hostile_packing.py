"""What somebody has packed to fill a memory, and what a program takes to refuse it."""

from __future__ import annotations

import lzma
import subprocess
import sys
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path

from tests.source_tree import ROOT

MOST_MB, MOST_S = 300.0, 10.0
"""What refusing a file may take: memory of the whole process, and time of the processor."""

BOMB_BYTES = 400_000_000
_PIECE = bytes(1 << 20)
_MEASURED = """
import sys, time
code = 1
try:
    exec(sys.argv[1])
finally:
    peak = next(line for line in open("/proc/self/status") if line.startswith("VmHWM")).split()[1]
    print(f"\\nPEAK {peak} {time.process_time()}", file=sys.stderr)
sys.exit(code)
"""


@dataclass(frozen=True)
class Measured:
    """What became of a program: exit code, what it printed, peak of its memory, time of the processor."""

    code: int
    text: str
    peak_mb: float
    cpu_s: float


def measured(program: str, *words: object) -> Measured:
    """Return what became of a program in a process of its own; it leaves its exit code in `code`."""
    command = [sys.executable, "-c", _MEASURED, program, *map(str, words)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300, check=False)
    text, mark, peak = done.stderr.rpartition("\nPEAK ")
    assert mark, done.stderr
    kilobytes, cpu_s = peak.split()
    return Measured(done.returncode, " ".join((done.stdout + text).split()), int(kilobytes) / 1024.0, float(cpu_s))


def command(*words: object) -> Measured:
    """Return what became of a command line."""
    return measured("from executor.cli.app import run; code = run(sys.argv[2:])", *words)


def assert_refused(found: Measured, code: int, said: str) -> None:
    """Refusing a file takes no more than it may, and is one clear message."""
    assert found.code == code and said in found.text, found.text
    assert "unexpected" not in found.text and "Traceback" not in found.text
    assert found.peak_mb < MOST_MB and found.cpu_s < MOST_S, found


def xz_bomb(begin: bytes, zeros: int = BOMB_BYTES) -> bytes:
    """Return a beginning, and very many zeros, packed."""
    packer = lzma.LZMACompressor(filters=[{"id": lzma.FILTER_LZMA2, "preset": 0}])
    parts = [packer.compress(begin), *(packer.compress(_PIECE) for _ in range(zeros // len(_PIECE)))]
    return b"".join([*parts, packer.flush()])


def zlib_bomb(zeros: int = BOMB_BYTES) -> bytes:
    """Return very many zeros, packed."""
    packer = zlib.compressobj(9)
    return b"".join([*(packer.compress(_PIECE) for _ in range(zeros // len(_PIECE))), packer.flush()])


def zip_bomb(path: Path, name: str, begin: bytes, kind: int = zipfile.ZIP_DEFLATED, zeros: int = BOMB_BYTES) -> None:
    """Write an archive with one file: a beginning, and very many zeros."""
    with zipfile.ZipFile(path, "w", kind) as archive, archive.open(name, "w") as file:
        file.write(begin)
        for _ in range(zeros // len(_PIECE)):
            file.write(_PIECE)
