"""Depths that are packed to fill a memory, or say more than they have, are refused within 300 MB and 10 s."""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from executor.photo.errors import PhotoRefused
from executor.photo.inputs.depth import read_depth
from tests.executor.hostile_packing import MOST_MB, MOST_S, measured, zip_bomb

_READ = """
from pathlib import Path
from executor.photo.inputs.depth import read_depth
from executor.photo.errors import PhotoRefused
code = 2
for name in sys.argv[2:]:
    try:
        read_depth(Path(name), (160, 120))
    except PhotoRefused as problem:
        print(problem)
"""


def head(shape: str, kind: str = "<f4", version: tuple[int, int] = (1, 0)) -> bytes:
    text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode().ljust(117) + b"\n"
    return b"\x93NUMPY" + bytes(version) + struct.pack("<H" if version == (1, 0) else "<I", len(text)) + text


def archived(path: Path, name: str, content: bytes) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(name, content)


HOSTILE: dict[str, tuple[str, Callable[[Path], object]]] = {
    "very many": ("d.npy", lambda path: path.write_bytes(head("(1000000, 1000000)"))),
    "a number beyond": ("d.npy", lambda path: path.write_bytes(head(f"(1, {10**30})"))),
    "fewer than none": ("d.npy", lambda path: path.write_bytes(head("(-1, 12)") + bytes(48))),
    "fewer than said": ("d.npy", lambda path: path.write_bytes(head("(120, 160)"))),
    "more than said": ("d.npy", lambda path: path.write_bytes(head("(2, 2)") + bytes(99))),
    "a long head": (
        "d.npy",
        lambda path: path.write_bytes(b"\x93NUMPY\x02\x00" + struct.pack("<I", 2**31) + bytes(99)),
    ),
    "nested": ("d.npy", lambda path: path.write_bytes(head("-" * 9000))),
    "objects": ("d.npy", lambda path: path.write_bytes(head("(2, 2)", "|O") + bytes(32))),
    "no array": ("d.npy", lambda path: path.write_bytes(b"nothing")),
    "a bomb that says so": ("d.npz", lambda path: zip_bomb(path, "depth.npy", head("(10000, 10000)"))),
    "a bomb behind an array": ("d.npz", lambda path: zip_bomb(path, "depth.npy", head("(120, 160)"))),
    "blocks": ("d.npz", lambda path: zip_bomb(path, "depth.npy", b"", zipfile.ZIP_BZIP2, 1 << 20)),
    "a lie in an archive": ("d.npz", lambda path: archived(path, "depth.npy", head("(4096, 4096)"))),
    "no archive": ("d.npz", lambda path: path.write_bytes(b"PK\x03\x04" + bytes(99))),
}


@pytest.mark.slow
def test_depths_that_would_fill_a_memory_are_refused(tmp_path: Path) -> None:
    paths = []
    for number, (name, write) in enumerate(HOSTILE.values()):
        paths.append(tmp_path / f"{number}{name}")
        write(paths[-1])
    found = measured(_READ, *paths)
    assert [path.name for path in paths if str(path) not in found.text] == [], found.text
    assert found.code == 2 and found.peak_mb < MOST_MB and found.cpu_s < MOST_S, found


def test_what_numpy_writes_is_read(tmp_path: Path) -> None:
    depth_m = np.linspace(1.0, 3.0, 120 * 160).reshape(120, 160)
    for kind in (np.float16, np.float32, np.float64):
        np.save(tmp_path / "d.npy", np.asfortranarray(depth_m.astype(kind)))
        assert np.allclose(read_depth(tmp_path / "d.npy", (160, 120)).z_m, depth_m, atol=2e-3)
    np.savez_compressed(tmp_path / "d.npz", colour=np.zeros((2, 2, 3)), depth=depth_m)
    assert np.allclose(read_depth(tmp_path / "d.npz", (160, 120)).z_m, depth_m)
    np.savez(tmp_path / "d.npz", a=depth_m, b=depth_m)
    with pytest.raises(PhotoRefused, match="holds a, b"):
        read_depth(tmp_path / "d.npz", (160, 120))
