"""A recording gives a picture with its depth and camera."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from executor.photo.errors import PhotoRefused
from executor.photo.inputs.depth import read_capture, read_depth

SIZE = (160, 120)
# As Record3D writes it: column by column, for the large picture.
SAID = {"w": 160, "h": 120, "K": [200.0, 0, 0, 0, 205.0, 0, 80.0, 60.0, 1]}


def r3d(folder: Path) -> Path:
    """Return a Record3D file with one moment: depths of 2 m, a quarter as wide, the first of them not sure."""
    lzfse = pytest.importorskip("lzfse")
    Image.new("RGB", SIZE, (10, 90, 60)).save(folder / "0.jpg")
    depth = np.full((30, 40), 2.0, np.float32)
    sure = np.full((30, 40), 2, np.uint8)
    sure[0, 0] = 0
    with zipfile.ZipFile(folder / "room.r3d", "w") as archive:
        archive.writestr("metadata", json.dumps(SAID))
        archive.write(folder / "0.jpg", "rgbd/0.jpg")
        archive.writestr("rgbd/0.depth", lzfse.compress(depth.tobytes()))
        archive.writestr("rgbd/0.conf", lzfse.compress(sure.tobytes()))
    return folder / "room.r3d"


def test_record3d_gives_depths_as_large_as_the_picture_and_the_camera(tmp_path: Path) -> None:
    found = read_capture(r3d(tmp_path))
    assert found.picture.size_px == SIZE and found.depth.z_m.shape == SIZE[::-1]
    assert found.depth.z_m[60, 80] == pytest.approx(2.0)
    assert found.camera is not None and (found.camera.fx, found.camera.fy, found.camera.cx) == (200.0, 205.0, 80.0)
    assert (found.depth.z_m[:4, :4] == 0.0).all(), "the sensor is not sure there"
    with pytest.raises(PhotoRefused, match="has 1 moments and no number 3; --frame 0 to 0"):
        read_capture(tmp_path / "room.r3d", 3)


def test_depths_in_exr_are_metres(tmp_path: Path) -> None:
    openexr, path = pytest.importorskip("OpenEXR"), tmp_path / "depth.exr"
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    openexr.File(header, {"R": np.full((30, 40), 2.0, np.float32)}).write(str(path))
    assert read_depth(path, (40, 30)).z_m[5, 5] == pytest.approx(2.0)
    path.write_bytes(b"no EXR")
    with pytest.raises(PhotoRefused, match="cannot be read as EXR"):
        read_depth(path, (40, 30))


@pytest.mark.parametrize(
    ("channels", "side", "said"), [(1, 10**6, "1000000 x 1000000"), (8, 4000, "512 MB"), (1, 4000, "cannot be read as")]
)
def test_an_exr_file_that_says_more_than_it_has_is_not_unpacked(
    tmp_path: Path, channels: int, side: int, said: str
) -> None:
    openexr = pytest.importorskip("OpenEXR")
    header = {"compression": openexr.ZIP_COMPRESSION, "type": openexr.scanlineimage}
    values = {f"{number}.Z" if number else "Z": np.full((8, 8), 2.0, np.float32) for number in range(channels)}
    openexr.File(header, values).write(str(tmp_path / "depth.exr"))
    content = bytearray((tmp_path / "depth.exr").read_bytes())
    at = content.index(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    content[at + 8 : at + 16] = (side - 1).to_bytes(4, "little") * 2
    (tmp_path / "depth.exr").write_bytes(content)
    with pytest.raises(PhotoRefused) as caught:
        read_depth(tmp_path / "depth.exr", (8, 8))
    assert caught.value.kind == "depth" and said in str(caught.value)


def test_packed_depths_that_say_more_than_a_recording_has_are_not_unpacked(tmp_path: Path) -> None:
    lzfse = pytest.importorskip("lzfse")
    path = r3d(tmp_path)
    with zipfile.ZipFile(path) as archive:
        kept = {name: archive.read(name) for name in archive.namelist()}
    bomb = bytearray(lzfse.compress(bytes(4_000_000)))
    bomb[4:8] = (400_000_000).to_bytes(4, "little")
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in kept.items():
            archive.writestr(name, bytes(bomb) if name.endswith(".depth") else content)
    with pytest.raises(PhotoRefused, match="MB when it is unpacked"):
        read_capture(path)
